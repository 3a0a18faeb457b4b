"""Touches of known geometry in the finger's frame, after the scenes of [S0]: what a finger meets, pose after pose.

The surfaces are distance functions, so nothing of a mesh's facets is in them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.contact.solver.bodies import ContactBody
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.nodes import Nodes
from core.contact.solver.pad_points import PadPoints
from core.contact.solver.path_solver import PathSolver
from core.skin.model import SkinModel
from core.skin.nodal_forces import NodalForces
from core.skin.surface_store import smooth_pad
from core.surface.gap import GapQuery, Surface
from core.surface.kernel_body import KernelBody
from core.surface.plane import Plane

Array = NDArray[np.float64]


class Solid(Plane):
    """A solid by its signed distance; its top is at the origin, +Z out of it.

    Nodes meet the distance itself. Points of the smooth skin meet a mesh of it, or of its upper side alone, 60 mm wide.
    """

    def __init__(
        self, distance: Callable[[Array], tuple[Array, Array]], mesh: Callable[[], Surface] | None = None
    ) -> None:
        object.__setattr__(self, "distance", distance)
        object.__setattr__(self, "made", mesh)

    @cached_property
    def mesh(self) -> Surface:
        """The mesh that points of the smooth skin meet."""
        if self.made is not None:  # type: ignore[attr-defined]
            return self.made()  # type: ignore[attr-defined, no-any-return]
        side = 1e-3 * np.concatenate([np.arange(-30, -12, 2), np.linspace(-12, 12, 161), np.arange(14, 31, 2)])
        count = len(side)
        x, y = (v.ravel() for v in np.meshgrid(side, side, indexing="ij"))
        z = np.full(len(x), 5e-3)
        for _ in range(200):
            gap, _ = self.distance(np.column_stack([x, y, z]))  # type: ignore[attr-defined]
            z = np.maximum(z - gap, -10e-3)
        corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
        one, other = [corner, corner + count, corner + count + 1], [corner, corner + count + 1, corner + 1]
        return Surface.build(np.column_stack([x, y, z]), np.vstack([np.transpose(one), np.transpose(other)]))

    @property
    def kernel_body(self) -> KernelBody:
        """The mesh, as the kernels take it."""
        return self.mesh.kernel_body

    def query(self, points: Array, search_radius: float = np.inf) -> GapQuery:
        """Return the signed gap as `Surface.query` does."""
        gap, normal = self.distance(points)  # type: ignore[attr-defined]
        near = gap <= search_radius
        n = len(gap)
        return GapQuery(
            np.where(near, gap, np.inf),
            np.where(near[:, None], normal, 0.0),
            np.where(near[:, None], points - gap[:, None] * normal, np.nan),
            np.where(near, 0, -1),
            np.zeros((n, 3)),
            np.zeros(n, bool),
        )


def ball(radius: float) -> Solid:
    """Return a ball."""

    def distance(p: Array) -> tuple[Array, Array]:
        v = p + np.array([0.0, 0.0, radius])
        r = np.linalg.norm(v, axis=1)
        return r - radius, v / r[:, None]

    return Solid(distance, lambda: Surface.sphere(radius))


def rod(radius: float, along: str = "x") -> Solid:
    """Return an endless round rod along X or Y."""
    free = 1 if along == "x" else 0

    def distance(p: Array) -> tuple[Array, Array]:
        v = p + np.array([0.0, 0.0, radius])
        v[:, 1 - free] = 0.0
        r = np.linalg.norm(v, axis=1)
        return r - radius, v / r[:, None]

    return Solid(distance)


def flat() -> Solid:
    """Return the half-space below z = 0."""
    return Solid(lambda p: (p[:, 2].copy(), np.tile([0.0, 0.0, 1.0], (len(p), 1))))


def edge(rounding: float = 0.5e-3, half_angle: float = np.pi / 4) -> Solid:
    """Return a wedge whose edge runs along X and points up: the edge of a block, a little rounded."""

    def distance(p: Array) -> tuple[Array, Array]:
        v = np.zeros_like(p)
        v[:, 1], v[:, 2] = p[:, 1], p[:, 2] + rounding  # about the axis of the rounding
        s, c = np.sin(half_angle), np.cos(half_angle)
        side = np.where(v[:, 1] >= 0, 1.0, -1.0)
        y = np.abs(v[:, 1])
        faces = y * c + v[:, 2] * s  # to the faces, whose normals are (c, s)
        along = -v[:, 2] * c + y * s
        r = np.hypot(v[:, 1], v[:, 2])
        round_part = (along < 0) & (r > 0)
        gap = np.where(round_part, r, faces) - rounding
        normal = np.zeros_like(p)
        safe = np.maximum(r, 1e-12)
        normal[:, 1] = np.where(round_part, v[:, 1] / safe, side * c)
        normal[:, 2] = np.where(round_part, v[:, 2] / safe, s)
        return gap, normal

    return Solid(distance, lambda: wedge(rounding, half_angle))


def wedge(rounding: float, half_angle: float, facets: int = 64) -> Surface:
    """Return the upper side of a wedge along X with a rounded edge of so many facets, which are not felt."""
    turn = np.linspace(half_angle - np.pi / 2, np.pi / 2 - half_angle, facets + 1)
    arc = rounding * np.column_stack([np.sin(turn), np.cos(turn) - 1.0])
    flank = 0.03 * np.array([np.sin(half_angle), -np.cos(half_angle)])
    profile = np.vstack([arc[0] + flank * [-1, 1], arc, arc[-1] + flank])
    count = len(profile)
    corners = np.vstack([np.column_stack([np.full(count, x), profile]) for x in (-0.03, 0.03)])
    i = np.arange(count - 1)
    faces = np.vstack([np.column_stack([i, i + count, i + 1]), np.column_stack([i + 1, i + count, i + count + 1])])
    return Surface.build(corners, faces)


def rim(radius: float = 35e-3, thickness: float = 1.5e-3) -> Solid:
    """Return the rim of a cup: a ring whose top is the origin, curving away along X."""

    def distance(p: Array) -> tuple[Array, Array]:
        v = p + np.array([0.0, radius, thickness])
        out = np.hypot(v[:, 0], v[:, 1])
        ring = np.stack([v[:, 0] * radius / out, v[:, 1] * radius / out, np.zeros(len(p))], axis=1)
        w = v - ring
        r = np.linalg.norm(w, axis=1)
        return r - thickness, w / r[:, None]

    return Solid(distance)


@dataclass(frozen=True)
class Touch:
    """A movement of a body relative to a finger.

    Attributes:
        surface: of the body. position: of its top in the finger's frame [m], shape (n, 3).
        pitch, roll: of the body about X and Y [rad], shape (n,).
        friction: Coulomb's coefficient. softness: [m/Pa].
    """

    name: str
    surface: Solid | Surface
    position: Array
    pitch: Array
    roll: Array
    friction: float = 0.6
    softness: float = 0.0

    def bodies(self, i: int) -> list[ContactBody]:
        """Return what there is to touch at step i."""
        cp, sp, ct, st = np.cos(self.pitch[i]), np.sin(self.pitch[i]), np.cos(self.roll[i]), np.sin(self.roll[i])
        turn = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]]) @ np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
        return [ContactBody(self.surface, turn, self.position[i], self.friction, self.softness)]

    def forces(self, skin: SkinModel, tolerance: float = 1e-6, *, points: bool = False) -> Array:
        """Return the forces on the nodes of a skin [N], shape (n, m, 3), solved there or on points of its surface."""
        path = solver_on(skin if points else skin.on_nodes, tolerance, self.name)
        return np.array([path.step(self.bodies(i)).nodal for i in range(len(self.position))])


def solver_on(skin: SkinModel, tolerance: float = 1e-6, name: str = "finger") -> PathSolver:
    """Return what follows a touch on points of a smooth skin, or at the nodes of a mesh that has none."""
    pad, law = smooth_pad(skin), LawSkin.of(skin)
    if pad is None:
        nodes = Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance)
        return PathSolver(nodes, tolerance=tolerance, name=name, law=law)
    return PathSolver(PadPoints(pad, NodalForces(skin.mesh, pad.chart, skin.follows_law)), name=name, law=law)


def along(count: int, **keys: list[tuple[float, float]]) -> dict[str, Array]:
    """Return named series through (time 0..1, value), smooth between keys."""
    t = np.linspace(0.0, 1.0, count)
    out = {}
    for name, points in keys.items():
        at, value = np.array(points).T
        out[name] = smooth(t, at, value)
    return out


def smooth(t: Array, at: Array, value: Array) -> Array:
    """Interpolate with a cosine between keys."""
    i = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
    s = np.clip((t - at[i]) / (at[i + 1] - at[i]), 0.0, 1.0)
    return value[i] + (value[i + 1] - value[i]) * (0.5 - 0.5 * np.cos(np.pi * s))


def make(name: str, surface: Solid, count: int, *, friction: float = 0.6, softness: float = 0.0, **keys: list) -> Touch:  # type: ignore[type-arg]
    """Return a touch from keys of depth, x, y [mm] and pitch, roll [deg]; depth is into the resting skin."""
    series = along(count, **{**{k: [(0.0, 0.0), (1.0, 0.0)] for k in ("depth", "x", "y", "pitch", "roll")}, **keys})
    position = 1e-3 * np.stack([series["x"], series["y"], series["depth"]], axis=1)
    return Touch(name, surface, position, np.radians(series["pitch"]), np.radians(series["roll"]), friction, softness)


PRESS = [(0.0, -0.3), (0.35, 1.2), (0.75, 1.2), (1.0, -0.3)]


def ball_roll(count: int = 120, friction: float = 0.6) -> Touch:
    """Return a ball that is pressed and rolled about the pad."""
    return make("ball", ball(15e-3), count, friction=friction, depth=PRESS,
                x=[(0, 0), (0.3, 0), (0.5, 3), (0.7, -3), (1, 0)], y=[(0, 0), (0.4, 2), (0.6, -2), (1, 0)])  # fmt: skip


def edge_press(count: int = 120) -> Touch:
    """Return an edge that is pressed and turned."""
    return make("edge", edge(), count, depth=[(0, -0.3), (0.35, 1.0), (0.75, 1.0), (1, -0.3)],
                pitch=[(0, 0), (0.35, 0), (0.55, 15), (0.75, -15), (1, 0)], y=[(0, 0), (0.5, 1.5), (1, 0)])  # fmt: skip


def slide(count: int = 120, friction: float = 0.6, sideways: float = 3.0, keys: str = "x") -> Touch:
    """Return a plane that is pressed and then slides sideways and back."""
    return make("slide", flat(), count, friction=friction, depth=[(0, -0.3), (0.25, 1.0), (0.85, 1.0), (1, -0.3)],
                **{keys: [(0, 0), (0.3, 0), (0.55, sideways), (0.8, -sideways), (1, -sideways)]})  # fmt: skip


def flat_press(count: int = 120) -> Touch:
    """Return a plane that is pressed and tilted."""
    return make("flat", flat(), count, depth=PRESS, pitch=[(0, 0), (0.4, 12), (0.7, -2), (1, 0)],
                roll=[(0, 0), (0.3, -10), (0.6, 10), (1, 0)])  # fmt: skip


def cup(count: int = 120) -> Touch:
    """Return the rim of a cup, pressed and turned."""
    return make("cup", rim(), count, depth=[(0, -0.3), (0.4, 1.0), (0.7, 1.0), (1, -0.3)],
                roll=[(0, 0), (0.5, 12), (0.75, -12), (1, 0)], y=[(0, -1.5), (0.5, 1.5), (1, 0)])  # fmt: skip


def foam(count: int = 120) -> Touch:
    """Return a soft flat block, pressed and tilted: it yields 1 mm under 8 kPa."""
    return make("foam", flat(), count, softness=1e-3 / 8e3, depth=[(0, -0.3), (0.4, 2.0), (0.7, 2.0), (1, -0.3)],
                pitch=[(0, 0), (0.5, 10), (1, 0)], roll=[(0, 0), (0.3, 8), (0.7, -8), (1, 0)])  # fmt: skip


def rod_at(
    y: float, count: int = 60, depth: float = 1.0, slides: str = "", start: float = -0.2, friction: float = 0.6
) -> Touch:
    """Return a thin rod across the finger, pressed at y [mm] of the pad.

    Args:
        slides: 'along' its own axis by 3 mm, 'across' it along the finger, or '' where it stays.
        start: depth before and after [mm].
    """
    way = [(0.0, 0.0), (0.3, 0.0), (0.8, 3.0 if slides else 0.0), (1.0, 3.0 if slides else 0.0)]
    across = [(at, y + (v if slides == "across" else 0.0)) for at, v in way]
    along = way if slides == "along" else [(0.0, 0.0), (1.0, 0.0)]
    press = [(0.0, start), (0.3, depth), (0.8, depth), (1.0, start)]
    return make("rod", rod(3e-3), count, friction=friction, depth=press, x=along, y=across)


def shaken_block(count: int = 120) -> Touch:
    """Return the face of a block that is held and shaken."""
    shake = [(0, 0), (0.2, 0)] + [(0.2 + 0.1 * i, 0.6 * (-1) ** i) for i in range(1, 7)] + [(1, 0)]
    return make("block", flat(), count, depth=[(0, -0.3), (0.2, 1.1), (0.9, 1.1), (1, -0.3)], y=shake)
