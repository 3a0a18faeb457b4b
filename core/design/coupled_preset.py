"""A device preset with fewer motors, coupled as a design found; its safe pose comes from the original device's."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.retraction import CLEAR, THICKEST, clearance
from ..devices.safe_state import safe_state
from ..devices.spec import DEVICE_SCHEMA, DeviceSpec, from_preset
from ..errors import DermisError
from ..files import write_bytes
from .answer import POOR, Design
from .synergies import Rule

MARGIN = 0.05  # of a new motor's range, left beyond the need of the interactions on either side


def preset(found: Design, rule: Rule = "touch", motors: int | None = None, name: str = "") -> dict[str, Any]:
    """Return a device preset with fewer motors and the couplings found, as JSON values.

    A new motor's command runs from 0 to 1 over the range of the interactions and of letting go, with a margin. Each
    original command is the coupling times the new commands plus an offset, so that the pulley radius of motor j on
    cable i is the original pulley's times `coupling[i][j]` over the new motor's travel. `safe` is missing where motors
    so coupled cannot let a finger go; `safe_findings` reports it for the written preset.

    Raises:
        DermisError: more motors than the device has, or fewer than one; nobody says how many, and the table is poor.
    """
    spec, reduction = found.spec, found.joint
    parts, n = reduction.components, len(reduction.components.mean)
    chosen = found.motors(rule) if motors is None else motors
    if chosen is None:
        raise DermisError(
            "all motors together leave too much of the touch to say how many it needs",
            where="design",
            value=", ".join(found.poor),
            limit=f"{100 * POOR:g} % of the touch",
            remedy="Use a table that reaches these touches, or say how many motors the preset shall have",
        )
    k = chosen
    if not 1 <= k <= n:
        raise DermisError("as many motors as the device has", where="design", value=k, limit=f"1 to {n}")
    needed = found.amounts[:, :k]
    safe = safe_commands(spec)
    if safe is not None:
        needed = np.vstack([needed, parts.amounts(safe[None], k)])
    low, high = needed.min(axis=0), needed.max(axis=0)
    span = np.maximum(high - low, 1e-9)
    low, span = low - MARGIN * span, (1.0 + 2.0 * MARGIN) * span
    matrix = parts.scale[:, None] * parts.directions[:, :k] * span
    offset = parts.mean + parts.scale * (parts.directions[:, :k] @ low)

    def nearest(original: Array) -> Array:
        """Return the new command that comes nearest to an original one."""
        found = np.linalg.lstsq(matrix / parts.scale[:, None], (original - offset) / parts.scale, rcond=None)[0]
        return np.clip(found, 0.0, 1.0)

    rest = nearest(np.array([c.rest for c in spec.channels]))
    unit = spec.channels[0].unit
    # each new motor crosses its range in one time, so short that no original motor goes faster than it could
    slews = [(i, c.slew) for i, c in enumerate(spec.channels) if c.slew]
    slew = min((s / max(float(np.abs(matrix[i]).sum()), 1e-12) for i, s in slews), default=None)
    why = f"design: {', '.join(found.names)}"
    source = {key: value for key, value in spec.source.items() if key not in ("channels", "parameters", "name", "safe")}
    own = f"the original motor's range [{unit}]"
    plain = spec.name.partition(" (")[0]  # the number of motors stands in brackets
    channels = []
    for j in range(k):
        channel: dict[str, Any] = {
            "name": f"motor_{j + 1}",
            "unit": "1",
            "actuator": f"motor_{j + 1}",
            "low": {"value": 0.0, "unit": "1", "source": why},
            "high": {"value": 1.0, "unit": "1", "source": why},
            "rest": {"value": float(rest[j]), "unit": "1", "source": "nearest to the original device at rest"},
        }
        channels.append(channel)
        if slew is not None:
            why_slow = "so that no original motor goes faster than it could, all moving"
            channel["slew"] = {"value": float(slew), "unit": "1/s", "source": why_slow}
    made = {
        **source,
        "schema": DEVICE_SCHEMA,
        "name": name or f"{plain}, {k} motor{'s' if k > 1 else ''} for {', '.join(found.names)}"[:80],
        "channels": channels,
        "parameters": {
            **dict(spec.source["parameters"]),
            "coupling": {"value": matrix.tolist(), "unit": "1", "source": f"{why}; original command [{unit}] a unit"},
            "coupling_offset": {"value": offset.tolist(), "unit": "1", "source": f"{why}; [{unit}]"},
            "coupling_low": {"value": [c.low for c in spec.channels], "unit": "1", "source": own},
            "coupling_high": {"value": [c.high for c in spec.channels], "unit": "1", "source": own},
            "coupling_unit": unit,
        },
    }
    spec_made = from_preset("design", made)  # a preset that cannot be read must not be written
    letting_go = None if safe is None else coupled_safe(spec_made, spec, nearest(safe))
    return made if letting_go is None else {**made, "safe": letting_go}


def write_preset(made: Mapping[str, Any], path: Path) -> None:
    """Write a preset as JSON, whole or not at all."""
    write_bytes(Path(path), (json.dumps(made, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def safe_commands(spec: DeviceSpec) -> Array | None:
    """Return the safe pose of a device's motors [SI], shape (motors,); None where its preset states none."""
    values = safe_state(spec).values
    names = [c.name for c in spec.channels]
    return np.array([values[n] for n in names]) if set(names) <= set(values) else None


def coupled_safe(made: DeviceSpec, original: DeviceSpec, commands: Array) -> dict[str, Any] | None:
    """Return `safe` of a preset with coupled motors, as JSON values; None where they cannot let a finger go.

    Args:
        commands: commands of the new motors, nearest to the original device's safe pose, shape (motors,).
    """
    room = clearance(made, commands)
    if not room >= CLEAR:
        return None
    why = f"nearest to the original device's safe pose; {1e3 * room:.1f} mm below a finger of {1e3 * THICKEST:g} mm"
    values = {
        c.name: {"value": float(v), "unit": "1", "source": why} for c, v in zip(made.channels, commands, strict=True)
    }
    return {"reach": safe_state(original).reach, "values": values, "source": why}
