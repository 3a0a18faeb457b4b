"""Projected block Gauss-Seidel for frictional contact: slow, and the last resort."""

from __future__ import annotations

import numpy as np

from ...arrays import Array


def gauss_seidel(
    compliance: Array, offset: Array, normals: Array, friction: Array, start: Array, tolerance: float, max_sweeps: int
) -> tuple[Array, int]:
    """Visit one node after the other and solve its own contact with all others held, until the forces stand still.

    Args:
        compliance: C [m/N], shape (3 k, 3 k); offset: b [m], shape (3 k,).
        normals: unit normals, shape (k, 3); friction: shape (k,); start: forces [N], shape (k, 3).
        tolerance: largest change in a sweep, relative to the forces.

    Returns:
        Forces [N], shape (k, 3), and the number of sweeps.
    """
    k = normals.shape[0]
    force = start.copy()
    displacement = (compliance @ force.reshape(-1) + offset).reshape(k, 3)
    blocks = [compliance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(k)]
    stiffness = [1.0 / np.linalg.eigvalsh(block)[-1] for block in blocks]
    columns = [np.ascontiguousarray(compliance[:, 3 * i : 3 * i + 3]) for i in range(k)]
    sweep = 0
    while sweep < max_sweeps:
        sweep += 1
        change = 0.0
        for i in range(k):
            old = force[i].copy()
            new = _one_node(blocks[i], displacement[i] - blocks[i] @ old, normals[i], friction[i], old, stiffness[i])
            step = new - old
            if step.any():
                force[i] = new
                displacement += (columns[i] @ step).reshape(k, 3)
                change = max(change, float(np.abs(step).max()))
        if change <= tolerance * max(float(np.abs(force).max()), 1e-300):
            break
    return force, sweep


def _one_node(
    block: Array, free: Array, normal: Array, friction: float, start: Array, stiffness: float, inner: int = 60
) -> Array:
    """Contact of a single node: open and stick in closed form, slip by fixed-point steps."""
    if float(free @ normal) >= 0.0:
        # open is a solution whenever the free gap is not negative
        return np.zeros(3)
    stick = np.asarray(-np.linalg.solve(block, free), dtype=np.float64)
    fn = float(stick @ normal)
    if fn >= 0.0 and np.linalg.norm(stick - fn * normal) <= friction * fn:
        return stick
    f = start
    for _ in range(inner):
        v = f - stiffness * (block @ f + free)
        vn = max(float(v @ normal), 0.0)
        t = v - float(v @ normal) * normal
        length = float(np.sqrt(t @ t))
        limit = friction * vn
        new = vn * normal + t * (limit / length if length > limit else 1.0)
        if np.abs(new - f).max() <= 1e-15 * max(float(np.abs(new).max()), 1e-300):
            return new
        f = new
    return f
