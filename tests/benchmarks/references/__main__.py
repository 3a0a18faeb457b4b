"""Make the references: `python -m tests.benchmarks.references [FAMILY ...]`, a mesh at a time; what is there is kept."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.skin.blas import one_thread

from .bisection import base_mesh, refined
from .cases import FAMILIES, FINGER, PROBE_DEPTHS, SIZES, Family, first_contact
from .contact import Pressed, press, press_linear
from .results import LAWS, errors, load, rounded, save
from .shapes import Shape
from .tissue import Tissue

Array = NDArray[np.float64]


class Meshed:
    """A family on one mesh.

    Args:
        family: what is pressed in. size: of elements where sharp shapes touch [mm].
    """

    def __init__(self, family: Family, size: float) -> None:
        started = time.process_time()
        self.family, self.size = family, size * family.coarseness
        whole = base_mesh(FINGER)
        base = whole.right_half() if family.symmetric else whole
        mesh = refined(base, lambda points: family.size(points, size)).tetra_mesh()
        self.touched = mesh.pad[family.may_touch(mesh.nodes[mesh.pad])]
        print(f"{family.name}: {mesh}, {len(self.touched)} may touch, {time.process_time() - started:.0f} s", flush=True)
        self.tissue = Tissue(mesh, self.touched, family.symmetric)
        fill = 1e-6 * self.tissue.dissection.fill
        print(f"  condensed, {fill:.0f} M, {time.process_time() - started:.0f} s", flush=True)

    def cases(self, shape: Shape, law: str) -> list[dict[str, Any]]:
        """Return force, stress and figures at each depth."""
        mesh, compliance, points = self.tissue.mesh, self.tissue.compliance, self.tissue.mesh.nodes[self.touched]
        at = first_contact(shape, self.family.sideways)
        places = [at + [0.0, 0.0, depth] for depth in self.family.depths]
        if law == "linear":
            found = [press_linear(compliance, points, shape, place) for place in places]
        else:
            found = press(compliance, points, shape, at, self.family.depths)
        out = []
        for place, state in zip(places, found, strict=True):
            moved, residual = self.tissue.displacement(state.displacement)
            figures = {
                "size": rounded(self.size),
                "nodes": len(mesh.nodes),
                "tetrahedra": len(mesh.tetrahedra),
                "loaded": int(state.force.any(axis=1).sum()),
                "change": rounded(state.change, 2),
                "penetration": rounded(max(state.penetration, self._missed(shape, place, moved, law)), 2),
                "residual": rounded(residual, 2),
            }
            stress = self.tissue.stress(moved, self.family.probes)
            out.append({"force": rounded(self._total(state), 6), "stress": rounded(stress), "mesh": figures})
        return out

    def _total(self, state: Pressed) -> Array:
        total = state.force.sum(axis=0)
        return total * [0.0, 2.0, 2.0] if self.family.symmetric else total

    def _missed(self, shape: Shape, place: Array, moved: Array, law: str) -> float:
        """Return how deep nodes are in the shape that were not expected to touch [mm]."""
        mesh = self.tissue.mesh
        rest = np.setdiff1d(mesh.pad, self.touched)
        if law == "linear":
            gap, normal = shape.gap(mesh.nodes[rest] - place)
            return -float((gap + np.einsum("ij,ij->i", normal, moved[rest])).min())
        return -float(shape.gap(mesh.nodes[rest] + moved[rest] - place)[0].min())


def enter(known: dict[str, Any], law: str, found: dict[str, Any]) -> None:
    """Add a case on a finer mesh to what is known of it."""
    old = known.get(law, {"meshes": [], "forces": []})
    sizes = [mesh["size"] for mesh in (*old["meshes"], found["mesh"])]
    new = {
        "force": found["force"],
        "stress": found["stress"],
        "forces": [*old["forces"], found["force"]],
        "meshes": [*old["meshes"], found["mesh"]],
    }
    if old["meshes"]:
        force = errors(new["forces"], sizes)
        stresses = [*old["before"], found["stress"]]
        stress = errors(stresses, sizes, len(PROBE_DEPTHS))
        new["error"] = {"force": rounded(force[0], 2), "stress": rounded(stress, 2)}
    if found["mesh"]["size"] > sizes[0] * SIZES[-1] / SIZES[0] * 1.01:
        new["before"] = [*old.get("before", []), found["stress"]]
    known[law] = new


def main(names: list[str]) -> None:
    """Make what is missing of the families named, or of all."""
    for family in [FAMILIES[name] for name in names] if names else FAMILIES.values():
        titles = {f"{name}, {depth:g} mm deep": shape for name, shape in family.shapes for depth in family.depths}
        for number, size in enumerate(SIZES):
            cases = load()["cases"]
            if all(len(cases.get(title, {}).get(LAWS[0], {"meshes": []})["meshes"]) > number for title in titles):
                continue
            meshed = Meshed(family, size)
            found = {
                (name, law): meshed.cases(shape, law) for name, shape in family.shapes for law in LAWS
            }
            results = load()  # another run may have written meanwhile
            results["probes"][family.name] = rounded(family.probes, 6)
            for (name, law), entries in found.items():
                for depth, entry in zip(family.depths, entries, strict=True):
                    case = results["cases"].setdefault(f"{name}, {depth:g} mm deep", {"family": family.name})
                    enter(case, law, entry)
                    shown = {key: case[law].get(key) for key in ("force", "error")}
                    print(f"  {name}, {depth:g} mm, {law}: {shown}, {entry['mesh']}", flush=True)
            save(results)


if __name__ == "__main__":
    with one_thread():
        main(sys.argv[1:])
