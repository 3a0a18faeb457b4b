"""The drawn skins at the current frame: their values and the range of colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes
from .._core import Array
from ..devices import skin_models
from ..preview.skin_state import SkinState
from . import skin_field
from .skin_field import QUANTITIES, SIGNED, Drawn


class Shown(NamedTuple):
    """Everything the view shows of skins at the current frame."""

    states: tuple[SkinState, ...]
    drawn: tuple[Drawn | None, ...]
    low: float
    high: float


_drawn: dict[str, tuple[SkinState, tuple[Any, ...], Drawn]] = {}
_largest: dict[tuple[Any, ...], float] = {}
_stresses = {"stress_computed": 0, "stress_skipped": 0, "stress_kept": 0}


def shown(scene: bpy.types.Scene, states: tuple[SkinState, ...]) -> Shown:
    """Return skins with their values, and the range of the colours.

    There are no values if the heat map is off.
    """
    view = scene.dermis.skin_view
    made = [s for s in states if s.model is not None and view.show]
    known = dict(zip(map(id, made), all_values(made, view.quantity, view.exaggeration), strict=True))
    drawn = tuple(known.get(id(s)) for s in states)
    for gone in set(_drawn) - {s.finger for s in states}:
        del _drawn[gone]
    low, high = _range(scene, [d for d in drawn if d is not None])
    return Shown(states, drawn, low, high)


def counters() -> dict[str, int]:
    """Return how often a skin's values were computed, were zero, or were kept."""
    return dict(_stresses)


def forget_range() -> None:
    """Let the automatic range begin anew."""
    _largest.clear()


def values(state: SkinState, quantity: str, exaggeration: float) -> Drawn:
    """Return a skin with its values, kept until the skin changes."""
    return all_values((state,), quantity, exaggeration)[0]


def all_values(states: Sequence[SkinState], quantity: str, exaggeration: float) -> list[Drawn]:
    """Return several skins with their values, each kept until the skin changes."""
    key = (quantity, round(float(exaggeration), 4))
    anew = [state for state in states if not _stays(state, key)]
    _stresses["stress_kept"] += len(states) - len(anew)
    for state in anew:
        _stresses["stress_computed" if state.touching else "stress_skipped"] += 1
    if anew:
        with skin_models.one_thread():
            for state in anew:
                _drawn[state.finger] = (state, key, skin_field.draw_of(state, *key))
    return [_drawn[state.finger][2] for state in states]


def _stays(state: SkinState, key: tuple[Any, ...]) -> bool:
    """Return whether the last drawing of a skin is still right."""
    kept = _drawn.get(state.finger)
    if kept is None or kept[1] != key:
        return False
    before = kept[0]
    return before is state or (
        before.model is state.model
        and before.lift == state.lift
        and np.array_equal(before.force, state.force)
        and _alike(before.amounts, state.amounts)
    )


def _alike(first: Array | None, second: Array | None) -> bool:
    return first is second or (first is not None and second is not None and np.array_equal(first, second))


def _range(scene: bpy.types.Scene, drawn: list[Drawn]) -> tuple[float, float]:
    view = scene.dermis.skin_view
    if view.range_mode == "fixed":
        top = view.maximum * QUANTITIES[view.quantity].factor
    else:
        now = max((max(d.high, -d.low) for d in drawn), default=0.0)
        if view.range_mode == "auto":
            key = (scene.session_uid, view.quantity, changes.lineage())
            now = _largest[key] = max(now, _largest.get(key, 0.0))
        factor = QUANTITIES[view.quantity].factor
        top = skin_field.nice(now / factor) * factor
    return (-top if view.quantity in SIGNED else 0.0), top


def colour_table(view: Any) -> str:
    """Return the name of the colour map in use."""
    return "signed" if view.quantity in SIGNED else str(view.colours)


def forget() -> None:
    """Forget all values and ranges."""
    _drawn.clear()
    _largest.clear()
