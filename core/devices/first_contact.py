"""First contact of a disc with the skin, and calibration of mounts by it."""

from __future__ import annotations

from dataclasses import replace

from ..arrays import Array
from .disc import DiscContact
from .disc_device import DiscDevice
from .disc_pose import placed
from .thimble import Thimble


def first_contact(device: DiscDevice, contact: DiscContact, pitch: float = 0.0, roll: float = 0.0) -> float:
    """Return the distance z at which the disc first touches the skin [m].

    The skin is undeformed.

    Args:
        device: the device.
        contact: contact of the device's disc with the skin.
        pitch, roll: tilt of the disc [rad].
    """
    z = 0.0
    # The first step would be exact without the rounded rim, which shifts a little along the skin when z changes.
    for _ in range(3):
        pose = placed(device, device.pose((pitch, roll, z)))
        gap = float(contact.gap(pose).min())
        z -= gap / -float(pose.shift[:, 2] @ pose.normal)
    return z


def calibrated(device: Thimble, contact: DiscContact, felt: Array) -> Thimble:
    """Return a thimble with its mount calibrated to a person.

    The mount is shifted along the base's axis. The disc of the model then first touches at the servo angles at which
    the person first felt the disc.

    Args:
        device: the thimble.
        contact: contact of the thimble's disc with the person's skin.
        felt: servo angles from neutral at the person's first contact [rad], shape (3,).

    Raises:
        DermisError: no pose of the platform has these angles.

    Source: [S0] 7.2, 'the angles and normal distance of first contact with each subject's finger pad'
    """
    neutral = (0.0, 0.0, first_contact(device, contact))
    pitch, roll, distance = device.forward(felt, neutral).tolist()
    mount = device.mount.copy()
    mount[:3, 3] -= mount[:3, 2] * (distance - first_contact(device, contact, pitch, roll))
    return replace(device, mount=mount)
