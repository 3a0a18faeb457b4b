"""Matching: what pins and thimbles do with a touch, by method and by solver.

Solvers of the same bounded least squares are judged by how far a step of projected descent from their answer moves,
relative to the greatest force: a certificate that none of them makes. Methods are judged by the skin's displacement
that they leave, thimbles by the stress.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from core.arrays import Array

from .. import one_blas_thread, timing
from ..bench_pins import LIMIT, _daqp, _forces, _setup
from .measured import Panel, Point, clocked

FEW = 60  # frames that slow solvers get
ROUNDING = 1e-16
COMPONENTS, TOUCH = (3, 6, 12, 25, 50, 100), 120  # of stress; frames of a touch


def pin_solvers() -> Panel:
    """Return DM2 on the path that never settles, by solver."""
    from core.matching.bounded_lsq import BoundedLeastSquares

    panel = Panel(
        "pin solvers", "128 pins, deformation matching: solvers", "how far a step of projected descent still moves"
    )
    matcher = _setup().matcher
    gram = matcher.gram("DM2")
    sides = [matcher.rhs("DM2", f) for f in _forces("varied")]
    ours = BoundedLeastSquares(gram, 0.0, LIMIT)
    makers: dict[str, tuple[Callable[[], Callable[[Array], Array]], int]] = {
        "ours": (lambda: lambda c: ours.solve(c).x, len(sides)),
        "DAQP": (lambda: _daqp(gram), len(sides)),
        "scipy BVLS": (lambda: _bvls(gram), FEW),
        "quadprog": (lambda: _quadprog(gram), FEW),
    }
    for digits in (1e-3, 1e-5):
        makers[f"OSQP {digits:.0e}"] = (lambda digits=digits: _osqp(gram, digits), FEW)  # type: ignore[misc]
    for digits in (1e-3, 1e-5, 1e-9):
        makers[f"ProxQP {digits:.0e}"] = (lambda digits=digits: _proxqp(gram, digits), len(sides))  # type: ignore[misc]
    for name, (make, count) in makers.items():
        try:
            solve = make()
        except ImportError:  # a development dependency
            continue
        panel.points.append(_solved(name, gram, sides[:count], solve))
    return panel


def _solved(name: str, gram: Array, sides: list[Array], solve: Callable[[Array], Array]) -> Point:
    slope, times, off = float(np.diag(gram).max()), [], 0.0
    with one_blas_thread():
        solve(sides[0])
        for c in sides:
            x, taken = clocked(lambda c=c: solve(c))  # type: ignore[misc]
            times.append(taken)
            moved = np.clip(x - (gram @ x - c) / slope, 0.0, LIMIT) - x
            off = max(off, float(np.abs(moved).max()) / LIMIT)
    found = timing(times)
    error = max(off, ROUNDING)
    return Point(name.partition(" 1e")[0], name, found.median, found.p95, error, error, name == "ours")


def _bvls(gram: Array) -> Callable[[Array], Array]:
    from scipy.optimize import lsq_linear

    root = np.linalg.cholesky(gram).T

    def solve(c: Array) -> Array:
        found = lsq_linear(root, np.linalg.solve(root.T, c), (0.0, LIMIT), method="bvls")
        return np.asarray(np.clip(found.x, 0.0, LIMIT))

    return solve


def _osqp(gram: Array, digits: float) -> Callable[[Array], Array]:
    import osqp
    from scipy import sparse

    n, scale = len(gram), float(np.diag(gram).mean())
    model = osqp.OSQP()
    upper = sparse.triu(sparse.csc_matrix(gram / scale), format="csc")
    bounds = sparse.eye(n, format="csc"), np.zeros(n), np.full(n, LIMIT)
    accuracy: dict[str, Any] = {"eps_abs": digits, "eps_rel": digits, "max_iter": 100_000}
    model.setup(upper, np.zeros(n), *bounds, **accuracy, verbose=False, polishing=False)

    def solve(c: Array) -> Array:
        model.update(q=-c / scale)
        return np.asarray(np.clip(model.solve().x, 0.0, LIMIT))

    return solve


def _proxqp(gram: Array, digits: float) -> Callable[[Array], Array]:
    """Return ProxQP's dense solver, its factors and the last answer kept from frame to frame."""
    proxqp = _proxsuite().proxqp
    n, scale = len(gram), float(np.diag(gram).mean())
    model = proxqp.dense.QP(n, 0, 0, True)  # bounds, and nothing else
    model.settings.eps_abs, model.settings.eps_rel = digits, 0.0
    none: dict[str, Any] = {"A": None, "b": None, "C": None, "l": None, "u": None}
    bounds = {"l_box": np.zeros(n), "u_box": np.full(n, LIMIT)}
    model.init(H=np.ascontiguousarray(gram / scale), g=np.zeros(n), **none, **bounds)
    model.solve()  # warm starts need an answer to start from: without one it does not return
    model.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT

    def solve(c: Array) -> Array:
        model.update(g=-c / scale)
        model.solve()
        return np.asarray(np.clip(model.results.x, 0.0, LIMIT))

    return solve


def _proxsuite() -> Any:
    """Return the package; its wheel keeps it in a folder below, which only an installed environment looks into."""
    here = f"cmeel.prefix/lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
    sys.path += [str(found) for entry in sys.path if (found := Path(entry) / here).is_dir()]
    return importlib.import_module("proxsuite")


def _quadprog(gram: Array) -> Callable[[Array], Array]:
    """Return quadprog, which starts anew at each frame; its factor of the matrix is kept."""
    import quadprog

    n = len(gram)
    inverse = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(gram).T))
    sides, bounds = np.hstack([np.eye(n), -np.eye(n)]), np.concatenate([np.zeros(n), np.full(n, -LIMIT)])

    def solve(c: Array) -> Array:
        found = quadprog.solve_qp(inverse, np.array(c, float), sides, bounds, 0, True)[0]
        return np.asarray(np.clip(found, 0.0, LIMIT))

    return solve


def pin_methods() -> Panel:
    """Return all methods on the paper's slide: displacement of the skin that is left, of what was asked for."""
    from core.matching.deformation import METHODS, PinSolver

    panel = Panel(
        "pin methods", "128 pins, a slide 2 mm deep (0: free to pull)", "displacement of the skin that is left"
    )
    matcher, forces = _setup().matcher, _forces("slide")
    asked = np.array([float(matcher.displacement_error(f, np.zeros(len(matcher.active)))) for f in forces])
    for method in METHODS:
        solver = PinSolver(matcher, method, force_limit=LIMIT)
        times, left = [], []
        with one_blas_thread():
            solver.step(forces[0])
            for f in forces:
                step, taken = clocked(lambda f=f, solver=solver: solver.step(f))  # type: ignore[misc]
                times.append(taken)
                left.append(float(matcher.displacement_error(f, step.x)))
        found = timing(times)
        off = float(np.sqrt((np.array(left) ** 2).sum() / (asked**2).sum()))
        panel.points.append(Point(method, method, found.median, found.p95, off, None, method == "DM2"))
    return panel


def thimble() -> Panel:
    """Return the searches of a thimble on three touches: stress that is left, of what was asked for.

    What the direct search leaves is nearly all the device's own: a rigid disc cannot render these touches. What a
    learned model leaves beyond it is its error.
    """
    from ..bench_thimble import searches

    panel = Panel("thimble", "thimble: searches on three touches", "stress that is left")
    direct = searches("direct")["error"]
    for kind in ("direct", "ridge", "network"):
        found, name = searches(kind), {"ridge": "polynomial"}.get(kind, kind)
        times = timing([1e-3 * us for us in found["us"]])
        beyond = max(found["error"] - direct, 0.0)
        other = {"beyond the direct search": beyond, "rescues": float(len(found["rescues"]))}
        panel.points.append(Point(name, name, times.median, times.p95, found["error"], beyond, kind == "direct", other))
    panel.bands = {"the device's own": direct}
    return panel


def thimble_components() -> Panel:
    """Return how many components of stress a thimble's search needs: what is left of *all* stress, by their number.

    The product takes as many as leave a tenth of the stress that its own movements make.
    """
    from core.matching.description import DESCRIPTOR_MOVEMENTS
    from core.matching.stress import StressMatcher
    from core.steps import drain
    from core.surrogate.dataset import record
    from core.surrogate.learned import descriptors
    from core.surrogate.store import contact_of
    from tests import touches

    from ..bench_thimble import device, skin

    panel = Panel("thimble components", "thimble: components of stress", "stress that is left, all of it")
    model = skin("draft")
    whole = model.stress_components()
    data = drain(record(device(), contact_of(device(), model, 0.6), DESCRIPTOR_MOVEMENTS))
    paths = [t.forces(model, points=True) for t in (make(TOUCH) for make in (touches.ball_roll, touches.slide))]
    usual = len(descriptors(data, whole).observation_matrix)
    for count in sorted({*COMPONENTS, usual}):
        matrix = descriptors(data, whole, size=count).observation_matrix
        times, left, asked = [], 0.0, 0.0
        with one_blas_thread():
            follower = StressMatcher(device(), contact_of(device(), model, 0.6), matrix)
            for forces in paths:
                follower.reset()
                for force in forces:
                    frame, taken = clocked(lambda f=force, s=follower, m=matrix: s.step(m @ f.ravel()))  # type: ignore[misc]
                    times.append(taken)
                    made = follower.contact.nodal(frame.solution)
                    left += float(np.sum((whole @ (made - force).ravel()) ** 2))
                    asked += float(np.sum((whole @ force.ravel()) ** 2))
        found, off = timing(times), float(np.sqrt(left / asked))
        panel.points.append(Point("components", str(count), found.median, found.p95, off, None, count == usual))
    panel.bands = {"the device's own": min(p.error for p in panel.points)}
    return panel
