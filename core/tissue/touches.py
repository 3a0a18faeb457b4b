"""Touches that show what skin may be asked: short presses and slides, drawn by chance but the same each time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..contact.solver.bodies import ContactBody
from ..contact.solver.law_skin import LawSkin
from ..contact.solver.path import PathSolver
from ..skin.model import SkinModel
from ..skin.shape import FingertipShape
from ..surface.plane import Plane
from .solids import ball, edge, flat, rod

PRESSES, SLIDES, KEPT = 12, 16, 4  # poses of a run, and every which of them is kept
DEPTHS = (1.0e-3, 2.4e-3)  # [m] on the pulp of the standard finger
SLIDE = 6e-3  # [m] at most, there
RADII = (1.5e-3, 20e-3)  # [m]
TILTS = ((-0.4, 0.5), (-0.4, 0.4))  # about X and Y [rad]
ASIDE = 3.5e-3  # [m] from the pad's lowest point
FRICTIONS = (0.0, 0.3, 0.6)
SHARES = {"flat": 0.28, "ball": 0.28, "rod": 0.18, "edge": 0.16, "rib": 0.1}


@dataclass(frozen=True, eq=False)
class Touch:
    """One run: a solid pressed into skin, then dragged along it.

    Attributes:
        surface: of the solid. rotation: to the finger's frame, shape (3, 3). friction: Coulomb's coefficient.
        start: where the solid's top lies when it touches [m], shape (3,).
        ways: from there, pose after pose [m], shape (n, 3).
    """

    surface: Plane
    rotation: Array
    friction: float
    start: Array
    ways: Array

    def poses(self) -> Iterator[list[ContactBody]]:
        """Yield what the finger meets, pose after pose."""
        for way in self.ways:
            yield [ContactBody(self.surface, self.rotation, self.start + way, self.friction)]


def touches(skin: SkinModel, count: int, seed: int = 0) -> list[Touch]:
    """Return touches of a skin; as deep and as wide as its pulp is thick against the standard finger's."""
    size = 1.0 if skin.shape is None else skin.shape.pulp / FingertipShape().pulp
    rng = np.random.default_rng(seed)
    return [_drawn(skin, size, rng) for _ in range(count)]


def shown(drawn: Sequence[Touch], what: Callable[[Touch], Array]) -> Generator[tuple[int, int], None, list[Array]]:
    """Return what touches show, one after another, shapes (s, ...); yields (done, how many)."""
    found = []
    for n, touch in enumerate(drawn):
        yield n, len(drawn)
        found.append(what(touch))
    return found


def loads_of(skin: SkinModel, touch: Touch) -> Array:
    """Return loads that displace linear skin as a touch displaces this one, over the modulus, shape (s, 3 m)."""
    law = LawSkin.of(skin)
    solver = PathSolver(skin.compliance, skin.positions, areas=skin.areas, depth_limit=1.0, law=law)
    out = []
    for n, bodies in enumerate(touch.poses()):
        step = solver.step(bodies)
        force = step.solution.force
        if n % KEPT != KEPT - 1 or not force.any():
            continue
        load = force.ravel() / skin.material.modulus
        if step.amounts is not None:
            load = load - np.linalg.solve(skin.unit_compliance, step.amounts.astype(np.float64))
        out.append(load)
    return np.array(out).reshape(-1, 3 * skin.pad_count)


def _drawn(skin: SkinModel, size: float, rng: np.random.Generator) -> Touch:
    kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    radius = size * float(np.exp(rng.uniform(*np.log(RADII))))
    angle = rng.uniform(0.5, 1.1) if kind == "edge" else rng.uniform(0.1, 0.3)
    surface = {"flat": flat, "ball": lambda: ball(radius), "rod": lambda: rod(radius)}.get(
        kind, lambda: edge(size * rng.uniform(0.2e-3, 0.6e-3), angle)
    )()
    rotation = _turned(rng.uniform(*TILTS[0]), rng.uniform(*TILTS[1]), rng.uniform(0.0, np.pi))
    aside, friction = size * rng.uniform(-ASIDE, ASIDE, 2), float(rng.choice(FRICTIONS))
    depth, along = size * rng.uniform(*DEPTHS), rng.uniform(0.0, 2.0 * np.pi)
    slide = size * rng.uniform(0.0, SLIDE) * (friction > 0.0)
    drag = slide * (np.cos(along) * rotation[:, 0] + np.sin(along) * rotation[:, 1])
    lowest = skin.positions[skin.positions[:, 2].argmin()]
    top = skin.positions[np.linalg.norm(skin.positions[:, :2] - lowest[:2] - aside, axis=1).argmin()]
    up = rotation[:, 2]
    start = _lifted(surface, rotation, top, skin.positions)
    ways = np.linspace(0.0, depth, PRESSES + 1)[1:, None] * up
    if slide > 0.0:
        ways = np.concatenate([ways, ways[-1] + np.linspace(0.0, 1.0, SLIDES + 1)[1:, None] * drag])
    return Touch(surface, rotation, friction, start, ways)


def _turned(pitch: float, roll: float, yaw: float) -> Array:
    """Return the rotation about Z by yaw, then about Y by roll, then about X by pitch."""
    c, s = np.cos([pitch, roll, yaw]), np.sin([pitch, roll, yaw])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c[0], -s[0]], [0.0, s[0], c[0]]])
    about_y = np.array([[c[1], 0.0, s[1]], [0.0, 1.0, 0.0], [-s[1], 0.0, c[1]]])
    about_z = np.array([[c[2], -s[2], 0.0], [s[2], c[2], 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_x @ about_y @ about_z)


def _lifted(surface: Plane, rotation: Array, top: Array, positions: Array) -> Array:
    """Return where a solid's top lies when none of the skin is inside any more."""
    for _ in range(200):
        deepest = float(surface.query((positions - top) @ rotation).gap.min())
        if deepest >= 0.0:
            break
        top = top + deepest * rotation[:, 2]
    return top
