"""Platforms that a look-up table drives: mechanism, and motors without couplings."""

from __future__ import annotations

import hashlib
import json

import numpy as np

from ..arrays import Array
from ..devices import cable_platform, hexapod
from ..devices.coupling import coupling_of
from ..devices.kinds import KINDS
from ..devices.mechanism import kind_of, mechanism_of
from ..devices.spec import Channel, DeviceSpec
from ..errors import DermisError

Mechanism = cable_platform.CablePlatform | hexapod.Hexapod


def mechanism(spec: DeviceSpec) -> Mechanism:
    """Return the mechanism of a platform's preset.

    Raises:
        DermisError: the device is of another kind, or the preset is broken.
    """
    if not kind_of(spec).platform:
        raise DermisError(
            "this device has no look-up table",
            where=f"device preset '{spec.key}'",
            value=spec.kind,
            limit=", ".join(name for name, kind in KINDS.items() if kind.platform),
        )
    return mechanism_of(spec)


def original_channels(spec: DeviceSpec) -> tuple[Channel, ...]:
    """Return the channels of the original motors: the device's own, or those that its couplings drive."""
    coupling = coupling_of(spec)
    return spec.channels if coupling is None else coupling.channels


def original_key(spec: DeviceSpec) -> str:
    """Return the key of a device for tables, made from its mechanism and its sweep.

    Couplings and the names of motors do not count.
    """
    parts = {k: v for k, v in spec.parameters.items() if not k.startswith("coupling") and k != "knee_error"}
    ends = [(c.low, c.high) for c in original_channels(spec)]
    return hashlib.sha256(json.dumps([spec.kind, parts, ends], sort_keys=True, default=str).encode()).hexdigest()


def mechanism_key(spec: DeviceSpec) -> str:
    """Return the key of a device for rows of a table, made from its mechanism alone.

    The range and the resolution of the sweep do not count.
    """
    plain = {k: v for k, v in spec.parameters.items() if not k.startswith(("coupling", "sweep")) and k != "knee_error"}
    return hashlib.sha256(json.dumps([spec.kind, plain], sort_keys=True, default=str).encode()).hexdigest()


def scale_of(spec: DeviceSpec) -> Array:
    """Return the width of each original motor's range in SI units, shape (motors,).

    Raises:
        DermisError: a motor has no range.
    """
    return np.array([high - low for low, high in map(ends_of, original_channels(spec))])


def ends_of(channel: Channel) -> tuple[float, float]:
    """Return the lower and the upper end of a motor's range in SI units.

    Raises:
        DermisError: the motor has no range.
    """
    if channel.low is None or channel.high is None:
        raise DermisError("a motor of a look-up table needs a range", where=f"channel '{channel.name}'")
    return channel.low, channel.high
