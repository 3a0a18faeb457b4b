"""Compute the pieces of a device's twin over frames: poses and colours.

Shapes are those that the view draws. Pieces are rigid, except bars and cables, which may stretch. These do not turn
about their own length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np

from .._core import Array, DermisError
from ..devices import active_presets, platform_devices
from ..preview.rows import Row
from ..viewport import platform_twin, tactor_twin, thimble_twin, twins
from ..viewport.parts import Colour, Part, across, bar, disc, heat, joined, placed

Z = np.array([0.0, 0.0, 1.0])


class Piece(NamedTuple):
    """A piece of a device.

    Attributes:
        shape: shape in the piece's own frame [m]; its colours are not used.
        poses: matrices to the finger's frame, with scale, shape (n, 4, 4), or (1, 4, 4) for a piece at rest.
        colours: colours over the frames, shape (n, 4), or (1, 4) for one that does not change.
        glows: whether it is light, not a body.
    """

    name: str
    shape: Part
    poses: Array
    colours: Array
    glows: bool = False


def pieces_of(scene: bpy.types.Scene, finger: bpy.types.Object, rows: Sequence[Row]) -> list[Piece]:
    """Return the pieces of a device from its state at each frame.

    A device that is drawn only as values has none.

    Raises:
        DermisError: the preset or commands have no pose, or a skin is still being made.
    """
    made: dict[str, Callable[[], list[Piece]]] = {
        "tactor": lambda: _tactor(rows, float(scene.dermis.twin_exaggeration)),
        "screen": lambda: _screen(rows),
        "thimble": lambda: _thimble(finger, rows),
        "platform": lambda: _platform(finger, rows),
    }
    return made[rows[0].drawn]() if rows[0].drawn in made else []


def _tactor(rows: Sequence[Row], exaggeration: float) -> list[Piece]:
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :2, 3] = [(r.values["tactor_x"], r.values["tactor_y"]) for r in rows]
    poses[:, :2, 3] *= exaggeration
    return [
        _still("Housing", tactor_twin.housing(), tactor_twin.HOUSING),
        Piece("Cap", tactor_twin.cover(), poses, _one(tactor_twin.CAP)),
        Piece("Tactor", tactor_twin.pin(), poses, _one(tactor_twin.TACTOR)),
    ]


def _screen(rows: Sequence[Row]) -> list[Piece]:
    """Return a field whose width and brightness grow with its amplitude.

    At an amplitude of 0 it is not visible.
    """
    levels = np.clip([r.values["amplitude"] / r.full_scale("amplitude") for r in rows], 0.0, 1.0)
    wide = tactor_twin.FINGER + 9e-3 * levels
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = wide
    colours = np.array([heat(level) for level in levels.tolist()])
    colours[:, 3] = np.where(levels > 0.0, 0.25 + 0.6 * levels, 0.0)
    return [Piece("Field", disc(1.0, -0.05e-3, (1.0,) * 4, (1.0,) * 4), poses, colours, glows=True)]


def _thimble(finger: bpy.types.Object, rows: Sequence[Row]) -> list[Piece]:
    mounted = twins.mounted_mechanism(finger, rows[0].device)
    if mounted is None:
        raise DermisError("the finger's skin is still being made", where=f"finger '{finger.name}'")
    device, reference = mounted
    x, at = np.array([0.0, 0.0, reference]), []
    for row in rows:
        start = np.array([row.values.get(n, v) for n, v in zip(("pitch", "roll", "distance"), x.tolist(), strict=True)])
        at.append(thimble_twin.joints(device, thimble_twin.servo_angles(row), start))
        x = at[-1].x
    poses = np.array([j.pose for j in at])
    servo, knee, end = (np.array([getattr(j, name) for j in at]) for name in ("servo", "knee", "platform"))
    warm = np.clip((np.array([thimble_twin.shares(r) for r in rows]) - thimble_twin.NEAR_LIMIT) / 0.15, 0.0, 1.0)
    arms = [bar(p, 0.5 * p, thimble_twin.ROD, thimble_twin.LINK) for p in _local(end[0], poses[0])]
    pieces = [
        _still("Base", placed(thimble_twin.ring(device.base_radius), device.mount), thimble_twin.BASE),
        Piece("Disc", thimble_twin.disc(device.disc_radius), poses, _one(thimble_twin.DISC)),
        Piece("Disc Arms", joined(arms), poses, _one(thimble_twin.LINK)),
    ]
    for i in range(3):
        tones = _between(thimble_twin.LINK, thimble_twin.WARNING, warm[:, i])
        pieces.append(_rod(f"Crank {i + 1}", servo[:, i], knee[:, i], thimble_twin.CRANK, tones))
        pieces.append(_rod(f"Rod {i + 1}", knee[:, i], end[:, i], thimble_twin.ROD, _one(thimble_twin.LINK)))
    return pieces


def _platform(finger: bpy.types.Object, rows: Sequence[Row]) -> list[Piece]:
    spec = active_presets.spec_of(rows[0].device, "platform")
    skin = platform_devices.model_of(finger)
    if spec is None or skin is None:
        raise DermisError("the finger's skin is still being made", where=f"finger '{finger.name}'")
    at: list[platform_twin.State] = []
    before: tuple[Any, ...] = ()
    for row in rows:
        touching = row.contact is None or row.contact > 0.5
        now = (row.numbers.tobytes(), touching)
        at.append(at[-1] if now == before else platform_twin.state(spec, row.numbers, skin, touching))
        before = now
    first, poses = at[0], np.array([s.pose for s in at])
    ends = _local(first.joints, first.pose)
    hub = [platform_twin.rim(ends), *(bar(p, 0.55 * p, platform_twin.RIM, platform_twin.LINK, sides=4) for p in ends)]
    pieces = [
        _still("Base", platform_twin.rim(first.base), platform_twin.BASE),
        Piece("Disc", platform_twin.disc(first.radius), poses, _one(platform_twin.DISC)),
        Piece("Disc Arms", joined(hub), poses, _one(platform_twin.LINK)),
    ]
    joints, shares = np.array([s.joints for s in at]), np.array([s.share for s in at])
    cables = first.tension is not None
    name, half = ("Cable", platform_twin.CABLE) if cables else ("Leg", platform_twin.LEG)
    for i, start in enumerate(first.base):
        starts = np.tile(start, (len(at), 1))
        tones = np.array([heat(s) for s in shares[:, i].tolist()])
        pieces.append(_rod(f"{name} {i + 1}", starts, joints[:, i], half, tones))
        if cables:
            length = float(np.linalg.norm(joints[0, i] - start))
            coil = platform_twin.spring(np.zeros(3), length * Z)
            spring = _rod(f"Spring {i + 1}", starts, joints[:, i], half, _one(platform_twin.SPRING))
            spring.poses[:, :3, 2] /= length
            pieces.append(spring._replace(shape=coil))
    return pieces


def _rod(name: str, start: Array, end: Array, half: float, colours: Array) -> Piece:
    """Return a bar between two points of every frame, shapes (n, 3).

    The bar has length 1 along its own Z, and its poses stretch it.
    """
    poses = np.tile(np.eye(4), (len(start), 1, 1))
    poses[:, :3, 3], poses[:, :3, 2] = start, end - start
    side = None
    for pose in poses:
        along = pose[:3, 2] / max(float(np.linalg.norm(pose[:3, 2])), 1e-12)
        # The side of the frame before, rotated only as far as the bar's direction requires.
        side = across(along[None])[0][0] if side is None else side - (side @ along) * along
        side = side / np.linalg.norm(side)
        pose[:3, 0], pose[:3, 1] = side, np.cross(along, side)
    return Piece(name, bar(np.zeros(3), Z, half, (1.0,) * 4), poses, colours)


def _local(points: Array, pose: Array) -> Array:
    return (points - pose[:3, 3]) @ pose[:3, :3]


def _still(name: str, shape: Part, colour: Colour) -> Piece:
    return Piece(name, shape, np.eye(4)[None], _one(colour))


def _one(colour: Colour) -> Array:
    """Return the opaque colour of a body that does not change, shape (1, 4).

    The view may draw the body as transparent.
    """
    return np.array([[*colour[:3], 1.0]])


def _between(cold: Colour, hot: Colour, share: Array) -> Array:
    mixed = _one(cold) + share[:, None] * (_one(hot) - _one(cold))
    return mixed if share.any() else mixed[:1]
