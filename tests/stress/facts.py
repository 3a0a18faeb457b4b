"""Facts: what is measured of how a finger was touched, so that conditions speak of a case as it was solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.contact.skin_stepper import SkinStepper
from core.contact.solver.path_step import PathStep
from core.contact.solver.point_path import PointSolver
from core.surface.gap import Surface

Array = NDArray[np.float64]

# What several paths of one case come to: the worst of them.
REDUCED: Mapping[str, Callable[[float, float], float]] = {
    "peak": max,  # the largest force of a sample [N]
    "dragged": max,  # samples in which friction acts on the skin
    "loaded": min,  # points, or nodes, that carry force at the largest force
    "edge": min,  # distance from a loaded place to where the body turns by SHARP [m], at most FARTHEST
    "cells": min,  # the same distance, over the width of the cells (or the spacing of the nodes) that carry force
    "stride": max,  # the way of a body in a sample, over that width
}
SHARP = np.radians(30.0)  # an edge: the angle at which Blender's 'Shade Auto Smooth' parts faces, too
# A ball of 5 mm across turns by 30 degrees within half its radius of 2.5 mm: what is smaller, or has an edge, turns
# nearer. Distances are told to the next of these rings.
SHARP_WITHIN = 1.25e-3
RINGS = (0.05e-3, 0.1e-3, 0.2e-3, 0.4e-3, 0.8e-3, SHARP_WITHIN, 2.5e-3)  # [m]
FARTHEST = 5e-3  # [m]: what no ring met is as far as that, or farther
AROUND = 12  # places on a ring
BELOW = 0.17  # of a ring's radius: so far beneath the face it lies, so that past an edge the wall is nearest
HEAVY, LONG = 0.1, 60  # [N], samples: of a costly touch
LOOKED, PLACES = 3, 24  # samples, and places of each that carry most, at which distances are measured


@dataclass
class Looked:
    """One sample that carries force.

    Attributes:
        force: its size [N]. count: places that carry force. friction: whether friction acts.
        width: of the cells that carry force [m].
        places: those that carry most, with the body each lies on: surface -> points in its space [m], shape (k, 3).
        at: each body's surface and origin.
    """

    force: float
    count: int
    friction: bool
    width: float
    places: list[tuple[Surface, Array]]
    at: dict[int, Array]


@dataclass
class Watch:
    """Takes in the samples of a path, and tells its facts."""

    seen: list[Looked | None] = field(default_factory=list)

    def take(self, stepper: SkinStepper) -> None:
        """Take in the sample that was solved last."""
        solver = stepper.bone.solver
        step: PathStep | None = solver._step
        if step is None or step.work == "idle" or step.gaps is None or not step.solution.force.any():
            self.seen.append(None)
            return
        solution = step.solution
        size = np.sqrt(np.einsum("ij,ij->i", solution.force, solution.force))
        loaded = np.flatnonzero(size)
        most = loaded[np.argsort(-size[loaded], kind="stable")[:PLACES]]
        places, bodies = (solver.points + step.displacement)[most], step.gaps.body[most]
        across = size**2 - solution.normal_force**2
        slips = (solution.friction > 0.0) & (across > 1e-12 * float(size.max()) ** 2)
        if isinstance(solver, PointSolver):
            width = float(np.sqrt(stepper.surface.cells.areas[solver.cells[loaded]].min()))  # type: ignore[union-attr]
        else:
            width = float(np.sqrt(stepper.skin.areas.mean()))
        on = [
            (step.gaps.bodies[b].surface, step.gaps.bodies[b].local(places[bodies == b])[0])
            for b in np.unique(bodies[bodies >= 0]).tolist()
        ]
        self.seen.append(
            Looked(
                float(np.linalg.norm(solution.force.sum(axis=0))),
                len(loaded),
                bool(slips[loaded].any()),
                width,
                [(surface, found) for surface, found in on if isinstance(surface, Surface)],
                {b: body.translation for b, body in enumerate(step.gaps.bodies) if not body.away},
            )
        )

    @property
    def facts(self) -> dict[str, float]:
        """What was measured, see `REDUCED`; empty where nothing was touched."""
        touched = [sample for sample in self.seen if sample is not None]
        if not touched:
            return {}
        peak = max(sample.force for sample in touched)
        heavy = [sample for sample in touched if sample.force >= 0.5 * peak]
        chosen = [heavy[k] for k in np.unique(np.linspace(0, len(heavy) - 1, LOOKED - 1).round().astype(int))]
        chosen.append(max(touched, key=lambda sample: sample.force))
        near = [(min((ring_of(*found) for found in s.places), default=FARTHEST), s.width) for s in chosen]
        strides = [
            float(np.linalg.norm(after.at[b] - before.at[b])) / after.width
            for before, after in zip(self.seen[:-1], self.seen[1:], strict=True)
            if before is not None and after is not None
            for b in after.at.keys() & before.at.keys()
        ]
        return {
            "peak": peak,
            "dragged": float(sum(sample.friction for sample in touched)),
            "loaded": float(min(s.count for s in touched if s.force == peak)),
            "edge": min(edge for edge, _ in near),
            "cells": min(edge / width for edge, width in near),
            "stride": max(strides, default=0.0),
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
