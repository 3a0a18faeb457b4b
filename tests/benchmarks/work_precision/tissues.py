"""Models of tissue: what each is off a neo-Hookean finger by, and what a frame of it takes.

Seven presses among the touches that no table has seen (`nonlinear_paths.py`), solved at nodes of the standard mesh, as
the references are: of mesh and shape there is no error in these, all of it is the model's.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from core.parameters.error_bands import LINEAR, NEO_HOOKEAN

from .. import one_blas_thread, timing
from .measured import Panel, Point, clocked

DEPTHS = (0.5e-3, 1e-3, 2e-3)  # [m]
NAMES = {LINEAR: "linear", NEO_HOOKEAN: "neo-Hookean"}
OWN = 1e-3  # of the references' stress, as they are kept
TOLERANCE = 3e-5


class Judged(NamedTuple):
    """A frame: its depth [m], its time [ms], errors of stress and force, and whether its contact was solved."""

    depth: float
    taken: float
    stress: float
    force: float
    solved: bool


def models() -> Panel:
    """Return the diagram: medians over the presses."""
    panel = Panel("tissues", "models of tissue, seven presses", "error of all stress, the model's alone", own=OWN)
    for depth in DEPTHS:
        for tissue, said in NAMES.items():
            found = [frame for frame in _judged(tissue) if abs(frame.depth - depth) < 1e-9]
            took = timing([frame.taken for frame in found])
            off, force = (float(np.median([getattr(frame, what) for frame in found])) for what in ("stress", "force"))
            more = {"force": force, "not solved": float(sum(not frame.solved for frame in found))}
            told = f"{1e3 * depth:g} mm deep", said, took.median, took.p95, off
            panel.points.append(Point(*told, None, tissue == LINEAR, more))
    return panel


_known: dict[str, list[Judged]] = {}


def _judged(tissue: str) -> list[Judged]:
    if tissue not in _known:
        with one_blas_thread():
            _known[tissue] = list(_follow(tissue))
    return _known[tissue]


def _follow(tissue: str) -> Iterator[Judged]:
    """Yield the frames of a tissue that have a reference."""
    from core.skin.stimulus import Stimulus
    from tests.nonlinear import difference
    from tests.stiff import on_nodes

    from ..nonlinear_errors import reference, skin_of

    truth, skin = reference(), skin_of(tissue)
    for number, path in enumerate(truth.paths):
        if path.move != "press":
            continue
        frames = {frame.number: frame for frame in truth.frames(number)}
        solver = on_nodes(skin, TOLERANCE, path.name)

        def felt(bodies: Any, solver: Any = solver) -> tuple[Any, Stimulus]:
            step = solver.step(bodies)
            found = Stimulus(skin, step.solution.force, given=step.amounts)
            found.stress  # noqa: B018  computed when first read
            return step, found

        for i, bodies in enumerate(path.frames(skin.positions)[: max(frames) + 1]):
            (step, found), taken = clocked(lambda bodies=bodies, felt=felt: felt(bodies))  # type: ignore[misc]
            if i in frames:
                total = frames[i].force.sum(axis=0)
                off = difference(found.stress, frames[i].stress, skin.mesh.volumes)
                force = float(np.linalg.norm(found.resultant - total) / np.linalg.norm(total))
                yield Judged(frames[i].depth, taken, off, force, bool(step.solution.converged))
