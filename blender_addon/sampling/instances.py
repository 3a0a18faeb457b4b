"""What instances show: the evaluated geometry and the place of each, as Blender's dependency graph lists them.

An instance belongs to the innermost touchable object that it is part of. Where that is an object of its own, in a
collection or among the nodes, each instance of it is a body. All else that a touchable object shows is its own surface,
together with its mesh: whether instances are realized makes no difference. Particles move one by one, so each is a
body as well, of the object that emits it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, NamedTuple

import bpy
import numpy as np

from .._core import Array
from . import curved_surfaces, participants
from .changes_seen import ChangesSeen
from .joined_pieces import Joined, Pieces, join, with_area
from .meshes import EvaluatedMesh, Geometry, MeshReader
from .participants import InstanceKey

_UNUSED = 2**31 - 1  # what Blender fills unused levels of a persistent id with


class Shown(NamedTuple):
    """What instances show at a moment.

    Attributes:
        surfaces: in its own space, of each instance that is a body, and by session uid of each object that shows
            instances as its own surface; None where it shows nothing.
        places: of the instances that are bodies, to the world [scene units], shape (4, 4) each.
        materials: session uid of the object whose material an instance has.
    """

    surfaces: dict[Hashable, Geometry | None]
    places: dict[InstanceKey, Array]
    materials: dict[InstanceKey, int]


@dataclass
class _Object:
    """What is asked of an evaluated object once a reading."""

    uid: int
    role: str
    evaluated: Any
    data: int  # address of its mesh, 0 where it has none
    particles: bool

    @property
    def touchable(self) -> bool:
        return self.role == "TOUCHABLE"


@dataclass
class _Body:
    """What is shown of a body: for each geometry, the ids of its pieces and the numbers of their matrices."""

    ids: tuple[int, ...] = ()
    shown: _Object | None = None
    place: int = -1
    material: int = 0
    others: bool = False  # some of it is another object's
    pieces: dict[int, tuple[list[tuple[int, ...]], list[int]]] = field(default_factory=dict)


class InstanceReader:
    """Reads what instances show, and hands out the same geometry while nothing of it changes.

    Args:
        meshes: reads the surfaces. changes: says when a frame need not be read again.
    """

    def __init__(self, meshes: MeshReader, changes: ChangesSeen | None = None) -> None:
        self._meshes = meshes
        self._changes = ChangesSeen() if changes is None else changes
        self._joined: dict[Hashable, Joined] = {}
        self._showing: set[int] = set()  # objects that were seen to show more, or less, than their own mesh
        self._relevant: set[int] = set()
        self._last: Shown | None = None
        self._at_once = False

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Read once at most meanwhile: it all happens at one moment."""
        self._last, self._at_once = None, True
        try:
            yield
        finally:
            self._at_once = False

    def read(self, depsgraph: bpy.types.Depsgraph) -> Shown:
        """Return what is shown now; the very object that was returned last where nothing of it can have changed."""
        if self._last is None or not (self._at_once or not self._changes.any_of(self._relevant)):
            self._last = self._read(depsgraph)
        return self._last

    def _read(self, depsgraph: bpy.types.Depsgraph) -> Shown:
        known: dict[int, _Object] = {}

        def know(evaluated: Any) -> _Object:
            address = evaluated.as_pointer()
            found = known.get(address)
            if found is None:
                original = evaluated.original
                is_mesh = evaluated.type == "MESH"
                found = known[address] = _Object(
                    original.session_uid,
                    participants.role_of(original),
                    evaluated,
                    evaluated.data.as_pointer() if is_mesh else 0,
                    len(evaluated.particle_systems) > 0,
                )
            return found

        own: dict[int, tuple[_Object, bool]] = {}
        objects: dict[int, _Body] = {}
        bodies: dict[InstanceKey, _Body] = {}
        geometries: dict[int, Geometry] = {}
        ordinals: dict[tuple[int, int], int] = {}
        matrices: list[Any] = []
        relevant: set[int] = set()
        trail: list[_Body] = []
        maker: _Object | None = None
        for item in depsgraph.object_instances:
            if not item.is_instance:
                found = know(item.object)
                if found.touchable:
                    own[found.uid] = found, item.show_self
                continue
            parent, shown = know(item.parent), know(item.instance_object)
            if parent is not maker:
                maker, trail = parent, []
                relevant.add(maker.uid)
            relevant.add(shown.uid)
            if not (maker.touchable or shown.touchable or trail):
                continue
            ids = item.persistent_id[:]
            ids = ids[: ids.index(_UNUSED)] if ids[-1] == _UNUSED else ids
            while trail and not _is_part(ids, trail[-1].ids):
                trail.pop()
            number = len(matrices)
            if shown.touchable and shown is not maker and not (trail and trail[-1].shown is shown):
                body = _opened(bodies, maker, shown, ids, number, shown.uid)
                trail.append(body)
            elif trail:
                body = trail[-1]
            elif not maker.touchable or shown.role == "FINGER":
                continue
            elif maker.particles and item.particle_system is not None:
                body = _opened(bodies, maker, shown, ids, number, maker.uid)
                trail.append(body)
            else:
                body = objects.setdefault(maker.uid, _Body(shown=maker))
                body.others |= shown is not maker
            matrices.append(item.matrix_world.copy())
            instance = item.object
            if instance.type != "MESH":
                continue  # the surface of a curve, a text or metaballs is an instance of a mesh of its own
            address = instance.data.as_pointer()
            if address not in geometries:
                key: Hashable = shown.uid
                if address != shown.data:
                    ordinal = ordinals[maker.uid, shown.uid] = ordinals.get((maker.uid, shown.uid), -1) + 1
                    key = (maker.uid, shown.uid, ordinal)
                with EvaluatedMesh(instance) as mesh:
                    geometries[address] = self._meshes.geometry(key, mesh, True)
            listed, numbers = body.pieces.setdefault(address, ([], []))
            listed.append(ids)
            numbers.append(number)
        self._relevant = relevant
        places = np.fromiter(chain.from_iterable(chain.from_iterable(matrices)), np.float32, 16 * len(matrices))
        return self._put_together(own, objects, bodies, geometries, places.reshape(-1, 4, 4).astype(np.float64))

    def _put_together(
        self,
        own: dict[int, tuple[_Object, bool]],
        objects: dict[int, _Body],
        bodies: dict[InstanceKey, _Body],
        geometries: dict[int, Geometry],
        places: Array,
    ) -> Shown:
        surfaces: dict[Hashable, Geometry | None] = {}
        for key, body in bodies.items():
            surfaces[key] = self._joined_of(key, _pieces(body, geometries, places), places[body.place])
        for uid in own.keys() | objects.keys():
            known, itself = own.get(uid, (None, False))
            body = objects.get(uid, _Body())
            known = body.shown if known is None else known
            assert known is not None  # it is there itself, or it shows something
            place = np.array(known.evaluated.matrix_world, np.float64)
            pieces = _pieces(body, geometries, places)
            itself = itself and known.evaluated.type == "MESH"
            if uid not in self._showing:
                if not body.others and _plain(known, itself, pieces, place):
                    continue
                self._showing.add(uid)
            if itself:
                with EvaluatedMesh(known.evaluated) as mesh:
                    pieces.insert(0, Pieces(self._meshes.geometry(uid, mesh, True), ((),), place[None]))
            surfaces[uid] = self._joined_of(uid, pieces, place)
        self._relevant |= self._showing
        self._joined = {key: joined for key, joined in self._joined.items() if key in surfaces}
        return Shown(
            surfaces,
            {key: places[body.place] for key, body in bodies.items()},
            {key: body.material for key, body in bodies.items()},
        )

    def _joined_of(self, key: Hashable, pieces: list[Pieces], place: Array) -> Geometry | None:
        if len(pieces) == 1 and len(pieces[0].ids) == 1 and np.array_equal(pieces[0].places[0], place):
            self._joined.pop(key, None)
            return pieces[0].geometry
        pieces = [p for p in map(with_area, pieces) if p.ids]
        if not pieces:
            self._joined.pop(key, None)
            return None
        made = join(pieces, place, self._joined.get(key))
        if made is None:
            return None
        self._joined[key] = made
        return made.geometry


def _opened(
    bodies: dict[InstanceKey, _Body], maker: _Object, shown: _Object, ids: tuple[int, ...], number: int, material: int
) -> _Body:
    """Begin a body of its own; ids that are not unique are told apart by their order."""
    key = InstanceKey(maker.uid, shown.uid, ids)
    again = 0
    while key in bodies:
        again += 1
        key = InstanceKey(maker.uid, shown.uid, (*ids, again))
    body = bodies[key] = _Body(ids, shown, number, material)
    return body


def _is_part(ids: tuple[int, ...], whole: tuple[int, ...]) -> bool:
    """Return whether an instance is part of another one: Blender puts the numbers of inner levels in front."""
    return len(ids) > len(whole) and ids[len(ids) - len(whole) :] == whole


def _pieces(body: _Body, geometries: dict[int, Geometry], places: Array) -> list[Pieces]:
    out = []
    for address, (ids, numbers) in body.pieces.items():
        if len(ids) == 1:
            out.append(Pieces(geometries[address], (ids[0],), places[numbers]))
            continue
        order = sorted(range(len(ids)), key=ids.__getitem__)
        out.append(Pieces(geometries[address], tuple(ids[i] for i in order), places[[numbers[i] for i in order]]))
    return out


def _plain(known: _Object, itself: bool, pieces: list[Pieces], place: Array) -> bool:
    """Return whether an object shows its own surface and nothing else."""
    if known.evaluated.type == "MESH":
        return itself and not pieces
    if not pieces:
        return True
    return (
        len(pieces) == 1
        and len(pieces[0].ids) == 1 == len(pieces[0].ids[0])
        and np.array_equal(pieces[0].places[0], place)
    )


class Present(NamedTuple):
    """An instance that is a body, over the range.

    Attributes:
        first: its matrix [scene units] where it first was; None where it is always there.
        material: session uid of the object whose material it has.
        changing: its surface is not always the same.
        stretch: the most that its matrices stretch it by; of those alone whose surface is felt curved.
    """

    first: Array | None
    material: int
    changing: bool
    stretch: float = 1.0


class Instances(NamedTuple):
    """The instances of the range.

    Attributes:
        bodies: those that are bodies, in the order of their keys.
        objects: session uids of the objects that show instances as their own surface, and whether that changes, or
            begins or ends.
    """

    bodies: dict[InstanceKey, Present]
    objects: dict[int, bool]


class Survey:
    """Looks at frames for instances: the header must name those that appear later.

    Args:
        curved: session uids of the objects that are felt curved: how large their instances become must be known.
    """

    def __init__(self, reader: InstanceReader, curved: frozenset[int] = frozenset()) -> None:
        self._reader, self._curved = reader, curved
        self._stretches: dict[InstanceKey, float] = {}
        self._frames = 0
        self._last: Shown | None = None
        self._since = 0
        self._times: dict[Hashable, int] = {}
        self._first: dict[InstanceKey, tuple[Array, int]] = {}
        self._surfaces: dict[Hashable, Geometry | None] = {}
        self._changing: set[Hashable] = set()

    def look(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Look at the frame that is evaluated now."""
        shown = self._reader.read(depsgraph)
        if shown is not self._last:
            self._count()
            for key, surface in shown.surfaces.items():
                if self._surfaces.setdefault(key, surface) is not surface:
                    self._changing.add(key)
            for key, place in shown.places.items():
                if key not in self._first:
                    self._first[key] = place, shown.materials[key]
            if self._curved:
                self._measure(shown)
            self._last = shown
        self._frames += 1

    def found(self) -> Instances:
        """Return what was seen at all frames."""
        self._count()
        bodies = {
            key: Present(
                None if self._times[key] == self._frames else place,
                material,
                key in self._changing,
                self._stretches.get(key) or 1.0,
            )
            for key, (place, material) in sorted(self._first.items(), key=lambda item: item[0])
        }
        objects = {
            key: key in self._changing or self._times[key] < self._frames
            for key in self._surfaces
            if isinstance(key, int)
        }
        return Instances(bodies, objects)

    def _measure(self, shown: Shown) -> None:
        keys = [key for key, material in shown.materials.items() if material in self._curved]
        if keys:
            now = curved_surfaces.stretches_of(np.stack([shown.places[key] for key in keys])).tolist()
            for key, stretch in zip(keys, now, strict=True):
                self._stretches[key] = max(self._stretches.get(key, 0.0), stretch)

    def _count(self) -> None:
        if self._last is not None:
            for key in self._last.surfaces:
                self._times[key] = self._times.get(key, 0) + self._frames - self._since
        self._since = self._frames


def only_now(reader: InstanceReader, depsgraph: bpy.types.Depsgraph, curved: frozenset[int] = frozenset()) -> Instances:
    """Return the instances of the current frame; `curved` as in `Survey`."""
    survey = Survey(reader, curved)
    survey.look(depsgraph)
    return survey.found()
