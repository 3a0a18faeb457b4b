"""What is pressed where, how finely it is meshed, and where stress is read. Lengths in mm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.skin.shape import FingertipShape

from .bisection import NAIL, places
from .shapes import PERIOD, RIB, RIB_ROUNDING, Ball, Edge, Flat, Ribs, Shape

Array = NDArray[np.float64]

FINGER = FingertipShape()
DEPTHS = (1.0, 2.0)
PROBE_DEPTHS = (0.3, 1.2, 2.0)
SIDEWAYS = (0.0, 0.37, 0.81)
EDGE_GRADING, RIB_GRADING = (0.22, 0.4), (0.3, 0.3)  # size where it is sharp, over the family's; growth at COARSE
COARSE = 0.12
# Of ever finer meshes, of sharp shapes [mm]; of others times their coarseness.
SIZES, WHOLE_SIZES = (0.36, 0.25, 0.18), (0.5, 0.36, 0.25)
GROWTH, FAR = 0.4, 1.45  # of edges, per distance from contact, and where they grow no more, at COARSE
STRETCH, LONG = 4.0, 0.6  # length over width of elements where a shape runs along Y, and how long they are at least
RIB_DOUBT = (0.02, 0.08)  # skin over a rib's corner is stretched to twenty times its width where pressure is 0.7 E
CORNER = 0.5 * RIB - 0.5 * RIB_ROUNDING  # of a rib, from its middle [mm]
AWAY, THERE = 7.0, 0.25  # beyond this distance from the pad's centre edges may grow by this per distance


@dataclass(frozen=True)
class Family:
    """Cases that share meshes.

    Attributes:
        name: of the family. shapes: by name, of the widest contact last. coarseness: of sizes, over those of edges.
        x, y: half widths of the region of even size [mm]. sideways: of the shape's origin [mm].
        sharp: places across, from the shape's origin, towards which elements shrink; it runs along Y there, and they
            may be long [mm]. grading: how.
        depths: [mm]. reach: nodes deeper in the last shape than this share of the depth may carry force.
        doubt: relative error of the force at each depth that these meshes do not show, where there is any: what
            elements of this size are off in plane strain, where they can be small enough.
        probe_x, probe_y: where stress is read, from the shape's origin [mm].
    """

    name: str
    shapes: tuple[tuple[str, Shape], ...]
    coarseness: float
    x: float
    y: float
    probe_x: tuple[float, ...]
    probe_y: tuple[float, ...]
    sideways: float = 0.0
    sharp: tuple[float, ...] = ()
    grading: tuple[float, float] = EDGE_GRADING
    depths: tuple[float, ...] = DEPTHS
    reach: float = 0.25
    doubt: tuple[float, ...] = (0.0, 0.0)

    @property
    def sizes(self) -> tuple[float, ...]:
        """Sizes of its meshes over its coarseness, falling [mm]: whole meshes are not made as fine as halves."""
        return SIZES if self.symmetric else WHOLE_SIZES

    @property
    def symmetric(self) -> bool:
        """Whether half a mesh is enough."""
        return self.sideways == 0.0

    def cases(self) -> Iterator[tuple[Shape, float, str]]:
        """Yield every shape at every depth [mm], and what the case is called."""
        for name, shape in self.shapes:
            for depth in self.depths:
                yield shape, depth, f"{name}, {depth:g} mm deep"

    def size(self, points: Array, step: float) -> Array:
        """Return the greatest length of elements' edges along x, y and z about points [mm], for a size of `step`."""
        scale = step / COARSE
        x, y = points[:, 0] - self.sideways, np.abs(points[:, 1])
        deep = np.maximum(points[:, 2] - skin_height(points), 0.0)
        far = FAR * scale + 3.0 * np.maximum(points[:, 2] - NAIL, 0.0)
        far += THERE * np.maximum(np.linalg.norm(points, axis=1) - AWAY, 0.0)
        growth = GROWTH * scale
        even = 1.4 * step * self.coarseness  # edges are halved below a length: on average they are 1.4 times shorter
        if self.sharp:
            near = np.abs(x[:, None] - np.array(self.sharp)).min(axis=1)
            share, slope = self.grading
            fine = even * share + slope * scale * np.hypot(near, deep) + growth * np.maximum(y - self.y, 0.0)
        else:
            radius = np.maximum(np.hypot(x / self.x, y / self.y) - 1.0, 0.0) * min(self.x, self.y)
            fine = even + growth * np.hypot(radius, np.maximum(deep - 2.0 * step * self.coarseness, 0.0))
        fine = np.minimum(fine, far)
        long = np.minimum(STRETCH * fine, np.maximum(fine, LONG * np.sqrt(scale))) if self.sharp else fine
        return np.stack([fine, np.minimum(long, far), fine], axis=1)

    def may_touch(self, points: Array) -> NDArray[np.bool_]:
        """Return which points of the skin may carry force at the greatest depth, shape (n,)."""
        shape, depth = self.shapes[-1][1], self.depths[-1]
        own = points - first_contact(shape, self.sideways) - [0.0, 0.0, depth]
        if isinstance(shape, Ribs):
            return own[:, 2] < -self.reach * depth
        return shape.gap(own)[0] < -self.reach * depth

    @cached_property
    def probes(self) -> Array:
        """Points [mm], depth by depth, shape (3 * len(probe_x) * len(probe_y), 3)."""
        x, y = (a.ravel() for a in np.meshgrid(np.array(self.probe_x) + self.sideways, self.probe_y, indexing="ij"))
        return np.concatenate([below_skin(x, y, depth) for depth in PROBE_DEPTHS])


def below_skin(x: Array, y: Array, depth: float) -> Array:
    """Return the points so deep below the smooth skin's points at x and y [mm], shape (n, 3)."""
    chart, step = chart_below(x, y), 1e-5
    skin = places(FINGER, chart, 1.0)
    inward = -np.cross(places(FINGER, chart + step, 1.0) - skin, places(FINGER, chart + 1j * step, 1.0) - skin)
    return skin + depth * inward / np.linalg.norm(inward, axis=1, keepdims=True)


def skin_height(points: Array) -> Array:
    """Return about how high the smooth skin is above the pad's centre below points [mm], shape (n,)."""
    x, y = points[:, 0] / (500.0 * FINGER.width), points[:, 1] / (1e3 * FINGER.tip)
    return 1e3 * FINGER.height_palm * (1.0 - np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0)))


def chart_below(x: Array, y: Array) -> NDArray[np.complex128]:
    """Return the points of the chart whose skin is at x and y [mm], by Newton's method."""
    chart = np.zeros(len(x), complex)
    step = 1e-6
    for _ in range(50):
        at = places(FINGER, chart, 1.0)[:, :2]
        real, imag = ((places(FINGER, chart + d, 1.0)[:, :2] - at) / step for d in (step, 1j * step))
        off = np.stack([x, y], axis=1) - at
        det = real[:, 0] * imag[:, 1] - real[:, 1] * imag[:, 0]
        chart += (
            off[:, 0] * imag[:, 1] - off[:, 1] * imag[:, 0] + 1j * (real[:, 0] * off[:, 1] - real[:, 1] * off[:, 0])
        ) / det
    return chart


def first_contact(shape: Shape, sideways: float) -> Array:
    """Return where a shape's origin is when it rises along Z and first meets the smooth skin [mm], shape (3,)."""
    x, y = np.meshgrid(np.linspace(-6.0, 6.0, 241), np.linspace(-6.0, 6.0, 241))
    x, y = x.ravel(), y.ravel()
    height = -10.0
    for _ in range(8):
        skin = places(FINGER, chart_below(x, y), 1.0)
        for _ in range(60):  # it rises by the smallest gap, which carries it past nothing
            gap = shape.gap(skin - [sideways, 0.0, height])[0]
            height += gap.min()
        best = int(gap.argmin())
        width = np.ptp(x) / 20
        around = np.linspace(-width, width, 41)
        x, y = (a.ravel() for a in np.meshgrid(x[best] + around, y[best] + around))
    return np.array([sideways, 0.0, height])


BALLS = {2.0: (1.0, 1.4), 3.0: (1.6, 2.0), 5.0: (1.9, 2.5), 12.0: (2.6, 3.4)}  # coarseness, half width
AROUND = (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)


def _families() -> tuple[Family, ...]:
    around = np.array([*AROUND[:3], 0.0, *AROUND[3:]])
    rows: list[Family] = [
        Family("plane", (("plane", Flat()),), 4.0, 4.0, 5.0, tuple(3.6 * around), tuple(4.2 * np.array(AROUND)))
    ]
    for radius, (coarseness, half) in BALLS.items():
        rows.append(
            Family(
                f"ball {radius:g}",
                ((f"ball {radius:g} mm", Ball(radius)),),
                coarseness,
                half,
                half,
                tuple(1.1 * half * around),
                tuple(1.1 * half * np.array(AROUND)),
                depths=DEPTHS[:1] if radius == 2.0 else DEPTHS,
                reach=0.15,
            )
        )
    for x in SIDEWAYS:
        edges = tuple((f"edge {angle} degrees at {x:g} mm", Edge(angle)) for angle in (90, 60, 120))
        probes = (-1.6, -0.8, -0.3, 0.0, 0.3, 0.8, 1.6)
        across = tuple(4.0 * np.array(AROUND))
        rows.append(Family(f"edge {x:g}", edges, 1.0, 0.0, 5.0, probes, across, x, (0.0,), reach=0.1))
    probes = (-2.25, -1.5, -0.75, 0.0, 0.375, 0.9, 1.5)
    across = tuple(4.0 * np.array(AROUND))
    corners = tuple(rib * PERIOD + side * CORNER for rib in range(-2, 3) for side in (-1, 1))
    ribs = (("ribs", Ribs()),)
    rows.append(
        Family(
            "ribs", ribs, 1.6, 3.9, 5.0, probes, across, sharp=corners, grading=RIB_GRADING, reach=0.1, doubt=RIB_DOUBT
        )
    )
    return tuple(rows)


FAMILIES = {family.name: family for family in _families()}
