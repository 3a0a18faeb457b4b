"""Facts: what is measured of how a finger was touched, which tells costly touches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.contact.skin_stepper import SkinStepper
from core.contact.solver.path_step import PathStep
from core.surface.gap import Surface

Array = NDArray[np.float64]

# What several paths of one case come to: the worst of them.
REDUCED: Mapping[str, Callable[[float, float], float]] = {
    "peak": max,  # the largest force of a sample [N]
    "dragged": max,  # samples in which friction acts on the skin
    "edge": min,  # distance from a loaded place to where the body turns by SHARP [m], at most FARTHEST
}
SHARP = np.radians(30.0)  # between faces: an edge, as for Blender's *Shade Auto Smooth*
# A ball with a diameter of 5 mm turns by 30 degrees within 1.25 mm, half its radius; a smaller body or an edge turns
# within less. A distance is rounded up to the next of these rings.
SHARP_WITHIN = 1.25e-3
RINGS = (0.05e-3, 0.1e-3, 0.2e-3, 0.4e-3, 0.8e-3, SHARP_WITHIN, 2.5e-3)  # [m]
FARTHEST = 5e-3  # [m]: the distance where no ring meets an edge
AROUND = 12  # places on a ring
BELOW = (
    0.17  # of a ring's radius: depth of the ring below the face (10 degrees), so that past an edge the wall is nearest
)
HEAVY, LONG = 0.1, 60  # [N], samples: of a costly touch
# Distances are measured in three samples (the largest force, and the first and last with half of it), at the 24 places
# that carry most.
HALF, PLACES = 0.5, 24


@dataclass
class Looked:
    """One sample that carries force.

    Attributes:
        force: its size [N]. friction: whether friction acts.
        places: those that carry most, by body: its surface, and points in its space [m], shape (k, 3).
    """

    force: float
    friction: bool
    places: list[tuple[Surface, Array]]


@dataclass
class Watch:
    """Collects the samples of a path that carry force, and measures facts of them."""

    seen: list[Looked] = field(default_factory=list)

    def take(self, stepper: SkinStepper) -> None:
        """Take in the sample that was solved last."""
        solver = stepper.bone.solver
        step: PathStep | None = solver._step
        if step is None or step.work == "idle" or step.gaps is None or not step.solution.force.any():
            return
        solution = step.solution
        size = np.sqrt(np.einsum("ij,ij->i", solution.force, solution.force))
        loaded = np.flatnonzero(size)
        most = loaded[np.argsort(-size[loaded], kind="stable")[:PLACES]]
        places, bodies = (solver.points + step.displacement)[most], step.gaps.body[most]
        across = size**2 - solution.normal_force**2
        slips = (solution.friction > 0.0) & (across > 1e-12 * float(size.max()) ** 2)
        on = [
            (step.gaps.bodies[b].surface, step.gaps.bodies[b].local(places[bodies == b])[0])
            for b in np.unique(bodies[bodies >= 0]).tolist()
        ]
        self.seen.append(
            Looked(
                float(np.linalg.norm(solution.force.sum(axis=0))),
                bool(slips[loaded].any()),
                [(surface, found) for surface, found in on if isinstance(surface, Surface)],
            )
        )

    @property
    def facts(self) -> dict[str, float]:
        """What was measured, see `REDUCED`; empty where nothing was touched."""
        if not self.seen:
            return {}
        most = max(self.seen, key=lambda sample: sample.force)
        heavy = [sample for sample in self.seen if sample.force >= HALF * most.force]
        measured = (most, heavy[0], heavy[-1])
        return {
            "peak": most.force,
            "dragged": float(sum(sample.friction for sample in self.seen)),
            "edge": min((ring_of(*found) for sample in measured for found in sample.places), default=FARTHEST),
        }


def ring_of(surface: Surface, places: Array) -> float:
    """Return the radius of the smallest ring about places on a surface on which it has turned [m]."""
    first, all_normals = surface.query(places), surface.table.bounds[3:6].T
    normals, feet = all_normals[first.triangle], first.point
    aside = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    one = np.cross(normals, aside)
    one /= np.linalg.norm(one, axis=1)[:, None]
    two = np.cross(normals, one)
    angles = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = np.cos(angles)[:, None, None] * one + np.sin(angles)[:, None, None] * two - BELOW * normals
    for radius in RINGS:
        found = surface.query((feet + radius * ring).reshape(-1, 3))
        turned = np.einsum("kij,ij->ki", all_normals[found.triangle].reshape(AROUND, -1, 3), normals)
        if (turned < np.cos(SHARP)).any() or found.beside.any():
            return radius
    return FARTHEST


def together(*facts: Mapping[str, float]) -> dict[str, float]:
    """Return the facts of a case of several paths."""
    out: dict[str, float] = {}
    for some in facts:
        for name, value in some.items():
            out[name] = REDUCED[name](out[name], value) if name in out else value
    return out


def costly(facts: Mapping[str, float]) -> bool:
    """Whether a touch is one that is hard to get right, and that people feel: .1 N or more on something sharp (an edge,
    or smaller than 5 mm), or friction over 60 samples or more."""
    if not facts:
        return False
    return facts["peak"] >= HEAVY and facts["edge"] <= SHARP_WITHIN or facts["dragged"] >= LONG
