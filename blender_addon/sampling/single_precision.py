"""Find poses that move in steps because Blender's matrices are rounded.

Numbers in single precision have 24 binary digits: near 1 km, neighbouring numbers are 0.06 mm apart. An object at rest
is felt where Blender shows it. An object that moves far from the origin jumps from step to step, and so does its speed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np

from .._core import Array, Finding, core
from . import participants
from .participants import Participants


def limit(rate: float) -> float:
    """Return the largest harmless step [m] of poses sampled at a rate [Hz].

    Surfaces are followed to within `core.surface.curved.TOLERANCE`, and a larger step shows in the depth of a touch. An
    error of half a step either way changes the velocity from one sample to the next by up to twice the step times the
    rate. From `core.contact.held_body.KINK` on, such a change counts as a jerk.
    """
    return float(min(core.surface.curved.TOLERANCE, core.contact.held_body.KINK / (2.0 * rate)))


def step(length: float, unit: float) -> float:
    """Return the distance of adjacent single-precision numbers at a length.

    Both are in metres. Blender rounds numbers of scene units, which are `unit` metres long.
    """
    return float(np.spacing(np.float32(length / unit))) * unit


def _nearest(limit: float) -> float:
    """Return a length [m] up to which no step is larger than a limit [m].

    A step is at most 2^-23 of the length.
    """
    return limit * 2.0**23


class _Worst(NamedTuple):
    step: float
    length: float
    where: str
    frame: float


class Steps:
    """Watcher of a sweep's chunks for steps that are too large."""

    def __init__(self, swept: Participants, rate: float, surfaces: Sequence[Any]) -> None:
        """Note the participants of a sweep.

        `surfaces` are those of the bodies in the header; None for bodies whose surfaces are in the chunks.
        """
        self._unit, self._limit = swept.unit, limit(rate)
        self._harmless = _nearest(self._limit)
        self._groups = (("finger", swept.fingers), ("object", swept.bodies), ("screen", swept.screens))
        self._first: dict[str, Array] = {}
        self._worst: dict[str, _Worst] = {}
        self._reach = np.array([0.0 if mesh is None else _reach(mesh) for mesh in surfaces])
        self._farthest = {"finger": 0.0, "object": float(self._reach.max(initial=0.0)), "screen": 0.0}
        place = {o.session_uid: i for i, o in enumerate(bpy.data.objects)}
        objects = participants.look_up({e.uid for e in swept.entries if e.instance is None})
        self._chains = {
            (kind, i): chain
            for kind, entries in self._groups
            for i, e in enumerate(entries)
            if e.instance is None and (chain := [(place[o.session_uid], o.session_uid) for o in _chain(objects[e.uid])])
        }
        self._linked = sorted({at for chain in self._chains.values() for at in chain})

    def look(self, chunk: Any) -> None:
        """Check the samples of a chunk; the scene must be at the last of them."""
        fingers = chunk.fingers[:, :, :3, 3]
        parents = self._parents()
        for (kind, entries), poses in zip(self._groups, (chunk.fingers, chunk.bodies, chunk.screens), strict=True):
            if not entries:
                continue
            if kind not in self._first:
                self._first[kind] = poses[:, 0].copy()
            places, first = poses[:, :, :3, 3], self._first[kind]
            most = max(places.max(), -places.min(), self._farthest[kind], *parents.values())
            if most <= self._harmless:
                continue
            lengths = np.abs(places).max(axis=(1, 2))
            for (owner, i), chain in self._chains.items():
                if owner == kind:
                    lengths[i] = max(lengths[i], *(parents[place] for place in chain))
            reach = self._reach if kind == "object" else np.zeros(len(poses))
            for i in np.flatnonzero(np.maximum(lengths, reach) > self._harmless).tolist():
                moved = poses[i] != first[i]
                if not moved.any():
                    continue
                length = float(lengths[i])
                if reach[i] > length and moved[:, :3, :3].any():
                    # The steps of a point of a turning body grow with its distance from the body's origin. They are
                    # felt at points near a finger.
                    away = np.linalg.norm(fingers - poses[i, :, :3, 3], axis=-1).min()
                    length = max(length, min(float(reach[i]), float(away)))
                frame = float(chunk.frames[np.argmax(moved.any(axis=(1, 2)))])
                self._note(f"{kind} '{entries[i].name}'", length, frame)

    def findings(self) -> Iterator[Any]:
        """Yield the finding of the largest step.

        Its count is the number of participants that move in steps.
        """
        if not self._worst:
            return
        worst = max(self._worst.values(), key=lambda w: w.step)
        yield Finding(
            "warning",
            "far-from-origin",
            "it is so far from the origin that it moves in steps: Blender rounds positions to single precision",
            where=worst.where,
            value=f"steps of {1e3 * worst.step:.2g} mm at {worst.length:.4g} m",
            limit=f"{1e3 * self._limit:.2g} mm",
            remedy=f"Move the scene with its keys to within {_rounded(self._harmless):g} m of the origin; a parent that"
            " brings it back does not help: its own positions stay rounded",
            frame=worst.frame,
            count=len(self._worst),
        )

    def _note(self, where: str, length: float, frame: float) -> None:
        size = step(length, self._unit)
        known = self._worst.get(where)
        if size > self._limit and (known is None or size > known.step):
            self._worst[where] = _Worst(size, length, where, frame if known is None else known.frame)

    def _parents(self) -> Mapping[tuple[int, int], float]:
        """Return the largest coordinate [m] of each child and parent.

        It is the largest in any of the spaces in which Blender adds up their places.
        """
        return {at: _farthest(participants.at_place(*at)) * self._unit for at in self._linked}


def _chain(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """Yield an object and all its parents; nothing if it has no parent."""
    while obj.parent is not None:
        yield obj
        obj = obj.parent
        if obj.parent is None:
            yield obj


def _farthest(obj: bpy.types.Object) -> float:
    places = (obj.matrix_world.translation, obj.location, obj.matrix_parent_inverse.translation)
    return max(abs(c) for place in places for c in place)


def _reach(mesh: Any) -> float:
    """Return the largest distance of a surface from its object's origin [m]."""
    places = mesh.vertices[np.isfinite(mesh.vertices).all(axis=1)] if len(mesh.vertices) else mesh.vertices
    return float(np.linalg.norm(places, axis=1).max()) if len(places) else 0.0


def _rounded(length: float) -> float:
    """Return a length with one digit, rounded down."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(np.floor(length / power) * power)
