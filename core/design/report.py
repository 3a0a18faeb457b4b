"""The answer to 'how many motors?': found, as text and as JSON.

Source: [S2] IV and V
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.coupling import refuse_coupled
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..matching.lookup import commands_of
from ..matching.readings import SATURATED, at_the_end
from ..matching.table import SkinTable
from .repetitions import scatter
from .shared_pulleys import SharedPulleys, shared_pulleys
from .synergies import RULES, Reduction, Rule, reduce

POOR = 0.3  # of a touch: if all motors leave more, fewer are soon as good as all
BOUNDS = 0.1  # of a touch: if all motors leave more, the table is what limits it
FORMAT = 2  # of the JSON: 1 had components by variance and by rendered error, and the paper's rule alone
LOW_RANK = 0.9  # share of the variance that fewer motors must explain to be called a low rank


@dataclass(frozen=True, eq=False)
class Design:
    """How many motors a set of touches needs on a device.

    Attributes:
        spec: the original device. names: of the interactions. samples: of each.
        repetitions: how often each is repeated, and how far repetitions are from their mean [counts]; 1 and nan where
            it is not.
        joint: what fewer motors cost with components of all interactions together.
        alone: the same for each interaction with components of its own.
        ranges: least and greatest original command in the interactions, SI, shape (2, motors).
        amounts: least and greatest amount of each joint component, shape (2, motors).
        table: where the look-up table comes from.
        findings: what makes the answer doubtful.
        shared: original motors that may share a pulley, by the rule that relates to the touch.
        reversed_sweep: spread of rows reached from deeper in, see `collect.reversed_spread`; empty where not made.
    """

    spec: DeviceSpec
    names: tuple[str, ...]
    samples: tuple[int, ...]
    repetitions: tuple[tuple[int, float], ...]
    joint: Reduction
    alone: tuple[Reduction, ...]
    ranges: Array
    amounts: Array
    table: Mapping[str, Any]
    findings: tuple[Finding, ...] = ()
    shared: SharedPulleys = SharedPulleys()
    reversed_sweep: Mapping[str, float] = field(default_factory=dict)

    def low_rank(self, rule: Rule = "touch") -> bool:
        """Return whether fewer motors than the device has are enough, and explain most of what the motors do."""
        parts, motors = self.joint.components, self.joint.motors(rule)
        return motors < len(parts.mean) and float(parts.explained[:motors].sum()) >= LOW_RANK


def knee_of(spec: DeviceSpec) -> float:
    """Return the knee rule's limit of a preset, a share.

    Raises:
        DermisError: it is missing or not a share above zero.
    """
    value = spec.parameters.get("knee_error")
    if not isinstance(value, float | int) or isinstance(value, bool) or not 0.0 < value < 10.0:
        raise DermisError("'knee_error' must be a share above zero", where=f"device preset '{spec.key}'", value=value)
    return float(value)


def design(spec: DeviceSpec, table: SkinTable, sensed: Mapping[str, Array]) -> Design:
    """Find the fewest motors for a set of sensed interactions.

    Args:
        spec: the original device. table: what it does to the skin.
        sensed: target readings [counts] by the interaction's name, each (n, channels).

    Raises:
        DermisError: coupled motors, nothing given, an interaction that never touches, one shorter than two samples, or
            one in which the sensor is at the end of its scale for long.
    """
    refuse_coupled(spec)
    if not sensed:
        raise DermisError("no interaction", where="design", remedy="Give at least one baked scene or recording")
    targets = {name: np.asarray(values, np.float64) for name, values in sensed.items()}
    for name, values in targets.items():
        if len(values) < 2:
            raise DermisError("too few samples", where=f"interaction '{name}'", value=len(values), limit=">= 2")
        full = at_the_end(values)
        if full.max() > SATURATED:
            raise DermisError(
                "the sensor is at the end of its scale",
                where=f"interaction '{name}', channel {full.argmax() + 1}",
                value=f"{100 * full.max():.0f} % of the time",
                limit=f"{100 * SATURATED:.0f} %",
                remedy="Touch less deeply",
            )
        if (table.from_rest(values) <= max(table.noise_floor, 0.0)).all():
            raise DermisError(
                "nothing is ever touched",
                where=f"interaction '{name}'",
                remedy="Choose a scene in which the finger touches something",
            )
    knee = knee_of(spec)
    commands = [commands_of(table, values) for values in targets.values()]
    joint = reduce(table, list(targets.values()), knee, commands=commands)
    alone = (
        tuple(reduce(table, [values], knee, commands=[m]) for values, m in zip(targets.values(), commands, strict=True))
        if len(targets) > 1
        else (joint,)
    )
    every = np.vstack(commands)
    amounts = joint.components.amounts(every, every.shape[1])
    return Design(
        spec,
        tuple(targets),
        tuple(len(v) for v in targets.values()),
        tuple(scatter(v, table.from_rest(v) > table.noise_floor) for v in targets.values()),
        joint,
        alone,
        np.stack([every.min(axis=0), every.max(axis=0)]),
        np.stack([amounts.min(axis=0), amounts.max(axis=0)]),
        {"rows": len(table.commands), **table.meta},
        _doubts(tuple(targets), joint),
        shared_pulleys(table, list(targets.values()), commands, joint, joint.motors()),
    )


def _doubts(names: tuple[str, ...], found: Reduction) -> tuple[Finding, ...]:
    """Find touches that the device does not render even with all its motors."""
    doubts = []
    for name, error, touch in zip(names, found.error[:, -1].tolist(), found.touch.tolist(), strict=True):
        if error > BOUNDS * touch:
            poor = error > POOR * touch
            doubts.append(
                Finding(
                    "warning" if poor else "info",
                    "poorly-rendered" if poor else "table-limits",
                    "all motors together leave much of this touch, so the number says little"
                    if poor
                    else "the table, not the motors, limits how well this touch is rendered",
                    f"interaction '{name}'",
                    f"{error:.0f} of {touch:.0f} counts",
                    f"{100 * (POOR if poor else BOUNDS):g} %",
                    "Check that recording and table are of one sensor, or use a table that reaches this touch",
                )
            )
    return tuple(doubts)


def as_json(found: Design) -> dict[str, Any]:
    """Return all figures as plain JSON values."""
    radius = found.spec.parameters.get("pulley_radius")

    def by(reduction: Reduction, rule: Rule) -> dict[str, Any]:
        above, below = reduction.limits(rule)
        return {
            "motors": reduction.motors(rule),
            "percent": reduction.percent(rule).tolist(),
            "mean_percent": reduction.mean_percent(rule).tolist(),
            "same_answer_above": above,
            "same_answer_up_to": below if np.isfinite(below) else None,
        }

    def one(reduction: Reduction) -> dict[str, Any]:
        parts, k = reduction.components, reduction.motors()
        result: dict[str, Any] = {
            "rules": {rule: by(reduction, rule) for rule in RULES},
            "error_counts": reduction.error.tolist(),
            "touch_counts": reduction.touch.tolist(),
            "explained": parts.explained.tolist(),
            "components": parts.directions.T.tolist(),
        }
        if isinstance(radius, float):
            # as the paper draws them: multiples of the coefficients; the largest is the original pulley
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
        "scatter_counts": [s if n > 1 else None for n, s in found.repetitions],
        "low_rank": found.low_rank(),
        "shared_pulleys": [[i + 1 for i in group] for group in found.shared.groups],
        "shared_pulleys_percent": found.shared.percent if found.shared.groups else None,
        "table": dict(found.table),
        "joint": one(found.joint),
        "alone": {name: one(each) for name, each in zip(found.names, found.alone, strict=True)},
        "sensor": "virtual: 19 electrodes and pressure, 12 bits",
        "percentage": "mean of percentages",
        "scaling": "commands centred, each over its motor's range",
        "findings": [f.as_dict() for f in found.findings],
        "reversed_sweep_counts": dict(found.reversed_sweep),
    }


def as_text(found: Design) -> str:
    """Return the report as text."""
    reduction, n = found.joint, len(found.spec.channels)
    parts, motors, limit = reduction.components, reduction.motors(), 100 * reduction.limit
    above, below = reduction.limits()
    lines = [
        f"How many motors? {found.spec.name}, {n} motors, table of {found.table['rows']} rows",
        "",
        f"{motors} motor{'s' if motors > 1 else ''}: the fewest that lose less than {limit:g} % of the touch beyond "
        f"what all {n} leave.",
        f"Any limit {_between(above, below)} gives the same. The paper's rule, less than {limit:g} % above the error "
        f"of all {n}, gives {reduction.motors('paper')}.",
        "",
        "  motors              " + " ".join(f"{k:8d}" for k in range(1, n + 1)),
        "  lost of touch [%]   " + " ".join(f"{p:8.1f}" for p in reduction.mean_percent()),
        "  above all, paper [%]" + " ".join(f"{p:8.1f}" for p in reduction.mean_percent("paper")),
        "  explained [%]       " + " ".join(f"{100 * p:8.1f}" for p in parts.explained),
        "",
        "Left of each touch, its size, and how far its repetitions differ [counts]:",
        "                      " + " ".join(f"{k:8d}" for k in range(1, n + 1)) + "    touch   repeats",
    ]
    for name, row, touch, (count, apart) in zip(
        found.names, reduction.error, reduction.touch, found.repetitions, strict=True
    ):
        again = f"{apart:10.1f}" if count > 1 else "         -"
        lines.append(f"  {name[:20]:20s}" + " ".join(f"{e:8.1f}" for e in row) + f" {touch:8.1f}{again}")
    lines.append("")
    lines += [
        f"  motor {j + 1} couples " + ", ".join(f"{v:+.3f}" for v in parts.directions[:, j]) for j in range(motors)
    ]
    lines += [
        f"  original motors {words} move alike: one pulley or lever may drive them" for words in found.shared.words()
    ]
    if found.shared.groups:
        lines.append(f"  so shared, {found.shared.percent:.1f} % of the touch is lost")
    lines.append("")
    if len(found.names) > 1:
        lines.append("Each by itself (the paper's rule in brackets):")
        for name, each in zip(found.names, found.alone, strict=True):
            lines.append(f"  {name}: {each.motors()} ({each.motors('paper')})")
        lines.append("")
    if not found.low_rank():
        lines.append(
            "The commands are not of low rank: no fewer motors both stay within the rule and explain "
            f"{100 * LOW_RANK:g} % of the movement."
        )
    if found.reversed_sweep:
        apart_by = found.reversed_sweep
        lines.append(
            f"Rows reached from deeper in instead of from rest read {apart_by['rms']:.1f} counts differently, at "
            f"worst {apart_by['worst']:.1f}: friction's doing."
        )
    lines += [str(finding) for finding in found.findings]
    lines.append("Sensed by a virtual sensor in a linear skin; percentages are the mean over interactions.")
    return "\n".join(lines) + "\n"


def _between(above: float, below: float) -> str:
    return f"above {100 * above:.1f} %" + (f", up to {100 * below:.1f} %," if np.isfinite(below) else "")
