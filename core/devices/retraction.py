"""Retraction: clearance between a worn device's safe pose and a finger.

Two rules hold for each safe pose. They were set before any pose was computed:

* In the safe pose, the platform is at least `CLEAR` below the pad of the thickest finger among the shipped skins.
  Devices are mounted on the nail, so a thicker finger than that of the preset extends lower by the difference.
* On the way there, with all channels moving together, the platform never presses more than 0.05 mm deeper than at the
  start.

Safe poses keep a margin to the ends of the servos' ranges. A servo horn can be mounted every 15 degrees (a spline of 24
teeth), so a calibration may shift all poses by up to 7.5 degrees.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from . import cable_platform, hexapod, thimble
from .coupling import coupling_of
from .spec import DeviceSpec

FITTED = 13.0e-3  # thickness from nail to pad of the finger for which the platforms' presets are made [m]
THICKEST = 18.0e-3  # largest thickness among the shipped skins, that of a large thumb [m]
CLEAR = 2.0e-3  # least clearance [m]


def clearance(spec: DeviceSpec, commands: Array) -> float:
    """Return the distance of the platform below the thickest finger [m].

    It is inf for devices without a platform.

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
    """Return the distance between a disc and the thickest finger [m].

    It is that from the highest point of the disc to the lowest point of the finger.
    """
    highest = centre[2] + radius * float(np.hypot(normal[0], normal[1]))
    return float(-(THICKEST - FITTED) - highest)
