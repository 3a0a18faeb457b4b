"""Baselines of [S0]: matching the total force alone, and fitting a plane to the contact.

The method 'force' replaces the stress components by the sum of the contact forces; the search stays the same. The
method 'geometry' fits the platform's plane to the contact surface of the virtual touch, as [S0] describes Perez et al.
2017. It uses neither stiffness nor friction.

Source: [S0] 7.2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice, scale_of
from ..devices.disc_pose import placed
from ..skin.model import SkinModel
from ..skin.stimulus import Stimulus
from .descent import Descent
from .minimum import Minimum, ServoLimits

# Weight of the previous configuration relative to the contact. It decides tilts that a contact along a line leaves
# open.
HOLD = 1e-2


def total_force(count: int) -> Array:
    """Return the observation matrix that sums the forces on `count` pad nodes, shape (3, 3 count)."""
    return np.tile(np.eye(3), (1, count))


@dataclass(frozen=True, eq=False)
class ContactPatch:
    """Part of the skin on which a virtual touch presses.

    Attributes:
        points: positions of the deformed nodes that carry force, in the finger's frame [m], shape (k, 3).
        areas: area of skin around each point [m^2], shape (k,).
    """

    points: Array
    areas: Array


def contact_patch(skin: SkinModel, force: Array, amounts: Array | None = None) -> ContactPatch:
    """Return the part of the skin on which contact forces act.

    Args:
        skin: model of the skin.
        force: contact forces on the pad nodes [N], shape (m, 3).
        amounts: see `Stimulus.given`, shape (3 m,).
    """
    force = np.asarray(force, np.float64).reshape(-1, 3)
    touched = np.flatnonzero(force.any(axis=1))
    moved = Stimulus(skin, force, None, amounts).pad_displacement if len(touched) else np.zeros_like(force)
    return ContactPatch((skin.positions + moved)[touched], skin.areas[touched])


def fit_plane(device: DiscDevice, patch: ContactPatch, start: Array, limits: ServoLimits | None = None) -> Minimum:
    """Fit the plane of a device's disc to a contact patch.

    The mean square distance over the patch's area is minimised.

    Args:
        device: the device.
        patch: the contact patch.
        start: previous configuration, shape (n,). It also decides the freedoms that a patch along a line or at a point
            leaves open.
        limits: limits of the joints; None for their whole range.

    Raises:
        DermisError: the start is outside the servos' range.
    """
    weights = np.sqrt(patch.areas / patch.areas.sum())
    scale = scale_of(device)
    # A tilt of one radian moves the rim of the patch by about the disc's radius, so that all residuals are lengths.
    hold = HOLD * device.disc_radius / scale

    def evaluate(x: Array) -> tuple[Array, Array]:
        pose = placed(device, device.pose(x))
        arm, normal = patch.points - pose.centre, pose.normal
        gap = weights * (arm @ normal)
        slope = np.empty((len(gap), len(x)))
        for j in range(len(x)):
            slope[:, j] = weights * (arm @ np.cross(pose.spin[j], normal) - pose.shift[:, j] @ normal)
        return np.concatenate([gap, hold * x]), np.concatenate([slope, np.diag(hold)])

    target = np.concatenate([np.zeros(len(patch.points)), hold * start])
    return Descent(device, bounded=True, tolerance=1e-8, most_steps=30, most_evaluations=60)(
        evaluate, target, start, limits
    )
