"""Mechanisms at the corners of their limits, beyond them, and at poses where legs lose their hold."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.devices.inverse_kinematics import inverse_kinematics
from core.devices.mechanism import mechanism_of
from core.devices.poses import Poses, rotation
from core.devices.spec import DeviceSpec
from core.devices.thimble import reference_distance
from core.errors import DermisError
from core.presets import Library

from . import tolerances
from .case import Dice, Family, Values, Verdict

Array = NDArray[np.float64]
WALKED = 64  # poses on the way from level to a corner
LENGTHS = {
    "thimble_3rrs": ("platform_radius", "base_radius", "crank", "rod", "reference_distance"),
    "hexapod": ("platform_radius", "base_radius", "rest_distance", "base_height"),
    "cable_platform": ("platform_radius", "base_radius", "rest_distance", "base_height", "spring_stiffness"),
}


@lru_cache(maxsize=8)
def preset(key: str) -> DeviceSpec:
    """Return a shipped preset."""
    return Library().device(key)


def changed(spec: DeviceSpec, share: float, seed: int) -> DeviceSpec:
    """Return a device whose lengths are others by up to a share."""
    rng, own = np.random.default_rng(seed), dict(spec.parameters)
    for name in LENGTHS[spec.key]:
        own[name] = spec.value(name) * float(np.exp(rng.uniform(-share, share)))
    return replace(spec, parameters=own)


def made(values: Values, key: str, verdict: Verdict) -> Any:
    """Return a drawn device's mechanism, None where it is refused; the shipped one may not be."""
    share = float(values["other"])
    try:
        return mechanism_of(changed(preset(key), share, int(values["random"])))
    except DermisError:
        verdict.hold("refused rightly", share == 0.0, 0)
        return None


def draw(dice: Dice) -> Values:
    """Draw a device's lengths, and poses within reach or beyond."""
    return {
        "other": dice.some(0.5, dice.decades(1e-3, 1.0)),
        "turn": dice.decades(1e-6, 2.0),
        "shift": dice.decades(1e-7, 2e-2),
        "random": dice.whole(0, 10**6),
    }


def judge_thimble(values: Values) -> Verdict:
    """Go to the corner of what a thimble can reach, and back by its servos' angles."""
    verdict, rng = Verdict(), np.random.default_rng(int(values["random"]) + 1)
    device = made(values, "thimble_3rrs", verdict)
    if device is None:
        return verdict
    low, high = device.servo_limits
    reference = float(np.array([0.0, 0.0, reference_distance(preset("thimble_3rrs"), device)])[2])
    level = np.array(
        [
            0.0,
            0.0,
            float(
                changed(preset("thimble_3rrs"), float(values["other"]), int(values["random"])).parameters[
                    "reference_distance"
                ]
            ),
        ]
    )
    way = rng.normal(size=3) * [float(values["turn"]), float(values["turn"]), float(values["shift"])]
    verdict.hold("level", not (np.isfinite(reference) and device.feasible(level)), 0)
    if verdict.missed:
        return verdict
    # the first corner on the way: what lies beyond it may be feasible again, and is another pose of the same angles
    outside = next((k / WALKED for k in range(1, WALKED + 1) if not device.feasible(level + k / WALKED * way)), None)
    inside = 1.0 if outside is None else outside - 1.0 / WALKED
    for _ in range(60 if outside is not None else 0):  # constraints are met here, and not a bit beyond
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if device.feasible(level + middle * way) else (inside, middle)
    x = level + inside * way
    angles = np.array(inverse_kinematics(device, *x.tolist())[0])
    over = max(float((angles - high).max()), float((low - angles).max()))
    verdict.hold("bounds", max(over, 0.0), tolerances.BEYOND)
    room = device.constraints(x, low, high)
    verdict.hold("finite", int((~np.isfinite(room)).sum()), 0)
    verdict.hold("constraints", max(-float(room.min()), 0.0), 1e-9)
    back = device.forward(angles, level)
    off = np.abs(back - x) / [1.0, 1.0, device.platform_radius]
    # the servos' own accuracy in `forward` turns the platform by more where it is held less firmly
    verdict.hold("there and back", float(off.max()), tolerances.CLOSE)
    try:
        beyond = device.servo_angles(level + 3.0 * way)[0]
        verdict.hold("finite", int((~np.isfinite(beyond)).sum()), 0)
    except DermisError:
        pass  # a leg that cannot reach says so
    return verdict


def judge_hexapod(values: Values) -> Verdict:
    """Close the legs at any pose, or be told that they do not close."""
    verdict, rng = Verdict(), np.random.default_rng(int(values["random"]) + 1)
    device = made(values, "hexapod", verdict)
    if device is None:
        return verdict
    turn, centre = rng.normal(size=3) * float(values["turn"]), rng.normal(size=3) * float(values["shift"])
    start = device.rest_poses(1)
    pose = Poses(rotation(turn[None]), start.centre + centre)
    lengths = device.commands(pose)
    held = device.conditioning(pose)
    verdict.hold("finite", int((~np.isfinite(lengths)).sum() + (~np.isfinite(held)).sum()), 0)
    try:
        found = device.carry(lengths, start)
    except DermisError:
        # far poses, and ones beyond where the legs lose their hold, may be refused
        near = float(values["turn"]) < 0.05 and float(values["shift"]) < 1e-3 and float(values["other"]) == 0.0
        verdict.hold("near poses are found", near, 0)
        return verdict
    verdict.hold("closes", float(np.abs(device.commands(found) - lengths).max()) / device.disc_radius, tolerances.CLOSE)
    square = found.rotation[0] @ found.rotation[0].T - np.eye(3)
    verdict.hold("rotation", float(np.abs(square).max()), 1e-9)
    return verdict


def judge_cables(values: Values) -> Verdict:
    """Wind the cables to any angles, and let platform, springs and cables come to balance."""
    verdict, rng = Verdict(), np.random.default_rng(int(values["random"]) + 1)
    device = made(values, "cable_platform", verdict)
    if device is None:
        return verdict
    start = device.rest_poses(4)
    wound = rng.normal(size=(4, 3)) * float(values["turn"])
    try:
        with np.errstate(all="ignore"):
            found = device.carry(wound, start)
    except np.linalg.LinAlgError:
        verdict.hold("no error of its own", 1, 0)
        return verdict
    verdict.hold("finite", int((~np.isfinite(found.centre)).sum() + (~np.isfinite(found.rotation)).sum()), 0)
    if verdict.missed:
        return verdict
    square = found.rotation @ found.rotation.transpose(0, 2, 1) - np.eye(3)
    verdict.hold("rotation", float(np.abs(square).max()), 1e-9)
    tension = device.tensions(found, wound)
    verdict.hold("cables pull", max(-float(tension.min()), 0.0), 0)
    if float(values["turn"]) < 0.05 and float(values["other"]) == 0.0:
        stretched = tension.max() / device.cable / device.pulley
        off = float(np.abs(device.commands(found) - wound).max())
        verdict.hold("there and back", off, stretched + tolerances.CLOSE)
    return verdict


PLAIN: Values = {"other": 0.0, "turn": 1e-3, "shift": 1e-4}
FAMILIES = (
    Family("thimble", "corners of a thimble's limits, and back by its servos", draw, judge_thimble, PLAIN),
    Family("hexapod", "six legs at any pose, near and beyond singular ones", draw, judge_hexapod, PLAIN),
    Family("cables", "cables wound to any angles, in balance with springs and slack", draw, judge_cables, PLAIN),
)
