"""What a skin costs to make and to load, and how far its mesh is from an 88k one under a flat press of 2 mm.

Condensing is timed with assembly, from mesh to compliance. Its peer is SuperLU on the same matrix with
all unit loads as right-hand sides. Discretisation errors use the exact contact of `problems.flat_press` on each mesh,
so no solver's tolerance is in them; stress is read at fixed points 1.2 mm under the skin of the pad.
"""

from __future__ import annotations

import functools
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from . import Result, benchmark, measure, one_blas_thread

DEPTH = 2e-3  # of the press [m]
PROBE_DEPTH = 1.2e-3  # [m]


@benchmark("condense_6k_s", limit=0.4, quick=True)
def condense_6k() -> Result:
    """Assemble and condense the standard mesh; SuperLU beside it."""
    from scipy.sparse.linalg import splu

    make, matrix, pad = _problem("standard")
    ours = measure(make, 9)

    def superlu() -> Any:
        loads = np.zeros((matrix.shape[0], len(pad)))
        loads[pad, np.arange(len(pad))] = 1.0
        return splu(matrix.tocsc()).solve(loads)[pad]

    peer = measure(superlu, 3, warmup=1)
    return Result("condense_6k_s", ours.median / 1e3, "s", ours.p95 / 1e3, {"SuperLU": peer.median / 1e3})


@benchmark("condense_27k_s", limit=6.0)
def condense_27k() -> Result:
    """Assemble and condense the fine mesh."""
    make, _, _ = _problem("fine")
    ours = measure(make, 3, warmup=1, max_seconds=30.0)
    return Result("condense_27k_s", ours.median / 1e3, "s", ours.p95 / 1e3)


@benchmark("skin_load_ms", limit=40.0, quick=True)
def skin_load() -> Result:
    """Load the standard skin from the cache, ready for contact; making it is the peer."""
    from core.cache import Cache
    from core.skin.model import fingertip_skin

    with tempfile.TemporaryDirectory(prefix="dermis-skin-") as folder:
        cache = Cache(Path(folder), 10**9)
        started = time.perf_counter()
        fingertip_skin(level="standard", cache=cache)
        made = (time.perf_counter() - started) * 1e3

        def load() -> None:
            skin = fingertip_skin(level="standard", cache=cache)
            assert skin.compliance32.shape == (3 * skin.pad_count,) * 2 and len(skin.normals) == len(skin.areas)

        ours = measure(load)
    return Result("skin_load_ms", ours.median, "ms", ours.p95, {"made anew": made})


@benchmark("force_error_6k", limit=0.02)
def force_error_6k() -> Result:
    """Total force of the standard mesh against the reference."""
    return _error("force_error_6k", lambda level: abs(_press(level)[0] / _press("reference")[0] - 1.0))


@benchmark("stress_error_6k", limit=0.06)
def stress_error_6k() -> Result:
    """Stress at fixed points of the standard mesh against the reference, relative L2, shear counted twice."""
    twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])

    def error(level: str) -> float:
        exact = _press("reference")[1]
        return float(np.sqrt(((_press(level)[1] - exact) ** 2 @ twice).sum() / (exact**2 @ twice).sum()))

    return _error("stress_error_6k", error)


def _error(name: str, error: Callable[[str], float]) -> Result:
    with one_blas_thread():
        peers = {level: float(error(level)) for level in ("draft", "fine", "standard p1")}
        return Result(name, float(error("standard")), "1", None, peers)


def _problem(level: str) -> tuple[Callable[[], Any], Any, Any]:
    """Return the timed work of a level, its stiffness without fixed nodes, and the pad's degrees of freedom in it."""
    from core.skin.assembly import degrees, stiffness
    from core.skin.condense import condense
    from core.skin.fingertip import fingertip_mesh
    from core.skin.material import Elastic

    mesh = fingertip_mesh(level=level)
    free, pad = degrees(mesh.free), np.searchsorted(mesh.free, mesh.pad)
    material = Elastic().unit

    def make() -> Any:
        return condense(stiffness(mesh, material)[free][:, free], pad)

    return make, stiffness(mesh, material)[free][:, free], degrees(pad)


@functools.cache
def _press(level: str) -> tuple[float, Any]:
    """Return the force [N] and the stress at the fixed points [Pa] of a flat press on a level's mesh."""
    from core.skin.assembly import Element, degrees, stiffness
    from core.skin.condense import condense
    from core.skin.fingertip import fingertip_mesh
    from core.skin.material import Elastic
    from core.skin.stress import StressOperator
    from tests.problems import flat_press
    from tests.tissue import probes_at

    level, _, element = level.partition(" ")
    kind: Element = "p1" if element == "p1" else "anp"
    material, mesh = Elastic(), fingertip_mesh(level=level)
    free = degrees(mesh.free)
    # A press lifts the whole pad, so a node that lies above the plate at rest does not come to touch it.
    near = mesh.pad[mesh.nodes[mesh.pad, 2] < DEPTH]
    matrix = stiffness(mesh, material, kind)[free][:, free]
    condensed = condense(matrix, np.searchsorted(mesh.free, near), response=True)
    force = flat_press(condensed.compliance, mesh.nodes[near, 2], DEPTH)
    assert condensed.response is not None
    displacement = np.zeros(mesh.nodes.size)
    displacement[free] = force.ravel().astype(np.float32) @ condensed.response
    stress = StressOperator(mesh, material, kind).stress(displacement)
    return float(force[:, 2].sum()), probes_at(mesh, _points()).read(mesh, stress)


def _points() -> Any:
    """Return points under the pad that do not depend on any mesh [m], shape (169, 3)."""
    from core.skin.shape import FingertipShape

    shape, step = FingertipShape(), 1e-5
    line = np.linspace(-0.15, 0.15, 13)
    real, imag = np.meshgrid(line, line)
    chart = (real + 1j * imag).ravel()
    skin = shape.skin(chart)
    inward = -np.cross(shape.skin(chart + step) - skin, shape.skin(chart + 1j * step) - skin)
    return skin + PROBE_DEPTH * inward / np.linalg.norm(inward, axis=1, keepdims=True)
