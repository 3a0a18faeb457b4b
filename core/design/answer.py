"""Number of motors that a set of sensed touches needs.

Source: [S2] IV and V
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.coupling import refuse_coupled
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..interpolate import interpolate
from ..matching.lookup import commands_of
from ..matching.readings import SATURATED, at_the_end, in_steps, step_of
from ..matching.table import SkinTable
from .shared_pulleys import SharedPulleys, shared_pulleys
from .synergies import Reduction, Rule, reduce

# Shares of a touch, which the error with all motors is compared with. Above POOR the error is so large that fewer
# motors soon look as good as all. Above BOUNDS the table, not the number of motors, limits the rendering.
POOR = 0.3
BOUNDS = 0.1
VIRTUAL = "virtual: 19 electrodes and pressure, 12 bits"
LOW_RANK = 0.9  # share of the variance that the reduced motors must explain for the commands to be of low rank


@dataclass(frozen=True, eq=False)
class Design:
    """Number of motors that a set of touches needs on a device.

    It includes the figures from which the number follows.

    Attributes:
        spec: the original device.
        names: names of the interactions.
        samples: number of samples of each interaction.
        sensors: the sensor of each interaction, in words.
        unit: unit of the readings, for display.
        step: smallest step of the readings, in their unit. Errors and touches are counted in such steps.
        repetitions: number of repetitions of each interaction, and their deviation from their mean [steps]; 1 and nan
            for an interaction without similar repetitions.
        poor: interactions with so large an error with all motors that no number of motors is given.
        joint: error of fewer motors, with the principal components of all interactions together.
        alone: error of fewer motors for each interaction, with the principal components of this interaction.
        ranges: least and greatest original command in the interactions, SI, shape (2, motors).
        amounts: least and greatest amount of each joint component, shape (2, motors).
        table: origin and size of the look-up table.
        findings: reasons to doubt the answer.
        shared: original motors that may share a pulley, for the number of motors by the rule 'touch'.
        reversed_sweep: differences of rows reached from deeper positions, see `collect.reversed_spread`; empty if not
            computed.
    """

    spec: DeviceSpec
    names: tuple[str, ...]
    samples: tuple[int, ...]
    sensors: tuple[str, ...]
    repetitions: tuple[tuple[int, float], ...]
    joint: Reduction
    alone: tuple[Reduction, ...]
    ranges: Array
    amounts: Array
    table: Mapping[str, Any]
    findings: tuple[Finding, ...] = ()
    shared: SharedPulleys = SharedPulleys()
    reversed_sweep: Mapping[str, float] = field(default_factory=dict)
    step: float = 1.0

    @property
    def recorded(self) -> bool:
        """Whether any interaction comes from a recording."""
        return any(sensor != VIRTUAL for sensor in self.sensors)

    @property
    def unit(self) -> str:
        """Unit of the readings, for display."""
        return "the recording's unit" if self.recorded else "counts"

    @property
    def poor(self) -> tuple[str, ...]:
        """Interactions with a large error even with all motors.

        The error is so large that no number of motors is given.
        """
        left = self.joint.error[:, -1] > POOR * self.joint.touch
        return tuple(name for name, poor in zip(self.names, left.tolist(), strict=True) if poor)

    def motors(self, rule: Rule = "touch") -> int | None:
        """Return the fewest motors that satisfy a rule.

        The result is None if any interaction is `poor`.
        """
        return None if self.poor else self.joint.motors(rule)

    def low_rank(self, rule: Rule = "touch") -> bool:
        """Return whether fewer motors are enough and explain the movement.

        They must explain at least the share `LOW_RANK` of the variance.
        """
        parts, motors = self.joint.components, self.joint.motors(rule)
        return motors < len(parts.mean) and float(parts.explained[:motors].sum()) >= LOW_RANK


def knee_of(spec: DeviceSpec) -> float:
    """Return the limit of the knee rule in a preset, a share.

    Raises:
        DermisError: the limit is missing or not a share above zero.
    """
    value = spec.parameters.get("knee_error")
    if not isinstance(value, float | int) or isinstance(value, bool) or not 0.0 < value < 10.0:
        raise DermisError("'knee_error' must be a share above zero", where=f"device preset '{spec.key}'", value=value)
    return float(value)


def design(
    spec: DeviceSpec, table: SkinTable, sensed: Mapping[str, Array], sensors: Mapping[str, str] | None = None
) -> Design:
    """Find the fewest motors for a set of sensed interactions.

    If the readings of a recorded table come in steps, readings are counted in these steps from rest. The answer then
    does not depend on the unit or on the zero of the readings, to the last bit.

    Args:
        spec: the original device.
        table: effect of the device on the skin.
        sensed: target readings of each interaction, by its name, in the table's unit, shape (n, channels) each.
        sensors: the sensor of each interaction, in words; the virtual sensor for interactions left out.

    Raises:
        DermisError: the motors are coupled, no interaction is given, or an interaction never touches, has fewer than
            two samples, or has the sensor at an end of its scale for long.
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
                "the sensor is saturated",
                where=f"interaction '{name}', channel {full.argmax() + 1}",
                value=f"{100 * full.max():.0f} % of the time",
                limit=f"{100 * SATURATED:.0f} %",
                remedy="Touch less deeply",
            )
        strongest = float(table.from_rest(values).max())
        if strongest <= table.noise_floor:
            raise DermisError(
                "nothing is ever touched",
                where=f"interaction '{name}'",
                value=f"readings up to {strongest:.3g} from rest",
                limit=f"> {table.noise_floor:.3g}, which the noise reaches",
                remedy="Choose a touch, or state the noise in the readings' own unit",
            )
    step = step_of(table.readings) if "channels" in table.meta else 0.0
    if step:
        origin = table.exact_readings[table.rest]
        targets = {name: in_steps(values, origin, step) for name, values in targets.items()}
        counted = in_steps(table.readings, origin, step)
        table = replace(table, readings=counted, noise_floor=table.noise_floor / step)
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
        tuple((sensors or {}).get(name, VIRTUAL) for name in targets),
        tuple(scatter(v, table.from_rest(v) > table.noise_floor) for v in targets.values()),
        joint,
        alone,
        np.stack([every.min(axis=0), every.max(axis=0)]),
        np.stack([amounts.min(axis=0), amounts.max(axis=0)]),
        {"rows": len(table.commands), **table.meta},
        _doubts(tuple(targets), joint),
        shared_pulleys(table, list(targets.values()), commands, joint, joint.motors()),
        step=step or 1.0,
    )


def _doubts(names: tuple[str, ...], found: Reduction) -> tuple[Finding, ...]:
    """Report touches with a large error even with all motors."""
    doubts = []
    for name, error, touch in zip(names, found.error[:, -1].tolist(), found.touch.tolist(), strict=True):
        if error > BOUNDS * touch:
            poor = error > POOR * touch
            doubts.append(
                Finding(
                    "warning" if poor else "info",
                    "poorly-rendered" if poor else "table-limits",
                    "even all motors together render this touch poorly, so the number of motors is unreliable"
                    if poor
                    else "the table, not the motors, limits how well this touch is rendered",
                    f"interaction '{name}'",
                    f"{100 * error / touch:.0f} %",
                    f"{100 * (POOR if poor else BOUNDS):g} %",
                    "Check that recording and table are of one sensor, or use a table that reaches this touch",
                )
            )
    return tuple(doubts)


SHORT = 0.5  # share of the longest contact; a shorter contact is no repetition, but noise or a slip
ALIKE = 1.25  # ratio of the longest to the shortest contact; above it, the contacts are different touches


def scatter(readings: Array, touching: NDArray[np.bool_]) -> tuple[int, float]:
    """Return the number of a touch's repetitions, and their deviation.

    A repetition is an interval of contact between two intervals of rest. Repetitions are resampled to one length and
    compared moment by moment.

    Args:
        readings: readings of the touch, shape (n, channels).
        touching: whether each sample differs from rest, shape (n,).

    Returns:
        Number of repetitions, and their standard deviation in the unit of the readings: the variance is summed over
        channels and averaged over time. (1, nan) if there are no two similar repetitions.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    lengths = runs[:, 1] - runs[:, 0]
    runs = runs[lengths >= max(SHORT * lengths.max(initial=0), 2)]
    lengths = runs[:, 1] - runs[:, 0]
    if len(runs) < 2 or lengths.max() > ALIKE * lengths.min():
        return 1, float("nan")
    share = np.linspace(0.0, 1.0, int(lengths.min()))
    each = [interpolate(np.linspace(0.0, 1.0, b - a), readings[a:b].astype(float), share) for a, b in runs.tolist()]
    spread = np.var(each, axis=0, ddof=1).sum(axis=1)
    return len(runs), float(np.sqrt(spread.mean()))
