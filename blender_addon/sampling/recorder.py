"""Record the evaluated values of all participants as chunks of samples.

One call copies the matrices of all objects into one buffer at each sample. All other work that can wait is done once
per chunk: a bare frame_set of a light scene takes 30 microseconds, so every microsecond added per sample would show.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import Array, DermisError, Finding, core
from . import curved_surfaces, participants, script_changes, simulated_motion
from .instance_samples import InstanceSamples
from .meshes import MeshReader
from .participants import Entry, Participants, at_place, is_disabled

SMALLEST_SCALE = 1e-6
"""[-] Scale that replaces a scale of zero: a matrix of scale zero has no inverse."""


class Recorder:
    """Recorder of all participants, for at most `count` samples at a time."""

    def __init__(
        self, swept: Participants, reader: MeshReader, count: int, instances: InstanceSamples, simulated: Any = None
    ) -> None:
        """Allocate the buffers.

        Args:
            instances: recorder of the instances among the same bodies, for the same number of samples.
            simulated: the recording that replaces the motion of simulated participants; None if there are none.
        """
        self._participants, self._reader, self._simulated = swept, reader, simulated
        self._entries = swept.entries
        total = len(bpy.data.objects)
        self._uids, self._now = np.empty(total, np.int32), np.empty(total, np.int32)
        bpy.data.objects.foreach_get("session_uid", self._uids)
        self._first = self._uids.tobytes()
        self._scripted = script_changes.run_here()
        self._raw = np.empty((count, total * 16), np.float32)
        place = {int(uid): i for i, uid in enumerate(self._uids)}
        self._place = np.array([place[e.uid] for e in self._entries], np.int64)
        self._blinking = [
            (i, int(self._place[i])) for i, e in enumerate(self._entries) if e.blinking and e.instance is None
        ]
        self._present = np.ones((len(self._entries), count), bool)
        first_body = len(swept.fingers)
        self._instances = instances
        self._shown = np.array(instances.bodies, np.int64) + first_body  # indices into the entries
        self._mirrored = np.array([i for i, e in enumerate(self._entries) if e.mirrored], np.int64)
        self._objects = np.array([i for i, e in enumerate(self._entries) if e.instance is None], np.int64)
        self._drawn = np.array([i for i, e in enumerate(swept.fingers) if e.drawn], np.int64)
        self._curved = [i for i, e in enumerate(self._entries) if e.curved is not None]
        self._particles = simulated_motion.between_frames(self._entries) if simulated is not None else {}
        self._offset = [(i, np.array(e.offset)) for i, e in enumerate(self._entries) if any(e.offset)]
        self._surfaced = [
            (first_body + i, i, e)
            for i, e in enumerate(swept.bodies)
            if (e.deforming or e.blinking) and e.shown_as is None and not _recorded(simulated, e)
        ]
        # Looks at meshes since surfaces were last made of them. The preview records one sample at a time and reads
        # each surface at once: to make surfaces of many looks may take a new mesh in the file, and only a sweep may
        # edit the file.
        self._looks: list[list[Any]] = [[] for _ in self._surfaced]
        self._look = reader.geometry_of if count == 1 else reader.look
        self._geometries = iter if count == 1 else reader.geometries
        self._surfaces: list[list[Any]] = [[] for _ in self._surfaced]  # one for each sample of the chunk so far
        self._absent = core.scene.tactile_scene.ABSENT
        self._bare = np.zeros((len(self._entries), count), bool)
        self._animated = self._animated_table()
        self._values = {key: np.empty(count) for key, _, _, _ in self._animated}
        self._checked = self._direct = False
        self._places = sorted(set(self._place[self._objects].tolist()))  # list indices of participants, no instances
        self._fine = b""  # the last linear maps whose scales needed no mending

    def holds(self) -> bool:
        """Return whether Blender still lists the same objects in the same order."""
        return len(bpy.data.objects) == len(self._uids) and self._now_first()

    def record(self, k: int, depsgraph: bpy.types.Depsgraph) -> None:
        """Record the current frame as sample k."""
        objects = bpy.data.objects
        if len(objects) != len(self._uids):
            self._changed()
        order = self._order() if self._scripted else None
        if not self._checked:
            self._check_source(depsgraph)
        if self._direct:
            self._record_directly(k, depsgraph)
        else:
            objects.foreach_get("matrix_world", self._raw[k])
            if order is not None:
                self._raw[k] = self._raw[k].reshape(-1, 16)[order].ravel()
        for i, place in self._blinking:
            self._present[i, k] = not is_disabled(self._object(place), depsgraph.view_layer)
        if self._shown.size:
            self._instances.record(k, depsgraph)
        if self._surfaced:
            self._record_surfaces(k, depsgraph)
        for key, place, path, factor in self._animated:
            owner = self._object(place) if self._scripted else objects[place]
            self._values[key][k] = owner.evaluated_get(depsgraph).dermis.path_resolve(path) * factor

    def chunk(self, frames: Array, times: Array, n: int, findings: list[Any], *, simulating: bool = False) -> Any:
        """Return samples 0 to n - 1 as a chunk; add repairs to `findings`.

        Raises:
            DermisError: a matrix or a parameter that is not a finite number.
        """
        # `record` may miss an exchange of objects that keeps their number. It is found here, before the chunk is used.
        if len(bpy.data.objects) != len(self._uids) or (self._order() is not None and not self._scripted):
            self._changed()
        self._take_instances(n)
        poses = self._poses(n)
        self._check_finite(poses, frames)
        self._mend_scales(poses, frames, findings)
        for i in self._curved:
            entry, stretches = self._entries[i], curved_surfaces.stretches_of(poses[i])
            if finding := curved_surfaces.outgrown(entry.name, entry.stretch, stretches, frames):
                _note(findings, finding)
        if self._simulated is not None:
            for i, entry in enumerate(self._entries):
                if entry.simulated:
                    now = self._simulated.poses_at(entry.name, times)
                    if i in self._particles:
                        self._particles[i].look(now[:, :3, 3], poses[i, :, :3, 3], self._present[i, :n], frames)
                    poses[i] = now
        f, b = len(self._participants.fingers), len(self._participants.bodies)
        self._take_surfaces()
        surfaces = {}
        for s, (_, body, _) in enumerate(self._surfaced):
            surfaces[body] = tuple(self._surfaces[s])
            self._surfaces[s].clear()
        if self._shown.size:
            surfaces |= self._instances.surfaces(n)
        if self._simulated is not None:
            for body, entry in enumerate(self._participants.bodies):
                if self._simulated.has_surface(entry.name):
                    surfaces[body] = self._simulated.surfaces_at(entry.name, times)
        for key, values in self._values.items():
            bad = np.flatnonzero(~np.isfinite(values[:n]))
            if len(bad):
                raise DermisError(
                    "an animated value is not a finite number",
                    where=f"animated parameter '{key}'",
                    value=f"{values[bad[0]]} at frame {frames[bad[0]]:g}",
                    remedy="Look at its F-curve or driver",
                )
        self._report_presence(frames[:n], findings, simulating)
        animated = {key: values[:n].copy() for key, values in self._values.items()}
        return core.scene.tactile_scene.Chunk(
            frames, times, _rigid(poses[:f]), poses[f : f + b], poses[f + b :], surfaces, animated
        )

    def findings(self) -> list[Any]:
        """Return the findings on particles between whole frames, over all chunks."""
        watched = dict.fromkeys(self._particles.values())
        return [found for between in watched if (found := between.finding()) is not None]

    def surfaces_of(self, k: int) -> Iterator[tuple[Entry, Any]]:
        """Yield deforming bodies and their surfaces at sample k, the last one."""
        self._take_surfaces()
        for s, (_, _, entry) in enumerate(self._surfaced):
            if entry.deforming:
                yield entry, self._surfaces[s][k]
        yield from self._instances.surfaces_now()

    def _animated_table(self) -> list[tuple[str, int, str, float]]:
        table = []
        at = 0
        for kind, entries in (
            ("finger", self._participants.fingers),
            ("body", self._participants.bodies),
            ("screen", self._participants.screens),
        ):
            for index, entry in enumerate(entries):
                for name, path, factor in entry.animated:
                    table.append((participants.animated_key(kind, index, name), int(self._place[at]), path, factor))
                at += 1
        return table

    def _changed(self) -> None:
        raise DermisError(
            "objects were added or removed while the scene was sampled",
            where=f"scene '{self._participants.scene}'",
            remedy="Bake again",
        )

    def _order(self) -> Array | None:
        """Return the present index of each object in Blender's list.

        None means that the order is as at the start. The list is in order of name, so a script that renames an object
        moves it.
        """
        if self._now_first():
            return None
        by_uid = np.argsort(self._now)
        order = by_uid[np.searchsorted(self._now, self._uids, sorter=by_uid).clip(max=len(by_uid) - 1)]
        if not np.array_equal(self._now[order], self._uids):
            self._changed()
        return order

    def _now_first(self) -> bool:
        """Read the order of Blender's list; return whether it is as at the start."""
        bpy.data.objects.foreach_get("session_uid", self._now)
        return self._now.tobytes() == self._first

    def _object(self, place: int) -> bpy.types.Object:
        """Return the object that had an index of Blender's list at the start."""
        return at_place(place, int(self._uids[place]))

    def _check_source(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Find out whether the objects hold the evaluated matrices of this graph.

        Blender copies evaluated matrices back to the objects only for the active dependency graph.
        """
        self._checked = True
        self._direct = not depsgraph_is_active(depsgraph, [self._object(i) for i in self._places])

    def _record_directly(self, k: int, depsgraph: bpy.types.Depsgraph) -> None:
        row = self._raw[k].reshape(-1, 4, 4)
        for place in self._places:
            columns = self._object(place).evaluated_get(depsgraph).matrix_world.col
            row[place] = [column[:] for column in columns]  # NumPy takes six times as long to read a matrix

    def _take_instances(self, n: int) -> None:
        """Copy at which samples instances are present but have no faces."""
        if not self._shown.size:
            return
        made = self._instances
        self._present[self._shown, :n] = made.here[:, :n]
        self._bare[self._shown, :n] = made.bare[:, :n] & self._present[self._shown, :n]

    def _record_surfaces(self, k: int, depsgraph: bpy.types.Depsgraph) -> None:
        for s, (i, _, entry) in enumerate(self._surfaced):
            look = None
            if self._present[i, k]:
                evaluated = self._object(int(self._place[i])).evaluated_get(depsgraph)
                look = self._look(evaluated, entry.curved is not None)
            self._looks[s].append(look)

    def _take_surfaces(self) -> None:
        """Make surfaces of the looks since the last call.

        Making surfaces for many samples at once is faster.
        """
        for s, (i, _, entry) in enumerate(self._surfaced):
            looks, self._looks[s], made = self._looks[s], [], self._surfaces[s]
            geometries = iter(self._geometries([look for look in looks if look is not None]))
            for look in looks:
                geometry = None if look is None else next(geometries)
                bare = geometry is None or not len(geometry.topology.faces)
                self._bare[i, len(made)] = bare and self._present[i, len(made)]
                args = self._participants.unit, entry.mirrored, entry.curved
                made.append(self._absent if bare else self._reader.surface(geometry, *args))

    def _poses(self, n: int) -> Array:
        """Return the matrices of all entries in metres, shape (entries, n, 4, 4).

        The matrices of mirrored entries have X negated.
        """
        poses = np.empty((len(self._entries), n, 4, 4))
        if self._shown.size:
            placed = self._instances.placed
            poses[self._shown[placed]] = self._instances.places[placed, :n]
        rows = self._raw[:n].reshape(n, -1, 4, 4)[:, self._place[self._objects]]
        poses[self._objects] = rows.transpose(1, 0, 3, 2)  # Blender's are column-major
        for i, offset in self._offset:
            poses[i, :, :3, 3] += poses[i, :, :3, :3] @ offset
        if self._mirrored.size:
            poses[self._mirrored, :, :3, 0] *= -1.0
        poses[:, :, :3, 3] *= self._participants.unit
        return poses

    def _check_finite(self, poses: Array, frames: Array) -> None:
        if np.isfinite(poses).all():
            return
        i, k = np.argwhere(~np.isfinite(poses).all(axis=(2, 3)))[0]
        raise DermisError(
            "its transform is not a finite number",
            where=f"object '{self._entries[i].name}'",
            value=f"NaN or infinity at frame {frames[k]:g}",
            remedy="Look for a broken key or driver at this frame",
        )

    def _mend_scales(self, poses: Array, frames: Array, findings: list[Any]) -> None:
        linear = poses[:, :, :3, :3]
        if linear.tobytes() == self._fine:
            return
        norms = np.sqrt(np.add.reduce(linear * linear, axis=2))
        off = (np.abs(norms[self._drawn] - 1.0) > participants.UNSCALED).any(axis=2)
        for d in np.flatnonzero(off.any(axis=1)):
            i = self._drawn[d]
            _note(findings, _scaled(self._entries[i].name, norms[i], off[d], frames))
        flat = (norms < 1e-9).any(axis=2)
        turned = np.linalg.det(linear) < 0
        turned[: len(self._participants.fingers)] = False
        mended = np.flatnonzero(flat.any(axis=1) | turned.any(axis=1)).tolist()
        if not (mended or off.any()):
            self._fine = linear.tobytes()
        for i in mended:
            name = self._entries[i].name
            if flat[i].any():
                _note(
                    findings,
                    Finding(
                        "warning",
                        "zero-scale",
                        f"a scale of zero was taken as {SMALLEST_SCALE:g}",
                        where=f"object '{name}'",
                        remedy="Give it a scale, or stop it being touchable",
                        frame=float(frames[np.argmax(flat[i])]),
                        count=int(flat[i].sum()),
                    ),
                )
                for k in np.flatnonzero(flat[i]):
                    linear[i, k] = _with_scale(linear[i, k])
            if (turned[i] & ~flat[i]).any():
                _note(
                    findings,
                    Finding(
                        "warning",
                        "scale-sign",
                        "its scale changes sign within the range, which turns it inside out",
                        where=f"object '{name}'",
                        frame=float(frames[np.argmax(turned[i])]),
                        count=int(turned[i].sum()),
                    ),
                )

    def _report_presence(self, frames: Array, findings: list[Any], simulating: bool) -> None:
        here = self._present[:, : len(frames)].all() and not self._bare[:, : len(frames)].any()
        if simulating or (here and not self._shown.size):
            return
        if self._shown.size:
            for finding in self._instances.findings(frames, self._present[self._shown, : len(frames)]):
                _note(findings, finding)
        some = ~self._present[:, : len(frames)].all(axis=1) | self._bare[:, : len(frames)].any(axis=1)
        for i in np.flatnonzero(some).tolist():
            entry = self._entries[i]
            gone = ~self._present[i, : len(frames)]
            if gone.any():
                finding = self._absence(i)
                frame, count = float(frames[np.argmax(gone)]), int(gone.sum())
                _note(findings, replace(finding, frame=frame, count=count))
            bare = self._bare[i, : len(frames)]
            if bare.any():
                _note(
                    findings,
                    Finding(
                        "warning",
                        "no-faces",
                        "for some time it has no faces and cannot be touched",
                        where=f"object '{entry.name}'",
                        frame=float(frames[np.argmax(bare)]),
                        count=int(bare.sum()),
                    ),
                )

    def _absence(self, i: int) -> Any:
        """Return the finding that entry i is hidden for a while.

        Chunks can mark bodies as absent, but neither fingers nor screens.
        """
        name, first_screen = self._entries[i].name, len(self._entries) - len(self._participants.screens)
        if len(self._participants.fingers) <= i < first_screen:
            what = "it is not there all the time, and cannot be touched meanwhile"
            return Finding("info", "absent", what, where=f"object '{name}'")
        is_screen = i >= first_screen
        return Finding(
            "warning",
            "felt-throughout",
            "it is hidden for some time, but "
            + ("a touch screen stays touchable" if is_screen else "a finger keeps touching"),
            where=f"{'screen' if is_screen else 'finger'} '{name}'",
            remedy="Move it away for these frames, or key none of its visibility",
        )


def _recorded(simulated: Any, entry: Entry) -> bool:
    return simulated is not None and simulated.has_surface(entry.name)


def depsgraph_is_active(depsgraph: bpy.types.Depsgraph, objects: list[bpy.types.Object]) -> bool:
    """Return whether original objects hold this graph's evaluated matrices."""
    for obj in objects:
        evaluated = obj.evaluated_get(depsgraph)
        theirs, ours = np.array(evaluated.matrix_world), np.array(obj.matrix_world)
        if evaluated != obj and not np.array_equal(theirs, ours, equal_nan=True):
            return False
    return True


def _scaled(name: str, scale: Array, off: NDArray[np.bool_], frames: Array) -> Any:
    """Return the finding that a finger's mesh is scaled in some samples.

    The skin does not follow the scale: it feels with the size that its settings say.
    """
    first = int(off.argmax())
    return Finding(
        "warning",
        "finger-scale",
        "it is drawn at another scale, but its skin has the size of its settings",
        where=f"finger '{name}'",
        value=f"{participants.farthest_scale(scale[first]):.3g} times",
        limit="1",
        remedy="Clear its scale, and set the lengths of its skin in the Dermis tab",
        frame=float(frames[first]),
        count=int(off.sum()),
    )


def _rigid(poses: Array) -> Array:
    """Return finger frames without scale or shear.

    Y keeps its direction, Z is made perpendicular to Y, and X is the cross product of Y and Z.
    """
    out = np.zeros_like(poses)
    y, z = poses[..., :3, 1], poses[..., :3, 2]
    y = y / np.sqrt(np.add.reduce(y * y, axis=-1, keepdims=True))
    z = z - y * np.add.reduce(y * z, axis=-1, keepdims=True)
    z = z / np.sqrt(np.add.reduce(z * z, axis=-1, keepdims=True))
    after, before = (1, 2, 0), (2, 0, 1)
    x = y[..., after] * z[..., before] - y[..., before] * z[..., after]  # like np.cross, with a tenth of its calls
    out[..., :3, 0], out[..., :3, 1], out[..., :3, 2] = x, y, z
    out[..., :3, 3] = poses[..., :3, 3]
    out[..., 3, 3] = 1.0
    return out


def _with_scale(linear: Array) -> Array:
    """Return a right-handed matrix; zero columns get `SMALLEST_SCALE`."""
    lengths = np.linalg.norm(linear, axis=0)
    rotation, _ = np.linalg.qr(np.where(lengths < 1e-9, np.eye(3), linear / np.maximum(lengths, 1e-30)))
    sign = np.sign((rotation * linear).sum(axis=0))
    rotation = rotation * np.where(sign == 0, 1.0, sign)
    if np.linalg.det(rotation) < 0:
        rotation[:, int(np.argmin(lengths))] *= -1.0
    return rotation * np.maximum(lengths, SMALLEST_SCALE)


def _note(findings: list[Any], finding: Any) -> None:
    """Add a finding, or add its count to one of the same code and place."""
    for i, known in enumerate(findings):
        if (known.code, known.where) == (finding.code, finding.where):
            findings[i] = Finding(
                known.severity,
                known.code,
                known.what,
                known.where,
                known.value,
                known.limit,
                known.remedy,
                known.frame,
                known.count + finding.count,
            )
            return
    findings.append(finding)
