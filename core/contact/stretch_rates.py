"""StretchRates: velocity of surfaces by changes of an object's scale and shear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..motion import rotations, singular
from .surfaces import alike


class StretchRates:
    """Rates of change of bodies' scale and shear, from sample to sample.

    A body counts as changing from the first sample at which its stretch differs from the first one. The rounding of
    single-precision matrices with a constant scale then does not count as motion.
    """

    def __init__(self) -> None:
        self._first: dict[int, Array] = {}
        self._stretching: set[int] = set()

    def of(
        self,
        b: int,
        times: Array,
        poses: Array,
        samples: NDArray[np.intp],
        stretch: Array,
        before: tuple[float, Array] | None,
    ) -> Array | None:
        """Return the velocity gradient of a body's carried space [1/s], shape (n, 3, 3).

        The velocity of a point is gradient @ point. The gradient is the change of the stretch since the previous
        sample, and zero without one.

        Args:
            b: index of the body.
            times: time of each sample of the chunk [s], shape (n,).
            poses: object-to-world matrices, shape (n, 4, 4).
            samples: indices of the samples at which it is needed, rising, shape (k,).
            stretch: scale and shear at these samples, shape (k, 3, 3).
            before: time [s] and pose of the last sample before the chunk; None if there is none.

        Returns:
            The gradient; None if the body keeps its scale.
        """
        first = self._first.setdefault(b, np.array(stretch[0]))
        start = 0
        if b not in self._stretching:
            told = stretch[:1] if stretch.strides[0] == 0 else stretch  # one matrix for all samples
            if told.tobytes() == first.tobytes() or not (other := ~alike(told, first)).any():
                return None
            self._stretching.add(b)
            start = int(np.argmax(other))
        moving, now = samples[start:], stretch[start:]
        earlier, since = poses[moving - 1, :3, :3].copy(), times[moving] - times[moving - 1]
        known = moving > 0
        if not known[0] and before is not None:
            earlier[0], since[0], known[0] = before[1][:3, :3], times[0] - before[0], True
        known &= ~singular(earlier)
        moving, now, earlier, since = moving[known], now[known], earlier[known], since[known]
        change = now - np.swapaxes(rotations(earlier), 1, 2) @ earlier
        gradient = np.zeros((len(times), 3, 3))
        gradient[moving] = change @ np.linalg.inv(now) / since[:, None, None]
        return gradient
