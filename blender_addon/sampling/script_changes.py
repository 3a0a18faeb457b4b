"""Follow the changes of shapes, visibility and settings by scripts.

These scripts run when the frame changes. Without them, only data whose relations depend on time can change, and these
relations are the same in the whole range. A script needs no relation, and may begin at any frame. Where scripts run,
the scene is therefore checked for changes at every sample. Shapes are read only when Blender reports an edit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import compat
from .._core import Array, Finding, core
from ..properties import object_properties
from . import participants, simulated_motion
from .meshes import MeshReader
from .participants import Entry, Participants, at_place, role_of

_LISTS = ("frame_change_pre", "frame_change_post")
_HANDLERS = tuple(
    getattr(bpy.app.handlers, name) for name in _LISTS
)  # Blender has one list object of each name, and changes it in place
_OURS = __name__.rpartition(".sampling.")[0]

_BRANCHES = {"FINGER": "finger", "SCREEN": "screen", "TOUCHABLE": "material"}
_CONSTANT = {"preset", "enabled", "screen", "source", "image", "filepath", "mesh_object", "resolution"}
"""Names of settings that a bake depends on, but that are in no table of parameters."""
_WORLD = ("gravity", "use_gravity", "unit_settings.scale_length")


# Copies of both lists at the last change, and the functions in them that are not the add-on's.
_looked_at: tuple[list[Any], list[Any], tuple[Any, ...]] = ([], [], ())


def _foreign(functions: list[Any]) -> list[Any]:
    return [f for f in functions if not str(getattr(f, "__module__", "")).startswith(_OURS)]


def functions() -> tuple[Any, ...]:
    """Return others' functions that run when the frame changes, in order.

    They are those that are not the add-on's. The result is cached, because it is needed several times at every shown
    frame.
    """
    global _looked_at
    pre, post = _HANDLERS
    if _looked_at[0] != pre or _looked_at[1] != post:
        _looked_at = list(pre), list(post), (*_foreign(pre), *_foreign(post))
    return _looked_at[2]


def run_here() -> bool:
    """Return whether functions of others run when the frame changes."""
    return bool(functions())


@contextmanager
def held_back() -> Iterator[None]:
    """Keep the functions of others from running when the frame changes."""
    before = {name: list(getattr(bpy.app.handlers, name)) for name in _LISTS}
    for name in _LISTS:
        foreign = _foreign(before[name])
        getattr(bpy.app.handlers, name)[:] = [f for f in before[name] if f not in foreign]
    try:
        yield
    finally:
        for name, functions in before.items():
            getattr(bpy.app.handlers, name)[:] = functions


def needed(scene: bpy.types.Scene) -> bool:
    """Return whether a scene must be watched for changes.

    It must if scripts run, or if a setting that is constant over a bake (gravity, unit scale) is animated.
    """
    return run_here() or not compat.animated_paths(scene).isdisjoint(_WORLD)


class Watch:
    """Context manager that follows the changes by scripts, sample by sample.

    Attributes:
        findings: findings on changes by scripts, each with the frame at which it was first seen.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        view_layer: bpy.types.ViewLayer,
        swept: Participants,
        surfaces: Sequence[Any],
        reader: MeshReader,
        timely: frozenset[int],
    ) -> None:
        """Note the state at the first frame, which is the current one.

        Args:
            surfaces: the bodies' surfaces in the header. reader: the reader that read them.
            timely: session uids of the data that Blender evaluates anew because time advances.
        """
        self.findings: list[Any] = []
        self._scene, self._view_layer, self._reader, self._timely = scene, view_layer, reader, timely
        self._unit, self._names = swept.unit, [e.name for e in swept.bodies]
        place = {o.session_uid: i for i, o in enumerate(bpy.data.objects)}
        self._bodies = [
            (b, (place[e.uid], e.uid), e) for b, e in enumerate(swept.bodies) if e.shown_as is None and not e.blinking
        ]
        self._still = {b: mesh for b, mesh in enumerate(surfaces) if mesh is not None}
        self._gone: set[int] = set()
        self._count = 0  # samples of the chunk so far
        self._rows: dict[int, list[Any]] = {}  # surfaces at these samples, by the index of a body that has changed
        self._edited: set[int] = set()  # session uids of what was edited since the last sample
        self._all = True  # whether any data may have been edited since then
        self._frame: int | None = None
        taking_part = [
            ((place[o.session_uid], o.session_uid), o) for o in scene.objects if participants.role_of(o) != "NONE"
        ]
        self._inside = _children()
        self._settings = [(at, _settings(o, compat.stored(o, "dermis"), self._inside)) for at, o in taking_part]
        # The engine knows no absence of fingers and screens, so changes of their visibility are only reported.
        self._disabled = [
            (at, participants.is_disabled(o, view_layer))
            for at, o in taking_part
            if participants.role_of(o) in ("FINGER", "SCREEN")
        ]
        self._world = _world(scene)
        self._off = {key for key, on in simulated_motion.switches(scene) if not on}
        self._known = {o.session_uid for _, o in taking_part}
        # A scene that has no instancers at first is swept without instances; any that appear later are reported.
        self._looks_for_makers = not participants.instancers(scene)
        self._keyable = _keyable(swept, place)
        self._following: dict[str, list[float]] = {}  # values of changed parameters at samples of the chunk

    def __enter__(self) -> Watch:
        bpy.app.handlers.frame_change_post.append(self._note)  # last in the list, so it sees the edits of the others
        return self

    def __exit__(self, *_: object) -> None:
        self._leave()

    def _leave(self) -> None:
        if self._note in bpy.app.handlers.frame_change_post:
            bpy.app.handlers.frame_change_post.remove(self._note)

    def _stay_last(self) -> None:
        """Move the watcher to the end of the list if it is not the last there.

        It may then have missed edits by scripts, so all data count as edited.
        """
        functions = bpy.app.handlers.frame_change_post
        if not functions or functions[-1] != self._note:
            self._all = True
            self._leave()
            functions.append(self._note)

    def _note(self, _scene: bpy.types.Scene, depsgraph: Any = None) -> None:
        if depsgraph is None:
            self._all = True
            return
        edited = {update.id.original.session_uid for update in depsgraph.updates} - self._timely
        if edited:
            self._edited |= edited
            changed = (update.id.original for update in depsgraph.updates)
            wide = (o for o in changed if isinstance(o, bpy.types.Scene | bpy.types.Collection))
            self._all |= any(o.session_uid in edited for o in wide)

    def look(self, depsgraph: bpy.types.Depsgraph, at_frame: float) -> None:
        """Check the current frame, the next sample of the chunk, for changes."""
        self._stay_last()
        frame = math.floor(at_frame)
        if frame != self._frame:
            self._frame = frame
            self._look_at_settings(float(frame))
        if self._edited or self._all:
            for at, disabled in self._disabled:
                obj = participants.at_place(*at)
                if participants.is_disabled(obj, self._view_layer) != disabled:
                    self._tell(f"object '{obj.name_full}'", "visibility", float(frame))
            if self._looks_for_makers and participants.instancers(self._scene):
                self._look_for_makers(depsgraph, float(frame))
            for b, at, entry in self._bodies:
                obj = participants.at_place(*at)
                if self._all or entry.uid in self._edited or _hangs_on_others(obj) or _uid(obj.data) in self._edited:
                    self._look_at_body(b, obj, entry, depsgraph)
            self._edited.clear()
            self._all = False
        for b, row in self._rows.items():
            row.append(self._now(b))
        self._count += 1
        for key, values in self._following.items():
            values.append(self._value(key))

    def follow(self, chunk: Any) -> Any:
        """Return a chunk with the changed surfaces and parameters put in.

        The chunk must hold exactly the samples of all calls of `look` since the last `follow`.
        """
        absent = core.scene.tactile_scene.ABSENT
        surfaces, animated = dict(chunk.surfaces), dict(chunk.animated)
        for b, row in self._rows.items():
            self._tell_absence(b, [mesh is absent for mesh in row], chunk.frames)
            if b in surfaces:  # the body deforms with time as well
                own = surfaces[b]
                surfaces[b] = tuple(absent if mine is absent else his for mine, his in zip(row, own, strict=True))
            else:
                surfaces[b] = tuple(row)
            row.clear()
        self._count = 0
        for key, values in self._following.items():
            before = len(chunk.times) - len(values)
            animated[key] = np.array([self._keyable[key].first] * before + values)
            values.clear()
        return replace(chunk, surfaces=surfaces, animated=animated)

    def _look_at_body(self, b: int, obj: bpy.types.Object, entry: Entry, depsgraph: bpy.types.Depsgraph) -> None:
        before = self._now(b)
        self._gone.discard(b)
        if participants.is_disabled(obj, self._view_layer):
            self._gone.add(b)
        elif b in self._still:
            mesh = self._reader.read(obj.evaluated_get(depsgraph), self._unit, entry.mirrored, entry.curved)
            self._still[b] = mesh if len(mesh.triangles) else core.scene.tactile_scene.ABSENT
        if self._now(b) is not before:
            self._rows.setdefault(b, [before] * self._count)

    def _now(self, b: int) -> Any:
        return core.scene.tactile_scene.ABSENT if b in self._gone else self._still.get(b)

    def _look_at_settings(self, frame: float) -> None:
        inside = _children()
        moved = inside != self._inside
        for i, (at, first) in enumerate(self._settings):
            obj = at_place(*at)
            stored = compat.stored(obj, "dermis")
            if moved or stored != first.stored:
                now = _settings(obj, stored, inside)
                if not self._compare(obj, first, now, frame):
                    self._settings[i] = at, now  # reading a group creates it empty, which changes no setting
        for obj in self._scene.objects:
            if obj.session_uid not in self._known and role_of(obj) != "NONE":
                self._tell(f"object '{obj.name_full}'", "role", frame)
        for name, value in _world(self._scene).items():
            if value != self._world[name]:
                self._tell(f"scene '{self._scene.name_full}'", name, frame)
        for (uid, name), on in simulated_motion.switches(self._scene) if self._off else ():
            if on and (uid, name) in self._off:
                self._tell(_owner(uid), name or "rigid body world", frame)

    def _compare(self, obj: Any, first: _Settings, now: _Settings, frame: float) -> bool:
        """Report settings that differ from the first ones; return whether any do."""
        changed = set(_differing(first.stored, now.stored))
        if first.content != now.content:
            changed.add("material.content_kind")
        if not changed:
            return False
        animated, branch = compat.animated_paths(obj), _BRANCHES.get(participants.role_of(obj))
        for path in sorted(changed):
            if f"dermis.{path}" in animated:
                continue
            key = next((k for k, v in self._keyable.items() if (v.uid, v.path) == (obj.session_uid, path)), None)
            if key is not None:
                self._following.setdefault(key, [])
            elif path == "role" or (path.partition(".")[0] == branch and _matters(path)):
                self._tell(f"object '{obj.name_full}'", path, frame)
        return True

    def _value(self, key: str) -> float:
        """Return the present value of a parameter in SI, from the original object.

        Blender does not evaluate an object anew when a script sets a property of the add-on.
        """
        parameter = self._keyable[key]
        obj = participants.at_place(parameter.place, parameter.uid)
        return float(obj.dermis.path_resolve(parameter.path)) * parameter.factor

    def _tell(self, where: str, name: str, frame: float) -> None:
        if any((f.code, f.where, f.value) == ("setting-changed", where, name) for f in self.findings):
            return
        self.findings.append(
            Finding(
                "warning",
                "setting-changed",
                "it changes within the range, but a bake takes it as it is at the first frame",
                where=where,
                value=name,
                remedy="Keep it constant, or bake the range in parts",
                frame=frame,
            )
        )

    def _look_for_makers(self, depsgraph: bpy.types.Depsgraph, frame: float) -> None:
        """Report objects that begin to show touchable instances within the range.

        Such instances are not felt, because bodies are listed before the first sample.
        """
        shown = [(i.object.original, i.parent.original) for i in depsgraph.object_instances if i.is_instance]
        makers = {
            maker.name_full
            for instance, maker in shown
            if "TOUCHABLE" in (participants.role_of(instance), participants.role_of(maker))
        }
        self._looks_for_makers = not makers
        for name in sorted(makers):
            self.findings.append(
                Finding(
                    "warning",
                    "instances-too-late",
                    "a script lets it show instances within the range, and they are not touchable",
                    where=f"object '{name}'",
                    remedy="Let the instances be there from the first frame, or bake the range in parts",
                    frame=frame,
                )
            )

    def _tell_absence(self, b: int, gone: list[bool], frames: Array) -> None:
        """Report the first frame at which a body is absent, once per body."""
        where = f"object '{self._names[b]}'"
        if not any(gone) or any((f.code, f.where) == ("absent", where) for f in self.findings):
            return
        self.findings.append(
            Finding(
                "info",
                "absent",
                "a script hides it or removes its faces for some time, and it cannot be touched then",
                where=where,
                frame=float(frames[gone.index(True)]),
            )
        )


def _hangs_on_others(obj: bpy.types.Object) -> bool:
    """Return whether a shape depends on more than its object and mesh."""
    return obj.type != "MESH" or len(obj.modifiers) > 0 or obj.data.shape_keys is not None


def _uid(data: bpy.types.ID | None) -> int:
    return 0 if data is None else int(data.session_uid)


class _Keyable(NamedTuple):
    """A parameter that may change within a bake but is not animated.

    `place` is the first index of its object in Blender's list, `path` is relative to `dermis`, `factor` converts to
    SI, and `first` is its first value in SI.
    """

    uid: int
    place: int
    path: str
    factor: float
    first: float


def _keyable(swept: Participants, place: Mapping[int, int]) -> dict[str, _Keyable]:
    """Return the keyable parameters that are not animated, by chunk key."""
    out = {}
    for kind, entries in (("finger", swept.fingers), ("body", swept.bodies), ("screen", swept.screens)):
        for index, entry in enumerate(entries):
            obj = bpy.data.objects[place[entry.uid]]
            for parameter in participants.keyable_parameters(obj):
                name, path, factor = parameter
                if parameter not in entry.animated:
                    first = float(obj.dermis.path_resolve(path)) * factor
                    key = participants.animated_key(kind, index, name)
                    out[key] = _Keyable(entry.uid, place[entry.uid], path, factor, first)
    return out


class _Settings(NamedTuple):
    """All settings of an object.

    Attributes:
        stored: the values below `dermis`, in nested groups. content: the sorted names of its children where these are
            its content, else None.
    """

    stored: dict[str, Any]
    content: tuple[str, ...] | None


def _settings(obj: bpy.types.Object, stored: dict[str, Any], inside: Mapping[int, list[str]]) -> _Settings:
    listed = participants.role_of(obj) == "TOUCHABLE" and obj.dermis.material.content_kind == "child"
    return _Settings(stored, tuple(sorted(inside.get(obj.session_uid, ()))) if listed else None)


def _children() -> dict[int, list[str]]:
    """Return the names of all children by the session uid of their parent.

    `Object.children` would go over all objects for each parent.
    """
    out: dict[int, list[str]] = {}
    for obj in bpy.data.objects:
        if obj.parent is not None:
            out.setdefault(obj.parent.session_uid, []).append(obj.name_full)
    return out


def _world(scene: bpy.types.Scene) -> dict[str, Any]:
    return dict(zip(_WORLD, (tuple(scene.gravity), scene.use_gravity, scene.unit_settings.scale_length), strict=True))


def _owner(uid: int) -> str:
    obj = next((o for o in bpy.data.objects if o.session_uid == uid), None)
    return "scene" if obj is None else f"object '{obj.name_full}'"


def _differing(first: Any, now: Any, path: str = "") -> Iterator[str]:
    """Yield the paths of the differences between two nested groups."""
    if isinstance(first, dict) and isinstance(now, dict):
        for name in first.keys() | now.keys():
            one, other = first.get(name, {}), now.get(name, {})
            if one != other:
                yield from _differing(one, other, f"{path}.{name}" if path else name)
        return
    before, after = dict(_flat(first, path)), dict(_flat(now, path))
    yield from (p for p in before.keys() | after.keys() if before.get(p) != after.get(p))


def _flat(values: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and the value of everything in nested groups and lists."""
    if isinstance(values, dict):
        for name, value in values.items():
            yield from _flat(value, f"{path}.{name}" if path else name)
    elif isinstance(values, list) and values and isinstance(values[0], dict):
        for index, value in enumerate(values):
            yield from _flat(value, f"{path}[{index}]")
    else:
        yield path, values


def _matters(path: str) -> bool:
    """Return whether a bake depends on a setting of an object's role."""
    name = path.rpartition(".")[2]
    tables = (*object_properties.TABLES.values(), core.parameters.skin.SKIN, core.parameters.skin.SKIN_CONTACT)
    return name in _CONSTANT or any(name == row.saved for table in tables for row in table.values() if row.label)
