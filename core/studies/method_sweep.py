"""Comparison of a pin array's methods on the sliding plane of [S1].

Depth, friction and direction vary.

Source: [S1] IV and V
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..contact.skin_sampler import SkinSampler
from ..devices.spec import DeviceSpec
from ..errors import DermisError
from ..files import write_bytes
from ..matching.deformation import METHODS, Method
from ..matching.pin_report import MethodReport, compare
from ..pipeline.bake import Progress
from ..plot.axes import FAINT, INK, PAPER, Axes, legend
from ..plot.canvas import PngCanvas
from ..scene.sliding import SLIDE, sliding_plane
from ..skin.model import SkinModel
from ..version import version

LIMITS = {  # by parameter: least and greatest value, unit of display and its size in SI units
    "depth": (0.1e-3, 4e-3, "mm", 1e-3),
    "friction": (0.0, 2.0, "", 1.0),
    "direction": (-2.0 * np.pi, 2.0 * np.pi, "deg", np.pi / 180.0),
    "slide": (0.05, 4.0, "s", 1.0),
}
MOST = 2000  # largest number of stimuli of a sweep; each takes a second or more
COLOURS = dict(zip(METHODS, ("#1f6fb2", "#c8503c", "#3a9a5f", "#8c6bb1", "#b07b2c", "#5a6673"), strict=True))
LONGEST = 4  # largest number of panels of a picture


@dataclass(frozen=True)
class Swept:
    """Results for one stimulus.

    Attributes:
        depth: depth [m].
        friction: friction coefficient.
        direction: direction of the movement, from +X to +Y [rad].
        reports: errors of each method.
    """

    depth: float
    friction: float
    direction: float
    reports: tuple[MethodReport, ...]


def sweep_methods(
    spec: DeviceSpec,
    skin: SkinModel,
    depths: Sequence[float],
    frictions: Sequence[float],
    directions: Sequence[float] = (0.0,),
    *,
    methods: Sequence[Method] = METHODS,
    slide: float = SLIDE,
) -> Generator[Progress, None, tuple[Swept, ...]]:
    """Match every combination of parameters by every method.

    The parameters are depth, friction and direction. Progress is yielded, and a `Swept` for each stimulus is
    returned.

    Args:
        spec: a pin array.
        skin: skin of the finger.
        depths: depths [m].
        frictions: friction coefficients.
        directions: directions of the movement, from +X to +Y [rad].
        methods: methods to compare.
        slide: duration of the movement [s].

    Raises:
        DermisError: the device is not a pin array, a value is out of range, or there is no stimulus, no method, or more
            than `MOST` stimuli.
    """
    if spec.kind != "pin_array":
        raise DermisError("methods are those of pin arrays", where=f"device preset '{spec.key}'", value=spec.kind)
    given = {"depth": depths, "friction": frictions, "direction": directions, "slide": (slide,)}
    for name, values in given.items():
        low, high, unit, factor = LIMITS[name]
        for value in values:
            if not low <= value <= high:
                shown = f"{low / factor:g} to {high / factor:g} {unit}".rstrip()
                raise DermisError(
                    f"{name} out of range", where="sweep", value=float(f"{value / factor:.6g}"), limit=shown
                )
    stimuli = list(product(depths, frictions, directions))
    if not 1 <= len(stimuli) <= MOST or not methods:
        raise DermisError("stimuli of a sweep", where="sweep", value=len(stimuli), limit=f"1 to {MOST}, and a method")
    found = []
    for done, (depth, friction, direction) in enumerate(stimuli):
        yield Progress("stimuli", done, len(stimuli))
        scene = sliding_plane(depth, friction, direction, slide=slide)
        sampler = SkinSampler(scene, {0: skin})
        for chunk in scene.chunks:
            sampler.add(chunk)
        reports = compare(sampler.finish()[0], spec, methods=methods, where=scene.name)
        found.append(Swept(depth, friction, direction, reports))
    yield Progress("stimuli", len(stimuli), len(stimuli))
    return tuple(found)


def text(found: Sequence[Swept]) -> str:
    """Return the sweep as a table for a terminal."""
    rows = [
        ("depth", "friction", "direction", "method", "u_err", "f_err", "shear / normal", "of the touch", "at limit")
    ]
    for each in found:
        for r in each.reports:
            place = (f"{1e3 * each.depth:g} mm", f"{each.friction:g}", f"{np.degrees(each.direction):g} deg")
            errors = (f"{100 * r.displacement_share:.1f} %", f"{1e3 * r.force_error:.1f} mN")
            rows.append((*place, r.method, *errors, f"{r.shear_ratio:.3f}", f"{r.target_ratio:.3f}", f"{r.at_limit}"))
    wide = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    made = ["  ".join(cell.rjust(w) for cell, w in zip(row, wide, strict=True)) for row in rows]
    return "\n".join([*made, "Simulated, on the matching mesh; u_err of the target's displacement."])


def csv(found: Sequence[Swept], spec: DeviceSpec, skin: SkinModel) -> str:
    """Return the sweep as CSV in SI units.

    There is a row for each stimulus and method, after lines `# key: value`.
    """
    names = [f.name for f in fields(MethodReport) if not f.name.startswith("finer")]
    about = {"device": spec.key, "skin": repr(skin), "generator": f"dermis {version()}", "note": "simulated"}
    out = ["# dermis-method-sweep 1", *(f"# {k}: {v}" for k, v in about.items())]
    out.append(",".join(["depth_m", "friction", "direction_rad", *names]))
    for each in found:
        for report in each.reports:
            values = [getattr(report, name) for name in names]
            words = [value if isinstance(value, str) else f"{value:.9g}" for value in values]
            out.append(",".join([f"{each.depth:.9g}", f"{each.friction:.9g}", f"{each.direction:.9g}", *words]))
    return "\n".join(out) + "\n"


def picture(found: Sequence[Swept], title: str) -> bytes:
    """Return a PNG of the ratio of tangential to normal force.

    The parameter with the most values is the horizontal axis. There is a panel for each of the first `LONGEST` values
    of the parameter with the next most values. Of the third parameter, only the first value is shown. Each panel has a
    dark curve for the target and a curve for each method.

    Source: [S1] fig. 9
    """
    values = {name: sorted({getattr(each, name) for each in found}) for name in ("depth", "friction", "direction")}
    along, apart, rest = sorted(values, key=lambda name: -len(values[name]))
    panels = values[apart][:LONGEST]
    width, height = 300.0, 250.0
    canvas = PngCanvas(60.0 + len(panels) * width, height + 70.0)
    canvas.rectangle(0, 0, 60.0 + len(panels) * width, height + 70.0, PAPER)
    shown = {name: LIMITS[name] for name in values}
    fixed = f", {rest} {values[rest][0] / shown[rest][3]:g} {shown[rest][2]}".rstrip() if len(values[rest]) > 1 else ""
    canvas.text(20, 22, f"{title}: tangential over normal force, simulated{fixed}"[:110], 9, INK)
    methods = [report.method for report in found[0].reports]
    legend(canvas, 20, 42, [("touch", INK), *((m, COLOURS[m]) for m in methods)])
    rows = [each for each in found if getattr(each, rest) == values[rest][0]]
    top = 1.15 * max(max(r.shear_ratio, r.target_ratio) for each in rows for r in each.reports)
    ends = [v / shown[along][3] for v in (values[along][0], values[along][-1])]
    xlim = (ends[0], ends[1]) if ends[1] > ends[0] else (ends[0] - 0.5, ends[0] + 0.5)
    for k, value in enumerate(panels):
        own = sorted((e for e in rows if getattr(e, apart) == value), key=lambda e: float(getattr(e, along)))
        axes = Axes(canvas, (50 + k * width, 75, width - 60, height - 60), xlim, (0.0, max(top, 0.1)))
        what = f"{apart} {value / shown[apart][3]:g} {shown[apart][2]}".rstrip()
        axes.grid(f"{along} [{shown[along][2] or '1'}]", what, most=(5, 5), colour=FAINT)
        x = np.array([getattr(e, along) for e in own]) / shown[along][3]
        axes.curve(x, _of(own, 0, "target_ratio"), INK, 2.0)
        for i, method in enumerate(methods):
            axes.curve(x, _of(own, i, "shear_ratio"), COLOURS[method])
    return canvas.to_bytes()


def write(found: Sequence[Swept], spec: DeviceSpec, skin: SkinModel, folder: Path) -> tuple[Path, Path]:
    """Write table and picture into a folder and return their paths.

    Each file is written atomically.

    Raises:
        DermisError: the folder cannot be written.
    """
    table, drawn = Path(folder) / f"{spec.key}.sweep.csv", Path(folder) / f"{spec.key}.sweep.png"
    write_bytes(table, csv(found, spec, skin).encode())
    write_bytes(drawn, picture(found, spec.name))
    return table, drawn


def _of(found: Sequence[Swept], method: int, name: str) -> Array:
    return np.array([getattr(each.reports[method], name) for each in found], np.float64)
