"""Platforms that a look-up table drives: their mechanism, and the motors that they have without couplings."""

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
        DermisError: another kind of device, or a broken preset.
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
    """Return the channels of the motors of the uncoupled device: those of its own, or those its couplings drive."""
    coupling = coupling_of(spec)
    return spec.channels if coupling is None else coupling.channels


def original_key(spec: DeviceSpec) -> str:
    """Return the key of a device for tables: its mechanism and sweep, not how its motors are coupled or named."""
    parts = {k: v for k, v in spec.parameters.items() if not k.startswith("coupling") and k != "knee_error"}
    ends = [(c.low, c.high) for c in original_channels(spec)]
    return hashlib.sha256(json.dumps([spec.kind, parts, ends], sort_keys=True, default=str).encode()).hexdigest()


def mechanism_key(spec: DeviceSpec) -> str:
    """Return the key of a device for rows of a table: its mechanism, not how far or finely it was swept."""
    plain = {k: v for k, v in spec.parameters.items() if not k.startswith(("coupling", "sweep")) and k != "knee_error"}
    return hashlib.sha256(json.dumps([spec.kind, plain], sort_keys=True, default=str).encode()).hexdigest()


def scale_of(spec: DeviceSpec) -> Array:
    """Return the range of each original motor, SI, shape (motors,).

    Raises:
        DermisError: a motor without one.
    """
    return np.array([high - low for low, high in map(ends_of, original_channels(spec))])


def ends_of(channel: Channel) -> tuple[float, float]:
    """Return a motor's range, SI.

    Raises:
        DermisError: it has none.
    """
    if channel.low is None or channel.high is None:
        raise DermisError("a motor of a look-up table needs a range", where=f"channel '{channel.name}'")
    return channel.low, channel.high
