"""Floor: smallest error of a touch that any pose of a device was found to leave.

A beam search follows several paths through the touch without limits of speed. For each sample, the pose of least error
on any path counts, with the friction state of its path. The poses of the device as it is used count too. The result is
the *best found* error: a search cannot prove that no better pose exists. For a thimble, the search is repeated for the
device on a stage that moves it along both axes of the pad and turns it about the pad's normal.

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

COMPONENTS = 60  # stress components of the finer search; on the built-in thimble they leave 2 % of its stress
MOST = 120  # largest number of samples; each needs some hundred searches

_known: Recent[str, Floor] = Recent(16)


class Step(NamedTuple):
    """Progress of the search for a floor.

    Attributes:
        stage: name of the current task.
        done, total: number of finished parts, and of all parts of the whole search.
    """

    stage: str
    done: int
    total: int


@dataclass(frozen=True)
class Floor:
    """Errors of a device for a touch: relative RMS over the samples, by each of `MEASURES`.

    Attributes:
        rendered: errors of the device as it is used, without limits of speed, shape (3,).
        best: errors of the best pose found at each sample, shape (3,).
        lateral: the same with a stage that moves the device along the pad; None for devices other than a thimble.
        samples: number of samples with contact.
        beyond: number of these at which the whole stress that the best pose leaves is not less than the target's.
    """

    rendered: tuple[float, ...]
    best: tuple[float, ...]
    lateral: tuple[float, ...] | None
    samples: int
    beyond: int

    def as_dict(self) -> dict[str, object]:
        """Return the results as plain JSON values."""
        errors = {"rendered": self.rendered, "best_found": self.best, "with_lateral_axes": self.lateral}
        named = {name: v if v is None else dict(zip(MEASURES, v, strict=True)) for name, v in errors.items()}
        return {"schema": "dermis-floor 1", **named, "touched_samples": self.samples, "samples_beyond": self.beyond}

    def words(self) -> list[str]:
        """Return the results as sentences for a designer."""
        rendered, best = _percent(self.rendered), _percent(self.best)
        out = [f"Of the touch's stress the device leaves {rendered}, the best pose found {best}"]
        if self.lateral is not None:
            out.append(f"Two axes along the pad and a turn about its normal would leave {_percent(self.lateral)}")
        return out

    def findings(self, where: str) -> tuple[Finding, ...]:
        """Return a finding if the best pose found is no better than no touch; `where` names the device."""
        if self.best[0] < 1.0 and not self.beyond:
            return ()
        whole = self.best[0] >= 1.0
        return (
            Finding(
                "warning" if whole else "info",
                "floor-above-touch",
                "the error of the best pose found is larger than that of no touch at all"
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
    """Find the floor of a device for a touch.

    The result is kept in memory and in the skin's cache.

    Args:
        use: the device on its finger.
        forces: forces of the touch on the pad nodes [N], shape (n, m, 3).
        amounts: see `Stimulus.given`, for nonlinear skin, shape (n, 3 m).

    Yields:
        The progress of the search.

    Returns:
        The floor.

    Raises:
        DermisError: nothing is touched, the forces do not fit, or the limits exclude contact.
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
    own, passes = follower(use), 1 + 2 * len(devices)  # each device is searched with few components, and then with many
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
        best = results[-1]  # on its stage, the device can take this pose too
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
    """Return the progress of one search as progress of the whole; `before` parts were finished before it."""
    return Step(name, before + step[0], total)


@dataclass(frozen=True, eq=False)
class _Found:
    """Poses found for all samples, described by their forces.

    Attributes:
        force: forces on the pad nodes [N], shape (n, m, 3).
        amounts: see `Stimulus.given`, shape (n, 3 m); None for linear skin.
        left: norm of the stress error, shape (n,).
    """

    force: Array
    amounts: Array | None
    left: Array

    def or_better(self, other: _Found) -> _Found:
        """Return the result with the smaller stress error at each sample."""
        better = other.left < self.left
        amounts = None
        if self.amounts is not None and other.amounts is not None:
            amounts = np.where(better[:, None], other.amounts, self.amounts)
        force = np.where(better[:, None, None], other.force, self.force)
        return _Found(force, amounts, np.minimum(other.left, self.left))


def _matrices(device: DiscDevice, use: ThimbleUse) -> list[Array]:
    """Return two observation matrices for the search, with few and with many stress components.

    The two searches lead to different poses, and the better one counts at each sample.
    """
    skin = use.skin
    data = movements_of(device, skin, use.friction)
    size = min(COMPONENTS, len(data.force), 3 * skin.pad_count)
    many = descriptors(data, skin.stress_components(), size=size).observation_matrix
    return [observation_of(device, skin, use.friction), many]


def _tried(
    device: DiscDevice, use: ThimbleUse, matrix: Array, forces: Array, felt: list[Array | None]
) -> Generator[tuple[int, int], None, tuple[Array, Array | None]]:
    """Return the forces and the amounts of the best pose found at each sample with an observation matrix."""
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
    """Return the norm of the difference between the stress of forces and a wanted stress, shape (n,)."""
    given = [None] * len(force) if amounts is None else amounts
    shown = (_stress(skin, f, c) for f, c in zip(force, given, strict=True))
    return np.array([float(np.linalg.norm(s - w)) for s, w in zip(shown, wanted, strict=True)])


def _keep(skin: SkinModel, key: str, floor: Floor) -> None:
    if skin.cache is not None:
        none = (np.nan,) * len(MEASURES)
        rows = [floor.rendered, floor.best, floor.lateral or none, (floor.samples, floor.beyond, 0.0)]
        with suppress(DermisError):  # if the folder cannot be written, the floor is computed again next time
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
    """Return the indices of the samples at which a floor is found: all `count`, or `MOST` evenly spread ones."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST)).round().astype(np.intp))
