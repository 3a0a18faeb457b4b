"""Device preset with fewer, coupled motors, from a design."""

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

MARGIN = 0.05  # share of the needed range of a new motor that is added at each end


def preset(found: Design, rule: Rule = "touch", motors: int | None = None, name: str = "") -> dict[str, Any]:
    """Return a device preset with fewer motors as JSON values.

    The motors have the couplings that the design found. A new motor's command runs from 0 to 1. This range covers
    the interactions and the safe pose, with a margin. Each original command is the coupling times the new commands,
    plus an offset. The pulley radius of motor j on cable i is therefore the radius of the original pulley times
    `coupling[i][j]`, divided by the new motor's travel. `safe` is left out if the coupled motors cannot release a
    finger; `safe_findings` reports this for the written preset.

    Args:
        found: result of the design.
        rule: rule that gives the number of motors.
        motors: number of motors; None for that of the rule.
        name: name of the preset; '' to make one.

    Raises:
        DermisError: `motors` is out of range; or it is None and the design gives no number of motors.
    """
    spec, reduction = found.spec, found.joint
    parts, n = reduction.components, len(reduction.components.mean)
    chosen = found.motors(rule) if motors is None else motors
    if chosen is None:
        raise DermisError(
            "even all motors together render the touch too poorly to recommend a number",
            where="design",
            value=", ".join(found.poor),
            limit=f"{100 * POOR:g} % of the touch",
            remedy="Use a table that reaches these touches, or state the number of motors for the preset",
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
        """Return the new commands that are nearest to original commands.

        The distance is measured between original commands, relative to the motors' ranges.
        """
        found = np.linalg.lstsq(matrix / parts.scale[:, None], (original - offset) / parts.scale, rcond=None)[0]
        return np.clip(found, 0.0, 1.0)

    rest = nearest(np.array([c.rest for c in spec.channels]))
    unit = spec.channels[0].unit
    # All new motors have the same slew limit, for which no original motor exceeds its own even if all new motors move.
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
    """Write a preset as JSON, atomically."""
    write_bytes(Path(path), (json.dumps(made, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def safe_commands(spec: DeviceSpec) -> Array | None:
    """Return the safe pose of a device's motors in SI units.

    The shape is (motors,). The result is None if the preset states no safe pose.
    """
    values = safe_state(spec).values
    names = [c.name for c in spec.channels]
    return np.array([values[n] for n in names]) if set(names) <= set(values) else None


def coupled_safe(made: DeviceSpec, original: DeviceSpec, commands: Array) -> dict[str, Any] | None:
    """Return `safe` of a preset with coupled motors as JSON values.

    The result is None if the coupled motors cannot release a finger.

    Args:
        made: the device with coupled motors.
        original: the original device.
        commands: commands of the new motors that are nearest to the original device's safe pose, shape (motors,).
    """
    room = clearance(made, commands)
    if not room >= CLEAR:
        return None
    why = f"nearest to the original device's safe pose; {1e3 * room:.1f} mm below a finger of {1e3 * THICKEST:g} mm"
    values = {
        c.name: {"value": float(v), "unit": "1", "source": why} for c, v in zip(made.channels, commands, strict=True)
    }
    return {"reach": safe_state(original).reach, "values": values, "source": why}
