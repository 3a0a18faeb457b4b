"""Friction and voltage along the Gaussian bump of [S4], by profile.

The bump is rendered on a friction screen.

Source: [S4] Table 1 and fig. 6
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..devices.friction_screen import AMPLITUDE
from ..devices.kinds import KINDS
from ..errors import DermisError
from ..files import write_bytes
from ..pipeline.render import run
from ..plot.axes import FAINT, INK, PAPER, Axes, legend
from ..plot.canvas import PngCanvas
from ..presets import Library
from ..scene.from_poses import scene_from_poses
from ..scene.tactile_scene import DeviceUse, Finger, Screen
from ..version import version

PROFILES = ("height", "slope", "rectangle")  # the paper's S1, S2, S3
COLOURS = {"height": "#1f6fb2", "slope": "#c8503c", "rectangle": "#3a9a5f"}
REACH = 4.0  # distance that the finger moves on either side of the bump's centre, in standard deviations
RATE = 240.0  # [Hz] sampling rate of the finger's path
COLUMNS, ROWS = 1600, 8  # size of the height map
LIMITS = {"height": (1e-6, 20e-3), "width": (0.5e-3, 50e-3), "speed": (1e-3, 1.0)}  # ranges [m], [m], [m/s]


@dataclass(frozen=True, eq=False)
class Bump:
    """Friction and voltage along a bump.

    Attributes:
        device: key of the device preset.
        height, width: height and standard deviation of the bump [m].
        place: position relative to the bump's centre [m], shape (n,).
        relief: height of the bump at these places [m], shape (n,).
        friction: perceived friction from 0 to 100, by profile, shape (n,) each.
        volts: amplitude of the voltage [V], by profile, shape (n,) each.
    """

    device: str
    height: float
    width: float
    place: Array
    relief: Array
    friction: dict[str, Array]
    volts: dict[str, Array]


def bump_curve(
    library: Library, device: str = "electrovibration", height: float = 1e-3, width: float = 8e-3, speed: float = 0.1
) -> Bump:
    """Render a finger's path over a bump with every profile.

    Args:
        device: preset of a friction screen.
        height: height of the bump [m].
        width: standard deviation of its profile [m].
        speed: speed of the finger [m/s].

    Raises:
        DermisError: the device is not a friction screen, or a value is out of range.
    """
    spec = library.device(device)
    if KINDS[spec.kind].drawn != "screen":
        raise DermisError("not a friction screen", where=f"device preset '{device}'", value=spec.kind)
    for (name, (low, high)), value in zip(LIMITS.items(), (height, width, speed), strict=True):
        if not low <= value <= high:
            limit = f"{1e3 * low:g} to {1e3 * high:g} mm{'/s' if name == 'speed' else ''}"
            raise DermisError(f"{name} out of range", where="bump", value=float(f"{1e3 * value:.6g}"), limit=limit)
    span = 2.0 * REACH * width
    x = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * span * 1.1
    heights = np.tile(height * np.exp(-0.5 * (x / width) ** 2), (ROWS, 1)).astype(np.float32)
    screen = Screen("Bump", (1.1 * span, 0.05), heights, 1.0)
    count = max(int(np.ceil(span / speed * RATE)), 8) + 1
    way = np.column_stack([np.linspace(-0.5 * span, 0.5 * span, count), np.zeros((count, 2))])
    friction, volts = {}, {}
    for profile in PROFILES:
        finger = Finger("Index", (DeviceUse(device, {"profile": profile}, "Bump"),))
        scene = scene_from_poses(RATE, [(finger, way)], screens=[(screen, (0.0, 0.0, 0.0))], name="bump")
        bake = run(scene, library)
        (output,) = bake.outputs
        friction[profile] = output.signals["friction"]
        volts[profile] = output.track.column(AMPLITUDE)
        place, relief = output.signals["x"], output.signals["height"]
    return Bump(device, height, width, place, relief, friction, volts)


def text(found: Bump) -> str:
    """Return the largest friction and voltage for a terminal.

    For each profile, the table also has the place of the largest friction.
    """
    out = [f"{'profile':12}friction   at [mm]   volts"]
    for profile in PROFILES:
        most = int(found.friction[profile].argmax())
        figures = f"{found.friction[profile][most]:8.1f}{1e3 * found.place[most]:10.2f}"
        out.append(f"{profile:12}{figures}{found.volts[profile].max():8.0f}")
    return "\n".join(out)


def csv(found: Bump) -> str:
    """Return the curves as CSV in SI units, after lines `# key: value`."""
    about = {"device": found.device, "height": f"{found.height:g}", "width": f"{found.width:g}"}
    out = ["# dermis-bump 1", *(f"# {k}: {v}" for k, v in about.items()), f"# generator: dermis {version()}"]
    kinds = [(found.friction, "friction"), (found.volts, "volts")]
    out.append(",".join(["x_m", "height_m", *(f"{name}_{p}" for _, name in kinds for p in PROFILES)]))
    columns = [found.place, found.relief, *(values[p] for values, _ in kinds for p in PROFILES)]
    out += [",".join(f"{v:.9g}" for v in row) for row in np.column_stack(columns).tolist()]
    return "\n".join(out) + "\n"


def picture(found: Bump) -> bytes:
    """Return a PNG with friction and voltage along the bump.

    There is a curve for each profile, and the bump behind the curves.
    """
    width, height = 700.0, 400.0
    canvas = PngCanvas(width, height)
    canvas.rectangle(0, 0, width, height, PAPER)
    size = f"{1e3 * found.height:g} mm high, {1e3 * found.width:g} mm wide (standard deviation)"
    canvas.text(20, 22, f"A bump {size}, on {found.device}", 9, INK)
    legend(canvas, 20, 42, [*((p, COLOURS[p]) for p in PROFILES), ("the bump", FAINT)])
    x = 1e3 * found.place
    xlim = (float(x.min()), float(x.max()))
    for k, (values, title) in enumerate(((found.friction, "friction, 0 to 100"), (found.volts, "amplitude [V]"))):
        top = 1.1 * max(max(float(v.max()) for v in values.values()), 1e-9)
        axes = Axes(canvas, (55 + 345 * k, 75, 275, 270), xlim, (0.0, top))
        axes.grid("place [mm]", title, most=(5, 5), colour=FAINT)
        axes.curve(x, found.relief / found.height * top / 1.1, FAINT)
        for profile in PROFILES:
            axes.curve(x, values[profile], COLOURS[profile])
    return canvas.to_bytes()


def write(found: Bump, folder: Path) -> tuple[Path, Path]:
    """Write table and picture into a folder and return their paths.

    Each file is written atomically.

    Raises:
        DermisError: the folder cannot be written.
    """
    table, drawn = Path(folder) / f"{found.device}.bump.csv", Path(folder) / f"{found.device}.bump.png"
    write_bytes(table, csv(found).encode())
    write_bytes(drawn, picture(found))
    return table, drawn
