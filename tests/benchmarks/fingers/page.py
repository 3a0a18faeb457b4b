"""The page of measured fingers, from its numbers."""

# ruff: noqa: E501  the lines of the page

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from core.contact.trusted import trusted
from core.parameters.error_bands import NEO_HOOKEAN

from .trials import BELOW, RADII, WEIGHTS

Cell = Callable[[Mapping[str, Any]], str]
COMMAND = "python -m tests.benchmarks.figures_fingers --out presets"
YOUNG = 100.0  # of the skin [kPa]

HEAD = """# Measured fingers

What laboratories measured on people's fingertips, and the results of the skins here under the same touch: the linear one and the neo-Hookean one, which stiffens. **Their values stand with their source; every number and picture of ours is simulated**, by `{command}` in the benchmarks' environment (some minutes).

Skin: *Index Finger, Medium* as it ships, E {young:g} kPa, Poisson's ratio 0.48, {level} accuracy. The lengths of the preset are chosen, not measured, so shapes can be compared with people's and absolute numbers only in size. The plate is smooth and rigid, tilted by 20 degrees towards the tip, as in Pawluk and Howe's 20 to 40. It touches on even squares of 0.4 mm, solved together: {moments} moments, contact's laws unsettled in {unsettled}.

Sources were read as abstracts where not said otherwise, so of curves only the shape is known to us, not the numbers. **No curve could be fitted, so no preset's stiffness comes from this page**; one measured range has numbers, and *Stiffness sideways* says which E would give it.
"""

FORCE = """
## Force against depth

Measured: force grows *exponentially* with depth, up to 2 N, under a flat probe (Pawluk and Howe 1999, *J Biomech Eng* 121(2) and 121(6): the instantaneous elastic response and the total force). The pulp is *compliant below 1 N and stiffens rapidly above* (Serina, Mote and Rempel 1997, *J Biomech* 30, 20 people; the sentence of its abstract, as others quote it). Strongly nonlinear and viscoelastic, with wide differences between people that finger size does not tell (Gulati and Srinivasan 1995, as the MIT Touch Lab's page sums it up).

![Force and stiffness against depth and force, both tissues](../pictures/fingers_force.png)
"""

FORCE_AFTER = """
An exponential is a straight line in the right-hand picture, stiffness against force; a power law bends to the right. {verdict} From 0.5 to 2 N stiffness grows {times}; how much the pulp's does is not in the abstracts. Uniform tissue has no stiff outer skin, no fibres that tighten and no relaxation (Pawluk and Howe: 4 ms, 70 ms and 1.4 s).
"""

AREA = """
## Contact area against force

Measured: area was taken from 0.25 to 7 N and told well by a membrane of stiffening skin about a fluid (Serina, Mockensturm and Mote 1998, *J Biomech* 31); on paper, by ink, it grows with force in straight pieces (*Measuring contact area in a sliding human finger-pad contact*, 2018, *Skin Res Technol* 24). The *pressure is plausibly an inverted paraboloid* (Pawluk and Howe 1999, 121(6)). The secant modulus of the whole pad rises with force along a straight line (Dzidek, Adams, Andrews, Zhang and Johnson 2017, *J R Soc Interface* 14, caption of figure 7). For a ball in Hertz's theory, area grows as force^0.67 and pressure is half an ellipsoid.

![Contact area against force, and pressure across the contact](../pictures/fingers_area.png)
"""

AREA_AFTER = """
Gross area only: our skin has no ridges, so the real area of contact, which people's friction follows, is not in it.
"""

DRAG = """
## Contact area under drag

Measured: *area shrinks while the pull grows*, which the authors propose to explain by skin that stiffens; the behaviour of skin differs much between the four directions that were tried (Delhaye, Lefevre and Thonnard 2014, *J R Soc Interface*, PMC4191101). It shrank from rest to sliding in the study of 2018 above, too. The contact of a plane finite-element fingertip of nonlinear tissue without adhesion shrinks significantly (*Macroscopic Modeling of Fingerpad Friction Under Electroadhesion*, 2020, *Front Mech Eng* 6). Friction 0.6 and 0.9 are those of a finger on aluminium and on rubber (Seo 2009); the force of {pulled:g} N is held to within {held:.1f} %.

![Contact area while the plate is dragged, three directions, both tissues](../pictures/fingers_drag.png)
"""

DRAG_AFTER = """
Area on the plate when all of it slides, over that before the pull (of a drag that did not come so far within 5.5 mm, at its end, marked *; of one in which skin then gave way, so that contact could not be settled, where it last was, marked †). {verdict} Up to {drawn:g} mm drawn the neo-Hookean one was held beside its law. How much people's shrinks is not in the abstract, so only the sign is compared. Adhesion, which would hold the rim longer and then let it peel, is not in the model.
"""

SLIP = """
## Slip from the rim

Measured: slip begins *at the periphery*, an annulus around a part that sticks, and grows towards the centre until all slips (Delhaye and others 2014, of their earlier work). The share that sticks *falls linearly from 1 to 0 with the pull*, at constant normal force (Andre, Levesque, Hayward, Lefevre and Thonnard 2011, *J R Soc Interface* 8). People notice when on average 48 % of the contact slips (Barrea, Delhaye, Lefevre and Thonnard 2018, *Sci Rep* 8).

![Sticking and slipping areas, at four pulls, both tissues](../pictures/fingers_slip.png)
"""

SLIP_AFTER = """
Means over three directions, friction 0.9. Both are Coulomb's law on an elastic body and need no stiffening; that a line is straight is no merit of either tissue.
"""

SIDE = """
## Stiffness sideways

Measured: 0.79 to 1.53 N/mm (Gleeson and others 2010, as [S3] quotes it; under what normal force is not known to us, so ours is at {pulled:g} N, over the first 0.2 mm, friction 0.9). It is the only measured range here that has numbers, so it can be asked which E would give it: tissue of E' under forces f acts as tissue of E under f E / E'.
"""

SIDE_AFTER = """
That E is beyond the {young:g} kPa of the presets ([S1]) and the 61 to 90 kPa of [S1]'s presses (alpha 0.61 to 0.90 as E / E0; by the wording of its fit alpha is the inverse, and E 111 to 164 kPa, which is still too soft to the side). So by these two measures no single E gives both. The presets keep [S1]'s.
"""

BALLS = """
## Goodwin's balls

Measured: balls of radius 1.92, 2.94, 5.81 and 12.4 mm and a flat, pressed on people's fingerpads with 40, 60 and 80 g: SA1 afferents *respond more the more curved the ball and the greater the force*, and the profile over the receptive field is *higher and narrower* for the more curved (Goodwin, Macefield and Bisley 1997, *J Neurophysiol* 78; the copy of the abstract that we read gives 694 per m for the smallest, which is a radius of 1.44 mm: we took the radii). That the mechanics below the skin can predict SA1 responses to shapes was found with layered fingertips (Dandekar, Raju and Srinivasan 2003, *J Biomech Eng* 125); strain energy density as the measure is our choice.

![Strain energy density below the skin under five shapes, both tissues](../pictures/fingers_balls.png)

Peak strain energy density {below:g} mm below the skin [kJ/m^3] and, in brackets, its width at half height [mm], by radius and weight:
"""

BALLS_AFTER = """
{verdict} The smallest ball goes {deepest} mm deep under 80 g, {comment}. Nothing here is a firing rate: an afferent saturates, energy does not. SA2 afferents, which tell 80.6 from 172 per m and no more beyond, have no counterpart.
"""

TAIL = """
## Not modelled

* **Adhesion.** Contact pulls nowhere. Clean glass holds moist skin; the rim then peels instead of opening.
* **Ridges, layers, fat, fibres.** One smooth, uniform tissue on bone and nail; what stiffens is its geometry and the law of large strains, not fibres.
* **Time.** No relaxation, creep or hysteresis; friction does not grow while sweat gathers (Dzidek, Bochereau, Johnson, Hayward and Adams 2017, *PNAS* 114: up to 20 s).
* **Depth.** Stress is off the neo-Hookean law itself by 12 % at 1 mm and 24 % at 2 mm in the linear skin, by 1 % in the neo-Hookean one, which follows it (medians of forty touches); long drags have larger errors in linear skin.
"""


def page(said: Mapping[str, Any]) -> str:
    """Return the page; `said` is what the command keeps of a run: level, and `numbers` of each tissue by its name."""
    tissues = said["tissues"]
    names = list(tissues)
    some = list(tissues.values())
    moments, unsettled = (sum(t[k] for t in some) for k in ("moments", "unsettled"))
    held = 100.0 * max(d["held"] for t in some for by in t["drag"].values() for d in by.values())
    parts = [
        HEAD.format(command=COMMAND, young=YOUNG, level=said["level"], moments=moments, unsettled=unsettled),
        FORCE,
        _table(tissues, _force_rows()),
        FORCE_AFTER.format(verdict=_straighter(tissues), times=_times(tissues)),
        AREA,
        _table(tissues, _area_rows()),
        AREA_AFTER,
        DRAG.format(pulled=2.0, held=held),
        _table(tissues, _drag_rows(some[0])),
        DRAG_AFTER.format(verdict=_shrinks(tissues), drawn=1e3 * trusted(NEO_HOOKEAN).slide),
        SLIP,
        _table(tissues, _slip_rows()),
        SLIP_AFTER,
        SIDE.format(pulled=2.0),
        _table(tissues, _side_rows(some[0])),
        SIDE_AFTER.format(young=YOUNG),
        BALLS.format(below=BELOW[0]),
        *(_ball_table(name, tissues[name]) for name in names),
        BALLS_AFTER.format(verdict=_order(tissues), **_deepest(tissues)),
        TAIL,
    ]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def _table(tissues: Mapping[str, Any], rows: Sequence[tuple[str, str, Cell]]) -> str:
    lines = ["| | measured | " + " | ".join(tissues) + " |", "|---|---|" + "---|" * len(tissues)]
    lines += [
        f"| {what} | {they} | " + " | ".join(cell(t) for t in tissues.values()) + " |" for what, they, cell in rows
    ]
    return "\n".join(lines)


def _force_rows() -> list[tuple[str, str, Cell]]:
    def law(key: str, power: str, rate: str, kept: str, unit: str) -> Cell:
        return lambda t: f"{t['press']['laws'][kept][power]:.4f}, {key} {t['press']['laws'][kept][rate]:.2f}{unit}"

    rows: list[tuple[str, str, Cell]] = []
    for kept in ("to 2 N", "to 2 mm"):
        rows += [
            (f"F = a (exp(b d) - 1), {kept}: R2, b", "exponential", law("b", "exponential", "rate", kept, "/mm")),
            (f"F = a d^n, {kept}: R2, n", "-", law("n", "power", "exponent", kept, "")),
        ]
    stiffness: Cell = lambda t: ", ".join(f"{k:.2f}" for k in t["press"]["stiffness"].values())  # noqa: E731
    return [
        *rows,
        ("stiffness against force, R2 of a straight line", "straight", lambda t: f"{t['press']['straight']:.3f}"),
        ("stiffness at 0.5, 1 and 2 N [N/mm]", "rises rapidly above 1 N", stiffness),
        ("force at 2 mm [N]", "-", lambda t: f"{t['press']['force']:.2f}"),
    ]


def _area_rows() -> list[tuple[str, str, Cell]]:
    area: Cell = lambda t: ", ".join(f"{a:.0f}" for a in t["press"]["area"].values())  # noqa: E731
    return [
        ("area at 0.5, 1 and 2 N [mm^2]", "-", area),
        ("area = c F^n from 0.25 N: n", "-", lambda t: f"{t['press']['area exponent']:.2f}"),
        ("pressure at 1 N, R2 of a paraboloid", "plausible", lambda t: f"{t['press']['paraboloid']:.3f}"),
        ("pressure at 1 N, R2 of half an ellipsoid", "-", lambda t: f"{t['press']['ellipsoid']:.3f}"),
    ]


def _drag_rows(first: Mapping[str, Any]) -> list[tuple[str, str, Cell]]:
    def cell(friction: str, name: str) -> Cell:
        def of(tissue: Mapping[str, Any]) -> str:
            d = tissue["drag"][friction][name]
            mark = "" if d["slides"] else " †" if d["gives way"] else " *"
            return f"{100.0 * (d['area'] - 1.0):+.1f} % after {d['way']:.1f} mm{mark}"

        return of

    return [
        (f"friction {friction}, {name}", "shrinks", cell(friction, name))
        for friction, by in first["drag"].items()
        for name in by
    ]


def _slip_rows() -> list[tuple[str, str, Cell]]:
    def mean(key: str, digits: int) -> Cell:
        def of(tissue: Mapping[str, Any]) -> str:
            found = [d[key] for d in tissue["drag"]["0.9"].values()]
            return f"{sum(found) / len(found):.{digits}f}"

        return of

    return [
        ("share that sticks against pull, R2 of a straight line", "linear", mean("straight", 3)),
        (
            "mean distance from the middle, slipping over sticking points, half slipping (annulus around a disc: 1.83)",
            "an annulus",
            mean("rim", 2),
        ),
        ("pull when 48 % slips, over the limit of friction", "noticed there", mean("pull when felt", 2)),
    ]


def _side_rows(first: Mapping[str, Any]) -> list[tuple[str, str, Cell]]:
    def young(times: float) -> str:
        return f"{YOUNG * times:.0f}" if times == times else "beyond what was tried"

    def stiffness(name: str) -> Cell:
        return lambda t: f"{t['sideways'][name]['stiffness']:.2f}"

    def fitted(name: str) -> Cell:
        return lambda t: " to ".join(young(t["sideways"][name][end]) for end in ("low", "high"))

    rows: list[tuple[str, str, Cell]] = []
    for name in first["sideways"]:
        rows += [(f"{name} [N/mm]", "0.79 to 1.53", stiffness(name)), (f"{name}: E for that [kPa]", "-", fitted(name))]
    return rows


def _ball_table(name: str, tissue: Mapping[str, Any]) -> str:
    found = tissue["balls"][f"{BELOW[0]:g}"]
    lines = [f"| {name} | " + " | ".join(f"{w:g} g" for w in WEIGHTS) + " |", "|---|" + "---|" * len(WEIGHTS)]
    for radius, peaks, widths in zip(RADII, found["peaks"], found["widths"], strict=True):
        title = f"{radius:g} mm" if radius < float("inf") else "flat"
        cells = [f"{peak / 1e3:.2f} ({wide:.1f})" for peak, wide in zip(peaks, widths, strict=True)]
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _straighter(tissues: Mapping[str, Any]) -> str:
    fits = {name: t["press"]["straight"] for name, t in tissues.items()}
    best = max(fits, key=lambda name: fits[name])
    if len(fits) == 1:
        return f"The {best} skin's R2 there is {fits[best]:.3f}."
    better = [
        n
        for n, t in tissues.items()
        if t["press"]["laws"]["to 2 mm"]["exponential"] > t["press"]["laws"]["to 2 mm"]["power"]
    ]
    said = (
        "By the force itself a power law fits both tissues better than an exponential"
        if not better
        else f"By the force itself an exponential fits the {' and the '.join(better)} skin better than a power law"
    )
    return f"The {best} skin's is the straighter line. {said}, by very little: R2 of a smooth curve hardly tells the two apart."


def _times(tissues: Mapping[str, Any]) -> str:
    found = {name: list(t["press"]["stiffness"].values()) for name, t in tissues.items()}
    return " and ".join(f"{rising[-1] / rising[0]:.1f} times ({name})" for name, rising in found.items())


def _shrinks(tissues: Mapping[str, Any]) -> str:
    said = []
    for name, t in tissues.items():
        areas = [d["area"] for by in t["drag"].values() for d in by.values()]
        fewer = sum(a < 1.0 for a in areas)
        said.append(
            f"the {name} skin's shrinks in {fewer} of {len(areas)} drags ({100 * (min(areas) - 1):+.0f} to {100 * (max(areas) - 1):+.0f} %)"
        )
    text = ", ".join(said)
    return f"{text[0].upper()}{text[1:]}."


def _order(tissues: Mapping[str, Any]) -> str:
    rules = ("rises with curvature", "rises with force", "narrows with curvature")
    said = []
    for name, t in tissues.items():
        found = t["balls"][f"{BELOW[0]:g}"]
        kept, broken = ([r for r in rules if found[r] is k] for k in (True, False))
        said.append(f"{name}: {', '.join(kept)}" + (f"; **not** {', '.join(broken)}" if broken else ""))
    also = all(t["balls"][f"{BELOW[1]:g}"][r] for t in tissues.values() for r in rules[:2])
    ends = f"At {BELOW[1]:g} mm, where TouchSim puts SA1 receptors, peaks {'are in the same order' if also else 'are not all in that order'}; widths there show the solver's squares and are not told."
    return f"Of what people's afferents do, the energy does: {'; '.join(said)}. {ends}"


def _deepest(tissues: Mapping[str, Any]) -> dict[str, str]:
    depths = {name: t["balls"][f"{BELOW[0]:g}"]["depths"][0][-1] for name, t in tissues.items()}
    beyond = [name for name, d in depths.items() if d > 2.0]
    text = " and ".join(f"{d:.2f} ({name})" for name, d in depths.items())
    return {
        "deepest": text,
        "comment": f"beyond the 2 mm that {' and '.join(beyond)} skin is trusted to"
        if beyond
        else "within the 2 mm that skins are trusted to",
    }
