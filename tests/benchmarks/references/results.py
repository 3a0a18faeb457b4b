"""The file of the references' results, and their errors. Forces in N, stress in Pa, lengths in mm."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.files import write_bytes

Array = NDArray[np.float64]
PATH = Path(__file__).with_name("shapes.json")
TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # shear components count twice
ORDERS = np.linspace(1.0, 2.0, 101)  # of convergence that are believed
ABOUT = {
    "rebuild": "python -m tests.benchmarks.references make [FAMILY ...], with scipy on the path; what is there is kept",
    "units": "N, Pa, mm; stress xx yy zz yz xz xy; depth beyond first contact of the smooth skin along +Z",
    "law": "linear tissue of quadratic elements; no node of the deformed skin is in the exact shape; no friction",
    "error": "of the finest mesh, relative: its change from the one before, over ratio^order - 1, where the order is "
    "that of the last two changes, between 1 and 2; stress by depth of the probes",
    "forces": "on ever finer meshes",
    "limit": "of the force along Z, by the same order; the error is that of this force",
}


def load(path: Path = PATH) -> dict[str, Any]:
    """Return what is known: 'about', 'probes' by family, 'cases' by name."""
    if not path.exists():
        return {"about": ABOUT, "probes": {}, "cases": {}}
    return dict(json.loads(path.read_text(encoding="utf-8")))


def save(results: dict[str, Any], path: Path = PATH) -> None:
    """Write the file, a case a line."""
    lines = []
    for part, entries in {**results, "about": ABOUT}.items():
        rows = ",\n".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in entries.items())
        lines.append(f"{json.dumps(part)}: {{\n{rows}\n}}")
    write_bytes(path, ("{\n" + ",\n".join(lines) + "\n}\n").encode())


def table(results: dict[str, Any]) -> str:
    """Return a line a case: force and its own error, stress's own errors by depth, the finest mesh."""
    lines = [f"{'case':36} {'force [N]':>10} {'own error':>10}   {'stress, by depth':22} {'nodes':>7} meshes"]
    for name, case in results["cases"].items():
        error = case.get("error", {"force": np.nan, "stress": []})
        stress = " ".join(f"{e:6.1%}" for e in error["stress"])
        nodes, count = case["mesh"]["nodes"], len(case["sizes"])
        lines.append(f"{name:36} {case['force'][2]:10.4f} {error['force']:10.1%}   {stress:22} {nodes:7} {count}")
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
        order = ORDERS[np.abs(np.log(ratio) - np.log(changes[-2] / max(changes[-1], 1e-300))).argmin()]
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
