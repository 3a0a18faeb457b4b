"""Floor: how good any pose of a device could be for a touch, and the gain of axes along the pad.

Several ways through the touch are followed, without limits of speed, and for each sample the best pose on any of them
counts, with the friction of its own way; the device's own poses count too. The result is the *best found*:
no search proves that there is nothing better. The same is done for the device on a stage that moves it along both axes
of the pad and turns it, unless it can do so by itself.

Source: [S0] 5.1; the floor and the stage are this project's own
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..cache import cache_key
from ..devices.disc_device import DiscDevice
from ..devices.lateral_stage import LateralStage
from ..devices.thimble import Thimble
from ..errors import DermisError, Finding
from ..recent import Recent
from ..skin.model import SkinModel
from ..skin.observation import Observer, stress_vector, touch_of
from ..skin.store import read_table, write_table
from ..steps import in_words
from ..surrogate.learned import descriptors
from ..surrogate.press_points import pressed_on
from ..surrogate.store import contact_of, device_key
from ..version import version
from .description import movements_of, observation_of
from .felt_errors import MEASURES, FeltErrors
from .stress import StressMatcher, ThimbleFrame
from .thimble import follower
from .thimble_sequence import amounts_of
from .thimble_use import ThimbleUse
from .trajectory import trajectory

COMPONENTS = 60  # of stress, that poses are told apart by: on the built-in thimble they leave 2 % of its stress
MOST = 120  # samples of a touch: every one costs some hundred searches

_known: Recent[str, Floor] = Recent(16)


class Step(NamedTuple):
    """Progress of the search for a floor: its present task, and parts of the whole search done and in all."""

    stage: str
    done: int
    total: int


@dataclass(frozen=True)
class Floor:
    """How far a touch is off, in each of `MEASURES`, relative RMS over its samples.

    Attributes:
        rendered: by the device as it is used, without limits of speed.
        best: the best pose found at each sample, the device's own among them.
        lateral: the same with axes along the pad, None where the device has them.
        samples: touched ones. beyond: those of them of which the best pose leaves more than there is, in whole stress.
    """

    rendered: tuple[float, ...]
    best: tuple[float, ...]
    lateral: tuple[float, ...] | None
    samples: int
    beyond: int

    def as_dict(self) -> dict[str, object]:
        """Return all as plain JSON values, errors by measure."""
        errors = {"rendered": self.rendered, "best_found": self.best, "with_lateral_axes": self.lateral}
        named = {name: v if v is None else dict(zip(MEASURES, v, strict=True)) for name, v in errors.items()}
        return {"schema": "dermis-floor 1", **named, "touched_samples": self.samples, "samples_beyond": self.beyond}

    def words(self) -> list[str]:
        """Return the results for a designer, a sentence each."""
        rendered, best = _percent(self.rendered), _percent(self.best)
        out = [f"Of the touch's stress the device leaves {rendered}, the best pose found {best}"]
        if self.lateral is not None:
            out.append(f"Two axes along the pad and a turn about its normal would leave {_percent(self.lateral)}")
        return out

    def findings(self, where: str) -> tuple[Finding, ...]:
        """Return the findings that a person must not miss: a touch that no pose renders better than none would."""
        if self.best[0] < 1.0 and not self.beyond:
            return ()
        whole = self.best[0] >= 1.0
        return (
            Finding(
                "warning" if whole else "info",
                "floor-above-touch",
                "the best pose found is farther from the touch than no touch at all"
                + ("" if whole else " at some samples"),
                where,
                f"{100 * self.best[0]:.0f} % of the touch",
                "< 100 %",
                "This device cannot render this touch: try one with other axes or another disc",
                count=max(self.beyond, 1),
            ),
        )


def _percent(errors: tuple[float, ...]) -> str:
    return f"{100 * errors[0]:.0f} %"


def floor_of(use: ThimbleUse, forces: Array, amounts: Array | None = None) -> Generator[Step, None, Floor]:
    """Find the floor of a device for a touch; yields how far it is.

    It is kept for the same touch, in memory and in the skin's cache.

    Args:
        use: the device on its finger.
        forces: forces of the touch on the pad nodes [N], shape (n, m, 3).
        amounts: see `Stimulus.given`, of skin that follows a law, shape (n, 3 m).

    Raises:
        DermisError: nothing is touched, forces that do not fit, or limits that exclude contact.
    """
    forces = np.asarray(forces, np.float64).reshape(len(forces), -1, 3)
    touched = forces.any(axis=(1, 2))
    if not touched.any():
        raise DermisError("the finger touches nothing, so there is no floor", where="floor")
    skin = use.skin
    key = cache_key(
        *(version(), skin.key, skin.tissue, pressed_on(skin), repr(skin.material), device_key(use.device)),
        repr(use.friction),
        *(use.method, "" if use.observation_matrix is None else use.observation_matrix.tobytes(), "floor 1"),
        *(forces.tobytes(), b"" if amounts is None else amounts.tobytes()),
    )
    known = _known.get(key) or _read(skin, key)
    if known is not None:
        return known
    judge, total = FeltErrors(skin), len(forces)
    devices = [use.device, *([LateralStage(use.device)] if isinstance(use.device, Thimble) else [])]
    own, passes = follower(use), 1 + 2 * len(devices)  # each device is searched by few components and by many
    rendered, frames = np.zeros_like(forces), []
    felt: list[Array | None] = [None] * total if amounts is None else list(amounts)
    for i, (force, given) in enumerate(zip(forces, felt, strict=True)):
        frame = own.step(force, given)
        frames.append(frame)
        rendered[i] = own.matching.contact.nodal(frame.solution)
        yield Step("rendered", i + 1, passes * total)
    made = amounts_of(frames, own.matching.contact)
    wanted = np.stack([_stress(skin, force, given) for force, given in zip(forces, felt, strict=True)])
    results: list[_Found] = [_Found(rendered, made, _left(skin, wanted, rendered, made))]
    behind = 1
    for name, device in zip(("best pose", "lateral axes"), devices, strict=False):
        best = results[-1]  # a device reaches it with its stage too
        for matrix in _matrices(device, use):
            words = partial(_part, name, behind * total, passes * total)
            found, given_ = yield from in_words(_tried(device, use, matrix, forces, felt), words)
            behind += 1
            best = best.or_better(_Found(found, given_, _left(skin, wanted, found, given_)))
        results.append(best)
    errors = [tuple(judge.of(forces, found.force, amounts, found.amounts).tolist()) for found in results]
    beyond = int((results[1].left[touched] >= np.linalg.norm(wanted[touched], axis=1)).sum())
    floor = Floor(errors[0], errors[1], errors[2] if len(errors) > 2 else None, int(touched.sum()), beyond)
    _known.make(key, lambda: floor)
    _keep(skin, key, floor)
    return floor


def _part(name: str, before: int, total: int, step: tuple[int, int]) -> Step:
    """Return how far one search among several is as how far all of them are."""
    return Step(name, before + step[0], total)


@dataclass(frozen=True, eq=False)
class _Found:
    """Forces at each sample, their amounts on skin with a law, and the norm of their stress error, shape (n,)."""

    force: Array
    amounts: Array | None
    left: Array

    def or_better(self, other: _Found) -> _Found:
        """Return the better of both at each sample."""
        better = other.left < self.left
        amounts = None
        if self.amounts is not None and other.amounts is not None:
            amounts = np.where(better[:, None], other.amounts, self.amounts)
        force = np.where(better[:, None, None], other.force, self.force)
        return _Found(force, amounts, np.minimum(other.left, self.left))


def _matrices(device: DiscDevice, use: ThimbleUse) -> list[Array]:
    """Return the components that a device is searched by, few and many: they lead to unlike poses."""
    skin = use.skin
    data = movements_of(device, skin, use.friction)
    size = min(COMPONENTS, len(data.force), 3 * skin.pad_count)
    many = descriptors(data, skin.stress_components(), size=size).observation_matrix
    return [observation_of(device, skin, use.friction), many]


def _tried(
    device: DiscDevice, use: ThimbleUse, matrix: Array, forces: Array, felt: list[Array | None]
) -> Generator[tuple[int, int], None, tuple[Array, Array | None]]:
    """Return forces and amounts of the best pose found at each sample by some components."""
    skin, contact = use.skin, contact_of(device, use.skin, use.friction)
    observer = Observer(skin, matrix)
    matching = StressMatcher(device, contact, observer, hover=use.hover)
    targets = np.stack([observer.seen(force, given) for force, given in zip(forces, felt, strict=True)])
    searched = yield from trajectory(matching, targets)
    best: list[ThimbleFrame] = searched.best
    return np.stack([contact.nodal(frame.solution) for frame in best]), amounts_of(best, contact)


def _stress(skin: SkinModel, force: Array, amounts: Array | None) -> Array:
    return stress_vector(touch_of(skin, force, amounts))


def _left(skin: SkinModel, wanted: Array, force: Array, amounts: Array | None) -> Array:
    """Return the norm of the stress error that forces leave at each sample, shape (n,)."""
    given = [None] * len(force) if amounts is None else amounts
    shown = (_stress(skin, f, c) for f, c in zip(force, given, strict=True))
    return np.array([float(np.linalg.norm(s - w)) for s, w in zip(shown, wanted, strict=True)])


def _keep(skin: SkinModel, key: str, floor: Floor) -> None:
    if skin.cache is not None:
        none = (np.nan,) * len(MEASURES)
        rows = [floor.rendered, floor.best, floor.lateral or none, (floor.samples, floor.beyond, 0.0)]
        with suppress(DermisError):  # a folder that cannot be written costs the time again, and nothing else
            skin.cache.put(key, lambda part: write_table(part, np.array(rows)))


def _read(skin: SkinModel, key: str) -> Floor | None:
    path = None if skin.cache is None else skin.cache.get(key)
    rows = None if path is None else read_table(path, (4, len(MEASURES)), np.float64)
    if rows is None or not np.isfinite(rows[[0, 1, 3]]).all():
        return None
    rendered, best, lateral, counts = rows.tolist()
    found = None if np.isnan(lateral).any() else tuple(lateral)
    return Floor(tuple(rendered), tuple(best), found, int(counts[0]), int(counts[1]))


def looked_at(count: int) -> NDArray[np.intp]:
    """Return which of many samples a floor is found at: all, or so many evenly spread that it can be waited for."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST)).round().astype(np.intp))
