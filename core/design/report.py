"""The answer to 'how many motors?': as text, as JSON, as a picture, and as a new device preset.

Source: [S2] IV and V
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..canvas import Canvas, PngCanvas, SvgCanvas
from ..devices.coupling import refuse_coupled
from ..devices.spec import DEVICE_SCHEMA, DeviceSpec, from_preset
from ..errors import DermisError
from ..files import write_bytes
from ..matching.lookup import commands_of
from ..matching.table import SkinTable
from .synergies import CHOICES, Choice, Reduction, reduce

Array = NDArray[np.float64]

LOW_RANK = 0.9  # share of the variance that fewer motors must explain to be called a low rank
MARGIN = 0.05  # of a new motor's range, left beyond what the interactions need on either side
INK, FAINT, GRID, PAPER, CHOSEN = "#20262e", "#6b7480", "#e4e7eb", "#ffffff", "#c8503c"
BARS = {"variance": "#1f6fb2", "rendered": "#12876f"}


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
        DermisError: coupled motors, nothing given, an interaction that never touches, or one shorter than two samples.
    """
    refuse_coupled(spec)
    if not sensed:
        raise DermisError("no interaction", where="design", remedy="Give at least one baked scene or recording")
    targets = {name: np.asarray(values, np.float64) for name, values in sensed.items()}
    for name, values in targets.items():
        if len(values) < 2:
            raise DermisError("too few samples", where=f"interaction '{name}'", value=len(values), limit=">= 2")
        if (table.from_rest(values) <= max(table.hush, 0.0)).all():
            raise DermisError("nothing is ever touched", where=f"interaction '{name}'",
                              remedy="Choose a scene in which the finger touches something")  # fmt: skip
    knee = knee_of(spec)
    commands = [commands_of(table, values) for values in targets.values()]
    joint = reduce(table, list(targets.values()), knee, commands=commands)
    alone = tuple(
        reduce(table, [values], knee, commands=[m]) for values, m in zip(targets.values(), commands, strict=True)
    ) if len(targets) > 1 else (joint,)  # fmt: skip
    every = np.vstack(commands)
    amounts: dict[str, Array] = {}
    for found in joint:
        values = found.components.amounts(every, every.shape[1])
        amounts[found.choice] = np.stack([values.min(axis=0), values.max(axis=0)])
    return Design(spec, tuple(targets), tuple(len(v) for v in targets.values()), knee, joint, alone,
                  np.stack([every.min(axis=0), every.max(axis=0)]), amounts,
                  {"rows": len(table.commands), **table.meta})  # fmt: skip


def preset(found: Design, choice: Choice = "variance", motors: int | None = None, name: str = "") -> dict[str, Any]:
    """Return a device preset with fewer motors and the couplings found, as JSON values.

    A new motor's command runs from 0 to 1 over what the interactions need, with a margin. Each original command is the
    coupling times the new commands plus an offset, so that the pulley radius of motor j on cable i is the original
    pulley's times `coupling[i][j]` over the new motor's travel.

    Raises:
        DermisError: more motors than the device has, or fewer than one.
    """
    spec, reduction = found.spec, found.by(choice)
    parts, n = reduction.components, len(reduction.components.mean)
    k = reduction.motors if motors is None else motors
    if not 1 <= k <= n:
        raise DermisError("as many motors as the device has", where="design", value=k, limit=f"1 to {n}")
    low, high = found.amounts[choice][:, :k]
    span = np.maximum(high - low, 1e-9)
    low, span = low - MARGIN * span, (1.0 + 2.0 * MARGIN) * span
    matrix = parts.scale[:, None] * parts.directions[:, :k] * span
    offset = parts.mean + parts.scale * (parts.directions[:, :k] @ low)
    # the command at rest: what comes nearest to the original device's
    rest = np.array([c.rest for c in spec.channels])
    nearest = np.linalg.lstsq(matrix / parts.scale[:, None], (rest - offset) / parts.scale, rcond=None)[0]
    nearest = np.clip(nearest, 0.0, 1.0)
    unit = spec.channels[0].unit
    slews = [(i, c.slew) for i, c in enumerate(spec.channels) if c.slew]
    slew = [min((s / max(abs(float(matrix[i, j])), 1e-12) for i, s in slews), default=None) for j in range(k)]
    why = f"design: {', '.join(found.names)}; components by {choice}"
    source = {key: value for key, value in spec.source.items() if key not in ("channels", "parameters", "name")}
    own = f"the original motor's range [{unit}]"
    channels = []
    for j in range(k):
        channel: dict[str, Any] = {
            "name": f"motor_{j + 1}", "unit": "1", "actuator": f"motor_{j + 1}",
            "low": {"value": 0.0, "unit": "1", "source": why}, "high": {"value": 1.0, "unit": "1", "source": why},
            "rest": {"value": float(nearest[j]), "unit": "1", "source": "nearest to the original device at rest"},
        }  # fmt: skip
        channels.append(channel)
        fastest = slew[j]
        if fastest is not None:
            why_slow = "so that no original motor goes faster than it could"
            channel["slew"] = {"value": float(fastest), "unit": "1/s", "source": why_slow}
    made = {
        **source, "schema": DEVICE_SCHEMA,
        "name": name or f"{_plain(spec.name)}, {k} motor{'s' if k > 1 else ''} for {', '.join(found.names)}"[:80],
        "channels": channels,
        "parameters": {
            **dict(spec.source["parameters"]),
            "coupling": {"value": matrix.tolist(), "unit": "1", "source": f"{why}; original command [{unit}] a unit"},
            "coupling_offset": {"value": offset.tolist(), "unit": "1", "source": f"{why}; [{unit}]"},
            "coupling_low": {"value": [c.low for c in spec.channels], "unit": "1", "source": own},
            "coupling_high": {"value": [c.high for c in spec.channels], "unit": "1", "source": own},
            "coupling_unit": unit,
        },
    }  # fmt: skip
    from_preset("design", made)  # a preset that cannot be read must not be written
    return made


def _plain(name: str) -> str:
    """Return a device's name without what stands in brackets: how many motors it has."""
    return name.partition(" (")[0]


def write_preset(made: Mapping[str, Any], path: Path) -> None:
    """Write a preset as JSON, whole or not at all."""
    write_bytes(Path(path), (json.dumps(made, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def as_json(found: Design) -> dict[str, Any]:
    """Return all figures as plain JSON values."""
    radius = found.spec.parameters.get("pulley_radius")

    def one(reduction: Reduction) -> dict[str, Any]:
        parts, k = reduction.components, reduction.motors
        result: dict[str, Any] = {
            "motors": k, "error_counts": reduction.error.tolist(), "percent": reduction.percent.tolist(),
            "mean_percent": reduction.mean_percent.tolist(), "explained": parts.explained.tolist(),
            "components": parts.directions.T.tolist(),
        }  # fmt: skip
        if isinstance(radius, float):
            # as the paper draws them: multiples of the coefficients; the largest is the original pulley
            e = parts.directions[:, :k]
            result["pulley_radii_m"] = (radius * e / np.abs(e).max(axis=0)).tolist()
        return result

    return {
        "device": found.spec.key, "knee_error": found.knee, "interactions": list(found.names),
        "samples": list(found.samples), "low_rank": found.low_rank, "table": dict(found.table),
        "joint": {r.choice: one(r) for r in found.joint},
        "alone": {name: {r.choice: one(r) for r in each} for name, each in zip(found.names, found.alone, strict=True)},
        "sensor": "virtual: 19 electrodes and pressure, 12 bits", "percentage": "mean of percentages",
        "scaling": "commands centred, each over its motor's range",
    }  # fmt: skip


def as_text(found: Design) -> str:
    """Return the report as text."""
    n = len(found.spec.channels)
    lines = [
        f"How many motors? {found.spec.name}, {n} motors, table of {found.table['rows']} rows",
        f"rule: the fewest motors whose error is less than {100 * found.knee:g} % above that of all {n}", "",
    ]  # fmt: skip
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
        lines.append("The commands are not of low rank: no fewer motors both stay within the rule and explain "
                     f"{100 * LOW_RANK:g} % of the movement.")  # fmt: skip
    lines.append("Sensed by a virtual sensor in a linear skin; percentages are the mean over interactions.")
    return "\n".join(lines) + "\n"


def write_picture(found: Design, path: Path) -> None:
    """Write error against number of motors as PNG or SVG, by the path's ending.

    Raises:
        DermisError: another ending, or the file cannot be written.
    """
    width, height = 640.0, 360.0
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".svg"):
        raise DermisError("unknown kind of picture", where=str(path), value=suffix, limit=".png, .svg")
    canvas: PngCanvas | SvgCanvas = PngCanvas(width, height, 2.0) if suffix == ".png" else SvgCanvas(width, height)
    _draw(found, canvas, width, height)
    write_bytes(Path(path), canvas.to_bytes())


def _draw(found: Design, canvas: Canvas, width: float, height: float) -> None:
    left, right, top, bottom = 64.0, 20.0, 86.0, 46.0
    canvas.rectangle(0, 0, width, height, PAPER)
    n = len(found.spec.channels)
    motors = found.by("variance").motors
    canvas.text(left, 22, f"How many motors? {found.spec.name}", 10, INK)
    said = f"{motors} of {n}" if motors < n else f"all {n}"
    canvas.text(left, 42, f"{said}, for {', '.join(found.names)}"[:80], 8.5, FAINT)
    # beyond 160 % a bar says no more: it is cut, and its number stands on it
    most = min(max(float(np.max([r.mean_percent for r in found.joint])), 150.0 * found.knee), 160.0)
    base, tall = height - bottom, height - bottom - top

    def y(percent: float) -> float:
        return base - tall * min(max(percent, 0.0), most) / most

    for tick in np.linspace(0.0, most, 5):
        canvas.line(left, y(tick), width - right, y(tick), GRID, 0.75)
        canvas.text(left - 6, y(tick) + 3, f"{tick:.0f}", 7.5, FAINT, "end")
    step = (width - left - right) / n
    for k in range(n):
        for i, reduction in enumerate(found.joint):
            value = float(reduction.mean_percent[k])
            x = left + k * step + step * (0.16 + 0.34 * i)
            canvas.rectangle(x, y(value), step * 0.3, max(base - y(value), 0.75), BARS[reduction.choice])
            canvas.text(x + step * 0.15, y(value) - 4, f"{value:.0f}", 7, INK, "middle")
        own = k + 1 == motors
        canvas.text(left + (k + 0.5) * step, base + 15, str(k + 1), 9 if own else 8, CHOSEN if own else INK, "middle")
    canvas.line(left, y(100 * found.knee), width - right, y(100 * found.knee), CHOSEN, 1.5, 6.0)
    canvas.text(width - right, y(100 * found.knee) - 4, "rule", 7.5, CHOSEN, "end")
    canvas.line(left, base, width - right, base, INK, 1.0)
    canvas.text(left + (width - left - right) / 2, base + 32, "motors", 8, INK, "middle")
    for i, choice in enumerate(CHOICES):
        x = width - right - 220 + 110 * i
        canvas.rectangle(x, 53, 9, 9, BARS[choice])
        canvas.text(x + 14, 61, f"by {choice}", 7.5, FAINT)
    canvas.text(left, 61, "error above all motors [%]", 7.5, FAINT)


def kept(paths: Sequence[Path]) -> str:
    """Return written paths, a line each."""
    return "\n".join(str(path) for path in paths)
