"""How far answers of the contact solvers are from the laws they must obey; all residuals are relative."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.contact.solver import frame_friction
from core.contact.solver.cone import SLIP, STICK, along
from core.contact.solver.grip import GripStep
from core.contact.solver.solve import Solution

Array = NDArray[np.float64]


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
