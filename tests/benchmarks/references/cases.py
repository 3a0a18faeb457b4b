"""What is pressed where, how finely it is meshed, and where stress is read. Lengths in mm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.parameters.error_bands import LINEAR, NEO_HOOKEAN
from core.skin.shape import FingertipShape

from .hexahedra import Grading, Gradings, chart_below, places
from .shapes import PERIOD, RIB, RIB_ROUNDING, Ball, Edge, Flat, Pillar, Plate, Ribs, Rod, Shape
from .turned_shapes import Cone, Dot, Peg, Torus

Array = NDArray[np.float64]

FINGER = FingertipShape()
DEPTHS = (0.5, 1.0, 1.5)
PROBE_DEPTHS = (0.3, 1.2, 2.0)
SOFT_DEPTHS, SOFT_PROBES = (1.0, 2.0), (0.3, 1.2, 1.6, 2.0)  # of neo-Hookean tissue: receptors lie at three of them
JUDGED_AT = 1  # of the probes' depths, all families': 1.2 mm
SCALES = (2.0, np.sqrt(2.0), 1.0)  # of a case's meshes, over its gradings
STEP, NEWTON_STEP = 0.1, 0.25  # longest step of a press, times the scale: of linear tissue, of neo-Hookean
ASIDE, FRICTION = 0.37, 0.3  # of edges beside the middle, where contact without friction has many answers
RIMMED = (0.5, 1.0, 1.5, 2.0)  # depths of a pillar [mm]


@dataclass(frozen=True)
class Family:
    """Cases that share meshes.

    Attributes:
        name: of the family. shapes: by name, of the widest contact last. gradings: of its meshes at a scale of 1.
        probe_x, probe_y: where stress is read, from the shape's origin [mm].
        sideways: x of the shape's origin [mm]; where it is not zero the whole finger is meshed.
        friction: of contact. depths: beyond first contact [mm].
        tissue: 'linear' or 'neo_hookean'.
        probe_depths: below the skin, where stress is read [mm].
        reach: nodes that would be deeper in the last shape than this share of the depth may carry force.
    """

    name: str
    shapes: tuple[tuple[str, Shape], ...]
    gradings: Gradings
    probe_x: tuple[float, ...]
    probe_y: tuple[float, ...]
    sideways: float = 0.0
    friction: float = 0.0
    depths: tuple[float, ...] = DEPTHS
    reach: float = 0.05
    tissue: str = LINEAR
    probe_depths: tuple[float, ...] = PROBE_DEPTHS

    @property
    def step(self) -> float:
        """Longest step of a press at a scale of 1 [mm]."""
        return STEP if self.tissue == LINEAR else NEWTON_STEP

    @property
    def half(self) -> bool:
        """Whether half a finger is enough."""
        return self.sideways == 0.0

    def cases(self) -> Iterator[tuple[Shape, float, str]]:
        """Yield every shape at every depth [mm], and what the case is called."""
        for name, shape in self.shapes:
            for depth in self.depths:
                yield shape, depth, f"{name}, {depth:g} mm deep"

    def may_touch(self, points: Array) -> NDArray[np.bool_]:
        """Return which points of the skin may carry force at the greatest depth, shape (n,)."""
        shape, depth = self.shapes[-1][1], self.depths[-1]
        own = points - first_contact(shape, self.sideways) - [0.0, 0.0, depth]
        if isinstance(shape, Ribs):
            return own[:, 2] < -self.reach * depth  # skin between ribs may be pressed against their sides
        return shape.gap(own)[0] < -self.reach * depth

    @cached_property
    def probes(self) -> Array:
        """Points [mm], depth by depth, shape (len(probe_depths) * len(probe_x) * len(probe_y), 3)."""
        x, y = (a.ravel() for a in np.meshgrid(np.array(self.probe_x) + self.sideways, self.probe_y, indexing="ij"))
        return np.concatenate([below_skin(x, y, depth) for depth in self.probe_depths])


def below_skin(x: Array, y: Array, depth: float) -> Array:
    """Return the points so deep below the smooth skin's points at x and y [mm], shape (n, 3)."""
    chart, step = chart_below(FINGER, x, y), 1e-5
    skin = places(FINGER, chart, 1.0)
    inward = -np.cross(places(FINGER, chart + step, 1.0) - skin, places(FINGER, chart + 1j * step, 1.0) - skin)
    return skin + depth * inward / np.linalg.norm(inward, axis=1, keepdims=True)


def first_contact(shape: Shape, sideways: float) -> Array:
    """Return where a shape's origin is when it rises along Z and first meets the smooth skin [mm], shape (3,)."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-6.0, 6.0, 241), np.linspace(-6.0, 6.0, 241)))
    height = -10.0
    for _ in range(8):
        skin = places(FINGER, chart_below(FINGER, x, y), 1.0)
        for _ in range(60):  # it rises by the smallest gap, which carries it past nothing
            gap = shape.gap(skin - [sideways, 0.0, height])[0]
            height += gap.min()
        best = int(gap.argmin())
        width = np.ptp(x) / 20
        around = np.linspace(-width, width, 41)
        x, y = (a.ravel() for a in np.meshgrid(x[best] + around, y[best] + around))
    return np.array([sideways, 0.0, height])


SEVEN, SIX = np.array([-1.0, -0.6, -0.2, 0.0, 0.2, 0.6, 1.0]), np.array([-1.0, -0.6, -0.2, 0.2, 0.6, 1.0])
ACROSS = (-1.6, -0.8, -0.3, 0.0, 0.3, 0.8, 1.6)  # of edges
LENGTHWISE = tuple(4.0 * SIX)
BALLS = {2.0: (0.125, 1.4, 0.25), 5.0: (0.18, 2.5, 0.2), 12.0: (0.3, 3.4, 0.2)}  # even size, half width, growth
CORNERS = tuple(rib * PERIOD + side * 0.5 * (RIB - RIB_ROUNDING) for rib in range(4) for side in (-1, 1))[1:]
ON_RIM = (0.0, 0.3, 0.6, 0.9, 1.2)  # y that a coin's rim runs through under the pad


def _about(even: float, half: float, growth: float = 0.2) -> Gradings:
    """Return gradings about a small contact."""
    side = Grading(even, half, growth=growth)
    return Gradings(side, side, Grading(min(even, 0.18), 0.3 * half, growth=growth))


def _along(even: float, half: float, growth: float = 0.15, along: float = 0.45) -> Gradings:
    """Return gradings about a line along Y."""
    across = Grading(even, half, growth=growth, most=0.8)
    return Gradings(across, Grading(along, 4.0), Grading(even, 0.1, growth=0.2))


def _families() -> Iterator[Family]:
    plane = Gradings(Grading(0.35, 4.0), Grading(0.35, 5.0), Grading(0.15, 0.5, growth=0.2))
    yield Family("plane", (("plane", Flat()),), plane, tuple(3.6 * SEVEN), tuple(4.2 * SIX))
    for radius, (even, half, growth) in BALLS.items():
        ball = ((f"ball {radius:g} mm", Ball(radius)),)
        yield Family(
            f"ball {radius:g}", ball, _about(even, half, growth), tuple(1.1 * half * SEVEN), tuple(1.1 * half * SIX)
        )
    edges = tuple((f"edge {angle} degrees at {{:g}} mm", Edge(angle)) for angle in (60, 90, 120))
    middle, beside = _along(0.024, 0.22, 0.2), _along(0.05, 0.3, 0.22, 0.5)
    for sideways, gradings, friction in ((0.0, middle, 0.0), (ASIDE, beside, FRICTION)):
        own = tuple((name.format(sideways), shape) for name, shape in edges)
        yield Family(f"edge {sideways:g}", own, gradings, ACROSS, LENGTHWISE, sideways, friction)
    ribs = Gradings(Grading(0.11, 0.1, CORNERS, 0.35), Grading(0.7, 4.0), Grading(0.11, 0.1, growth=0.28))
    between = (-2.25, -1.5, -0.75, 0.0, 0.375, 0.9, 1.5)
    yield Family("ribs", (("ribs", Ribs()),), ribs, between, LENGTHWISE, reach=0.1)
    yield Family(
        "ribs with friction", (("ribs with friction", Ribs()),), ribs, between, LENGTHWISE, 0.0, FRICTION, reach=0.1
    )
    rim = Gradings(Grading(0.25, 3.2), Grading(0.055, 0.2, ON_RIM, 0.26, 1.0), Grading(0.055, 0.1, growth=0.25))
    coin = ("coin with friction", Peg(6.0, 0.1, 6.0))
    yield Family("coin", (coin,), rim, tuple(3.0 * SIX), ACROSS, 0.0, FRICTION, reach=-0.1)
    ring = Gradings(Grading(0.25, 3.0), Grading(0.1, 0.6, (0.0, 0.6, 1.2)), Grading(0.1, 0.4, growth=0.2))
    yield Family("torus", (("torus 1 mm", Torus(1.0, 5.0, 5.0)),), ring, tuple(3.0 * SIX), ACROSS, reach=-0.1)
    rims = Grading(0.07, 0.25, (-1.0, 1.0), 0.28)
    punch = Gradings(rims, rims, Grading(0.07, 0.1, growth=0.25))
    about, peg = (tuple(1.5 * SEVEN), tuple(1.5 * SIX)), ("punch 2 mm with friction", Peg(1.0, 0.1))
    yield Family("punch", (peg,), punch, *about, 0.0, FRICTION, reach=-0.1)
    yield from _upright(about)
    yield Family("rod", (("rod 3 mm", Rod(3.0)),), _along(0.09, 1.2), tuple(2.0 * SEVEN), LENGTHWISE)
    cone = ("cone 60 degrees", Cone(60.0, 0.5))
    yield Family("cone", (cone,), _about(0.08, 0.9, 0.25), tuple(1.5 * SEVEN), tuple(1.5 * SIX))
    fine = Grading(0.09, 0.9, growth=0.2)
    dot = Gradings(fine, fine, Grading(0.09, 0.3, growth=0.2))
    yield Family("dot", (("Braille dot", Dot(0.72, 0.48)),), dot, tuple(1.5 * SEVEN), tuple(1.5 * SIX))
    yield from _softer()


def _softer() -> Iterator[Family]:
    """Yield what is pressed into neo-Hookean tissue, as deep as that is trusted without a finding."""
    flat = Gradings(Grading(0.5, 4.0), Grading(0.5, 5.0), Grading(0.25, 1.0, growth=0.2))
    wide = tuple(2.75 * SEVEN), tuple(2.75 * SIX)
    for name, shape, gradings, x, y in (
        ("ball 5", Ball(5.0), _about(0.42, 2.5), *wide),
        ("plane", Flat(), flat, tuple(3.6 * SEVEN), tuple(4.2 * SIX)),
        ("rod 6", Rod(6.0), _along(0.42, 2.5, along=0.5), tuple(3.0 * SEVEN), LENGTHWISE),
    ):
        title = f"neo-Hookean {name}"
        shapes = ((title if isinstance(shape, Flat) else f"{title} mm", shape),)
        yield Family(title, shapes, gradings, x, y, 0.0, 0.0, SOFT_DEPTHS, 0.0, NEO_HOOKEAN, SOFT_PROBES)


def _upright(about: tuple[tuple[float, ...], tuple[float, ...]]) -> Iterator[Family]:
    """Yield a pillar and plates, whose rims are as sharp as cells allow.

    Without friction skin slides round a rim; cells that are wider than a tenth of its radius hold it back, and the
    force is too large by up to a third, whatever its change from mesh to mesh: rims are judged with friction.
    """
    square = Grading(0.05, 0.2, (-1.0, 1.0))
    pillar = Gradings(square, square, Grading(0.05, 0.1, growth=0.25))
    rims = tuple((f"pillar 2 mm with a rim of {rim:g} mm", Pillar(2.0, rim)) for rim in (0.1, 0.05))
    yield Family("pillar", rims, pillar, *about, 0.0, FRICTION, RIMMED, reach=-0.1)
    for name, friction, even in (("plate", 0.0, 0.016), ("plate with friction", FRICTION, 0.03)):
        side = Grading(even, 0.1, (-0.2, 0.2), 0.22, 0.8)
        plate = Gradings(side, Grading(0.5, 4.0), Grading(even, 0.08, growth=0.22))
        own = (f"{name} along", Plate(0.5, 0.1))
        yield Family(name, (own,), plate, ACROSS, LENGTHWISE, 0.0, friction, (0.5, 1.0), reach=-0.1)
    side = Grading(0.03, 0.1, (-0.2, 0.2), 0.22, 0.8)
    across = Gradings(Grading(0.35, 3.5), side, Grading(0.03, 0.08, growth=0.22))
    own = ("plate with friction across", Plate(0.5, 0.1, turned=True))
    yield Family("plate across", (own,), across, tuple(3.0 * SIX), ACROSS, 0.0, FRICTION, (0.5, 1.0), reach=-0.1)


FAMILIES = {family.name: family for family in _families()}
