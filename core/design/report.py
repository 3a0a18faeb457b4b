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
from ..matching.readings import FULL_SCALE, SATURATED
from ..matching.table import SkinTable
from .synergies import CHOICES, Choice, Reduction, reduce

POOR = 0.3  # of what a touch changes in the readings: if all motors leave more, the table does not hold this touch
LOW_RANK = 0.9  # share of the variance that fewer motors must explain to be called a low rank


@dataclass(frozen=True, eq=False)
class Design:
    """How many motors a set of touches needs on a device.

    Attributes:
        spec: the original device. names: of the interactions. samples: of each.
        knee: the rule's limit, as a share.
        joint: what fewer motors cost with components of all interactions together, by choice.
        alone: the same for each interaction with components of its own, by interaction and choice.
        ranges: least and greatest original command in the interactions, SI, shape (2, motors).
        amounts: least and greatest amount of each joint component, by choice, shape (2, motors) each.
        table: where the look-up table comes from.
        findings: what makes the answer doubtful.
        reversed_sweep: spread of rows reached from deeper in, see `collect.reversed_spread`; empty where not made.
    """

    spec: DeviceSpec
    names: tuple[str, ...]
    samples: tuple[int, ...]
    knee: float
    joint: tuple[Reduction, ...]
    alone: tuple[tuple[Reduction, ...], ...]
    ranges: Array
    amounts: Mapping[str, Array]
    table: Mapping[str, Any]
    findings: tuple[Finding, ...] = ()
    reversed_sweep: Mapping[str, float] = field(default_factory=dict)

    def by(self, choice: Choice) -> Reduction:
        """Return the joint result of one way to choose components."""
        return self.joint[CHOICES.index(choice)]

    @property
    def low_rank(self) -> bool:
        """Whether fewer motors than the device has are enough, and explain most of what the motors do."""
        found = self.by("variance")
        fewer = found.motors < len(found.components.mean)
        return fewer and float(found.components.explained[: found.motors].sum()) >= LOW_RANK


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
        full = ((values <= 0) | (values >= FULL_SCALE)).mean(axis=0)
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
    amounts: dict[str, Array] = {}
    for found in joint:
        values = found.components.amounts(every, every.shape[1])
        amounts[found.choice] = np.stack([values.min(axis=0), values.max(axis=0)])
    return Design(
        spec,
        tuple(targets),
        tuple(len(v) for v in targets.values()),
        knee,
        joint,
        alone,
        np.stack([every.min(axis=0), every.max(axis=0)]),
        amounts,
        {"rows": len(table.commands), **table.meta},
        _doubts(table, targets, joint[0]),
    )


def _doubts(table: SkinTable, targets: Mapping[str, Array], found: Reduction) -> tuple[Finding, ...]:
    """Find touches that the device does not render even with all its motors: fewer are then soon as good as all."""
    doubts = []
    for (name, values), error in zip(targets.items(), found.error[:, -1], strict=True):
        away = table.from_rest(values)
        signal = float(np.sqrt((away[away > table.noise_floor] ** 2).mean()))
        if error > POOR * signal:
            doubts.append(
                Finding(
                    "warning",
                    "poorly-rendered",
                    "all motors together leave much of this touch, so the number says little",
                    f"interaction '{name}'",
                    f"{error:.0f} of {signal:.0f} counts",
                    f"{100 * POOR:g} %",
                    "Check that recording and table are of one sensor, or use a table that reaches this touch",
                )
            )
    return tuple(doubts)


def as_json(found: Design) -> dict[str, Any]:
    """Return all figures as plain JSON values."""
    radius = found.spec.parameters.get("pulley_radius")

    def one(reduction: Reduction) -> dict[str, Any]:
        parts, k = reduction.components, reduction.motors
        result: dict[str, Any] = {
            "motors": k,
            "error_counts": reduction.error.tolist(),
            "percent": reduction.percent.tolist(),
            "mean_percent": reduction.mean_percent.tolist(),
            "explained": parts.explained.tolist(),
            "components": parts.directions.T.tolist(),
        }
        if isinstance(radius, float):
            # as the paper draws them: multiples of the coefficients; the largest is the original pulley
            e = parts.directions[:, :k]
            result["pulley_radii_m"] = (radius * e / np.abs(e).max(axis=0)).tolist()
        return result

    return {
        "device": found.spec.key,
        "knee_error": found.knee,
        "interactions": list(found.names),
        "samples": list(found.samples),
        "low_rank": found.low_rank,
        "table": dict(found.table),
        "joint": {r.choice: one(r) for r in found.joint},
        "alone": {name: {r.choice: one(r) for r in each} for name, each in zip(found.names, found.alone, strict=True)},
        "sensor": "virtual: 19 electrodes and pressure, 12 bits",
        "percentage": "mean of percentages",
        "scaling": "commands centred, each over its motor's range",
        "findings": [f.as_dict() for f in found.findings],
        "reversed_sweep_counts": dict(found.reversed_sweep),
    }


def as_text(found: Design) -> str:
    """Return the report as text."""
    n = len(found.spec.channels)
    lines = [
        f"How many motors? {found.spec.name}, {n} motors, table of {found.table['rows']} rows",
        f"rule: the fewest motors whose error is less than {100 * found.knee:g} % above that of all {n}",
        "",
    ]
    for reduction in found.joint:
        parts = reduction.components
        lines.append(f"Components by {reduction.choice}: {reduction.motors} motor{'s' if reduction.motors > 1 else ''}")
        lines.append("  motors              " + " ".join(f"{k:8d}" for k in range(1, n + 1)))
        lines.append("  mean error above [%]" + " ".join(f"{p:8.1f}" for p in reduction.mean_percent))
        lines.append("  explained [%]       " + " ".join(f"{100 * p:8.1f}" for p in parts.explained))
        for name, row in zip(found.names, reduction.error, strict=True):
            lines.append(f"  {name[:18]:18s} ct" + " ".join(f"{e:8.1f}" for e in row))
        for j in range(reduction.motors):
            lines.append(f"  motor {j + 1} couples " + ", ".join(f"{v:+.3f}" for v in parts.directions[:, j]))
        lines.append("")
    if len(found.names) > 1:
        lines.append("Each by itself (variance, rendered):")
        for name, each in zip(found.names, found.alone, strict=True):
            lines.append(f"  {name}: " + ", ".join(str(r.motors) for r in each))
        lines.append("")
    if not found.low_rank:
        lines.append(
            "The commands are not of low rank: no fewer motors both stay within the rule and explain "
            f"{100 * LOW_RANK:g} % of the movement."
        )
    if found.reversed_sweep:
        apart = found.reversed_sweep
        lines.append(
            f"Rows reached from deeper in instead of from rest read {apart['rms']:.1f} counts differently, at "
            f"worst {apart['worst']:.1f}: friction's doing."
        )
    lines += [str(finding) for finding in found.findings]
    lines.append("Sensed by a virtual sensor in a linear skin; percentages are the mean over interactions.")
    return "\n".join(lines) + "\n"
