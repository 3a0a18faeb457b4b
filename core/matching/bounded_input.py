"""Checks of the bounds and the start of a bounded least-squares problem."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError

WHERE = "bounded least squares"


def bounds_of(low: Any, high: Any, n: int) -> tuple[Array, Array]:
    """Return lower and upper bounds of n variables, shape (n,) each.

    Args:
        low, high: numbers or shape (n,).

    Raises:
        DermisError: the bounds are not numbers, have another shape, are crossed or are not finite.
    """
    below, above = _bound("lower", low, n), _bound("upper", high, n)
    bad = np.flatnonzero(~(below <= above) | ~np.isfinite(below) | ~np.isfinite(above))
    if len(bad):
        i = int(bad[0])
        raise DermisError(
            "bounds must be finite and not crossed", where=f"{WHERE}, variable {i}", value=f"{below[i]} to {above[i]}"
        )
    return below, above


def statuses_of(start: Any, n: int) -> NDArray[np.int8]:
    """Return the active set to start from: -1 lower bound, 0 free, +1 upper bound, shape (n,).

    Raises:
        DermisError: the start has another shape or other values.
    """
    given = np.asarray(start)
    if given.shape != (n,):
        raise DermisError("the start does not fit", where=WHERE, value=given.shape, limit=f"({n},)")
    bad = np.flatnonzero(~np.isin(given, (-1, 0, 1)))
    if len(bad):
        raise DermisError(
            "a start is at its lower bound, free or at its upper bound",
            where=f"{WHERE}, variable {int(bad[0])}",
            value=given[bad[0]],
            limit="-1, 0 or 1",
        )
    return given.astype(np.int8)


def _bound(which: str, given: Any, n: int) -> Array:
    try:
        bound = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise DermisError(f"the {which} bounds are not numbers", where=WHERE, limit=f"a number or ({n},)") from None
    if bound.shape not in ((), (n,)):
        raise DermisError(f"the {which} bounds do not fit", where=WHERE, value=bound.shape, limit=f"a number or ({n},)")
    return np.array(np.broadcast_to(bound, (n,)))
