"""Balls pressed into a fingertip, and the strain energy density below the skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.contact.solver.bodies import ContactBody
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.pad_points import PadPoints
from core.contact.solver.path_solver import PathSolver
from core.skin.model import SkinModel
from core.skin.nodal_forces import NodalForces
from core.skin.point_forces import PointForces
from core.skin.stimulus import Stimulus
from core.skin.stress import locate, stored
from core.skin.surface_store import smooth_pad
from tests.touches import Solid, ball, flat

from .plate import DEEPEST, HIGH, MM, STEP, Array

LINE = 5.0 * MM  # half of the line across the finger below which stress is told
FRICTION = 0.6


@dataclass(frozen=True, eq=False)
class Profile:
    """Strain energy density below a line across the finger, the ball's middle above its middle.

    Attributes:
        across: [m], shape (n,). density: [J/m^3], shape (n,). depth: of the ball [m].
    """

    across: Array
    density: Array
    depth: float


def ball_profiles(skin: SkinModel, radius: float, forces: Sequence[float], below: float) -> list[Profile]:
    """Press a ball, or with an infinite radius a plate, into the pad's centre until each of some forces.

    Args:
        radius: [m]. forces: [N], rising. below: the depth under the skin at which stress is told [m].
    """
    pad = smooth_pad(skin)
    assert pad is not None
    law = LawSkin.of(skin)
    points = PadPoints(pad, NodalForces(skin.mesh, pad.chart, skin.follows_law))
    solver = PathSolver(points, name="ball", depth_limit=np.inf, law=law)
    surface: Solid = ball(radius) if np.isfinite(radius) else flat()
    row = np.arange(pad.chart.starts[2], pad.chart.starts[3])
    where = pad.cells.positions[row]
    middle = np.abs(where[:, 1]).min() + 1e-9
    row = row[(np.abs(where[:, 1]) <= middle) & (np.abs(where[:, 0]) <= LINE) & (where[:, 2] < HIGH)]
    row = row[np.argsort(pad.cells.positions[row, 0])]
    across = pad.cells.positions[row]
    across = across[np.unique(np.round(across[:, 0], 9), return_index=True)[1]]  # one side of y = 0
    out: list[Profile] = []
    before: tuple[float, Array, float] = (0.0, np.zeros(len(across)), 0.0)
    depth = 0.0
    while len(out) < len(forces) and depth < DEEPEST:
        depth += STEP
        step = solver.step([ContactBody(surface, np.eye(3), np.array([0.0, 0.0, depth]), FRICTION)])
        loaded = np.flatnonzero(step.solution.force.any(axis=1))
        points = PointForces(pad, solver.cells[loaded], step.solution.force[loaded], step.amounts)
        force = float(step.solution.force[:, 2].sum())
        now = (force, _density(Stimulus(skin, step.nodal, points, step.amounts), across, below), depth)
        while len(out) < len(forces) and force >= forces[len(out)]:
            share = (forces[len(out)] - before[0]) / (force - before[0])
            blend = [(1.0 - share) * np.asarray(a) + share * np.asarray(b) for a, b in zip(before, now, strict=True)]
            out.append(Profile(across[:, 0], blend[1], float(blend[2])))
        before = now
    return out


def _density(touch: Stimulus, positions: Array, depth: float) -> Array:
    """Return the strain energy density so deep below places of the skin [J/m^3], shape (n,)."""
    assert touch.points is not None
    from scipy.spatial import cKDTree

    skin, chart = touch.skin, touch.points.surface.chart
    stress = touch.points.stress_below(positions, np.full(len(positions), depth))
    if skin.follows_law:
        below = positions - depth * chart.surface(chart.project(positions)[0]).normals
        beyond = touch.surface_values(touch.stress - skin.stress(touch.force))
        element, weights = locate(skin.mesh, below)
        more = np.einsum("pj,pjc->pc", weights, beyond[skin.mesh.tetrahedra[element]])
        above = element < 0  # the mesh lies a little inside the smooth skin
        more[above] = beyond[cKDTree(skin.mesh.nodes).query(below[above])[1]]
        stress = stress + more
    return stored(stress, skin.material)
