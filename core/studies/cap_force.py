"""Cap force: force of a shear tactor in its weakest direction.

It is computed for two rules of torque limits.

Source: [S3] section 3.1 with the corrections: both of its figures follow from one torque limit under two rules
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..devices.shear_tactor import ShearTactor
from ..devices.spec import DeviceSpec
from ..errors import DermisError

DIRECTIONS = 720  # number of points on the rim of the workspace at which the force is computed


@dataclass(frozen=True)
class CapForce:
    """Forces that the cap can exert in its weakest direction [N].

    Attributes:
        reference: force in the reference pose, if each motor's torque is limited by itself.
        anywhere: least such force in the workspace.
        reference_shared, anywhere_shared: the same forces if the root of the sum of squares of both torques is limited.
        place: position of the cap with the force `anywhere_shared` [m].
        direction: direction of this force, from the pad's +X [rad].
    """

    reference: float
    anywhere: float
    reference_shared: float
    anywhere_shared: float
    place: tuple[float, float]
    direction: float


def cap_force(spec: DeviceSpec) -> CapForce:
    """Return the force of a shear tactor's cap in its weakest direction.

    A force F on the cap requires the torques J^T F, where J is the Jacobian of the rhombus. Both columns of J have the
    length of a link, and the angle between them is that between the rods. If each torque is limited by itself, the
    weakest direction is that of a column. With the shared limit it is that of the largest singular value of J.

    Raises:
        DermisError: the device is not a shear tactor.
    """
    if spec.kind != "shear_tactor":
        raise DermisError("not a shear tactor", where=f"device preset '{spec.key}'", value=spec.kind)
    tactor = ShearTactor.from_spec(spec)
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    rim = tactor.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    places = np.vstack([np.zeros((1, 2)), rim])
    turned = tactor.inverse(places) + np.array([tactor.heading - np.pi / 4.0, tactor.heading + np.pi / 4.0])
    jacobian = tactor.link * np.stack([-np.sin(turned), np.cos(turned)], axis=1)  # (n, 2 axes, 2 motors)
    alone = tactor.torque / np.linalg.norm(jacobian, axis=1).max(axis=1)
    left, size, _ = np.linalg.svd(jacobian)
    shared = tactor.torque / size[:, 0]
    worst = int(shared.argmin())
    axis = left[worst, :, 0]
    return CapForce(
        float(alone[0]),
        float(alone.min()),
        float(shared[0]),
        float(shared[worst]),
        (float(places[worst, 0]), float(places[worst, 1])),
        float(np.arctan2(axis[1], axis[0]) % np.pi),
    )


def text(found: CapForce, spec: DeviceSpec) -> str:
    """Return the forces for a terminal."""
    torque, radius = 1e3 * float(spec.value("torque_limit")), 1e3 * ShearTactor.from_spec(spec).radius
    x, y = (1e3 * v for v in found.place)
    return "\n".join(
        [
            f"{spec.name}: force on the cap in its weakest direction [N], motors limited to {torque:g} mN m",
            f"{'':44}reference pose   anywhere within {radius:g} mm",
            f"{'each torque limited by itself':44}{found.reference:14.2f}   {found.anywhere:.2f}",
            f"{'root of the sum of squares limited':44}{found.reference_shared:14.2f}   {found.anywhere_shared:.2f}",
            f"weakest of all: cap at ({x:.2f}, {y:.2f}) mm, along {np.degrees(found.direction):.0f} degrees from +X",
        ]
    )
