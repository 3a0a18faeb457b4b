"""Where a body is, sample after sample, in the frame of a finger that keeps still; and how all is carried about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .bodies import draw_body, mesh_of
from .case import Dice, Values
from .contacts import Felt, Thing, feel, first_touch, most_force, skin_of

Array = NDArray[np.float64]
ALMOST = 0.499  # incompressible: steps of tissue that stiffens come to an end there, but not always to the same one


def draw_skin(dice: Dice) -> Values:
    """Draw a finger's skin, and how its contact is solved."""
    contact = dice.one_of("points", "nodes")
    shipped = contact == "points" or dice.rng.uniform() < 0.3
    tissue = dice.one_of(*["linear"] * 5, "neo_hookean") if shipped else "linear"
    drawn = {
        "contact": contact,
        "level": dice.one_of(*["draft"] * 14, "standard"),
        "poisson": 0.48 if shipped else dice.one_of(0.0, 0.2, 0.3, 0.4, 0.45, 0.49, 0.499),
        "young": dice.decades(1e2, 1e8),
        "tissue": tissue,
    }
    aside = dice.rng.spawn(1)[0]  # what is drawn after it stays what it was
    if not shipped and drawn["poisson"] < ALMOST and aside.uniform() < 1.0 / 6.0:
        drawn["tissue"] = "neo_hookean"
    return drawn


def draw_touch(dice: Dice, kinds: tuple[str, ...], deepest: float = 6e-3, aside: float = 3e-3) -> Values:
    """Draw a skin, a body, and where it is pressed to which depth [m]."""
    return {
        **draw_skin(dice),
        **draw_body(dice, kinds),
        "depth": dice.between(0.05e-3, deepest),
        "tilt": dice.between(-25.0, 25.0),
        "roll": dice.between(-25.0, 25.0),
        "x": dice.between(-aside, aside),
        "y": dice.between(-aside, aside),
    }


PLAIN: Values = {
    "tissue": "linear",
    "level": "draft",
    "young": 1e5,
    "slivers": 0,
    "friction": 0.0,
    "tilt": 0.0,
    "roll": 0.0,
    "x": 0.0,
    "y": 0.0,
    "stiffness": 0.0,
    "mode": "animated",
    "turning": 0.0,
    "growing": 1.0,
    "others": 0,
}


def turned(pitch: float, roll: float, yaw: float = 0.0) -> Array:
    """Return a rotation about X, then Y, then Z [degrees], shape (3, 3)."""
    (cp, cr, cy), (sp, sr, sy) = (f(np.radians([pitch, roll, yaw])) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_y = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1.0]])
    return np.asarray(about_z @ about_y @ about_x, np.float64)


def poses(places: Array, turn: Array | None = None) -> Array:
    """Return poses of places [m], shape (n, 3), and one rotation (3, 3) or one each, shape (n, 4, 4)."""
    found = np.tile(np.eye(4), (len(places), 1, 1))
    found[:, :3, 3] = places
    if turn is not None:
        found[:, :3, :3] = turn
    return found


class Press:
    """A drawn touch: its skin, its body, and the place at which that first meets the pad.

    Attributes:
        height: of the body where it first meets the pad [m]; NaN where it passes it.
    """

    def __init__(self, values: Values) -> None:
        self.values = values
        v = values
        self.skin = skin_of(str(v["level"]), float(v["poisson"]), str(v["tissue"]), float(v["young"]))
        self.mesh, self.turn = mesh_of(v), turned(float(v["tilt"]), float(v["roll"]))
        self.at = np.array([float(v["x"]), float(v["y"])])
        self.height = first_touch(self.mesh, self.turn, self.at)
        self.parameters = {"contact": str(v["contact"]), "tissue": str(v["tissue"])}

    @property
    def meets(self) -> bool:
        """Whether the body meets the pad at all."""
        return bool(np.isfinite(self.height))

    def thing(self, offsets: Array, friction: float = 0.0, **more: float) -> Thing:
        """Return the body, moved from where it first meets the pad by offsets [m], shape (n, 3)."""
        places = np.array([*self.at, self.height]) + offsets
        return Thing("body", self.mesh, poses(places, self.turn), {"friction": friction, **more})

    def feel(self, things: Sequence[Thing], world: Array | None = None, **more: object) -> Felt:
        """Follow the things with a finger that keeps still, all of it carried to where a pose (4, 4) brings it."""
        count = len(things[0].poses)
        world = np.eye(4) if world is None else world
        carried = [replace(thing, poses=world @ thing.poses) for thing in things]
        return feel(self.skin, np.tile(world, (count, 1, 1)), carried, self.parameters, **more)  # type: ignore[arg-type]

    def most(self, far: float, friction: float = 0.0) -> float:
        """Return a force beyond reason [N] of a path that goes so far in all [m]."""
        v = self.values
        return most_force(float(v["young"]), float(v["poisson"]), far, friction)


def pressing(depth: float, count: int, before: float = 0.2e-3) -> Array:
    """Return offsets of a press from before first contact to a depth [m], shape (count, 3)."""
    rise = np.linspace(-before, depth, count)
    return np.stack([np.zeros(count), np.zeros(count), rise], axis=1)


def wander(depth: float, slide: float, way: float, length: float, start: float, count: int) -> Array:
    """Return offsets along a way that is walked to and fro: down onto the pad, along it, and up again.

    Args:
        slide: along the pad [m], in direction `way` [rad]. length: of a sample's step [m]. start: on the way [m].
    """
    before = 0.5e-3
    corners = np.array([[0.0, -before], [0.0, depth], [slide, depth], [slide, -before]])
    ends = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1))])
    whole = ends[-1]
    at = np.mod(start + length * np.arange(count), 2.0 * whole)
    at = np.where(at > whole, 2.0 * whole - at, at)
    along, rise = (np.interp(at, ends, corners[:, k]) for k in (0, 1))
    return np.stack([along * np.cos(way), along * np.sin(way), rise], axis=1)


def dragged(depth: float, slide: float, length: float, count: int) -> Array:
    """Return offsets of a press to a depth that is then dragged to and fro [m], shape (count, 3).

    It turns at samples with even numbers, so that half of the samples know the same way.

    Args:
        slide: to either side, along X [m]. length: of a sample's step, at most [m].
    """
    before = 0.3e-3
    corners = [np.array([0.0, 0.0, -before]), np.array([0.0, 0.0, depth])]
    out = [corners[0]]
    while len(out) < count:
        legs = 2 * int(np.ceil(np.linalg.norm(corners[-1] - corners[-2]) / (2.0 * length) - 1e-9))
        out += [corners[-2] + (corners[-1] - corners[-2]) * k / legs for k in range(1, legs + 1)]
        corners.append(np.array([slide if len(corners) % 2 == 0 else -slide, 0.0, depth]))
    return np.array(out[:count])
