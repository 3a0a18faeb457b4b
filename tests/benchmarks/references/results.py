"""The file of the references' results, and their own errors. Forces in N, stress in Pa, lengths in mm.

The rule, the same for every case: it is solved on three meshes whose sizes fall by the square root of two each (steps
of a press with friction as well). The reference is what the finest has. Its own error is the change from the mesh
before, over ratio^order - 1, the order being that of the last two changes, between 1 and 2: once to 2.4 times the
change. An error of the product is judged where that of the force is at most `OWN_FORCE` and that of stress 1.2 mm deep
at most `OWN_STRESS`; elsewhere it is reported only.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.files import write_bytes

Array = NDArray[np.float64]
PATH = Path(__file__).with_name("shapes.json")
VERSION = 2
OWN_FORCE, OWN_STRESS = 0.02, 0.03
TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # shear components count twice
ORDERS = np.linspace(1.0, 2.0, 101)  # of convergence that are believed
ABOUT = {
    "version": VERSION,
    "rebuild": "python -m tests.benchmarks.references [FAMILY ...], with scipy on the path",
    "units": "N, Pa, mm; stress xx yy zz yz xz xy; depth beyond first contact of the smooth skin along +Z",
    "law": "linear tissue of hexahedra with mean dilatation; no node of the deformed skin is in the exact shape; "
    "Coulomb's friction by its own coefficient, zero on most shapes",
    "error": "relative, of the finest mesh: its change from the mesh before, over ratio^order - 1, where the order is "
    "that of the last two changes, between 1 and 2; of the force along Z, and of stress by depth of the probes",
    "slides": "forces on the finger of a shape that was pressed and then moved sideways, and of it pressed in the same "
    "place; error: relative, as above, of the vectors; apart: |slid - pressed| over |pressed|, coarse to fine by place",
    "meshes": "coarse to fine; contact: how far it is from its laws; balance: force left on a degree of freedom",
}


def load(path: Path = PATH) -> dict[str, Any]:
    """Return what is known: 'about', 'probes' by family, 'cases' and 'slides' by name; nothing of other versions."""
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if known.get("about", {}).get("version") != VERSION:
        return {"about": ABOUT, "probes": {}, "cases": {}, "slides": {}}
    return {"slides": {}, **known}


def save(results: Mapping[str, Any], path: Path = PATH) -> None:
    """Write the file, a case a line."""
    lines = []
    for part, entries in {**results, "about": ABOUT}.items():
        rows = ",\n".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in entries.items())
        lines.append(f"{json.dumps(part)}: {{\n{rows}\n}}")
    write_bytes(path, ("{\n" + ",\n".join(lines) + "\n}\n").encode())


def is_judged(case: Mapping[str, Any]) -> bool:
    """Return whether a case's own error is small enough for errors to be judged by it."""
    from .cases import JUDGED_AT

    error = case["error"]
    return bool(error["force"] <= OWN_FORCE and error["stress"][JUDGED_AT] <= OWN_STRESS)


def summary(forces: Sequence[Array], stresses: Sequence[Array], scales: Sequence[float], depths: int) -> dict[str, Any]:
    """Return the reference of a case and its own errors, from ever finer meshes.

    Args:
        forces: on the finger, shape (3,) each. stresses: at the probes, shape (depths * k, 6) each.
    """
    along = [np.array([force[2]]) for force in forces]
    change = abs(float(along[-1][0] - along[-2][0])) / abs(float(along[-1][0]))
    own = {"force": rounded(change * missing(along, scales), 2), "stress": rounded(errors(stresses, scales, depths), 2)}
    return {
        "force": rounded(forces[-1], 6),
        "error": own,
        "forces": rounded([force[2] for force in forces], 6),
        "stress": rounded(stresses[-1]),
    }


def table(results: Mapping[str, Any]) -> str:
    """Return a line a case: force and its own error, stress's own errors by depth, the finest mesh."""
    lines = [f"{'case':46} {'force [N]':>10} {'own error':>10}   {'stress, by depth':22} {'nodes':>7}"]
    for name, case in results["cases"].items():
        stress = " ".join(f"{e:6.1%}" for e in case["error"]["stress"])
        told = f"{name:46} {case['force'][2]:10.4f} {case['error']['force']:10.1%}   {stress:22} "
        lines.append(f"{told}{case['meshes'][-1]['nodes']:7}{'' if is_judged(case) else '  not judged by'}")
    return "\n".join(lines)


def norm(stress: Array, depths: int) -> Array:
    """Return the L2 norm of stresses at probes of each depth, shape (depths * k, 6) to (depths,)."""
    return np.array([np.sqrt(((s**2) @ TWICE).sum()) for s in np.split(np.asarray(stress), depths)])


def difference(one: Array, exact: Array, depths: int) -> list[float]:
    """Return the relative L2 difference of stresses at probes of each depth, shape (depths * k, 6)."""
    return (norm(np.asarray(one) - np.asarray(exact), depths) / norm(exact, depths)).tolist()


def missing(values: Sequence[Array], sizes: Sequence[float]) -> float:
    """Return what is missing from the last of values on ever finer meshes, over its change from the one before."""
    changes = [float(np.linalg.norm(np.subtract(b, a))) for a, b in zip(values, values[1:], strict=False)]
    order = ORDERS[0]
    if len(changes) > 1:
        coarse, middle, fine = (size**ORDERS for size in sizes[-3:])
        ratio = (coarse - middle) / (middle - fine)
        order = ORDERS[np.abs(np.log(ratio) - np.log(max(changes[-2], 1e-300) / max(changes[-1], 1e-300))).argmin()]
    return float(sizes[-1] ** order / (sizes[-2] ** order - sizes[-1] ** order))


def errors(stresses: Sequence[Array], sizes: Sequence[float], depths: int) -> list[float]:
    """Return the relative error of the last of stresses on ever finer meshes, at probes of each depth."""
    out = []
    for parts in zip(*(np.split(np.asarray(s) * np.sqrt(TWICE), depths) for s in stresses), strict=True):
        change = np.linalg.norm(parts[-1] - parts[-2]) / np.linalg.norm(parts[-1])
        out.append(float(change * missing(parts, sizes)))
    return out


def rounded(values: Any, digits: int = 4) -> Any:
    """Return numbers with few digits, as lists."""
    flat = [float(f"{v:.{digits}g}") for v in np.asarray(values, float).ravel()]
    return np.array(flat).reshape(np.shape(values)).tolist()
