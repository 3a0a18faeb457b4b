"""A finger that follows a path over bodies, as a bake solves it, and the laws that every frame of it obeys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.contact.posed_scene import PosedScene
from core.contact.skin_stepper import SkinStepper
from core.contact.solver.solution import Solution
from core.errors import Finding
from core.experiment import fingertip
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh
from core.skin.blas import one_thread
from core.skin.model import SkinModel
from core.skin.surface_store import smooth_pad
from core.surface.gap import Surface
from tests.contact_laws import cone_residual

from . import tolerances
from .case import Verdict, bits_of
from .facts import Watch, together

Array = NDArray[np.float64]
CHUNK = 16
# Findings that name what a check of a path may meet: what they tell of is no defect that nobody was told.
NOT_SOLVED = frozenset({"not-converged"})
LEFT = frozenset({"passed-through", "slides-past", "over-a-rim", "turned-over", "starts-inside", "slips-in"})
# These say in words that contact has several solutions, or that the force depends on the way there; or on how often it
# is sampled. A way that is sampled otherwise is another way: bodies go straight between samples.
OTHER_WAY = frozenset({"sharp-corner", "open-rim", "several-states", "smaller-than-mesh", "hangs-behind"})
OTHER_RATE = frozenset({"lets-go", "slid-far"})
EXCUSES: Mapping[str, frozenset[str]] = {
    "fall": NOT_SOLVED | LEFT | {"too-fine"},
    "pull": NOT_SOLVED,
    **{check: NOT_SOLVED | LEFT | OTHER_WAY | {"too-fine", "too-fast"} for check in ("inside", "again")},
    "limit": NOT_SOLVED | {"force-limit"},
    "rate": NOT_SOLVED | LEFT | OTHER_WAY | OTHER_RATE | {"too-fine", "too-fast"},
    "same": NOT_SOLVED | LEFT | {"too-fine", "too-fast"},
    "drift": NOT_SOLVED | LEFT | {"hangs-behind", "too-fine", "too-fast"},  # cycle after cycle is another way there
}


@dataclass(frozen=True, eq=False)
class Thing:
    """A body and its way: object to world, shape (n, 4, 4)."""

    name: str
    mesh: Mesh
    poses: Array
    parameters: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Felt:
    """What a finger felt along a path.

    Attributes:
        force: on the nodes of the pad, frame by frame [N], shape (n, m, 3). resultant: shape (n, 3).
        solutions: of the frames that were solved. reused: of those that the last forces served again, which is allowed
            where they meet the residual, its cones within it.
        unsolved: frames that missed their residual. findings: of the finger. facts: see `facts.REDUCED`.
    """

    force: Array
    resultant: Array
    solutions: Sequence[Solution]
    reused: Sequence[Solution]
    unsolved: int
    findings: tuple[Finding, ...]
    facts: Mapping[str, float]

    @property
    def told(self) -> frozenset[str]:
        """Codes of the findings that are more than a remark."""
        return frozenset(f.code for f in self.findings if f.severity != "info")

    @property
    def bits(self) -> str:
        """A hash of the forces and of what was said."""
        return bits_of([self.force, np.frombuffer(repr(self.findings).encode(), np.uint8)])


@lru_cache(maxsize=24)
def _skin(level: str, poisson: float, tissue: str) -> SkinModel:
    return fingertip(level=level, poisson=poisson, tissue=tissue)


def skin_of(level: str = "draft", poisson: float = 0.48, tissue: str = "linear", young: float = 1e5) -> SkinModel:
    """Return a fingertip's skin; of one level and Poisson's ratio it is made once."""
    return _skin(level, poisson, tissue).with_material(young=young)


@lru_cache(maxsize=1)
def smooth_points() -> Array:
    """Return points all over the smooth pad of the default fingertip [m], shape (p, 3)."""
    pad = smooth_pad(skin_of())
    assert pad is not None
    starts = pad.chart.starts
    return np.asarray(pad.cells.positions[starts[1] : starts[2]], np.float64)


def first_touch(mesh: Mesh, turn: Array, at: Array) -> float:
    """Return the height at which a body that comes from below first meets the pad [m]; NaN where it passes it."""
    surface, points = Surface.build(mesh.vertices, mesh.triangles), smooth_points()
    top = float((mesh.vertices @ turn.T)[:, 2].max())
    height = float(points[:, 2].min()) - top - 1e-6
    for _ in range(200):
        gap = float(surface.query((points - [at[0], at[1], height]) @ turn).gap.min())
        if gap <= 1e-8:
            return height
        height += gap
        if not height < 0.1:
            break
    return float("nan")


def feel(
    skin: SkinModel,
    finger: Array,
    things: Sequence[Thing],
    parameters: Mapping[str, Any],
    *,
    step: float = 1.0 / 240.0,
    frames: Array | None = None,
) -> Felt:
    """Follow a path, in chunks, as a bake does.

    Args:
        finger: its poses, shape (n, 4, 4). parameters: of the finger. step: of time [s].
        frames: their numbers, 1, 2 ... where None.
    """
    count = len(finger)
    bodies = tuple(Body(thing.name, thing.mesh, dict(thing.parameters)) for thing in things)
    scene = PosedScene(bodies)
    stepper = SkinStepper(skin, 0, Finger("f", (), parameters), scene)
    numbers = np.arange(1.0, count + 1.0) if frames is None else frames
    poses = np.array([thing.poses for thing in things]).reshape(len(things), count, 4, 4)
    forces, solutions, reused, unsolved, watch = [], [], [], 0, Watch()
    with one_thread():
        for i in range(0, count, CHUNK):
            part = slice(i, min(i + CHUNK, count))
            size = part.stop - part.start
            times = np.arange(part.start, part.stop) * step
            none = np.zeros((0, size, 4, 4))
            scene.take(Chunk(numbers[part], times, finger[None, part], poses[:, part], none, {}, {}))
            approach = stepper.approach()
            for k in range(size):
                felt = stepper.step(approach, k) if approach.near else stepper.idle()
                forces.append(felt.force)
                unsolved += not felt.converged
                watch.take(stepper)
                last = stepper.bone.solver._step
                if last is not None and last.work != "idle":
                    (solutions if last.work == "solved" else reused).append(last.solution)
    force = np.array(forces)
    return Felt(force, force.sum(axis=1), solutions, reused, unsolved, stepper.findings, watch.facts)


def said(*felts: Felt) -> Verdict:
    """Return a verdict on paths of one case, of which nothing is measured yet."""
    told = frozenset[str]().union(*(felt.told for felt in felts))
    return Verdict(told=told, excuses=EXCUSES, facts=together(*(felt.facts for felt in felts)))


def lawful(felt: Felt, most: float) -> Verdict:
    """Return how far a path is from what holds in every frame.

    Args:
        most: force that no frame should come near [N], see `most_force`.
    """
    verdict = said(felt)
    arrays = [felt.force, *(a for s in (*felt.solutions, *felt.reused) for a in (s.force, s.displacement))]
    verdict.hold("finite", sum(int((~np.isfinite(a)).sum()) for a in arrays), tolerances.FINITE)
    if verdict.missed:
        return verdict
    verdict.hold("bounded", float(np.abs(felt.force).sum(axis=(1, 2)).max(initial=0.0)) / most, tolerances.BOUND)
    for solution in felt.solutions:
        if solution.force.any():
            scale = float(np.abs(solution.force).max())
            verdict.hold("cone", max(cone_residual(solution), -solution.normal_force.min() / scale), tolerances.CONE)
    silent = felt.unsolved if "not-converged" not in felt.told else 0
    verdict.hold("residual told", silent, tolerances.SILENT)
    met = [s.residual / s.tolerance for s in (*felt.solutions, *felt.reused) if s.converged]
    verdict.hold("residual met", max(met, default=0.0), 1.0)
    return verdict


def most_force(young: float, poisson: float, far: float, friction: float) -> float:
    """Return a force beyond reason [N]: the whole pad in a press that cannot give way sideways, three times over.

    Args:
        far: pressed and dragged in all [m].
    """
    confined = young * (1.0 - poisson) / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    return 3.0 * confined * far / 3e-3 * 4e-4 * (1.0 + friction)
