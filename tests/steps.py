"""A step: a wide solid whose top has two heights."""

from __future__ import annotations

import numpy as np

from core.surface.gap import Surface

WIDE, THICK = 0.06, 5e-3  # [m]
_FACES = [[0, 1, 4], [1, 3, 4], [1, 2, 3], [0, 4, 5]]  # of the profile


def step(height: float) -> Surface:
    """Return a solid whose top is at Z = 0 for X < 0, and at a height [m] for X > 0; the foot is along Y."""
    a = WIDE / 2
    profile = np.array([(-a, -THICK), (a, -THICK), (a, height), (0.0, height), (0.0, 0.0), (-a, 0.0)])
    vertices = np.concatenate([np.insert(profile, 1, y, axis=1) for y in (-a, a)])
    faces = [[i, i + 6, j] for i, j in zip(range(6), [1, 2, 3, 4, 5, 0], strict=True)]
    faces += [[j, i + 6, j + 6] for i, j in zip(range(6), [1, 2, 3, 4, 5, 0], strict=True)]
    faces += [[a, b, c] for a, b, c in _FACES] + [[a + 6, c + 6, b + 6] for a, b, c in _FACES]
    surface = Surface.build(vertices, np.array(faces, dtype=np.int32))
    return surface if surface.volume > 0.0 else Surface.build(vertices, np.array(faces, dtype=np.int32)[:, ::-1].copy())
