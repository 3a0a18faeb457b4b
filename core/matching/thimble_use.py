"""Use of a thimble on one finger: mechanism, method and learned model.

The mechanism is mounted as on the person who wears it.

Bake, preview, plot and adaptation all call `prepare`, so all of them use the same device.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices import hexapod
from ..devices.coupling import coupling_of
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice, seated
from ..devices.disc_pose import placed
from ..devices.first_contact import calibrated, first_contact
from ..devices.retraction import CLEAR
from ..devices.safe_state import safe_state
from ..devices.servo_limits import SERVOS
from ..devices.six_legs import SixLegs
from ..devices.spec import DeviceSpec
from ..devices.thimble import Thimble, mechanism, reference_distance
from ..errors import DermisError, Finding
from ..parameters.device import DEVICE
from ..skin.model import SkinModel
from ..surrogate.forward import ForwardModel
from ..surrogate.soundness import try_out
from ..surrogate.store import contact_of, errors_by_law, load, place_of, tissue_of
from ..surrogate.surrogate import Surrogate

METHODS = DEVICE["thimble_method"].keys
LOOKUP = "lookup"  # the method of platforms that takes commands from a table instead of a search for a pose
LEARNED = ("network", "ridge")
HOVER = DEVICE["thimble_hover"].default
# [rad] Tilt at which a surrogate is tried out.
# [m] Depth beyond first contact at which it is tried out.
TRIED_TILT, TRIED_DEPTH = 0.2, 0.5e-3


@dataclass(frozen=True, eq=False)
class ThimbleUse:
    """A thimble on one finger, or six legs that are matched like a thimble.

    Attributes:
        device: the mechanism, mounted as on this person.
        skin: model of the skin under the device.
        friction: friction coefficient between disc and skin.
        hover: distance of the disc from the skin while nothing is touched [m].
        method: one of `METHODS`. A learned method that cannot be used has been replaced by 'stress'.
        observation_matrix: maps forces on the pad nodes to the learned model's stress components, shape (k, 3 m). None
            for the components of the device's own description.
        learned: model of the methods 'network' and 'ridge'; None for the others.
        findings: problems found, among them the reason for a replaced method.
    """

    device: DiscDevice
    skin: SkinModel
    friction: float
    hover: float
    method: str
    observation_matrix: Array | None
    learned: ForwardModel | None
    findings: tuple[Finding, ...]


def calibrated_mechanism(spec: DeviceSpec, skin: SkinModel, parameters: Mapping[str, Any]) -> tuple[Thimble, float]:
    """Return a preset's mechanism as mounted on a person, and its friction.

    The friction is the Coulomb coefficient of its disc.

    Args:
        spec: the device's preset.
        skin: model of the finger's skin.
        parameters: 'thimble_calibrated' (bool), and 'thimble_felt_1' to 'thimble_felt_3', the servo angles from neutral
            at which the person first feels the disc [rad]. All other entries are ignored.

    Raises:
        DermisError: the mechanism cannot be built, an angle is outside the servos' range, or no configuration of the
            platform has these angles.
    """
    device, friction = mechanism(spec), float(spec.value("skin_friction"))
    if not DEVICE["thimble_calibrated"].of(parameters, spec.key):
        return device, friction
    felt = np.array([float(DEVICE[f"thimble_felt_{i}"].of(parameters, spec.key)) for i in (1, 2, 3)])
    low, high = device.servo_limits
    if not np.isfinite(felt).all() or (felt < low).any() or (felt > high).any():
        raise DermisError(
            "the first contact was felt outside the servos' range",
            where=f"{spec.key}, calibration",
            value=", ".join(f"{np.degrees(a):.1f}" for a in felt) + " deg",
            limit=f"{np.degrees(low.max()):.3g} to {np.degrees(high.min()):.3g} deg",
        )
    return calibrated(device, contact_of(device, skin, friction), felt), friction


def method_name(spec: DeviceSpec) -> str:
    """Return the name of the parameter that selects a device's method."""
    return "platform_method" if spec.kind == "hexapod" else "thimble_method"


def by_stress(spec: DeviceSpec, parameters: Mapping[str, Any]) -> bool:
    """Return whether a device is matched by a search for its pose.

    Other devices are matched by a look-up table.

    This is so for each thimble, and for six legs unless their method is 'lookup'.

    Raises:
        DermisError: the method is unknown, or the platform does not have six legs with a motor each.
    """
    if spec.kind == "thimble":
        return True
    method = DEVICE["platform_method"].of(parameters, spec.key)
    if method == LOOKUP:
        return False
    if spec.kind != "hexapod" or coupling_of(spec) is not None:
        raise DermisError(
            "only six legs with a motor each can be matched pose by pose",
            where=f"device preset '{spec.key}', method",
            value=method,
            limit=LOOKUP,
            remedy="Use the look-up table",
        )
    return True


def disc_device(spec: DeviceSpec, skin: SkinModel, parameters: Mapping[str, Any]) -> tuple[DiscDevice, float]:
    """Return the mechanism of a thimble or of six legs, and its friction.

    The mechanism is mounted as on a person. The friction is the Coulomb coefficient of its disc.

    Arguments and errors are those of `calibrated_mechanism`. Six legs have no calibration.
    """
    if spec.kind != "hexapod":
        return calibrated_mechanism(spec, skin, parameters)
    by_stress(spec, {"platform_method": "stress"})
    return SixLegs.of(hexapod.mechanism(spec), spec), float(spec.value("friction"))


def prepare(spec: DeviceSpec, skin: SkinModel, parameters: Mapping[str, Any], where: str = "thimble") -> ThimbleUse:
    """Return the use of a thimble on one finger.

    If a surrogate cannot be used, the method 'stress' replaces it, and a finding gives the reason.

    Args:
        spec: the device's preset.
        skin: model of the finger's skin.
        parameters: those of `calibrated_mechanism`, and 'thimble_method' (one of `METHODS`, default 'stress'),
            'thimble_surrogate' (for 'network' and 'ridge': path of the surrogate's file, or of the folder in which
            adaptations are stored) and 'thimble_hover' [m]. Six legs have 'platform_method' instead of
            'thimble_method'; it must not be 'lookup'.
        where: the finger and device that findings and errors name.

    Raises:
        DermisError: the method is unknown, the hover is out of range, or `calibrated_mechanism` fails.
    """
    device, friction = disc_device(spec, skin, parameters)
    method, hover = (DEVICE[name].of(parameters, where) for name in (method_name(spec), "thimble_hover"))
    contact = contact_of(device, skin, friction)
    near = _near(spec, device, contact)
    if method not in LEARNED:
        return ThimbleUse(device, skin, friction, hover, method, None, None, near)
    try:
        surrogate = load(surrogate_path(parameters, skin, device, friction), skin, device, friction)
        observation_matrix, learned = (
            surrogate.descriptors.observation_matrix,
            surrogate.model(device, skin, contact, method),
        )
        try_out(learned, _pressing(device, contact), where)
    except DermisError as error:
        finding = error.as_finding(
            "warning", code="surrogate", what=f"the direct method was used: {error.what}", where=where
        )
        return ThimbleUse(device, skin, friction, hover, "stress", None, None, (finding, *near))
    linear = _linear(method, surrogate, where) if skin.tissue != tissue_of(surrogate.meta) else ()
    return ThimbleUse(device, skin, friction, hover, method, observation_matrix, learned, (*linear, *near))


def _linear(method: str, surrogate: Surrogate, where: str) -> tuple[Finding, ...]:
    """Report that a learned model of linear tissue is used on tissue that follows a nonlinear law."""
    error = errors_by_law(surrogate.meta).get(method)
    return (
        Finding(
            "info",
            "surrogate-linear",
            "the learned model was trained on linear tissue, but this finger's is neo-Hookean: the law corrects it "
            "once in each frame",
            where,
            None if error is None else f"by the law {100 * error:.0f} % off",
            remedy="Adapt it again, which learns by the law, or use the direct method",
        ),
    )


def _near(spec: DeviceSpec, device: DiscDevice, contact: DiscContact) -> tuple[Finding, ...]:
    """Report a safe pose in which the disc is too near to this finger.

    The preset's own check cannot find this, since a calibrated finger may be thicker than the preset assumes.
    """
    values = safe_state(spec).values
    joints = SERVOS if isinstance(device, Thimble) else tuple(c.name for c in spec.channels)
    if not set(joints) <= set(values):
        return ()  # the check of the preset reports this
    x = device.forward([values[j] for j in joints], middle_of(spec, device))
    room = float(contact.gap(placed(device, device.pose(x))).min())
    if room >= CLEAR:
        return ()
    return (
        Finding(
            "warning",
            "safe-pose-near",
            "the safe pose is not clear of this finger",
            where=f"device preset '{spec.key}', safe",
            value=f"{1e3 * room:.1f} mm",
            limit=f">= {1e3 * CLEAR:g} mm",
            remedy="State one further away in a preset, or seat the device nearer to the nail",
        ),
    )


def middle_of(spec: DeviceSpec, device: DiscDevice) -> Array:
    """Return a level configuration of a device, shape (freedoms,).

    It is within the device's range, and a start for forward kinematics.
    """
    distance = reference_distance(spec, device) if isinstance(device, Thimble) else float(spec.value("rest_distance"))
    return seated(device, 0.0, 0.0, distance)


def _pressing(device: DiscDevice, contact: DiscContact) -> list[Array]:
    """Return a few configurations that press on the skin, level and tilted."""
    tilts = ((0.0, 0.0), (TRIED_TILT, 0.0), (0.0, -TRIED_TILT))
    return [seated(device, p, r, first_contact(device, contact, p, r) - TRIED_DEPTH) for p, r in tilts]


def surrogate_path(parameters: Mapping[str, Any], skin: SkinModel, device: DiscDevice, friction: float) -> Path:
    """Return the path of a surrogate.

    If 'thimble_surrogate' is a folder, the path is that of this skin's own surrogate in it. For skin that follows a
    nonlinear law, it is that of the surrogate of linear tissue if the folder has only that one.

    Raises:
        DermisError: 'thimble_surrogate' is empty.
    """
    given = DEVICE["thimble_surrogate"].of(parameters)
    if not given:
        raise DermisError(
            "no surrogate was adapted to this finger",
            where="thimble",
            remedy="Adapt one to this finger, or use the direct method",
        )
    path = Path(given)
    if not os.path.isdir(path):
        return path
    own, linear = (place_of(path, each, device, friction) for each in (skin, skin.linear))
    return linear if linear.is_file() and not own.is_file() else own
