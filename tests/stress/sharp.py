"""By how much force hangs on a shift of a micrometre at sharp places: corners, feet of steps and rims of open sheets.

`python -m tests.stress.sharp --runs 20` draws so many touches of each kind, with each friction, and prints the table of
*Sharp places* in presets/ACCURACY.md.

The rule, set before any outcome was looked at. A touch is pressed, or pressed and slid, on points of the smooth skin.
It is told again with the solid shifted by 1 nm and by 1 um, each in a random direction. Its change is the largest
change of the force along the path, over the peak. Without friction it also goes there and back, and what differs at one
place counts too. A friction is enough if, of the touches for which the doubt's condition holds, at most one in twenty
changes by more than 1 % (there and back 4 %), the limits of `tolerances.INVARIANCE`. The doubt is told below the least
friction that is enough, as are all larger ones; with every friction if none is. The change that its finding states is
the largest of those with friction below that. Touches for which the condition does not hold must keep to the same
limits. Two things came later: shallower and shorter touches were drawn first, and showed little. And feet of
steps, of which a doubt was told while points saw one of two faces alone, keep to the limits since hollows are rounded.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.contact.doubtful_touches import CORNER, RIM
from core.scene.tactile_scene import Body, Mesh

from .case import Dice, Values, apart
from .paths import poses
from .placed import ABOVE, RATE, Touch, first_contact
from .setups import Setup
from .tolerances import INVARIANCE

Array = NDArray[np.float64]
FRICTIONS = (0.0, 0.1, 0.3, 0.6)
SPEED, DEPTH, SLIDE = (50e-3, 200e-3), (0.5e-3, 1.5e-3), (2e-3, 4e-3)  # as `placed.draw`, slow and shallow ones aside
SHIFTS = (1e-9, 1e-6)  # [m]
SHIFTED, BACK = INVARIANCE["shifted"], INVARIANCE["back"]
WIDE, HIGH = 12e-3, 10e-3  # of the solids, so that nothing else of them is touched [m]
STORED = Path(__file__).with_name("sharp.jsonl")
RUNS = 20
# Codes of the doubts; none is told of the foot of a step, as without friction it keeps to the limits.
KINDS = {"corner": CORNER.code, "foot": None, "rim": RIM.code}


def draw(kind: str, friction: float, seed: int) -> Values:
    """Draw a touch; the same seed draws the same one for each friction."""
    dice = Dice(f"sharp place, {kind}", seed)
    return {
        "kind": kind,
        "friction": friction,
        "angle": dice.between(*{"corner": (40.0, 170.0), "foot": (35.0, 90.0), "rim": (60.0, 180.0)}[kind]),
        "rise": dice.between(0.15e-3, 0.6e-3),
        "path": dice.one_of("press", "slide"),
        "speed": dice.decades(*SPEED),
        "depth": dice.between(*DEPTH),
        "slide": dice.between(*SLIDE),
        "way": dice.between(-180.0, 180.0),
        "x": dice.between(-1e-3, 1e-3) + (0.0 if kind != "rim" else dice.between(-1e-3, 5e-3)),
        "y": dice.between(-1e-3, 1e-3),
        "tilt": dice.between(-10.0, 10.0),
        "roll": dice.between(-10.0, 10.0),
        "yaw": dice.between(-180.0, 180.0),
        "random": dice.whole(0, 10**6),
    }


def solid(values: Values) -> Mesh:
    """Return the solid of a touch; the sharp place is at its origin, and its top is level there."""
    angle, rise = np.radians(float(values["angle"])), float(values["rise"])
    if values["kind"] == "corner":  # a prism whose top has a corner of that angle
        turns = np.array([0.0, angle / 2.0, angle])
        outer = WIDE * np.array([1.0, 1.5, 1.0])[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        return _prism(np.vstack([np.zeros(2), outer]), HIGH)
    if values["kind"] == "rim":  # a sheet with a corner of that angle, far off; the nearest rim runs along Y
        corners = np.array([[0.0, -WIDE], [2.0 * WIDE, -WIDE], [2.0 * WIDE, WIDE], [0.0, WIDE]])
        return Mesh(np.column_stack([corners, np.zeros(4)]), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    run = rise / np.tan(angle)  # a step: its wall turns by the angle at the foot, and rises along X
    profile = [[-WIDE, -HIGH], [WIDE, -HIGH], [WIDE, rise], [run, rise], [0.0, 0.0], [-WIDE, 0.0]]
    return _along(np.array(profile), 3.0 * WIDE)


def _prism(outline: Array, high: float) -> Mesh:
    n = len(outline)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    fan = np.array([(0, k, k + 1) for k in range(1, n - 1)])
    vertices = np.vstack([np.column_stack([outline, np.full(n, z)]) for z in (0.0, -high)])
    sides = np.vstack([np.stack([i + n, j + n, j], 1), np.stack([i + n, j, i], 1)])
    return Mesh(vertices, np.vstack([fan, fan[:, ::-1] + n, sides]).astype(np.int32))


def _along(profile: Array, length: float) -> Mesh:
    """Return a prism along Y over a profile in X and Z whose second corner sees all others."""
    n = len(profile)
    low, high = (np.insert(profile, 1, y, axis=1) for y in (-length / 2, length / 2))
    ends = np.array([(1, 2, 3), (1, 3, 4), (1, 4, 5), (1, 5, 0)])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    sides = np.vstack([np.stack([i, i + n, j], 1), np.stack([j, i + n, j + n], 1)])
    return Mesh(np.vstack([low, high]), np.vstack([ends, ends[:, ::-1] + n, sides]).astype(np.int32))


class SharpTouch(Touch):
    """A drawn touch of a sharp place."""

    def __init__(self, values: Values, mesh: Mesh | None = None) -> None:
        told = {**values, "shape": "block", "contact": "points", "level": "draft"}
        super().__init__(told, [solid(values) if mesh is None else mesh])
        self.at = np.zeros(2)

    @property
    def place(self) -> Array:  # type: ignore[override]
        """Where the solid's origin is when it first meets the smooth skin [m], shape (3,)."""
        beside = self.turn @ [float(self.values["x"]), float(self.values["y"]), 0.0]
        at = -beside[:2]
        return np.array([*at, first_contact(self.parts, self.turn, at)])

    def told(self, shift: Array | None = None, *, back: bool = False) -> Setup:
        """Return the scene, shifted by so much [m], shape (3,), or there and back."""
        start, deep = [0.0, 0.0, -ABOVE], [0.0, 0.0, self.depth]
        way = np.array([start, deep, [*self.slide, self.depth]][: 2 if self.values["path"] == "press" else 3])
        offsets = self.offsets(np.vstack([way, way[-2::-1]]) if back else way, RATE)
        if shift is not None:
            offsets = offsets + shift
        body = Body("solid", self.parts[0], {"friction": float(self.values["friction"])})
        bodies = ((body, poses(self.known + offsets, self.turn)),)
        return Setup(RATE, bodies, {"contact": "points", "skin_level": "draft"})

    @property
    def known(self) -> Array:
        """The place, found once."""
        if "_known" not in self.__dict__:
            self._known = self.place
        return self._known


@dataclass(frozen=True)
class Outcome:
    """What was measured of a touch: whether its doubt's condition held, and its changes by shifts and by the way."""

    values: Values
    told: bool
    shifted: float
    back: float


def measure(values: Values) -> Outcome:
    """Measure a touch."""
    _, changes, told = retold(SharpTouch(values))
    return Outcome(values, KINDS[str(values["kind"])] in told, **changes)


def retold(touch: SharpTouch) -> tuple[Array, dict[str, float], frozenset[str]]:
    """Return a touch's force at each sample [N], its changes by shifts and by the way, and the codes that are told."""
    rng = np.random.default_rng(int(touch.values["random"]))
    force, told = felt(touch.told())
    changes = {"shifted": 0.0, "back": 0.0}
    for far in SHIFTS:
        way = rng.normal(size=3)
        other, also = felt(touch.told(far * way / np.linalg.norm(way)))
        changes["shifted"], told = max(changes["shifted"], apart(force, other)), told | also
    if not touch.values["friction"]:
        both, also = felt(touch.told(back=True))
        changes["back"], told = apart(both, both[::-1]), told | also
    return force, changes, told


def felt(setup: Setup) -> tuple[Array, frozenset[str]]:
    """Return the force at each sample [N], shape (n, 3), and the codes of all findings."""
    bake = setup.bake()
    felt = bake.skins[setup.name]
    force = np.zeros((len(felt.times), 3))
    force[felt.contact] = np.asarray(felt.held, np.float64).sum(axis=1)
    return force, frozenset(f.code for f in bake.all_findings)


def outcomes(stored: Path, runs: int) -> Iterator[Outcome]:
    """Yield what was measured, and measure what is not stored yet."""
    drawn = (draw(kind, friction, seed) for seed in range(runs) for kind in KINDS for friction in FRICTIONS)
    return (Outcome(**entry) for entry in entries(stored, drawn, measure))


def entries(stored: Path, drawn: Iterable[Values], measure: Callable[[Values], object]) -> Iterator[dict[str, Any]]:
    """Yield what was measured of touches as lines store it, and measure and store what is not stored yet."""
    lines = stored.read_text(encoding="utf-8").splitlines() if stored.exists() else []
    known = {json.dumps(entry["values"], sort_keys=True): entry for entry in map(json.loads, lines)}
    with stored.open("a", encoding="utf-8") as file:
        for values in drawn:
            entry = known.get(json.dumps(values, sort_keys=True))
            if entry is None:
                entry = vars(measure(values))
                file.write(json.dumps(entry) + "\n")
                file.flush()
            yield entry


def table(found: list[Outcome]) -> str:
    """Return the table: of each kind and friction, how many touches change beyond the limit, and the largest change."""
    rows = ["| sharp place | friction | told | beyond 1 % | largest | there and back | not told: largest |"]
    rows.append("|---|---|---|---|---|---|---|")
    for kind in KINDS:
        for friction in FRICTIONS:
            mine = [o for o in found if o.values["kind"] == kind and o.values["friction"] == friction]
            told, others = [o for o in mine if o.told], [o for o in mine if not o.told]
            beyond = sum(o.shifted > SHIFTED or o.back > BACK for o in told)
            back = "-" if friction else most(o.back for o in told)
            row = (kind, f"{friction:g}", f"{len(told)} of {len(mine)}", f"{beyond}")
            rows.append(
                f"| {' | '.join((*row, most(o.shifted for o in told), back, most(o.shifted for o in others)))} |"
            )
    return "\n".join(rows)


def beyond(found: list[Outcome], kind: str, friction: float) -> float:
    """Return the share of the touches told with a friction that change by more than the limits."""
    told = [o for o in found if o.told and o.values["kind"] == kind and o.values["friction"] == friction]
    return sum(o.shifted > SHIFTED or o.back > BACK for o in told) / max(len(told), 1)


def enough(found: list[Outcome], kind: str) -> float:
    """Return the friction from which on the doubt is not told, inf for none: see the rule."""
    for friction in FRICTIONS:
        if all(beyond(found, kind, more) <= 1.0 / 20.0 for more in FRICTIONS if more >= friction):
            return friction
    return float("inf")


def most(changes: Iterable[float]) -> str:
    """Return the largest change in percent."""
    largest = max(changes, default=None)
    return "-" if largest is None else f"{100.0 * largest:.1f} %"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS, help="touches of each kind with each friction")
    parser.add_argument("--stored", type=Path, default=STORED, help="file with what was measured")
    given = parser.parse_args()
    print(table(list(outcomes(given.stored, given.runs))))
