"""Forty touches that no basis or table of stiffening has seen: planes, balls, rods, edges and ribs, seeded and named.

Each is pressed along its own normal, 0.25 mm a frame, and then pressed on or drawn across the finger as far a frame.
Sizes, tilts, places and directions come from a generator of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.contact.solver.bodies import ContactBody
from tests.touches import Solid, ball, edge, flat, rod

Array = NDArray[np.float64]

SEED = 150_023
STEP = 0.25e-3  # of every movement in a frame [m]
DEPTH, DEEP, SHEAR, SLIDE = 2e-3, 4e-3, 2e-3, 6e-3
TILT, ASIDE = 0.3, 2e-3  # at most [rad], [m]
ROUNDING = 0.2e-3
SHOWN = ((0.5e-3, 1e-3, 1.5e-3, 2e-3, 3e-3, 4e-3), (1e-3, 2e-3, 4e-3, 6e-3))  # depths of a press, lengths of a slide
# how often each is pressed, drawn 2 mm, drawn 6 mm and pressed to 4 mm
COUNTS = {"plane": (2, 4, 3, 2), "ball": (2, 5, 2, 2), "rod": (1, 3, 1, 1), "edge": (1, 3, 1, 1), "rib": (1, 3, 1, 1)}
MOVES = ("press", "shear", "slide", "deep")


@dataclass(frozen=True, eq=False)
class Path:
    """A touch.

    Attributes:
        name: its shape, size, movement and friction. kind, move: of `COUNTS` and `MOVES`.
        surface: of the body, its top at the origin. turn: from the body to the finger, shape (3, 3).
        place: of the pad under which its top is [m], shape (2,). across: direction of the slide, shape (3,).
    """

    name: str
    kind: str
    move: str
    surface: Solid
    turn: Array
    place: Array
    across: Array
    friction: float

    @cached_property
    def way(self) -> tuple[tuple[float, float], ...]:
        """Depth and slide of each frame [m]."""
        depth = DEEP if self.move == "deep" else DEPTH
        slide = {"shear": SHEAR, "slide": SLIDE}.get(self.move, 0.0)
        pressed = [(STEP * k, 0.0) for k in range(1, round(depth / STEP) + 1)]
        return (*pressed, *((depth, STEP * k) for k in range(1, round(slide / STEP) + 1)))

    @property
    def shown(self) -> list[int]:
        """Frames that are compared."""
        return [i for i, (depth, slide) in enumerate(self.way) if _among(slide or depth, SHOWN[slide > 0.0])]

    def frames(self, points: Array) -> list[list[ContactBody]]:
        """Return what there is to touch, frame after frame, for skin through points [m], shape (m, 3)."""
        normal = self.turn[:, 2]
        top = points[np.linalg.norm(points[:, :2] - self.place, axis=1).argmin()].copy()
        for _ in range(200):  # down to where it first touches
            gap = float(self.surface.query((points - top) @ self.turn).gap.min())
            if abs(gap) < 1e-9:
                break
            top += normal * gap
        places = [top + normal * depth + self.across * slide for depth, slide in self.way]
        return [[ContactBody(self.surface, self.turn, place, self.friction)] for place in places]


def _among(value: float, values: tuple[float, ...]) -> bool:
    return any(abs(value - v) < 1e-9 for v in values)


def paths(centre: Array) -> list[Path]:
    """Return all of them, about the pad's lowest place [m], shape (3,)."""
    rng = np.random.default_rng(SEED)
    out = []
    for kind, counts in COUNTS.items():
        for move, count in zip(MOVES, counts, strict=True):
            for _ in range(count):
                out.append(_path(rng, kind, move, centre, len(out)))
    return out


def _path(rng: np.random.Generator, kind: str, move: str, centre: Array, number: int) -> Path:
    pitch, roll = rng.uniform(-TILT, TILT, 2)
    yaw, heading = rng.uniform(-np.pi, np.pi, 2)
    size, aside = rng.uniform(0.0, 1.0), rng.uniform(-ASIDE, ASIDE, 2)
    surface, what = _surface(kind, size)
    drawn = move in ("shear", "slide") or kind in ("edge", "rib")
    friction = float(rng.choice([0.3, 0.6] if drawn else [0.0, 0.3, 0.6]))
    if move == "slide" and kind != "plane":  # along the finger, over its middle: it is to stay on the pad, as deep
        heading = np.pi / 2 + 0.1 * heading
        pitch, yaw = 0.1 * pitch, 0.25 * yaw
    turn = _about(0, pitch) @ _about(1, roll) @ _about(2, yaw)
    across = turn @ _about(2, -yaw) @ np.array([np.cos(heading), np.sin(heading), 0.0])
    place = centre[:2] + aside - (0.25 * SLIDE * across[:2] if move == "slide" else 0.0)
    name = f"{number:02d} {kind} {what} {move} mu {friction:g}".replace("  ", " ")
    return Path(name, kind, move, surface, turn, place, across, friction)


def _surface(kind: str, size: float) -> tuple[Solid, str]:
    """Return a shape of a size between zero and one, and what it is called."""
    if kind == "plane":
        return flat(), ""
    if kind == "edge":
        angle = 0.6 + 0.45 * size
        return edge(ROUNDING, angle), f"{np.degrees(2.0 * angle):.0f} deg"
    if kind == "rib":
        width = 1.5e-3 + 1.5e-3 * size
        return rib(width, ROUNDING), f"{1e3 * width:.2f} mm"
    radius = 3e-3 * (20.0 / 3.0) ** size
    return (ball(radius) if kind == "ball" else rod(radius)), f"R {1e3 * radius:.2f} mm"


def rib(width: float, rounding: float) -> Solid:
    """Return a wall along X whose top is the origin, its two edges rounded."""

    def distance(p: Array) -> tuple[Array, Array]:
        out, up = np.abs(p[:, 1]) - (0.5 * width - rounding), p[:, 2] + rounding
        corner = (out > 0.0) & (up > 0.0)
        far = np.hypot(out, up)
        side = out > up
        gap = np.where(corner, far, np.maximum(out, up)) - rounding
        safe = np.maximum(far, 1e-12)
        sign = np.where(p[:, 1] >= 0.0, 1.0, -1.0)
        normal = np.zeros_like(p)
        normal[:, 1] = sign * np.where(corner, out / safe, side)
        normal[:, 2] = np.where(corner, up / safe, ~side)
        return gap, normal

    return Solid(distance)


def _about(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    out = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out
