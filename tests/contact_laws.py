"""How far answers of the contact solvers are from the laws they must obey; all residuals are relative."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.contact.solver import frame_friction
from core.contact.solver.cone import SLIP, STICK, along
from core.contact.solver.grip import GripStep
from core.contact.solver.solution import Solution
from core.contact.solver.sweeps import MOST_SWEEPS, sweep

Array = NDArray[np.float64]


def solve(
    compliance: Array,
    offset: Array,
    friction: Array | float,
    *,
    normals: Array | None = None,
    softness: Array | float = 0.0,
    start: Array | None = None,
    tolerance: float = 1e-10,
) -> Solution:
    """Solve one contact problem by sweeps over all nodes.

    Args:
        compliance: C [m/N], shape (3 m, 3 m).
        offset: relative displacement without force [m], shape (3 m,) or (m, 3).
        friction: friction coefficient, one number or shape (m,).
        normals: unit normals from the object into the skin, shape (m, 3). If None, the three rows of each node are
            (n, t1, t2) in its own frame.
        softness: compliance of the object's surface at each node [m/N], one number or shape (m,).
        start: forces to start from [N], shape (m, 3); None for zero.
        tolerance: residual at which the sweeps end.
    """
    b = np.asarray(offset, np.float64).reshape(-1, 3)
    m = len(b)
    axes = np.tile([1.0, 0.0, 0.0], (m, 1)) if normals is None else normals
    mu, soft = (np.array(np.broadcast_to(value, (m,)), np.float64) for value in (friction, softness))
    first = np.zeros((m, 3)) if start is None else start
    found = sweep(np.asarray(compliance, np.float64), b, axes, mu, soft, first, tolerance, MOST_SWEEPS)
    w, status = found.displacement, found.status
    return Solution(found.force, w, axes, mu, status, found.sweeps, found.residual, tolerance, "sweeps")


def at_frame_ends_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let paths follow Coulomb's law at the ends of frames alone, as a disc on the skin does."""
    monkeypatch.setattr(frame_friction, "changing", lambda *_: 0.0)
    monkeypatch.setattr(frame_friction.FrameFriction, "notice", lambda *_: None)


def complementarity_residual(solution: Solution) -> float:
    """Return the largest violation of 0 <= f_n, 0 <= w_n, f_n w_n = 0, relative to force and displacement."""
    f, w = _scales(solution)
    gap = along(solution.displacement, solution.normals)
    return float(np.abs(np.minimum(solution.normal_force / f, gap / w)).max(initial=0.0))


def cone_residual(solution: Solution) -> float:
    """Return how far the worst node is outside its friction cone, relative to the largest force."""
    f, _ = _scales(solution)
    tangential = solution.force - solution.normal_force[:, None] * solution.normals
    excess = np.sqrt(along(tangential, tangential)) - solution.friction * np.maximum(solution.normal_force, 0.0)
    return float(np.maximum(excess, 0.0).max(initial=0.0)) / f


def slip_residual(solution: Solution) -> float:
    """Return the worst slip of a sticking node, or of a slipping node in a wrong direction, relative to w."""
    f, w = _scales(solution)
    gap = along(solution.displacement, solution.normals)
    slip = solution.displacement - gap[:, None] * solution.normals
    tangential = solution.force - solution.normal_force[:, None] * solution.normals
    speed, load = np.sqrt(along(slip, slip)), np.sqrt(along(tangential, tangential))
    turned = slip * load[:, None] + tangential * speed[:, None]
    wrong = np.sqrt(along(turned, turned)) / f
    worst = np.where(solution.status == STICK, speed, np.where(solution.status == SLIP, wrong, 0.0))
    return float(np.where(solution.friction == 0.0, 0.0, worst).max(initial=0.0)) / w


def balance_residual(step: GripStep) -> float:
    """Return |contact force - m (a - g)| relative to |m (a - g)|."""
    size = max(float(np.linalg.norm(step.required[:3])), 1e-300)
    return float(np.linalg.norm(step.on_object[:3] - step.required[:3])) / size


def with_tangents(compliance: Array, offset: Array, rows: int) -> tuple[Array, Array]:
    """Give nodes of one row (n) or two (n, t) their missing tangents: they couple with nothing, so they carry nothing.

    Args:
        compliance: shape (rows m, rows m). offset: shape (rows m,).
    """
    m = len(offset) // rows
    given = (3 * np.arange(m)[:, None] + np.arange(rows)).reshape(-1)
    wide = np.zeros((3 * m, 3 * m))
    wide[np.ix_(given, given)] = compliance
    missing = np.setdiff1d(np.arange(3 * m), given)
    wide[missing, missing] = np.repeat(np.diag(compliance)[::rows], 3 - rows)
    whole = np.zeros(3 * m)
    whole[given] = offset
    return wide, whole


def _scales(solution: Solution) -> tuple[float, float]:
    """Return the largest force [N] and displacement [m]."""
    f, w = (max(float(np.abs(x).max(initial=0.0)), 1e-300) for x in (solution.force, solution.displacement))
    return f, w
