"""Touches on skin that follows the neo-Hookean law, for tests of what any of them must obey."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.contact.solver.bodies import ContactBody
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.contact.solver.path_step import PathStep
from core.skin.model import SkinModel, fingertip_skin
from core.surface.gap import Surface
from tests.touches import Solid, Touch, flat

Array = NDArray[np.float64]

MIRROR = np.array([-1.0, 1.0, 1.0])


@functools.cache
def stiff_skin(level: str = "draft") -> SkinModel:
    """Return a standard fingertip whose tissue follows the law."""
    return fingertip_skin(level=level).with_law()


def on_nodes(skin: SkinModel, tolerance: float = 1e-6, name: str = "finger") -> PathSolver:
    """Return what follows a touch at the nodes of a skin, stiff or not, however deep.

    The law is followed as closely as contact is solved, or as single precision lets it be.
    """
    law = LawSkin.of(skin, None if tolerance >= 3e-5 else max(10.0 * tolerance, 2e-5))
    nodes = Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance)
    return PathSolver(nodes, tolerance=tolerance, name=name, depth_limit=np.inf, law=law)


def frozen(path: PathSolver, bodies: Sequence[ContactBody]) -> PathStep:
    """Solve the next frame with the gaps of its beginning, which do not follow the nodes."""
    return path.step_gaps(replace(path.look(bodies), where=None))


def press(
    skin: SkinModel,
    surface: Solid | Surface,
    depth: float,
    *,
    slide: float = 0.0,
    friction: float = 0.6,
    pitch: float = 0.0,
    roll: float = 0.0,
    step: float = 0.2e-3,
    across: tuple[float, float] = (1.0, 0.0),
) -> Touch:
    """Return a touch at the pad's lowest place, pressed straight and then drawn in the finger's X and Y [m]."""
    foot = skin.positions[skin.positions[:, 2].argmin()]
    pressed = np.linspace(0.0, depth, round(depth / step) + 1)[1:]
    drawn = np.linspace(0.0, slide, round(slide / step) + 1)[1:]
    position = np.zeros((len(pressed) + len(drawn), 3))
    position[:, 2] = np.concatenate([pressed, np.full(len(drawn), depth)])
    position[len(pressed) :, :2] = drawn[:, None] * across
    count = len(position)
    return Touch("press", surface, foot + position, np.full(count, pitch), np.full(count, roll), friction)


def mirrored(skin: SkinModel) -> NDArray[np.intp]:
    """Return which pad node is on the other side of X = 0 from each, shape (m,)."""
    from scipy.spatial import cKDTree

    far, other = cKDTree(skin.positions).query(skin.positions * MIRROR)
    assert far.max() < 1e-9, "the pad is not symmetric"
    return np.asarray(other)


def closed_loop(skin: SkinModel, depth: Array, slide: Array, friction: float, tolerance: float) -> tuple[float, float]:
    """Return the work of a plane on the finger over press, slide, return and release, and of the press alone [J].

    Args:
        depth, slide: of the plane on its way [m], from zero on.
    """
    foot = skin.positions[skin.positions[:, 2].argmin()]
    ways = [(0.0, d) for d in depth] + [(x, depth[-1]) for x in slide[1:]] + [(x, depth[-1]) for x in slide[-2::-1]]
    ways += [(0.0, d) for d in depth[-2::-1]]
    path, work, pressing, place, force = on_nodes(skin, tolerance), 0.0, 0.0, foot, np.zeros(3)
    for n, (x, z) in enumerate(ways):
        now = foot + np.array([x, 0.0, z])
        step = path.step([ContactBody(flat(), translation=now, friction=friction)])
        assert step.solution.converged
        total = step.solution.force.sum(axis=0)
        work += 0.5 * float((force + total) @ (now - place))
        place, force = now, total
        if n == len(depth) - 1:
            pressing = work
    return work, pressing
