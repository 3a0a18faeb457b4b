"""Retraction: the safe pose of a worn device, clear of whichever finger is in it.

The rules were set before any pose was looked at:

* CLEAR: in the safe pose the platform stands at least this far below the pad of the thickest finger among the skins
  that ship. Devices sit on the nail, so a finger thicker than the one that a preset was made for hangs lower by the
  difference.
* On the way there, all channels together, the platform never presses deeper than where it started, by more than
  0.05 mm.

A servo's end of range is not used up: a horn fits every 15 degrees (a spline of 24 teeth), so a calibration moves a
pose by up to 7.5, and the safe pose with it.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from . import cable_platform, hexapod, thimble
from .coupling import coupling_of
from .spec import DeviceSpec

FITTED = 13.0e-3  # [m] thickness of the finger that the platforms' presets were made for, nail to pad
THICKEST = 18.0e-3  # [m] of the skins that ship: a large thumb
CLEAR = 2.0e-3  # [m]


def clearance(spec: DeviceSpec, commands: Array) -> float:
    """Return how far the platform stays below the thickest finger [m]; inf for devices that have none.

    Args:
        commands: commands of every channel with an actuator [SI], shape (channels,); those of the new motors if motors
            are coupled.

    Raises:
        DermisError: no pose of the platform has these commands.
    """
    if spec.kind == "thimble":
        device = thimble.mechanism(spec)
        x = device.forward(commands, (0.0, 0.0, thimble.reference_distance(spec, device)))
        place = device.in_finger(device.pose(x))
        return _below(place[:3, 2], place[:3, 3], device.disc_radius)
    if spec.kind not in ("cable_platform", "hexapod"):
        return np.inf
    platform = (cable_platform if spec.kind == "cable_platform" else hexapod).mechanism(spec)
    coupling = coupling_of(spec)
    original = commands if coupling is None else coupling.original(commands)
    pose = platform.carry(original[None], platform.rest_poses(1))
    return _below(pose.rotation[0, :, 2], pose.centre[0], platform.disc_radius)


def _below(normal: Array, centre: Array, radius: float) -> float:
    """Return how far the highest point of a disc lies below the lowest of the thickest finger [m]."""
    highest = centre[2] + radius * float(np.hypot(normal[0], normal[1]))
    return float(-(THICKEST - FITTED) - highest)
