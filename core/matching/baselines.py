"""Baselines of [S0]: the same search for the total force alone, and a plane fitted to the contact.

Force only replaces the stress descriptor by the sum of the contact forces and leaves the rest as it is. The geometric
method lays the platform's plane on the contact surface of the virtual touch, as [S0] describes Perez et al. 2017: it
knows neither stiffness nor friction.

Source: [S0] 7.2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice, scale_of
from ..devices.disc_pose import placed
from ..devices.thimble import Thimble
from ..skin.model import SkinModel
from ..skin.stimulus import Stimulus
from .box_descent import descend_in_box
from .gauss_newton import Minimum, ServoLimits, minimise

HOLD = 1e-2  # weight of staying where the platform was, relative to the contact's own: decides tilts a line leaves open


def total_force(count: int) -> Array:
    """Return the observation matrix that sums the forces on `count` pad nodes, shape (3, 3 count)."""
    return np.tile(np.eye(3), (1, count))


@dataclass(frozen=True, eq=False)
class ContactPatch:
    """The part of the skin that a virtual touch presses on.

    Attributes:
        points: deformed, on the touched surface, in the finger's frame [m], shape (k, 3).
        areas: area of skin around each point [m^2], shape (k,).
    """

    points: Array
    areas: Array


def contact_patch(skin: SkinModel, force: Array, amounts: Array | None = None) -> ContactPatch:
    """Return the touched part of the skin for contact forces [N], shape (m, 3), and amounts as of `Stimulus`."""
    force = np.asarray(force, np.float64).reshape(-1, 3)
    touched = np.flatnonzero(force.any(axis=1))
    moved = Stimulus(skin, force, None, amounts).pad_displacement if len(touched) else np.zeros_like(force)
    return ContactPatch((skin.positions + moved)[touched], skin.areas[touched])


def fit_plane(device: DiscDevice, patch: ContactPatch, start: Array, limits: ServoLimits | None = None) -> Minimum:
    """Return the configuration whose plane is nearest to a contact patch, in the mean square over its area.

    Args:
        start: configuration before, which also settles the freedoms that the patch leaves open (a line or a point).

    Raises:
        DermisError: the start is outside the servos' range.
    """
    weights = np.sqrt(patch.areas / patch.areas.sum())
    scale = scale_of(device)
    # a tilt by one radian moves the rim of the patch by its size: both parts of the sum are lengths
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
    if not isinstance(device, Thimble):
        return descend_in_box(evaluate, target, start, device, limits, max_evaluations=60)
    return minimise(evaluate, target, start, device, limits, tolerance=1e-8, max_iterations=30, max_evaluations=60)
