"""The pictures of the page of measured fingers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from core.files import write_bytes
from core.plot.axes import FAINT, INK
from core.plot.canvas import PngCanvas

from ..chart import Chart
from .numbers import pulls
from .plate import MM, Array, Moment
from .trials import BELOW, DIRECTIONS, FRICTIONS, PULLED, RADII, Trials

COLOURS = {"linear": "#1f6fb2", "neo-Hookean": "#c8323c", "exponential through it": "#b9c0c8"}
BALLS = dict(zip(RADII, ("#c8323c", "#b0661a", "#8a4fb0", "#1f6fb2", "#6b7480"), strict=True))
STUCK, SLIPS = "#1f3a5f", "#f0a830"
PULLS = (0.25, 0.5, 0.75, 0.95)  # of what friction can carry
NEAR = 0.05  # to a pull: one that is farther off is not it
SCALE, SQUARE = 15.0, 0.88  # points a millimetre, and how much of a square is drawn of its side
TALL = 13.0  # of what is drawn of a contact [mm]


def draw(found: Mapping[str, Trials], folder: Path) -> None:
    """Draw and write all of them."""
    _force(found, folder / "fingers_force.png")
    _area(found, folder / "fingers_area.png")
    _drag(found, folder / "fingers_drag.png")
    _slip(found, folder / "fingers_slip.png")
    _balls(found, folder / "fingers_balls.png")


def _force(found: Mapping[str, Trials], path: Path) -> None:
    chart = Chart(
        2,
        "A plate pressed on the index finger, medium, E 100 kPa: simulated",
        ("depth [mm]", "force [N]"),
        ("force [N]", "stiffness [N/mm]"),
        colours=COLOURS,
    )
    for name, each in found.items():
        depth, force = _pressed(each.pressed)
        chart.curve(0, np.r_[0.0, depth], np.r_[0.0, force], name)
        chart.curve(1, force, np.gradient(force, depth), name)
    chart.write(path)


def _area(found: Mapping[str, Trials], path: Path) -> None:
    chart = Chart(
        2,
        "What touches the plate, and the pressure across the middle of the contact at 1 N: simulated",
        ("force [N]", "across the finger [mm]"),
        ("area on the plate [mm^2]", "pressure [kPa]"),
        colours=COLOURS,
    )
    for name, each in found.items():
        _, force = _pressed(each.pressed)
        chart.curve(0, np.r_[0.0, force], np.r_[0.0, [m.plate / MM**2 for m in each.pressed]], name)
        at_one = each.pressed[int(np.abs(force - 1.0).argmin())]
        x, pressure = _across(at_one)
        chart.curve(1, x / MM, pressure / 1e3, name)
    chart.write(path)


def _drag(found: Mapping[str, Trials], path: Path) -> None:
    chart = Chart(
        3,
        f"Area on the plate while it is dragged under {PULLED:g} N, friction {FRICTIONS[-1]:g}: simulated",
        ("pull over what friction can carry",) * 3,
        tuple(f"area [% of that at rest], {name}" for name in DIRECTIONS),
        colours=COLOURS,
        from_zero=False,
    )
    for tissue, each in found.items():
        for k, name in enumerate(DIRECTIONS):
            moments = each.dragged[FRICTIONS[-1], name]
            pull = np.maximum.accumulate(pulls(moments, name, FRICTIONS[-1]))
            chart.curve(k, pull, np.array([100.0 * m.plate / moments[0].plate for m in moments]), tissue)
    chart.write(path)


def _slip(found: Mapping[str, Trials], path: Path) -> None:
    step_x, step_y = 920.0 / (len(PULLS) + 0.35), TALL * SCALE + 16.0
    canvas = PngCanvas(920.0, 64.0 + step_y * len(found))
    words = (
        f"What sticks (dark) and slips (light): {PULLED:g} N, friction {FRICTIONS[-1]:g}, plate to the right; simulated"
    )
    canvas.text(24, 24, words, 9.5, INK)
    for k, share in enumerate(PULLS):
        middle = 90.0 + step_x * (k + 0.4)
        canvas.text(middle, 46, f"pull {100 * share:g} % of friction", 7.5, FAINT, "middle")
    for row, (tissue, each) in enumerate(found.items()):
        moments = each.dragged[FRICTIONS[-1], "to the side"]
        pull = pulls(moments, "to the side", FRICTIONS[-1])
        y = 56.0 + step_y * (row + 0.5)
        canvas.text(24, y, tissue, 8.5, INK)
        for k, share in enumerate(PULLS):
            nearest, x = int(np.abs(pull - share).argmin()), 90.0 + step_x * (k + 0.4)
            if abs(pull[nearest] - share) <= NEAR:
                _map(canvas, moments[nearest], x, y)
            else:  # skin gave way before
                canvas.text(x, y, "not reached", 7.5, FAINT, "middle")
    write_bytes(path, canvas.to_bytes())


def _map(canvas: PngCanvas, moment: Moment, x: float, y: float) -> None:
    middle = 0.5 * (moment.points.max(axis=0) + moment.points.min(axis=0))
    places, sides = SCALE * (moment.points - middle) / MM, SCALE * SQUARE * np.sqrt(moment.areas) / MM
    for (right, up), side, sticks in zip(places.tolist(), sides.tolist(), moment.sticks.tolist(), strict=True):
        canvas.rectangle(x + right - 0.5 * side, y - up - 0.5 * side, side, side, STUCK if sticks else SLIPS)


def _balls(found: Mapping[str, Trials], path: Path) -> None:
    names = {r: f"{r:g} mm" if np.isfinite(r) else "flat" for r in RADII}
    chart = Chart(
        len(found),
        f"Strain energy density {BELOW[0]:g} mm below the skin under balls of these radii, 80 g: simulated",
        ("across the finger [mm]",) * len(found),
        tuple(f"log10 of J/m^3, {name}" for name in found),
        colours={names[r]: BALLS[r] for r in RADII},
        from_zero=False,
    )
    for k, each in enumerate(found.values()):
        for r in RADII:
            profile = each.balls[BELOW[0], r][-1]
            chart.curve(k, profile.across / MM, np.log10(profile.density), names[r])
    chart.write(path)


def _pressed(moments: list[Moment]) -> tuple[Array, Array]:
    return np.array([m.place[2] for m in moments]) / MM, np.array([m.force[2] for m in moments])


def _across(moment: Moment) -> tuple[Array, Array]:
    """Return places and pressure along the row of squares next to the middle of the pressure."""
    middle = float(np.average(moment.points[:, 1], weights=moment.pressure))
    height = moment.points[:, 1] - moment.points[np.abs(moment.points[:, 1] - middle).argmin(), 1]
    row = np.flatnonzero(np.abs(height) < 0.3 * np.sqrt(np.median(moment.areas)))
    row = row[np.argsort(moment.points[row, 0])]
    return moment.points[row, 0], moment.pressure[row]
