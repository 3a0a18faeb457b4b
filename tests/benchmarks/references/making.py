"""Make what is missing of the references, a mesh at a time."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.skin.blas import one_thread

from .bisection import base_mesh, refined
from .cases import FAMILIES, FINGER, PROBE_DEPTHS, Family, first_contact
from .contact import Press, Pressed
from .quadratic import bent
from .results import errors, load, missing, rounded, save
from .shapes import Shape
from .tissue import Tissue

Array = NDArray[np.float64]


class Meshed:
    """A family on one mesh.

    Args:
        family: what is pressed in. size: of the mesh [mm], one of the family's over its coarseness.
    """

    def __init__(self, family: Family, size: float) -> None:
        started = time.process_time()
        self.family, self.size = family, size * family.coarseness
        whole = base_mesh(FINGER, family.sideways)
        smooth = refined(whole.right_half() if family.symmetric else whole, lambda points: family.size(points, size))
        mesh = bent(smooth)
        self.touched = mesh.pad[family.may_touch(mesh.nodes[mesh.pad])]
        self.line = mesh.middle[self.touched] & (not family.symmetric)
        print(f"{family.name}: {mesh}, {len(self.touched)} may touch", flush=True)
        self.tissue = Tissue(mesh, self.touched, family.symmetric)
        fill = 1e-6 * self.tissue.dissection.fill
        print(f"  condensed, {fill:.0f} M, {time.process_time() - started:.0f} s", flush=True)

    def cases(self, shape: Shape) -> list[dict[str, Any]]:
        """Return force, stress and figures at each depth."""
        mesh = self.tissue.mesh
        skin = Press(self.tissue.compliance, mesh.nodes[self.touched], shape, self.line)
        out = []
        for state in skin.depths(lambda x: first_contact(shape, x), self.family.sideways, self.family.depths):
            moved, pressure, residual = self.tissue.deformed(state.displacement)
            figures = {
                "size": rounded(self.size),
                "nodes": len(mesh.nodes),
                "tetrahedra": len(mesh.elements),
                "loaded": int(state.force.any(axis=1).sum()),
                "change": rounded(state.change, 2),
                "rounds": state.rounds,
                "penetration": rounded(max(state.penetration, self._missed(shape, state.place, moved)), 2),
                "residual": rounded(residual, 2),
                "held": rounded(state.held, 2),
            }
            stress = self.tissue.stress(moved, pressure, self.family.probes)
            case = {"force": self._total(state), "place": state.place, "stress": stress}
            out.append({**{key: rounded(value, 6) for key, value in case.items()}, "mesh": figures})
        return out

    def _total(self, state: Pressed) -> Array:
        total = state.force.sum(axis=0)
        return total * [0.0, 2.0, 2.0] if self.family.symmetric else total

    def _missed(self, shape: Shape, place: Array, moved: Array) -> float:
        """Return how deep nodes are in the shape that were not expected to touch [mm]."""
        mesh = self.tissue.mesh
        rest = np.setdiff1d(mesh.pad, self.touched)
        return -float(shape.gap(mesh.nodes[rest] + moved[rest] - place)[0].min())


def refine(known: dict[str, Any], found: dict[str, Any], doubt: float) -> dict[str, Any]:
    """Return what is known of a case after one more, finer mesh, where the force's error is no less than a doubt."""
    sizes = [*known.get("sizes", []), found["mesh"]["size"]]
    forces = [*known.get("forces", []), found["force"]]
    stresses = [*known.get("stresses", []), found["stress"]]
    new = {"family": known["family"], "place": found["place"], "force": found["force"]}
    if len(sizes) > 1:
        along = [[force[2]] for force in forces]
        rest = missing(along, sizes) * (along[-1][0] - along[-2][0])
        new["error"] = {
            "force": rounded(max(abs(rest) / along[-1][0], doubt), 2),
            "stress": rounded(errors(stresses, sizes, len(PROBE_DEPTHS)), 2),
        }
        new["limit"] = rounded(along[-1][0] + rest, 4)
    new.update(forces=forces, sizes=sizes, mesh=found["mesh"], stress=rounded(found["stress"]))
    if len(sizes) < len(FAMILIES[known["family"]].sizes):
        new["stresses"] = stresses[-2:]
    return new


def make(names: list[str]) -> None:
    """Make what is missing of the families named, or of all, coarse meshes first."""
    families = [FAMILIES[name] for name in names] if names else list(FAMILIES.values())
    with one_thread():
        for number in range(max(len(family.sizes) for family in families)):
            for family in families:
                _make(family, number)


def _make(family: Family, number: int) -> None:
    """Press a family's shapes on one of its meshes, unless that was done, and write what was found."""
    titles = [title for _, _, title in family.cases()]
    cases = load()["cases"]
    if all(len(cases.get(title, {}).get("sizes", [])) > number for title in titles):
        return
    meshed = Meshed(family, family.sizes[number])
    found = [entry for _, shape in family.shapes for entry in meshed.cases(shape)]
    results = load()  # another run may have written meanwhile
    results["probes"][family.name] = rounded(family.probes, 6)
    for title, entry, doubt in zip(titles, found, family.doubt * len(family.shapes), strict=False):
        case = refine(results["cases"].get(title, {"family": family.name}), entry, doubt)
        results["cases"][title] = case
        print(f"  {title}: {case['force']}, {case.get('error')}, {entry['mesh']}", flush=True)
    save(results)
