"""Letting go: the safe pose of a device whose motors are coupled, from that of the original one."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.retraction import CLEAR, THICKEST, clearance
from ..devices.safe_state import safe_state
from ..devices.spec import DeviceSpec


def safe_commands(spec: DeviceSpec) -> Array | None:
    """Return the safe pose of a device's motors [SI], shape (motors,); None where its preset states none."""
    values = safe_state(spec).values
    names = [c.name for c in spec.channels]
    return np.array([values[n] for n in names]) if set(names) <= set(values) else None


def coupled_safe(made: DeviceSpec, original: DeviceSpec, commands: Array) -> dict[str, Any] | None:
    """Return `safe` of a preset with coupled motors, as JSON values; None where they cannot let a finger go.

    Args:
        commands: of the new motors, nearest to the original device's safe pose, shape (motors,).
    """
    room = clearance(made, commands)
    if not room >= CLEAR:
        return None
    why = f"nearest to the original device's safe pose; {1e3 * room:.1f} mm below a finger of {1e3 * THICKEST:g} mm"
    values = {
        c.name: {"value": float(v), "unit": "1", "source": why} for c, v in zip(made.channels, commands, strict=True)
    }
    return {"reach": safe_state(original).reach, "values": values, "source": why}
