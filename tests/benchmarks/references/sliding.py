"""A shape that is pressed and moved sideways, beside the same shape pressed in each of the places. Lengths in mm.

Without friction both must agree in the limit of fine meshes where contact has one answer; with friction they differ.
What the forces are off is judged by the rule in `results.py`, of force vectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .cases import FINGER, FRICTION, SCALES, STEP, first_contact
from .contact import Press, Pressed
from .hexahedra import Grading, Gradings, graded_fingertip
from .results import missing, rounded
from .shapes import Edge, Pillar, Shape
from .tissue import Tissue

Array = NDArray[np.float64]
RUN_UP = 0.1  # from where a shape begins to rise, below its place less the depth [mm]
MISSED = 1e-4  # deepest of the nodes that were not expected to touch [mm]


@dataclass(frozen=True)
class Slide:
    """A press in the middle and a way from there.

    Attributes:
        name: of the case. shape: what presses. gradings: of its meshes at a scale of 1, about `sideways`.
        way: where it is after each part of the way, (x, y) from the middle [mm]; the first is where it is pressed.
        half: half a finger is enough. sideways: x that the meshes are graded about [mm]. depth: of the press [mm].
        reach: nodes that would be deeper in the shape than this share of the depth may carry force.
    """

    name: str
    shape: Shape
    gradings: Gradings
    way: tuple[tuple[float, float], ...]
    half: bool = False
    sideways: float = 0.0
    depth: float = 1.0
    reach: float = -0.1


def _slides() -> dict[str, Slide]:
    rims = Grading(0.06, 0.3, (-1.0, 1.0))
    pillar = Gradings(rims, rims, Grading(0.06, 0.1, growth=0.25))
    along = tuple((0.0, y) for y in (0.0, 0.2, 0.4))
    line = Gradings(Grading(0.06, 0.4, growth=0.25, most=0.8), Grading(0.6, 4.0), Grading(0.06, 0.1, growth=0.25))
    across = tuple((x, 0.0) for x in (0.0, 0.2, 0.4))
    each = (
        Slide("slid pillar", Pillar(2.0, 0.1), pillar, along, half=True),
        Slide("slid edge 90", Edge(90.0), line, across, sideways=0.2, reach=0.05),
    )
    return {slide.name: slide for slide in each}


SLIDES = _slides()


def slid(slide: Slide, scales: Sequence[float] = SCALES) -> dict[str, dict[str, Any]]:
    """Return the forces of a slide, without friction and with it, and print them as they are found.

    Args:
        scales: of its meshes, over its gradings, falling.

    Raises:
        ArithmeticError: contact is not solved, or nodes that may not carry force are in the shape.
    """
    found: dict[str, list[tuple[Array, Array, dict[str, Any]]]] = {}
    for scale in scales:
        mesh = graded_fingertip(FINGER, slide.gradings, slide.sideways, scale, half=slide.half)
        origin = first_contact(slide.shape, 0.0) + [0.0, 0.0, slide.depth]
        places = origin + np.column_stack([slide.way, np.zeros(len(slide.way))])
        skin = mesh.nodes[mesh.pad]
        gaps = np.array([slide.shape.gap(skin - place)[0] for place in places])
        touched = mesh.pad[gaps.min(axis=0) < -slide.reach * slide.depth]
        rest = np.setdiff1d(mesh.pad, touched)
        tissue = Tissue(mesh, touched)
        print(f"{slide.name}: {mesh}, {len(touched)} may touch", flush=True)
        for friction in (0.0, FRICTION):
            press = Press(tissue.compliance, mesh.nodes[touched], slide.shape, friction, mesh.cut[touched])
            one, other = both(press, places, slide.depth, STEP * scale)
            for state in (*one, *other):
                moved = tissue.deformed(state.force)[0][rest]
                missed = -float(slide.shape.gap(mesh.nodes[rest] + moved - state.place)[0].min())
                if missed > MISSED:
                    raise ArithmeticError(f"{missed:.3f} mm: skin is in {slide.name} where it may not carry force")
            sides = [0.0, 2.0, 2.0] if slide.half else [1.0, 1.0, 1.0]
            forces = [np.array([state.force.sum(axis=0) for state in states]) * sides for states in (one, other)]
            worst = max(state.residual for state in (*one, *other))
            title = f"{slide.name}, friction {friction:g}"
            figures = {"scale": rounded(scale), "nodes": len(mesh.nodes), "contact": rounded(worst, 2)}
            found.setdefault(title, []).append((*forces, figures))
            print(f"  {title}: slid {forces[0].round(5).tolist()}, pressed {forces[1].round(5).tolist()}", flush=True)
        del tissue
    return {title: _summary(slide, parts, scales) for title, parts in found.items()}


def both(press: Press, places: Array, depth: float, step: float) -> tuple[list[Pressed], list[Pressed]]:
    """Return contact in each place, slid there from the first, and pressed there."""
    below = places - [0.0, 0.0, depth + RUN_UP]
    pressed = [press.moved(press.untouched(low), place, step) for low, place in zip(below, places, strict=True)]
    moved = [pressed[0]]
    for place in places[1:]:
        moved.append(press.moved(moved[-1], place, step))
    return moved, pressed


def _summary(
    slide: Slide, parts: Sequence[tuple[Array, Array, dict[str, Any]]], scales: Sequence[float]
) -> dict[str, Any]:
    """Return what the file says of a case, from what each mesh found: slid, pressed, figures."""
    slides, presses = (np.array([part[k] for part in parts]) for k in (0, 1))
    apart = np.linalg.norm(slides - presses, axis=2) / np.linalg.norm(presses, axis=2)
    return {
        "way": rounded(slide.way),
        "depth": slide.depth,
        "slid": rounded(slides[-1], 5),
        "pressed": rounded(presses[-1], 5),
        "error": {"slid": _errors(slides, scales), "pressed": _errors(presses, scales)},
        "apart": rounded(apart[:, 1:], 2),
        "meshes": [part[2] for part in parts],
    }


def _errors(forces: Array, scales: Sequence[float]) -> list[float]:
    """Return the own error of the finest mesh's force in each place, of forces by mesh and place, shape (m, p, 3)."""
    change = np.linalg.norm(forces[-1] - forces[-2], axis=1) / np.linalg.norm(forces[-1], axis=1)
    return list(rounded([c * missing(list(f), scales) for c, f in zip(change, forces.swapaxes(0, 1), strict=True)], 2))
