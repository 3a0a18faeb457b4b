"""A drawn touch of a solid: where it is, how it moves from first contact on, and what a scene tells of that."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from core.scene.tactile_scene import Body, Mesh
from core.skin.surface_store import smooth_pad
from core.surface.gap import Surface
from tests.pad_cells import descendants

from .case import Dice, Values
from .contacts import skin_of
from .paths import poses, turned
from .setups import COMMANDS, Setup
from .solids import SHAPES, parts_of

Array = NDArray[np.float64]
RATE = 240.0  # [Hz]
SLOWEST_RATE = 60.0  # ways turn at samples of it, so that every rate knows all of a way
ABOVE = 0.3e-3  # of first contact, where a way begins [m]
CLEAR = 2e-3  # above first contact, where a tilted or stepped solid does not yet touch elsewhere [m]
LOOKS = 24  # times at which stress is compared
DEPTHS = (0.3e-3, 1.2e-3, 2.0e-3)  # of probes [m]
ACROSS, ALONG = np.linspace(-1.8e-3, 1.8e-3, 7), (-0.4e-3, 0.4e-3)  # probes about the middle of a way [m]
COARSE = 0.3e-3  # of the points that are asked first, half of the way from one to the next [m]
EXACT = 1e-8  # to which first contact is found [m]


def draw(dice: Dice) -> Values:
    """Draw a touch: shapes and friction in turn, seed after seed, the rest at random; one in four in line with the
    finger's axes, as scenes are modelled."""
    rounds, number = divmod(dice.seed, len(SHAPES))
    drawn = {
        "shape": dice.in_turn(*SHAPES),
        "friction": (0.0, 0.3, 0.6)[(number + rounds) % 3],
        "contact": dice.one_of("points", "points", "points", "nodes"),
        "level": "draft",
        "path": dice.one_of("slide", "slide", "zigzag", "press"),
        "speed": dice.decades(20e-3, 200e-3),
        "depth": dice.between(0.4e-3, 1.5e-3),
        "slide": dice.between(2e-3, 4e-3),
        "way": dice.between(-180.0, 180.0),
        "x": dice.between(-2.5e-3, 2.5e-3),
        "y": dice.between(-2.5e-3, 2.5e-3),
        "tilt": dice.between(-10.0, 10.0),
        "roll": dice.between(-10.0, 10.0),
        "yaw": dice.between(-180.0, 180.0),
        "devices": dice.one_of(0, 0, 1),
        "random": dice.whole(0, 10**6),
    }
    in_line = dict.fromkeys(("x", "y", "tilt", "roll", "yaw"), 0.0)
    return drawn | dice.one_of({}, {}, {}, in_line)


def draw_without_friction(dice: Dice) -> Values:
    """Draw the same touch without friction."""
    return {**draw(dice), "friction": 0.0}


class Touch:
    """A drawn touch.

    Args:
        values: see `draw`.
        parts: of the solid, in place of those that its name stands for.
    """

    def __init__(self, values: Values, parts: list[Mesh] | None = None) -> None:
        self.values = values
        self.parts = parts_of(str(values["shape"])) if parts is None else parts
        self.turn = turned(*(float(values[name]) for name in ("tilt", "roll", "yaw")))
        self.at = np.array([float(values["x"]), float(values["y"])])
        self.depth, self.speed = float(values["depth"]), float(values["speed"])
        way = np.radians(float(values["way"]))
        self.slide = float(values["slide"]) * np.array([np.cos(way), np.sin(way)])

    @cached_property
    def place(self) -> Array:
        """Where the solid's origin is when it first meets the smooth skin, to .1 um [m], shape (3,)."""
        names = ("shape", "tilt", "roll", "yaw", "x", "y")
        return np.array([*self.at, _first_contact(*(self.values[name] for name in names))])

    def way(self) -> Array:
        """Return the turning points of the drawn way, from first contact [m], shape (k, 3)."""
        start, deep = [0.0, 0.0, -ABOVE], [0.0, 0.0, self.depth]
        far = [*self.slide, self.depth]
        ways = {
            "press": [start, deep, start],
            "slide": [start, deep, far],
            "zigzag": [start, deep, far, [*(-0.5 * self.slide), self.depth]],
        }
        return np.array(ways[str(self.values["path"])])

    def offsets(self, way: Array, rate: float, speed: float | None = None) -> Array:
        """Return a way's samples [m], shape (n, 3): straight legs at the drawn speed, or as much slower as it takes to
        turn at samples of the slowest rate."""
        lengths = np.linalg.norm(np.diff(way, axis=0), axis=1) / (self.speed if speed is None else speed)
        ends = (
            np.concatenate([[0.0], np.cumsum(np.maximum(np.ceil(lengths * SLOWEST_RATE - 1e-9), 1.0))]) / SLOWEST_RATE
        )
        times = np.arange(round(ends[-1] * rate) + 1) / rate
        return np.stack([np.interp(times, ends, way[:, k]) for k in range(3)], axis=1)

    def setup(self, rate: float = RATE, way: Array | None = None, speed: float | None = None) -> Setup:
        """Return the touch as a scene tells it.

        Args:
            way: turning points in place of the drawn ones [m], shape (k, 3). speed: in place of the drawn one [m/s].
        """
        v, way = self.values, self.way() if way is None else way
        offsets = self.offsets(way, rate, speed)
        material = {"friction": float(v["friction"])}
        bodies = tuple(
            (Body(f"part {k}", part, material), poses(self.place + offsets, self.turn))
            for k, part in enumerate(self.parts)
        )
        told = {"contact": str(v["contact"]), "skin_level": str(v["level"])}
        devices = tuple(COMMANDS) if int(v["devices"]) else ()
        duration = (len(offsets) - 1) / rate
        grid = SLOWEST_RATE if duration * SLOWEST_RATE >= LOOKS / 2 else RATE  # so that rates share as many as can be
        count = int(duration * grid + 1e-6) + 1
        looked = np.arange(0, count, -(-count // LOOKS)) / grid
        return Setup(rate, bodies, told, devices, self.probes(way[:, :2].mean(axis=0)), looked)

    def probes(self, offset: Array) -> Array:
        """Return 42 points in the tissue about where the solid is [m], shape (42, 3)."""
        pad = smooth_pad(skin_of(str(self.values["level"])))
        assert pad is not None
        x, y = (a.ravel() for a in np.meshgrid(ACROSS, ALONG, indexing="ij"))
        above = np.stack([self.at[0] + offset[0] + x, self.at[1] + offset[1] + y], axis=1)
        cells = pad.cells.positions[pad.chart.starts[2] : pad.chart.starts[3]]
        nearest = np.linalg.norm(cells[None, :, :2] - above[:, None], axis=2).argmin(axis=1)
        skin = pad.chart.surface(pad.chart.project(cells[nearest])[0])
        return np.concatenate([skin.positions - depth * skin.normals for depth in DEPTHS])


@lru_cache(maxsize=256)
def _first_contact(shape: str, tilt: float, roll: float, yaw: float, x: float, y: float) -> float:
    return round(first_contact(parts_of(shape), turned(tilt, roll, yaw), np.array([x, y])), 7)


def first_contact(parts: list[Mesh], turn: Array, at: Array) -> float:
    """Return the height at which a solid that comes from below first meets the smooth skin [m].

    It rises by the smallest gap, which can never carry it past a point, over ever more points where it is closest:
    those of the finest cells of the pad lie .1 mm apart, and an edge is felt between them.

    Raises:
        ValueError: it passes the pad.
    """
    pad = smooth_pad(skin_of())
    assert pad is not None
    surfaces, starts = [Surface.build(part.vertices, part.triangles) for part in parts], pad.chart.starts
    top = max(float((part.vertices @ turn.T)[:, 2].max()) for part in parts)
    cells = np.arange(starts[1], starts[2])
    points = pad.cells.positions[cells]
    height = _risen(surfaces, points, turn, at, float(points[:, 2].min()) - top - EXACT, 0.1)
    near = cells[_gaps(surfaces, points, turn, at, height) < 2.0 * COARSE]
    fine = descendants(pad.chart, near, len(starts) - 2)[0]
    some, half = pad.chart.places[fine], 2.0 * float(pad.chart.halves[fine].max())
    reach, roots = COARSE, slice(starts[0], starts[1])
    for _ in range(6):
        points = pad.chart.surface(some).positions
        height = _risen(surfaces, points, turn, at, height - reach, height)
        best = some[np.argsort(_gaps(surfaces, points, turn, at, height))[:20]]
        steps = np.stack(np.meshgrid(*[np.linspace(-half, half, 5)] * 2), axis=2).reshape(-1, 2)
        some, half, reach = (best[:, None] + steps).reshape(-1, 2), half / 2.0, reach / 2.0
        apart = np.abs(some[:, None] - pad.chart.places[roots]) - pad.chart.halves[roots]
        some = some[(apart <= 1e-12).all(axis=2).any(axis=1)]  # the chart goes on beyond the pad's rim
    return height


def _gaps(surfaces: list[Surface], points: Array, turn: Array, at: Array, height: float) -> Array:
    seen = (points - [*at, height]) @ turn
    return np.min([surface.query(seen).gap for surface in surfaces], axis=0)


def _risen(surfaces: list[Surface], points: Array, turn: Array, at: Array, height: float, highest: float) -> float:
    """Return the height at which the lowest gap is closed [m], from one at which it is open up to the highest."""
    while height < highest:
        gap = _gaps(surfaces, points, turn, at, height)
        lowest = float(gap.min())
        if lowest <= EXACT:
            return height
        points = points[gap <= highest - height]  # others stay open
        height += lowest
        if not len(points):
            break
    if highest >= 0.1:
        raise ValueError("the solid does not meet the pad")
    return highest


def with_parts(touch: Touch, parts: list[Mesh], setup: Setup) -> Setup:
    """Return a setup with other meshes of the same solid."""
    bodies = zip(parts, setup.bodies, strict=True)
    return replace(setup, bodies=tuple((replace(body, mesh=part), way) for part, (body, way) in bodies))
