"""Find simulations, and record and interpolate their motion.

Simulations are swept at whole frames from their start. Blender does not evaluate them at sub-frames: it shows steps, or
straight segments from a cache. Position, rotation, stretch and vertices are therefore interpolated by the engine's own
C2 splines.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import compat, scene_time
from .._core import Array, Finding, core
from . import dependence, motion_pieces, participants
from .participants import Entry

MARGIN = 8
"""[frames] Vertices taken on either side of a window. The effect of a knot on a cubic spline falls by a factor of 0.27
per frame, and to 3e-5 in eight frames."""

_CACHED = {"CLOTH", "SOFT_BODY"}
_SIMULATED_TYPES = {"CLOTH", "SOFT_BODY", "DYNAMIC_PAINT", "EXPLODE", "PARTICLE_INSTANCE"}


@dataclass(frozen=True)
class Simulations:
    """The simulations of a scene.

    Attributes:
        uids: session uids of simulated objects and of all that depend on them.
        start: first frame of the earliest simulation.
        fluids: names of fluid domains, whose surface cannot be followed.
    """

    uids: frozenset[int]
    start: int
    fluids: tuple[str, ...]


def switches(scene: bpy.types.Scene) -> Iterator[tuple[tuple[int, str], bool]]:
    """Yield all that may simulate, and whether it is on.

    Its key is the session uid of the object and the name of the modifier. The rigid body world has the uid of the
    scene and the name ''.
    """
    if scene.rigidbody_world is not None:
        yield (scene.session_uid, ""), scene.rigidbody_world.enabled
    for obj in scene.objects:
        for modifier in obj.modifiers:
            if modifier.type in _SIMULATED_TYPES or modifier.type in ("FLUID", "NODES"):
                yield (obj.session_uid, modifier.name), modifier.show_viewport


def find(scene: bpy.types.Scene) -> Simulations:
    """Find simulations and everything that depends on them.

    Dependence is by parents, constraints, modifiers and drivers.
    """
    sources: set[Any] = set()
    starts: list[int] = []
    fluids = []
    world = scene.rigidbody_world
    keyed_on = "rigidbody_world.enabled" in compat.animated_paths(scene)
    if world is not None and (world.enabled or keyed_on) and world.collection is not None:
        active = {o for o in world.collection.all_objects if o.rigid_body is not None and o.rigid_body.type == "ACTIVE"}
        if active:
            sources |= active
            starts.append(world.point_cache.frame_start)
    for obj in scene.objects:
        for modifier in obj.modifiers:
            if not modifier.show_viewport and not _keyed_on(obj, modifier):
                continue
            if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
                fluids.append(obj.name_full)
            elif modifier.type in _SIMULATED_TYPES or (modifier.type == "NODES" and _simulates(modifier.node_group)):
                sources.add(obj)
                cache = modifier.point_cache if modifier.type in _CACHED else None
                starts.append(cache.frame_start if cache else scene.frame_start)
        for system in obj.particle_systems:
            sources.add(obj)
            starts.append(system.point_cache.frame_start)
    uids = frozenset(o.session_uid for o in dependence.dependants(sources) if isinstance(o, bpy.types.Object))
    return Simulations(uids, min(starts, default=scene.frame_start), tuple(sorted(fluids)))


def _keyed_on(obj: bpy.types.Object, modifier: Any) -> bool:
    """Return whether a modifier's visibility in the viewport is animated."""
    return f'modifiers["{bpy.utils.escape_identifier(modifier.name)}"].show_viewport' in compat.animated_paths(obj)


def _simulates(tree: Any) -> bool:
    seen = set()
    pending = [tree]
    while pending:
        current = pending.pop()
        if current is None or current.name_full in seen:
            continue
        seen.add(current.name_full)
        for node in current.nodes:
            if node.bl_idname == "GeometryNodeSimulationOutput":
                return True
            pending.append(getattr(node, "node_tree", None))
    return False


def stretched(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return the finding that time is stretched, which a playback shows.

    With a stretch, playback may show simulations differently from how they are baked.
    """
    factor = scene_time.stretch(scene)
    if factor == 1.0:
        return ()
    slow = "playback shows simulations in steps, standing still between them; the bake moves them smoothly"
    fast = "playback leaves out steps of simulations, which then may not move; the bake takes each step"
    return (
        Finding(
            "info",
            "simulation-stretched",
            f"time is stretched, so {slow if factor > 1.0 else fast}",
            where=f"scene '{scene.name_full}'",
            value=f"Time Stretching by {factor:g}",
            limit="the same at a stretch of 1",
            remedy="Bake the simulation's cache before it is played, or set Old and New to the same number",
        ),
    )


class BetweenFrames:
    """Measure how far particles are felt from where Blender shows them.

    The two differ between whole frames. There, Blender interpolates particles from one frame to the next. Here, they
    move on smooth curves, which round off a bounce.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._worst, self._worst_at, self._since, self._count = 0.0, 0.0, np.inf, 0

    def look(self, felt: Array, shown: Array, there: NDArray[np.bool_], frames: Array) -> None:
        """Compare the felt and the shown positions of a particle.

        Both are in metres, shape (n, 3). `frames`, shape (n,), are their frames; `there`, shape (n,), says at which of
        these the particle exists.
        """
        off = np.where(there, np.linalg.norm(felt - shown, axis=1), 0.0)
        rounding = np.finfo(np.float32).eps * np.abs(shown).max(axis=1)
        beyond = np.flatnonzero(off > core.surface.curved.TOLERANCE + rounding)
        if not len(beyond):
            return
        self._since = min(self._since, float(frames[beyond[0]]))
        self._count += len(beyond)
        worst = int(np.argmax(off))
        if off[worst] > self._worst:
            self._worst, self._worst_at = float(off[worst]), float(frames[worst])

    def finding(self) -> Any | None:
        """Return the finding on the samples so far; None if none was off."""
        if not self._count:
            return None
        return Finding(
            "warning",
            "particles-between-frames",
            "between whole frames contact and Blender interpolate its particles differently",
            where=f"object '{self._name}'",
            value=f"up to {1e3 * self._worst:.4g} mm, at frame {self._worst_at:g}",
            limit=f"{1e3 * core.surface.curved.TOLERANCE:g} mm",
            remedy="Raise the frame rate and stretch time by as much, or sample at whole frames only",
            frame=self._since,
            count=self._count,
        )


def between_frames(entries: Sequence[Entry]) -> dict[int, BetweenFrames]:
    """Return a `BetweenFrames` for particles and emitters, by index of entry.

    All entries of one emitter share it. Blender moves these between whole frames too. Rigid bodies and cloth stand
    still there.
    """
    makers = {i: e.uid if e.instance is None else e.instance.instancer for i, e in enumerate(entries) if e.simulated}
    emitting = {
        uid: BetweenFrames(obj.name_full)
        for uid, obj in participants.look_up(set(makers.values())).items()
        if obj.particle_systems and obj.rigid_body is None
    }
    return {i: emitting[uid] for i, uid in makers.items() if uid in emitting}


class Recording:
    """The motion of simulations at whole frames."""

    def __init__(self, times: Array) -> None:
        """Start a recording at the times [s] of the whole frames, shape (n,)."""
        self.times = times
        self._poses: dict[str, motion_pieces.Poses] = {}
        self._surfaces: dict[str, list[Any]] = {}
        self._bare: set[tuple[str, int]] = set()
        # By code and name: the time [s] of the first sample, and the number of samples.
        self._seen: dict[tuple[str, str], tuple[float, int]] = {}

    def keep_poses(self, name: str, matrices: Array, here: NDArray[np.bool_]) -> None:
        """Keep one entry's matrices at the whole frames, shape (n, 4, 4).

        `here`, shape (n,), says at which frames the entry is present.
        """
        self._poses[name] = motion_pieces.Poses(self.times, matrices, here)

    def keep_surface(self, name: str, mesh: Any, *, bare: bool = False) -> None:
        """Keep a body's surface at the next whole frame.

        It is kept in single precision, as Blender had it.

        Args:
            bare: the body is present, but has no faces.
        """
        kept = self._surfaces.setdefault(name, [])
        if bare:
            self._bare.add((name, len(kept)))
        if mesh is not core.scene.tactile_scene.ABSENT:
            mesh = core.scene.tactile_scene.Mesh(mesh.vertices.astype(np.float32), mesh.triangles)
        kept.append(mesh)

    def has_surface(self, name: str) -> bool:
        """Return whether a body's surface was recorded."""
        return name in self._surfaces

    def poses_at(self, name: str, times: Array) -> Array:
        """Return matrices at other times, shape (m, 4, 4)."""
        return self._poses[name].at(times)

    def surfaces_at(self, name: str, times: Array) -> tuple[Any, ...]:
        """Return a body's surfaces at other times.

        Where faces change between two whole frames, the surface of the first of them is returned. Faces that are only
        cut along other diagonals count as the same, and have the triangles of the last whole frame.
        """
        meshes = self._surfaces[name]
        at = motion_pieces.whole_frames(self.times, times)
        low, high = max(int(at[0]) - MARGIN, 0), min(int(at[-1]) + 1 + MARGIN, len(meshes) - 1)
        window, knots = meshes[low : high + 1], self.times[low : high + 1]
        same = np.array([_same_faces(*pair) for pair in pairwise(window)], bool)
        moves = np.array([not np.array_equal(one.vertices, other.vertices) for one, other in pairwise(window)], bool)
        first, last = motion_pieces.runs(same & moves)
        out = [meshes[i] for i in at.tolist()]
        for start in np.unique(first[at - low]).tolist():
            if last[start] == start:
                continue
            chosen = np.flatnonzero(first[at - low] == start)
            stack = np.stack([m.vertices for m in window[start : last[start] + 1]])
            spline = core.motion.Spline(knots[start : last[start] + 1], stack.reshape(len(stack), -1))
            moved = spline.at(times[chosen]).reshape(-1, *stack.shape[1:])
            for k, vertices in zip(chosen.tolist(), moved, strict=True):
                out[k] = core.scene.tactile_scene.Mesh(vertices.copy(), out[k].triangles)
        bare = np.array([(name, i) in self._bare for i in range(low, high + 1)])
        there = bare | [mesh is not core.scene.tactile_scene.ABSENT for mesh in window]
        others = np.append(~same & there[1:] & there[:-1], False)
        self._note("no-faces", name, times[bare[at - low]])
        self._note("faces-between-frames", name, times[others[at - low] & ~np.isin(times, self.times)])
        return tuple(out)

    def findings(self, clock: scene_time.Clock) -> Iterator[Any]:
        """Yield findings on the surfaces that `surfaces_at` has returned."""
        for (code, name), (since, count) in self._seen.items():
            what, remedy = _SAID[code]
            yield Finding(
                "warning",
                code,
                what,
                where=f"object '{name}'",
                remedy=remedy,
                frame=float(clock.frames(since)),
                count=count,
            )

    def _note(self, code: str, name: str, times: Array) -> None:
        if len(times):
            since, count = self._seen.get((code, name), (float(times[0]), 0))
            self._seen[code, name] = since, count + len(times)


_SAID = {
    "no-faces": ("for some time it has no faces and cannot be touched", ""),
    "faces-between-frames": (
        "it is simulated and gets other faces: between these whole frames it is felt as at the first of them",
        "Let its faces change while nothing touches it, or sample at whole frames only",
    ),
}


def _same_faces(one: Any, other: Any) -> bool:
    a, b = one.triangles, other.triangles
    if len(one.vertices) != len(other.vertices):
        return False
    return a is b or np.array_equal(a, b) or core.surface.topology.cut_otherwise(a, b)
