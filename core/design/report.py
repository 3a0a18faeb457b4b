"""Reports of a task-driven design: text and JSON.

Source: [S2] IV and V
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..contact.trusted import WORDS
from ..parameters.error_bands import LINEAR
from .answer import LOW_RANK, POOR, VIRTUAL, Design
from .synergies import RULES, Reduction, Rule

# Version of the JSON. In version 2 every unit was called counts, every sensor was called virtual, and there was a
# number of motors even for a poor table.
FORMAT = 3


def as_json(found: Design) -> dict[str, Any]:
    """Return all figures as plain JSON values."""
    radius = found.spec.parameters.get("pulley_radius")

    def by(reduction: Reduction, rule: Rule, given: bool) -> dict[str, Any]:
        above, below = reduction.limits(rule)
        return {
            "motors": reduction.motors(rule) if given else None,
            "percent": reduction.percent(rule).tolist(),
            "mean_percent": reduction.mean_percent(rule).tolist(),
            "same_answer_above": above,
            "same_answer_up_to": below if np.isfinite(below) else None,
        }

    def one(reduction: Reduction, given: bool) -> dict[str, Any]:
        parts, k = reduction.components, reduction.motors()
        result: dict[str, Any] = {
            "rules": {rule: by(reduction, rule, given) for rule in RULES},
            "error": (found.step * reduction.error).tolist(),
            "touch": (found.step * reduction.touch).tolist(),
            "explained": parts.explained.tolist(),
            "components": parts.directions.T.tolist(),
        }
        if isinstance(radius, float) and given:
            # Multiples of the coefficients, as in the figures of [S2]; the largest one is the original pulley's radius.
            e = parts.directions[:, :k]
            result["pulley_radii_m"] = (radius * e / np.abs(e).max(axis=0)).tolist()
        return result

    return {
        "format": FORMAT,
        "device": found.spec.key,
        "knee_error": found.joint.limit,
        "interactions": list(found.names),
        "samples": list(found.samples),
        "repetitions": [n for n, _ in found.repetitions],
        "scatter": [found.step * s if n > 1 else None for n, s in found.repetitions],
        "low_rank": found.low_rank(),
        "shared_pulleys": [[i + 1 for i in group] for group in found.shared.groups],
        "shared_pulleys_percent": found.shared.percent if found.shared.groups else None,
        "table": dict(found.table),
        "joint": one(found.joint, not found.poor),
        "alone": {name: one(each, name not in found.poor) for name, each in zip(found.names, found.alone, strict=True)},
        "sensors": dict(zip(found.names, found.sensors, strict=True)),
        "unit": found.unit,
        "poorly_rendered": list(found.poor),
        "percentage": "mean of percentages",
        "scaling": "commands centred, each over its motor's range",
        "findings": [f.as_dict() for f in found.findings],
        "reversed_sweep": dict(found.reversed_sweep),
    }


def as_text(found: Design) -> str:
    """Return the report as text."""
    reduction, n = found.joint, len(found.spec.channels)
    parts, motors = reduction.components, found.motors()
    lines = [
        f"How many motors? {found.spec.name}, {n} motors, table of {found.table['rows']} rows",
        "",
        *_headline(found),
        "",
        "  motors              " + " ".join(f"{k:8d}" for k in range(1, n + 1)),
        "  lost of touch [%]   " + " ".join(f"{p:8.1f}" for p in reduction.mean_percent()),
        "  above all, paper [%]" + " ".join(f"{p:8.1f}" for p in reduction.mean_percent("paper")),
        "  explained [%]       " + " ".join(f"{100 * p:8.1f}" for p in parts.explained),
        "",
        f"Left of each touch, its size, and how far its repetitions differ, in {found.unit}:",
        "                      " + " ".join(f"{k:8d}" for k in range(1, n + 1)) + "    touch   repeats",
    ]
    digits = "4g" if found.recorded else "1f"
    for name, row, touch, (count, apart) in zip(
        found.names, found.step * reduction.error, found.step * reduction.touch, found.repetitions, strict=True
    ):
        again = f"{found.step * apart:10.{digits}}" if count > 1 else "         -"
        lines.append(f"  {name[:20]:20s}" + " ".join(f"{e:8.{digits}}" for e in row) + f" {touch:8.{digits}}{again}")
    lines.append("")
    lines += [
        f"  motor {j + 1} couples " + ", ".join(f"{v:+.3f}" for v in parts.directions[:, j]) for j in range(motors or 0)
    ]
    if motors is not None and found.shared.groups:
        lines += [f"  original motors {w} move alike: one pulley or lever may drive them" for w in found.shared.words()]
        lines.append(f"  so shared, the error exceeds that of all motors by {found.shared.percent:.1f} % of the touch")
    lines.append("")
    if len(found.names) > 1:
        lines.append("Each by itself (the paper's rule in brackets):")
        for name, each in zip(found.names, found.alone, strict=True):
            number = f"{each.motors()} ({each.motors('paper')})"
            lines.append(f"  {name}: {'all motors together leave too much of it' if name in found.poor else number}")
        lines.append("")
    if found.reversed_sweep:
        apart_by = found.reversed_sweep
        where = "" if found.table.get("tissue", LINEAR) == LINEAR else " on linear skin"
        lines.append(
            f"Rows reached from deeper in instead of from rest read {apart_by['rms']:.1f} counts differently{where}, "
            f"at worst {apart_by['worst']:.1f}: friction's doing."
        )
    lines += [str(finding) for finding in found.findings]
    virtual = [name for name, sensor in zip(found.names, found.sensors, strict=True) if sensor == VIRTUAL]
    tissue = WORDS[str(found.table.get("tissue", LINEAR))]
    if not found.recorded:
        lines.append(f"Sensed by a virtual sensor in a {tissue} skin; percentages are the mean over interactions.")
        return "\n".join(lines) + "\n"
    for name, sensor in zip(found.names, found.sensors, strict=True):
        if name not in virtual:
            lines.append(f"{name}: {sensor}, in the recording's own unit.")
    if virtual:
        lines.append(f"{', '.join(virtual)}: sensed by a virtual sensor in a {tissue} skin.")
    source = found.table.get("source")
    lines.append(f"Table: {f'recorded, {source}' if source else 'swept in simulation'}. Percentages are the mean.")
    return "\n".join(lines) + "\n"


def _headline(found: Design) -> list[str]:
    """Return the number of motors, or why there is none, in sentences.

    If the commands are not of low rank, a warning comes first.
    """
    reduction, n = found.joint, len(found.spec.channels)
    motors, limit = found.motors(), 100 * reduction.limit
    if motors is None:
        left = 100 * reduction.error[:, -1] / reduction.touch
        worst = ", ".join(f"{left[found.names.index(name)]:.0f} % of '{name}'" for name in found.poor)
        return [
            f"No number of motors: all {n} together leave {worst}, more than {100 * POOR:g} %.",
            "What fewer leave beyond that says little. Check that table and recording are of one sensor in one unit, "
            "or use a table that reaches this touch.",
        ]
    above, below = reduction.limits()
    lines = []
    if not found.low_rank():
        lines.append(
            "The commands are not of low rank: no fewer motors both stay within the rule and explain "
            f"{100 * LOW_RANK:g} % of the movement."
        )
    return [
        *lines,
        f"{motors} motor{'s' if motors > 1 else ''}: the fewest that lose less than {limit:g} % of the touch beyond "
        f"what all {n} leave.",
        f"Any limit {_between(above, below)} gives the same. The paper's rule, less than {limit:g} % above the error "
        f"of all {n}, gives {reduction.motors('paper')}.",
    ]


def _between(above: float, below: float) -> str:
    return f"above {100 * above:.1f} %" + (f", up to {100 * below:.1f} %," if np.isfinite(below) else "")
