"""What linear and stiffening skin are off by on the forty unseen touches, each with its own contact at the nodes."""

from __future__ import annotations

import functools
import time
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from core.parameters.error_bands import DEPTHS, LINEAR, NEO_HOOKEAN, SLID_AT, SLIDES
from core.skin.model import SkinModel
from core.skin.stimulus import Stimulus
from tests.contact_laws import at_frame_ends_alone
from tests.nonlinear import difference
from tests.stiff import on_nodes

from .nonlinear_paths import SHOWN
from .nonlinear_reference import Reference

Array = NDArray[np.float64]


class Error(NamedTuple):
    """One frame of one touch, as a model of tissue has it.

    Attributes:
        kind, move: of the path. depth, slide: of the object, from where it first touched [m].
        drawn: how far the model's skin is drawn along itself, `PathStep.slide` [m].
        stress, force: relative errors. converged: whether contact was solved.
    """

    kind: str
    move: str
    depth: float
    slide: float
    drawn: float
    stress: float
    force: float
    converged: bool


class Measured(NamedTuple):
    """All frames of a model, and what its solved frames take of the processor [ms]."""

    errors: list[Error]
    times: list[float]


@functools.cache
def reference() -> Reference:
    """Return the truth, read once."""
    return Reference()


@functools.cache
def skin_of(tissue: str) -> SkinModel:
    """Return the standard finger of a tissue.

    Raises:
        LookupError: there is no table of it.
    """
    from core.skin.finger_skin import of_tissue

    made = of_tissue(reference().skin, tissue)
    if made.tissue != tissue:
        raise LookupError(f"no table of the standard finger's {tissue} tissue ships")
    return made


@functools.cache
def measured(tissue: str) -> Measured:
    """Follow all paths on a model of tissue and compare.

    Friction follows Coulomb's law at the ends of frames alone, as the truth's does: what is told is tissue's error.
    """
    with pytest.MonkeyPatch.context() as patch:
        at_frame_ends_alone(patch)
        return _followed(tissue)


def _followed(tissue: str) -> Measured:
    truth, skin = reference(), skin_of(tissue)
    errors: list[Error] = []
    times: list[float] = []
    for number, path in enumerate(truth.paths):
        frames = {frame.number: frame for frame in truth.frames(number)}
        solver = on_nodes(skin, 3e-5, path.name)
        for i, bodies in enumerate(path.frames(skin.positions)[: max(frames, default=-1) + 1]):
            started = time.process_time()
            step = solver.step(bodies)
            felt = Stimulus(skin, step.solution.force, given=step.amounts)
            stress = felt.stress
            times.append(1e3 * (time.process_time() - started))
            frame = frames.get(i)
            if frame is None:
                continue
            total = frame.force.sum(axis=0)
            errors.append(
                Error(
                    path.kind,
                    path.move,
                    frame.depth,
                    frame.slide,
                    step.sums.slide,
                    difference(stress, frame.stress, skin.mesh.volumes),
                    float(np.linalg.norm(felt.resultant - total) / np.linalg.norm(total)),
                    step.solution.converged,
                )
            )
    return Measured(errors, times)


def at(tissue: str, depth: float, slide: float = 0.0, kinds: tuple[str, ...] = ()) -> list[Error]:
    """Return the errors of frames at a depth and a slide of the object, of some kinds of path or all."""
    return [
        e
        for e in measured(tissue).errors
        if abs(e.depth - depth) < 1e-9 and abs(e.slide - slide) < 1e-9 and (not kinds or e.kind in kinds)
    ]


def spread(values: list[float]) -> tuple[float, float]:
    """Return the median and the 90th percentile; not a number of nothing."""
    return (float(np.median(values)), float(np.quantile(values, 0.9))) if values else (np.nan, np.nan)


def print_bands(tissues: tuple[str, ...] = (LINEAR, NEO_HOOKEAN)) -> None:
    """Print the tables of `core/parameters/error_bands.py`: by depth where nothing slid, by how far skin was drawn.

    Below them stands what the object's own slide makes of it: where friction slips, skin is drawn no farther.
    """
    for tissue in tissues:
        print(tissue)
        slid = [e for e in measured(tissue).errors if abs(e.depth - SLID_AT) < 1e-9]
        bounds = [0.0, *(0.5 * (a + b) for a, b in zip(SLIDES, SLIDES[1:], strict=False)), np.inf]
        _tell("deep", DEPTHS, [at(tissue, depth) for depth in DEPTHS])
        drawn_by = [[e for e in slid if low <= e.drawn < high] for low, high in zip(bounds, bounds[1:], strict=False)]
        _tell("drawn", SLIDES, drawn_by)
        _tell("slid", (0.0, *SHOWN[1]), [at(tissue, SLID_AT, slide) for slide in (0.0, *SHOWN[1])])


def _tell(what: str, places: tuple[float, ...], groups: list[list[Error]]) -> None:
    """Print a line a group, then the rows of the table: never less than nearer ones."""
    rows: dict[str, list[tuple[float, float]]] = {"stress": [], "force": []}
    for place, errors in zip(places, groups, strict=True):
        for kind, found in rows.items():
            found.append(spread([getattr(e, kind) for e in errors]))
        mean, lost = np.mean([e.drawn for e in errors]) if errors else np.nan, sum(not e.converged for e in errors)
        told = "  ".join(f"{kind} {found[-1][0]:.3f} {found[-1][1]:.3f}" for kind, found in rows.items())
        print(f"  {1e3 * place:3g} mm {what:5} {len(errors):3} frames, {1e3 * mean:.2f} mm drawn, {lost} lost: {told}")
    for kind, found in rows.items():
        risen = np.fmax.accumulate(np.array(found), axis=0)
        print(f'        "{kind}": (' + ", ".join(f"({a:.3f}, {b:.3f})" for a, b in risen) + "),")
