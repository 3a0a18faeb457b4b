"""First contact: where the disc first meets the skin, and how the device sits on a person who says so."""

from __future__ import annotations

from dataclasses import replace

from ..arrays import Array
from .disc import DiscContact
from .disc_device import DiscDevice
from .disc_pose import placed
from .thimble import Thimble


def first_contact(device: DiscDevice, contact: DiscContact, pitch: float = 0.0, roll: float = 0.0) -> float:
    """Return the distance z [m] at which the disc, so tilted, first meets the undeformed skin."""
    z = 0.0
    for _ in range(3):  # exact at once but for the rim, which shifts a little with z
        pose = placed(device, device.pose((pitch, roll, z)))
        gap = float(contact.gap(pose).min())
        z -= gap / -float(pose.shift[:, 2] @ pose.normal)
    return z


def calibrated(device: Thimble, contact: DiscContact, felt: Array) -> Thimble:
    """Return the device mounted as it sits on a person, from the servo angles at which the disc is first felt.

    Args:
        felt: servo angles from neutral [rad], shape (3,), at the first contact that the person reports.

    The mounting moves along the base's axis until the model first touches in that very pose.

    Raises:
        DermisError: no pose of the platform has these angles.

    Source: [S0] 7.2, 'the angles and normal distance of first contact with each subject's finger pad'
    """
    neutral = (0.0, 0.0, first_contact(device, contact))
    pitch, roll, distance = device.forward(felt, neutral).tolist()
    mount = device.mount.copy()
    mount[:3, 3] -= mount[:3, 2] * (distance - first_contact(device, contact, pitch, roll))
    return replace(device, mount=mount)
