"""Make references, a family at a time: all its shapes on three meshes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.parameters.error_bands import LINEAR
from core.skin.blas import one_thread

from .cases import FAMILIES, FINGER, SCALES, Family, first_contact
from .contact import Press, Pressed
from .hexahedra import graded_fingertip
from .neo_hookean import NeoHookean, pressed
from .results import load, rounded, save, summary
from .shapes import Shape
from .sliding import SLIDES, slid
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
        self.mesh = graded_fingertip(FINGER, family.gradings, family.sideways, scale, half=family.half)
        self.touched = self.mesh.pad[family.may_touch(self.mesh.nodes[self.mesh.pad])]
        self._linear = Tissue(self.mesh, self.touched) if family.tissue == LINEAR else None

    def cases(self, shape: Shape, probes: Array) -> list[Found]:
        """Return what the shape does at each depth, with stress at points [mm].

        Raises:
            ArithmeticError: nodes that may not carry force are in the shape.
        """
        family, mesh, touched = self.family, self.mesh, self.touched
        start, step = first_contact(shape, family.sideways), family.step * self.scale
        if self._linear is None:
            law = NeoHookean(mesh)
            states = pressed(mesh, touched, shape, family.friction, start, family.depths, step)
            return [self._found(shape, *state, law.stress(state[1], probes)) for state in states]
        cut, points = mesh.cut[touched], mesh.nodes[touched]
        press = Press(self._linear.compliance, points, shape, family.friction, cut)
        out = []
        for state in press.depths(start, family.depths, step):
            moved, balance = self._linear.deformed(state.force)
            out.append(self._found(shape, state, moved, balance, self._linear.stress(moved, probes)))
        return out

    def _found(self, shape: Shape, state: Pressed, moved: Array, balance: float, stress: Array) -> Found:
        mesh = self.mesh
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
        return Found(total, stress, state.place, figures)


def make(names: Sequence[str]) -> None:
    """Make the references of the families and slides named, or of all, and write each when it is done.

    Raises:
        SystemExit: an unknown family, or families that could not be made.
    """
    known = [*FAMILIES, *SLIDES]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise SystemExit(f"no such family: {', '.join(unknown)}; there are: {', '.join(known)}")
    failed = []
    with one_thread():
        for name in names or known:
            started = time.process_time()
            try:
                slides = slid(SLIDES[name]) if name in SLIDES else {}
                cases = made(FAMILIES[name]) if name in FAMILIES else {}
            except ArithmeticError as error:  # the others can be made all the same
                failed.append(f"{name}: {error}")
                print(failed[-1], flush=True)
                continue
            results = load()  # another run may have written meanwhile
            if cases:
                results["probes"][name] = rounded(FAMILIES[name].probes, 6)
                results["probes"] = {key: of for key, of in results["probes"].items() if key in FAMILIES}
                results["cases"] = _sorted({**results["cases"], **cases})
            results["slides"].update(slides)
            save(results)
            print(f"{name}: {time.process_time() - started:.0f} s of the processor", flush=True)
    if failed:
        raise SystemExit("\n".join(failed))


def made(family: Family) -> dict[str, dict[str, Any]]:
    """Return all cases of a family."""
    found: dict[str, list[Found]] = {title: [] for *_, title in family.cases()}
    for scale in SCALES:
        meshed = Meshed(family, scale)
        print(f"{family.name}: {meshed.mesh}, {len(meshed.touched)} may touch", flush=True)
        titles = iter(found)
        for _, shape in family.shapes:
            for case in meshed.cases(shape, family.probes):
                title = next(titles)
                found[title].append(case)
                print(f"  {title}: {case.force.round(5)} N, {case.figures}", flush=True)
        del meshed
    out = {}
    for title, of in found.items():
        own = summary([f.force for f in of], [f.stress for f in of], SCALES, len(family.probe_depths))
        print(f"  {title}: {own['force'][2]} N, own {own['error']}", flush=True)
        place = rounded(of[-1].place, 6)
        out[title] = {"family": family.name, "place": place, **own, "meshes": [f.figures for f in of]}
        out[title]["stress"] = out[title].pop("stress")  # last, for whoever reads the file
    return out


def _sorted(cases: dict[str, Any]) -> dict[str, Any]:
    titles = [title for family in FAMILIES.values() for *_, title in family.cases()]
    return {title: cases[title] for title in titles if title in cases}
