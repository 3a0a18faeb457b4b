"""Make references, a family at a time: all its shapes on three meshes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.skin.blas import one_thread

from .cases import FAMILIES, FINGER, PROBE_DEPTHS, SCALES, STEP, Family, first_contact
from .contact import Press, Pressed
from .hexahedra import graded_fingertip
from .results import load, rounded, save, summary
from .shapes import Shape
from .tissue import Tissue

Array = NDArray[np.float64]
MISSED = 1e-4  # deepest of the nodes that were not expected to touch [mm]


class Found(NamedTuple):
    """A case on one mesh: the force on the finger [N], stress at the probes [Pa], the shape's origin, and figures."""

    force: Array
    stress: Array
    place: Array
    figures: dict[str, Any]


class Meshed:
    """A family on one mesh.

    Args:
        family: what is pressed in. scale: of the mesh.
    """

    def __init__(self, family: Family, scale: float) -> None:
        self.family, self.scale = family, scale
        mesh = graded_fingertip(FINGER, family.gradings, family.sideways, scale, half=family.half)
        self.touched = mesh.pad[family.may_touch(mesh.nodes[mesh.pad])]
        self.tissue = Tissue(mesh, self.touched)

    def pressed(self, shape: Shape) -> list[Pressed]:
        """Return contact at each depth."""
        mesh, family = self.tissue.mesh, self.family
        press = Press(
            self.tissue.compliance, mesh.nodes[self.touched], shape, family.friction, mesh.cut[self.touched]
        )
        return press.depths(first_contact(shape, family.sideways), family.depths, STEP * self.scale)

    def felt(self, shape: Shape, state: Pressed, probes: Array) -> Found:
        """Return what one state of contact does.

        Raises:
            ArithmeticError: nodes that may not carry force are in the shape.
        """
        mesh = self.tissue.mesh
        moved, balance = self.tissue.deformed(state.force)
        rest = np.setdiff1d(mesh.pad, self.touched)
        missed = -float(shape.gap(mesh.nodes[rest] + moved[rest] - state.place)[0].min())
        if missed > MISSED:
            raise ArithmeticError(f"{missed:.3f} mm: skin is in {shape} where it may not carry force")
        figures = {
            "scale": rounded(self.scale),
            "nodes": len(mesh.nodes),
            "elements": len(mesh.elements),
            "loaded": int(state.loaded.sum()),
            "rounds": state.rounds,
            "contact": rounded(state.residual, 2),
            "balance": rounded(balance, 2),
        }
        total = state.force.sum(axis=0) * ([0.0, 2.0, 2.0] if mesh.half else [1.0, 1.0, 1.0])
        return Found(total, self.tissue.stress(moved, probes), state.place, figures)


def make(names: Sequence[str]) -> None:
    """Make the references of the families named, or of all, and write each when it is done."""
    unknown = [name for name in names if name not in FAMILIES]
    if unknown:
        raise SystemExit(f"no such family: {', '.join(unknown)}; there are: {', '.join(FAMILIES)}")
    with one_thread():
        for name in names or FAMILIES:
            started = time.process_time()
            cases = made(FAMILIES[name])
            results = load()  # another run may have written meanwhile
            results["probes"][name] = rounded(FAMILIES[name].probes, 6)
            results["cases"] = _sorted({**results["cases"], **cases})
            save(results)
            print(f"{name}: {time.process_time() - started:.0f} s of the processor", flush=True)


def made(family: Family) -> dict[str, dict[str, Any]]:
    """Return all cases of a family."""
    found: dict[str, list[Found]] = {title: [] for *_, title in family.cases()}
    for scale in SCALES:
        meshed = Meshed(family, scale)
        print(f"{family.name}: {meshed.tissue.mesh}, {len(meshed.touched)} may touch", flush=True)
        titles = iter(found)
        for _, shape in family.shapes:
            for state in meshed.pressed(shape):
                title = next(titles)
                found[title].append(meshed.felt(shape, state, family.probes))
                print(f"  {title}: {found[title][-1].force.round(5)} N, {found[title][-1].figures}", flush=True)
        del meshed
    out = {}
    for title, of in found.items():
        own = summary([f.force for f in of], [f.stress for f in of], SCALES, len(PROBE_DEPTHS))
        print(f"  {title}: {own['force'][2]} N, own {own['error']}", flush=True)
        place = rounded(of[-1].place, 6)
        out[title] = {"family": family.name, "place": place, **own, "meshes": [f.figures for f in of]}
        out[title]["stress"] = out[title].pop("stress")  # last, for whoever reads the file
    return out


def _sorted(cases: dict[str, Any]) -> dict[str, Any]:
    titles = [title for family in FAMILIES.values() for *_, title in family.cases()]
    return {title: cases[title] for title in titles if title in cases}
