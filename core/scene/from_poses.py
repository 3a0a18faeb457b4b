"""Sampled scenes from poses, for scripts without Blender's animation."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError
from .tactile_scene import Body, Chunk, Finger, Screen, TactileScene


def scene_from_poses(
    rate: float,
    fingers: Sequence[tuple[Finger, ArrayLike]],
    bodies: Sequence[tuple[Body, ArrayLike]] = (),
    screens: Sequence[tuple[Screen, ArrayLike]] = (),
    *,
    name: str = "scene",
) -> TactileScene:
    """Return a scene of bodies, fingers and screens from their sampled poses.

    Every sample is a frame. Each finger, body and screen comes with its path. A path of positions [m] has shape (n, 3),
    and its object keeps the axes of the world. A path of object-to-world matrices has shape (n, 4, 4). A single
    position, shape (3,), or a single matrix, shape (4, 4), holds for all samples.

    Args:
        rate: samples per second [Hz].
        fingers: fingers with their paths.
        bodies: bodies with their paths.
        screens: screens with their paths.
        name: name of the scene.

    >>> from dermis import Body, Finger, Surface, scene_from_poses
    >>> plate = Body("Plate", Surface.block().mesh, {"friction": 0.5})
    >>> way = [(0.0, 0.0, 1e-3), (0.0, 0.0, 0.0), (1e-3, 0.0, 0.0)]
    >>> scene_from_poses(100.0, [(Finger("Index"), way)], [(plate, (0.0, 0.0, 0.0))])
    TactileScene('scene', frames 1 to 3, 0.02 s at 100 Hz, 1 fingers, 1 bodies, 0 screens)

    Raises:
        DermisError: the rate is not above zero, a path has another shape or is not finite, paths have different numbers
            of samples, nothing moves, or the scene cannot be rendered (see `TactileScene.validate`).
    """
    if not (np.isfinite(rate) and rate > 0):
        raise DermisError("the sampling rate must be positive", where=f"scene '{name}'", value=rate, limit="> 0 Hz")
    placed = [[_poses(thing.name, where) for thing, where in group] for group in (fingers, bodies, screens)]
    counts = {len(poses) for group in placed for poses in group} - {1}
    if len(counts) != 1:
        raise DermisError(
            "all moving objects need the same number of samples",
            where=f"scene '{name}'",
            value=", ".join(map(str, sorted(counts))) or "nothing moves",
        )
    n = counts.pop()
    all_of = [np.array([np.broadcast_to(p, (n, 4, 4)) for p in group]).reshape(-1, n, 4, 4) for group in placed]
    samples = np.arange(n, dtype=np.float64)
    chunk = Chunk(samples + 1.0, samples / rate, all_of[0], all_of[1], all_of[2])
    scene = TactileScene(
        name,
        fps=Fraction(rate).limit_denominator(1_000_000),
        frame_range=(1, n),
        rate=rate,
        fingers=tuple(finger for finger, _ in fingers),
        bodies=tuple(body for body, _ in bodies),
        screens=tuple(screen for screen, _ in screens),
        chunks=(chunk,),
    )
    scene.validate()
    return scene


def _poses(name: str, where: ArrayLike) -> Array:
    """Return a path as matrices, shape (n, 4, 4); n is 1 without motion."""
    given = np.asarray(where, np.float64)
    if given.shape[-1:] == (3,) and given.ndim in (1, 2):
        poses = np.tile(np.eye(4), (given.size // 3, 1, 1))
        poses[:, :3, 3] = given
    else:
        poses = given.reshape(-1, *given.shape[-2:])
    if poses.shape[1:] != (4, 4) or not np.isfinite(poses).all():
        limit = "finite, (3,), (n, 3), (4, 4) or (n, 4, 4)"
        raise DermisError("neither positions nor poses", where=name, value=given.shape, limit=limit)
    return poses
