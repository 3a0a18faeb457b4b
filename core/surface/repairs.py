"""Repairs: values of a scene that are not finite are replaced.

Findings report them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError, Finding
from ..scene.tactile_scene import Chunk, TactileScene, constant


class Repairs:
    """Replaces bad poses and animated values over the chunks of a scene."""

    def __init__(self) -> None:
        self._bad: dict[tuple[str, str], list[float]] = {}
        self._last_pose: dict[str, Array] = {}  # by kind, shape (k, 4, 4); NaN before the first good pose

    def note(self, code: str, name: str, frames: list[float]) -> None:
        """Record frames in which a value was bad.

        Args:
            code: code of the finding, see `findings`.
            name: name of the object or value.
            frames: numbers of the frames.
        """
        self._bad.setdefault((code, name), []).extend(frames)

    def poses(self, kind: str, names: list[str], poses: Array, frames: Array) -> Array:
        """Replace poses that are not finite by the last good one.

        Their frames are recorded.

        If there was no good pose before, the first good one of these samples is used, or else the identity.

        Args:
            kind: 'finger', 'object' or 'screen'.
            names: names of the k things that have the poses, for findings.
            poses: poses at n samples, shape (k, n, 4, 4).
            frames: frame numbers of the samples, shape (n,).
        """
        finite = np.isfinite(poses)
        if finite.all() and len(frames):
            self._last_pose[kind] = poses[:, -1].copy()
            return poses
        good: NDArray[np.bool_] = np.logical_and.reduce(finite, axis=(2, 3))
        before = self._last_pose.get(kind)
        if before is None:
            before = np.full((len(names), 4, 4), np.nan)
        poses = poses.copy()
        for i in np.flatnonzero(~good.all(axis=1)):
            self._bad.setdefault((f"not-finite {kind}", names[i]), []).extend(frames[~good[i]].tolist())
            start = before[i]
            if not np.isfinite(start).all():
                first = np.flatnonzero(good[i])
                start = poses[i, first[0]] if first.size else np.eye(4)
            last = np.maximum.accumulate(np.where(good[i], np.arange(len(frames)), -1))
            poses[i] = np.where((last >= 0)[:, None, None], poses[i, np.maximum(last, 0)], start)
        ever: NDArray[np.bool_] = np.logical_or.reduce(good, axis=1)
        self._last_pose[kind] = np.where(ever[:, None, None], poses[:, -1], before)
        return poses

    def animated(self, chunks: Sequence[Chunk], frames: Array, scene: TactileScene) -> dict[str, Array]:
        """Join the animated parameters of all chunks, and replace bad values.

        A value that is not finite is replaced by the last good one, or by the first good one if there is none before.
        If a chunk does not have a parameter, the value in the scene's header is used.

        Raises:
            DermisError: a parameter has a wrong length, is never finite, or is neither in a chunk nor in the header.
        """
        joined: dict[str, Array] = {}
        for key in sorted({key for c in chunks for key in c.animated}):
            parts = [
                np.asarray(c.animated[key], np.float64)
                if key in c.animated
                else np.full(len(c.times), constant(scene, key))
                for c in chunks
            ]
            values = np.concatenate(parts)
            if len(values) != len(frames):
                raise DermisError(
                    "an animated value needs one number per sample",
                    where=key,
                    value=len(values),
                    limit=str(len(frames)),
                )
            good = np.isfinite(values)
            if not good.any():
                raise DermisError(
                    "an animated value is never a finite number", where=key, remedy="Look at its keyframes and drivers"
                )
            if not good.all():
                self._bad["not-finite value", key] = frames[~good].tolist()
                last = np.maximum.accumulate(np.where(good, np.arange(len(values)), -1))
                values = np.where(last >= 0, values[np.maximum(last, 0)], values[np.flatnonzero(good)[0]])
            joined[key] = values
        return joined

    def findings(self) -> Iterator[Finding]:
        """Yield findings of bad values, ordered by code and name."""
        for (code, name), bad in sorted(self._bad.items()):
            if code == "zero-scale":
                yield Finding(
                    "error",
                    code,
                    "the object is scaled to 0 or flat, so it cannot be touched there",
                    f"object '{name}'",
                    limit="a scale other than 0",
                    frame=bad[0],
                    count=len(bad),
                    remedy="Scale its vertices instead, or stop it being touchable",
                )
            elif code == "not-finite surface":
                yield Finding(
                    "error",
                    "not-finite",
                    "vertices are not finite numbers; the last good surface was held",
                    f"object '{name}'",
                    remedy="Look at its shape keys and modifiers",
                    frame=bad[0],
                    count=len(bad),
                )
            else:
                what = "pose" if not code.endswith("value") else "value"
                where = name if what == "value" else f"{code.split()[1]} '{name}'"
                yield Finding(
                    "error",
                    "not-finite",
                    f"the {what} is not a finite number; the last good one was held",
                    where,
                    remedy="Look at its drivers and constraints",
                    frame=bad[0],
                    count=len(bad),
                )
