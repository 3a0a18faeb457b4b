"""Shear tactor: commands of its pulleys from the sum of all effects on a finger.

The displacements of several effects are added in the finger's frame, as fractions of the tactor's range. The sum is
projected into the pad's plane and limited to range and speed, for both pulleys together. The pipeline and the sender
check the channels again.

Source: [S3] section 4
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..contact.pad_contact import PadContact
from ..devices.shear_tactor import ShearTactor, within_speed
from ..devices.spec import DeviceSpec
from ..errors import DermisError
from ..parameters.device import DEVICE
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..track.command_track import CommandTrack
from .effect_sum import EffectSum
from .rendered import Rendered

# A length that exceeds 1 by no more than this counts as rounding and not as limited.
SLACK = 1e-9


def render(pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec) -> Rendered:
    """Render one finger's shear tactor.

    Signals: 'contact' and 'held' (0 or 1), 'magnitude' (length of the sum before the limit, as a fraction of the
        range).

    Raises:
        DermisError: a method or setting of an effect is unknown, or the preset lacks a parameter of the mechanism.

    Source: [S3] eq. 1-8
    """
    method = DEVICE["projection"].of(use.parameters, f"finger '{scene.fingers[finger].name}'")
    tactor = pad_contact.lasting(("tactor", spec.key), lambda: ShearTactor.from_spec(spec))
    times = pad_contact.device_times(scene, spec.rate)
    sums = EffectSum(pad_contact, scene, finger, use, tactor.tap_axis, times)
    for body in range(len(scene.bodies)):
        sums.add_body(body)
    sums.add_pattern()
    sums.add_earlier_taps()
    if sums.sum is None:
        position, magnitude, limited = np.zeros((len(times), 2)), np.zeros(len(times)), 0
    else:
        position, magnitude, limited = projected(sums.sum, tactor.radius, method)
    with pad_contact.carry(("cap", finger, sums.device), times) as carry:
        position, slowed = within_speed(position, tactor.speed / spec.rate, carry.start)
        carry.found = position[carry.index]
    angles = np.zeros_like(position)
    x, y = position.T
    moved = (x != 0.0) | (y != 0.0)
    count = np.count_nonzero(moved)
    if count:
        which = moved if count < len(times) else slice(None)  # a slice copies nothing
        angles[which] = tactor.inverse(position[which])
    columns = {"tactor_x": x, "tactor_y": y, "pulley_1": angles[:, 0], "pulley_2": angles[:, 1]}
    unknown = [c.name for c in spec.channels if c.name not in columns]
    if unknown:
        raise DermisError(
            "the shear tactor has no such channel",
            where=f"device preset '{spec.key}'",
            value=", ".join(unknown),
            limit=", ".join(columns),
        )
    counts = {}
    for name in ("tactor_x", "tactor_y"):
        counts.update({f"{name}.disc": limited, f"{name}.slew_of_pair": slowed})
    names = [c.name for c in spec.channels]
    values = np.empty((len(times), len(names)))
    for column, name in enumerate(names):
        values[:, column] = columns[name]
    limits = {k: v for k, v in counts.items() if v and k.partition(".")[0] in names}
    track = CommandTrack(spec, times, values, limited=limits)
    signals = {"contact": sums.contact.astype(np.float64), "held": sums.held.astype(np.float64), "magnitude": magnitude}
    return Rendered(track, signals, tuple(sums.findings), {k: v for k, v in sums.skipped.items() if v})


def projected(displacement: Array, radius: float, method: str = "magnitude") -> tuple[Array, Array, int]:
    """Project displacements into the pad's plane and limit them.

    The method 'magnitude' is p = A min(1, |P T^-1 d|) P T^-1 d / |P T^-1 d|. The method 'printed' divides by |d| as in
    the paper, which shortens a tilted vector twice and is 0/0 at d = 0. Both give 0 there.

    Args:
        displacement: T^-1 d, displacements in the finger's frame as fractions of the range, shape (n, 3).
        radius: range A [m].
        method: 'magnitude' or 'printed'.

    Returns:
        Positions [m], shape (n, 2); lengths |P T^-1 d|, shape (n,); number of lengths that were limited to 1.

    Raises:
        DermisError: the method is unknown.

    Source: [S3] eq. 6
    """
    DEVICE["projection"].check(method, "shear tactor")
    flat = displacement[:, :2]
    length = np.hypot(flat[:, 0], flat[:, 1])
    limited = int((length > 1.0 + SLACK).sum())
    if method == "magnitude":
        return radius * flat / np.maximum(length, 1.0)[:, None], length, limited
    displacement = np.ascontiguousarray(displacement)  # an order of the sums that no layout changes
    whole = np.sqrt(np.einsum("ij,ij->i", displacement, displacement))
    factor = np.minimum(1.0, length) / np.where(whole > 0.0, whole, 1.0)
    return radius * factor[:, None] * flat, length, limited
