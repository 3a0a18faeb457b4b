"""Semi-smooth Newton for frictional contact: the polish after, and the fallback of, the alternating method."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from .cone import OPEN, SLIP, along, project


def newton(
    compliance: Array,
    offset: Array,
    normals: Array,
    friction: Array,
    start: Array,
    stiffness: float,
    tolerance: float,
    max_iterations: int = 60,
) -> tuple[Array, int, float]:
    """Iterate F(f) = f - P(f - stiffness (C f + b)) = 0 from `start`, with a line search on |F|.

    Args:
        compliance: C [m/N], shape (3 k, 3 k); offset: b [m], shape (3 k,).
        normals: unit normals, shape (k, 3); friction: shape (k,); start: forces [N], shape (k, 3).
        stiffness: weighs displacement against force [N/m].
        tolerance: |F| relative to |f| to stop at.

    Returns:
        The best forces found, the iterations made, and the relative |F| there. Newton alone may cycle; then the
        residual says so.
    """
    force = start.copy()
    residual, vectors = _residual(compliance, offset, normals, friction, force, stiffness)
    value = float(np.linalg.norm(residual))
    iteration = 0
    while iteration < max_iterations and value > tolerance * max(float(np.linalg.norm(force)), 1e-300):
        iteration += 1
        step = _direction(compliance, normals, friction, vectors, residual, stiffness)
        if step is None:
            break
        scale, improved = 1.0, False
        while scale > 1e-3:
            trial = force + scale * step
            trial_residual, trial_vectors = _residual(compliance, offset, normals, friction, trial, stiffness)
            trial_value = float(np.linalg.norm(trial_residual))
            if trial_value < (1.0 - 0.1 * scale) * value:
                improved = True
                break
            scale *= 0.5
        if not improved:
            break
        force, residual, vectors, value = trial, trial_residual, trial_vectors, trial_value
    size = float(np.linalg.norm(force))
    return force, iteration, value / size if size > 0.0 else (0.0 if value == 0.0 else np.inf)


def _residual(
    compliance: Array, offset: Array, normals: Array, friction: Array, force: Array, stiffness: float
) -> tuple[Array, Array]:
    displacement = (compliance @ force.reshape(-1) + offset).reshape(-1, 3)
    vectors = force - stiffness * displacement
    return force - project(vectors, normals, friction)[0], vectors


def _direction(
    compliance: Array, normals: Array, friction: Array, vectors: Array, residual: Array, stiffness: float
) -> Array | None:
    """Solve J step = -F with J = I - D (I - stiffness C), D the generalised derivative of the projection."""
    k = normals.shape[0]
    _, status = project(vectors, normals, friction)
    vn = along(vectors, normals)
    tangential = vectors - vn[:, None] * normals
    length = np.maximum(np.sqrt(along(tangential, tangential)), 1e-300)
    direction = tangential / length[:, None]
    identity = np.eye(3)
    nn = normals[:, :, None] * normals[:, None, :]
    across = identity - nn
    # slip: d(mu vn direction) = mu direction dvn' + mu vn / |vt| (across - direction direction') dv
    derivative = np.broadcast_to(identity, (k, 3, 3)).copy()
    s = status == SLIP
    dd = direction[s][:, :, None] * direction[s][:, None, :]
    derivative[s] = (
        nn[s]
        + friction[s, None, None] * direction[s][:, :, None] * normals[s][:, None, :]
        + (friction[s] * vn[s] / length[s])[:, None, None] * (across[s] - dd)
    )
    active = np.flatnonzero(status != OPEN)
    step = -residual.copy()  # open nodes: f goes to zero at once
    if active.size == 0:
        return step
    index = (3 * active[:, None] + np.arange(3)).reshape(-1)
    n = active.size
    inner = np.einsum("aij,ajm->aim", derivative[active], stiffness * compliance[index].reshape(n, 3, -1))
    block = inner[:, :, index].reshape(3 * n, 3 * n)
    for a in range(3):
        for b in range(3):
            rows = np.arange(n) * 3
            block[rows + a, rows + b] += identity[a, b] - derivative[active][:, a, b]
    rest = np.setdiff1d(np.arange(k), active)
    rhs = -residual[active].reshape(-1)
    if rest.size:
        columns = (3 * rest[:, None] + np.arange(3)).reshape(-1)
        rhs = rhs - inner[:, :, columns].reshape(3 * n, -1) @ step[rest].reshape(-1)
    try:
        solved = np.linalg.solve(block, rhs)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(solved).all():
        return None
    step[active] = solved.reshape(n, 3)
    return step
