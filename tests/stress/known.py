"""What is known to fail, and why; and seeds that failed once, which every run tries first.

A known failure stands until it is mended: its seeds are tried in every run of their family, and one that passes is
told, so that its row goes. Nothing else is excused: a failure that no row covers fails the run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .case import Values


@dataclass(frozen=True)
class Known:
    """A failure that is known.

    Attributes:
        family, check: what fails, or how that begins. seeds: of cases that fail, tried in every run.
        reason: what is wrong.
        below: the largest value known: one above it is another failure. covers: which cases fail so.
    """

    family: str
    check: str
    seeds: tuple[int, ...]
    reason: str
    below: float = float("inf")
    covers: Callable[[Values], bool] = lambda values: True


_CORNER = (
    "a finger without friction slides off a sharp corner or edge to one side or the other, as the way there has it: "
    "what is sharper than a cell of skin is catches it, or lets it go, as a whole"
)
_FACETS = "at the few nodes of a mesh, which facet of a ball or face of a hull holds a node depends on the way there"
_ONE_NODE = (
    "a corner of a hull that one node holds: which of its faces that lies on depends on the way there; "
    "'smaller-than-mesh' says so of its force"
)
_ENTERS = (
    "few and long steps: friction is right to the second order of the step, and only to the first where a way turns at "
    "once, at edges, and for how frames are walked in parts"
)
_SMALL = (
    "something smaller than a mesh's cells is held by one node or two, slips between them, and where it is deeper than "
    "they face it drags them after it; 'smaller-than-mesh' says so of its force, 'slips-in' of some of these frames"
)


def _small(values: Values) -> bool:
    beside = int(values.get("others", 0)) > 0  # balls of 3 mm, whatever the body is
    return values["contact"] == "nodes" and (beside or values["shape"] != "block" and float(values["size"]) < 8e-3)


def _narrow(values: Values) -> bool:
    sharp = values["shape"] in ("pillar", "edge", "hull")
    return values["contact"] == "points" and sharp and float(values["size"]) < 5e-3


KNOWN: tuple[Known, ...] = (
    Known(
        "press",
        "fall",
        (610128,),
        "at nodes something small is held by few of them: where it comes to bear on another, less is lost than "
        "'slips-in' tells of",
        0.02,
        _small,
    ),
    Known(
        "press",
        "fall",
        (795404,),
        "the one node that is touched first, by a corner of an edge, is held by this face and then by that, with some "
        "thousandths of what is felt in the end",
        0.8,
        lambda v: v["contact"] == "nodes" and v["shape"] == "edge",
    ),
    Known("rate", "rate", (508, 2017, 510000), _SMALL, covers=_small),
    Known(
        "inside", "inside", (16, 610025), _CORNER, 0.65, lambda v: v["contact"] == "points" and v["shape"] != "block"
    ),
    Known("inside", "inside", (60,), _FACETS, 0.15, lambda v: v["contact"] == "nodes" and v["shape"] != "block"),
    Known(
        "inside",
        "inside",
        (310042,),
        _ONE_NODE,
        1.5,
        lambda v: v["contact"] == "nodes" and v["shape"] == "hull" and float(v["depth"]) < 1e-3,
    ),
    Known(
        "again",
        "again",
        (15, 610043, 770007),
        _CORNER,
        1.5,
        lambda v: v["contact"] == "points" and v["shape"] != "block",
    ),
    Known("again", "again", (1,), _FACETS, 1.0, lambda v: v["contact"] == "nodes" and v["shape"] != "block"),
    Known("again", "again", (760006,), _ONE_NODE, 1.5, lambda v: v["contact"] == "nodes" and v["shape"] == "hull"),
    Known(
        "rate",
        "rate",
        (70005,),
        "a ball of 1 to 3 mm, with holes or without, that skin is drawn across with friction: the skin lets go of it "
        "sooner or later, as steps have it",
        0.5,
        lambda v: v["shape"] in ("ball", "shell") and float(v["size"]) < 3e-3 and float(v["friction"]) > 0.0,
    ),
    Known("rate", "rate", (3,), _ENTERS, 0.3, lambda v: float(v["friction"]) > 0.0),
    Known("rate", "rate", (1, 17), _CORNER, 0.1, lambda v: v["friction"] == 0.0 and v["shape"] != "block"),
    Known(
        "rate",
        "rate",
        (720004,),
        "a card that gives way by more than it is thick: skin comes about its lower face, sooner or later, as steps "
        "have it",
        1.0,
        lambda v: v["shape"] == "card" and 0.0 < float(v["stiffness"]) < 1e7,
    ),
    Known(
        "card",
        "same",
        (1004,),
        "beside the rim of a card that is narrower than the pad, and deeper in it than it is thick, skin comes about "
        "the card's lower face, where a block has a wall",
        0.15,
        lambda v: float(v["width"]) < 0.02 and float(v["depth"]) > float(v["thickness"]),
    ),
    Known(
        "drift",
        "drift",
        (310000, 760014),
        "which cells of skin a sharp edge is pressed by depends on when they were looked at last: cycle by cycle its "
        "force differs by some hundredths, of the lightest touches by a sixth, and stays about the same",
        0.2,
        lambda v: v["contact"] == "points" and v["shape"] in ("pillar", "edge", "hull") and float(v["friction"]) > 0.0,
    ),
    Known(
        "drift",
        "drift",
        (610016,),
        "skin that a narrow, tilted pillar is pressed into over and over comes off its rim within some cycles, with a "
        "sixth of the force, and then stays",
        0.15,
        lambda v: _narrow(v) and v["shape"] == "pillar",
    ),
    Known(
        "drift",
        "drift",
        (795015, 795051),
        _CORNER,
        0.5,
        lambda v: v["friction"] == 0.0 and v["shape"] in ("pillar", "edge", "hull"),
    ),
    Known(
        "meshed",
        "same",
        (795136, 795248, 795252),
        "where a tilted pillar is deeper than linear skin is trusted, skin that is drawn about its rim lies on its top "
        "or on its wall by how these are cut",
        0.1,
        lambda v: v["contact"] == "points" and v["shape"] == "pillar" and float(v["depth"]) > 2e-3,
    ),
)
# Cases that failed and were mended: family -> seeds.
MENDED: dict[str, tuple[int, ...]] = {
    "card": (40052,),
    "drift": (70003,),
    "meshed": (760079, 760146, 770001),
    "press": (47, 2007, 40007, 40040, 40044, 70033, 110067, 510149, 760059, 760073),
    "surface": (25, 193, 223, 273, 480, 111588),
    "stretched": (1049,),
    "turned": (710053,),
    "pins": (13649,),
    "thimble": (13698, 14997, 15036, 15243, 41448, 47863, 52968, 54682, 57493, 66816),
}


def known_failure(family: str, check: str, value: float, values: Values) -> Known | None:
    """Return the row that covers a failure, None where it is new."""
    rows = (row for row in KNOWN if row.family == family and check.startswith(row.check))
    return next((row for row in rows if value <= row.below and row.covers(values)), None)
