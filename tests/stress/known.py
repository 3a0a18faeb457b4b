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
    "each point of skin keeps the face that it came to"
)
_FACETS = "at the few nodes of a mesh, which facet of a ball or face of a hull holds a node depends on the way there"
_ENTERS = (
    "few and long steps: friction is right to the second order of the step, and only to the first where a way turns at "
    "once, at edges, and for how frames are walked in parts"
)
_SMALL = (
    "something smaller than a mesh's cells is held by one node or two, slips between them, and where it is deeper than "
    "they face it drags them after it; 'smaller-than-mesh' says so of its force, 'slips-in' of some of these frames"
)


def _small(values: Values) -> bool:
    return values["contact"] == "nodes" and values["shape"] != "block" and float(values["size"]) < 8e-3


KNOWN: tuple[Known, ...] = (
    Known(
        "surface",
        "distance",
        (25,),
        "which of two edges is closest is told by squares: next to where they meet that leaves half of the digits; so "
        "do Gram determinants of triangles down to 1e-4 as high as they are long",
        below=3e-8,
    ),
    Known("press", "pull", (47,), _SMALL, covers=_small),
    Known("press", "fall", (2007,), _SMALL, covers=_small),
    Known("rate", "rate", (2013, 2017), _SMALL, covers=lambda v: _small(v) and v["friction"] == 0.0),
    Known(
        "thimble",
        "refused at core/devices",
        (13698, 15036),
        "where a leg is all but stretched, a pose that passes as feasible is refused by its constraints, or not found "
        "again from its servos' angles",
        covers=lambda v: float(v["turn"]) > 0.1 or float(v["shift"]) > 1e-3,
    ),
    Known(
        "thimble",
        "there and back",
        (15243,),
        "far from level another pose has the same servos' angles, and is found in its place",
        covers=lambda v: float(v["turn"]) > 0.3,
    ),
    Known("inside", "inside", (16,), _CORNER, 0.6, lambda v: v["contact"] == "points" and v["shape"] != "block"),
    Known("inside", "inside", (60,), _FACETS, 0.15, lambda v: v["contact"] == "nodes" and v["shape"] != "block"),
    Known("again", "again", (15,), _CORNER, 0.6, lambda v: v["contact"] == "points" and v["shape"] != "block"),
    Known("again", "again", (1,), _FACETS, 1.0, lambda v: v["contact"] == "nodes" and v["shape"] != "block"),
    Known(
        "rate",
        "rate",
        (504,),
        "neo-Hookean tissue, pressed or dragged farther than it is trusted ('too-deep', 'slid-far'), lets go on "
        "another way than it came, as its steps have it",
        1.0,
        lambda v: v["tissue"] == "neo_hookean" and max(float(v["depth"]), 0.4 * float(v["slide"])) > 2e-3,
    ),
    Known("rate", "rate", (3,), _ENTERS, 0.3, lambda v: float(v["friction"]) > 0.0),
    Known("rate", "rate", (1, 17), _CORNER, 0.1, lambda v: v["friction"] == 0.0 and v["shape"] != "block"),
    Known(
        "rate",
        "rate",
        (508,),
        "a block without friction at nodes, not looked into yet: it is likely its rim, as of what is sharp",
        0.1,
        lambda v: v["friction"] == 0.0 and v["shape"] == "block" and v["contact"] == "nodes",
    ),
    Known("meshed", "same", (1022,), _CORNER, 0.2, lambda v: v["shape"] in ("pillar", "edge", "hull")),
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
        (7,),
        "what presses with sharp edges and friction settles over more cycles than three",
        0.1,
        lambda v: float(v["friction"]) > 0.0 and v["shape"] in ("pillar", "edge", "hull"),
    ),
)
# Cases that failed and were mended: family -> seeds.
MENDED: dict[str, tuple[int, ...]] = {
    "surface": (193, 223, 273, 480),
    "stretched": (1049,),
    "pins": (13649,),
    "thimble": (14997,),
}


def known_failure(family: str, check: str, value: float, values: Values) -> Known | None:
    """Return the row that covers a failure, None where it is new."""
    rows = (row for row in KNOWN if row.family == family and check.startswith(row.check))
    return next((row for row in rows if value <= row.below and row.covers(values)), None)
