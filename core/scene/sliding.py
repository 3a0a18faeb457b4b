"""The sliding plane of [S1]: its motion, and a scene with it.

The plane is pressed into the pad to a depth, and is then drawn along the pad. The target of deformation matching comes
from contact with this plane, and never from contact with the pins of a device.

Source: [S1] IV.A and eq. 19
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..parameters.material import FRICTION
from .tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene, sample_frames

STROKE = 0.02  # [m] amplitude R of the movement along the pad. Source: [S1] IV.A
ANGULAR_VELOCITY = np.pi / 4  # [rad/s] omega of this movement, for a period of 8 s. Source: [S1] IV.A
FPS = Fraction(24)  # frames per second
SETTLE = 0.5  # [s] time of pressing and coming to rest before the movement; [S1] waits for 0.42 s
PRESS = 0.25  # [s] time of pressing, at the start of SETTLE
SLIDE = 2.0  # [s] duration of the movement along the pad. Source: [S1] IV.A
DEPTHS = (0.5e-3, 1.0e-3, 1.5e-3, 2.0e-3)  # [m] depths to which the plane is pressed. Source: [S1] IV.A
FRICTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # coefficients of friction. Source: [S1] V.A
# [rad] directions of the movement along the pad. Source: [S1] V.B
DIRECTIONS = tuple(float(np.radians(a)) for a in range(0, 360, 10))
RATE = 240.0  # [Hz] rate of the samples. Source: [S1] IV.C


def plane_offset(times: Array, depth: float, direction: float) -> Array:
    """Return the plane's origin at each time [m], shape (n, 3).

    The origin is on the upper face. The coordinate of the origin along `direction` is l(t) - l(0) with l = -R cos(wt)
    and t counted from the end of `SETTLE`.

    Args:
        times: times [s], shape (n,).
        depth: final penetration of the undeformed pad [m].
        direction: direction of the movement, see `sliding_plane` [rad].
    """
    share = np.clip(times / PRESS, 0.0, 1.0)
    height = -0.2e-3 + (depth + 0.2e-3) * share * share * (3.0 - 2.0 * share)  # the plane starts 0.2 mm below the pad
    along = STROKE * (1.0 - np.cos(ANGULAR_VELOCITY * np.maximum(times - SETTLE, 0.0)))
    return np.column_stack([along * np.cos(direction), along * np.sin(direction), height])


def sliding_plane(
    depth: float = 2.0e-3,
    friction: float = FRICTION,
    direction: float = 0.0,
    *,
    devices: Sequence[DeviceUse] = (),
    slide: float = SLIDE,
    rate: float = RATE,
) -> TactileScene:
    """Return a scene of one finger and the sliding plane.

    The plane comes in along the pad's normal, rests, and is then drawn along the pad as -R cos(wt).

    Args:
        depth: penetration of the undeformed pad [m].
        friction: Coulomb coefficient.
        direction: direction of the movement in the pad's plane, from +X (the finger's right) to +Y (the tip) [rad].
        devices: devices on the finger.
        slide: duration of the movement [s]; the scene begins `SETTLE` before it.
        rate: samples per second [Hz].
    """
    last = 1 + int(np.ceil((SETTLE + slide) * FPS))
    frames, times = sample_frames(FPS, (1, last), rate)
    moved = plane_offset(times, depth, direction)
    return TactileScene(
        name=f"Sliding plane {1e3 * depth:g} mm, friction {friction:g}, {np.degrees(direction):.0f} deg",
        fps=FPS,
        frame_range=(1, last),
        rate=rate,
        fingers=(Finger("Index", tuple(devices)),),
        bodies=(Body("Plane", _slab(), {"friction": friction}),),
        screens=(),
        chunks=[Chunk(frames, times, _poses(np.zeros_like(moved)), _poses(moved), np.zeros((0, len(times), 4, 4)))],
    )


def _slab() -> Mesh:
    """Return a slab below z = 0, large enough for the whole movement."""
    half, thick = 0.1, 0.02
    corners = [(x, y, z) for z in (-thick, 0.0) for y in (-half, half) for x in (-half, half)]
    quads = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6))
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Mesh(np.array(corners), np.array(triangles, dtype=np.int32))


def _poses(offsets: Array) -> Array:
    poses = np.zeros((1, len(offsets), 4, 4))
    poses[:] = np.eye(4)
    poses[0, :, :3, 3] = offsets
    return poses
