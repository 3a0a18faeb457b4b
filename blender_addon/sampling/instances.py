"""Read the geometry and the place of instances from the dependency graph.

An instance belongs to the innermost touchable object that it is part of. If that is a separate object, in a collection
or among geometry nodes, each instance of it is a body. All other instances that a touchable object shows are, together
with its mesh, its own surface, so it makes no difference whether instances are realized. Particles move independently,
so each particle is a body as well; it has the material of its emitter.
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
from . import participants
from .changes_seen import ChangesSeen
from .joined_pieces import Joined, Pieces, join, with_area
from .meshes import SURFACE_TYPES, EvaluatedMesh, Geometry, MeshReader
from .participants import InstanceKey
from .unfelt import Unfelt, is_unfelt

_UNUSED = 2**31 - 1  # Blender's value for unused levels of a persistent id


class Shown(NamedTuple):
    """The geometry and places of instances at a moment.

    Attributes:
        surfaces: the surface of each instance that is a body, by its key, and of each object that shows instances as
            its own surface, by its session uid. It is in the body's own space, and None where nothing is shown.
        places: matrices to the world [scene units] of the instances that are bodies, shape (4, 4) each.
        materials: session uid of the object whose material an instance has.
        unfelt: geometry without faces, which cannot be felt.
    """

    surfaces: dict[Hashable, Geometry | None]
    places: dict[InstanceKey, Array]
    materials: dict[InstanceKey, int]
    unfelt: frozenset[Unfelt]


@dataclass
class _Object:
    """The properties of an evaluated object, looked up once per reading."""

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
    """The shown pieces of a body.

    `pieces` has, for each geometry, the ids of its pieces and the indices of their matrices.
    """

    ids: tuple[int, ...] = ()
    shown: _Object | None = None
    place: int = -1
    material: int = 0
    others: bool = False  # whether some of its pieces are instances of another object
    pieces: dict[int, tuple[list[tuple[int, ...]], list[int]]] = field(default_factory=dict)


class InstanceReader:
    """Reader of instances; unchanged geometry is the same object.

    Args:
        meshes: reads the surfaces. changes: shows when a frame need not be read again.
    """

    def __init__(self, meshes: MeshReader, changes: ChangesSeen | None = None) -> None:
        self._meshes = meshes
        self._changes = ChangesSeen() if changes is None else changes
        self._joined: dict[Hashable, Joined] = {}
        self._showing: set[int] = set()  # objects that have shown more, or less, than their own mesh at some time
        self._relevant: set[int] = set()
        self._last: Shown | None = None
        self._at_once = False

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Read instances at most once inside the context: its time is one moment."""
        self._last, self._at_once = None, True
        try:
            yield
        finally:
            self._at_once = False

    def read(self, depsgraph: bpy.types.Depsgraph) -> Shown:
        """Return the instances shown now.

        It is the last `Shown` again if nothing of it can have changed.
        """
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
        unfelt: set[Unfelt] = set()
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
                if is_unfelt(instance, shown.evaluated):
                    unfelt.add(Unfelt(shown.uid if body.shown is None else body.shown.uid, instance.type))
                continue
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
        all_places = places.reshape(-1, 4, 4).astype(np.float64)
        return self._put_together(own, objects, bodies, geometries, all_places, frozenset(unfelt))

    def _put_together(
        self,
        own: dict[int, tuple[_Object, bool]],
        objects: dict[int, _Body],
        bodies: dict[InstanceKey, _Body],
        geometries: dict[int, Geometry],
        places: Array,
        unfelt: frozenset[Unfelt],
    ) -> Shown:
        surfaces: dict[Hashable, Geometry | None] = {}
        for key, body in bodies.items():
            surfaces[key] = self._joined_of(key, _pieces(body, geometries, places), places[body.place])
        for uid in own.keys() | objects.keys():
            known, itself = own.get(uid, (None, False))
            body = objects.get(uid, _Body())
            known = body.shown if known is None else known
            assert known is not None  # the object is listed itself, or it shows something
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
            unfelt,
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
    """Begin a separate body; a counter makes its ids unique if they are not."""
    key = InstanceKey(maker.uid, shown.uid, ids)
    again = 0
    while key in bodies:
        again += 1
        key = InstanceKey(maker.uid, shown.uid, (*ids, again))
    body = bodies[key] = _Body(ids, shown, number, material)
    return body


def _is_part(ids: tuple[int, ...], whole: tuple[int, ...]) -> bool:
    """Return whether an instance is part of another one.

    Blender puts the numbers of inner levels first, so the ids of the whole are the last ids of its part.
    """
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
        known.evaluated.type in SURFACE_TYPES  # others have no mesh of their own beside that of nodes
        and len(pieces) == 1
        and len(pieces[0].ids) == 1 == len(pieces[0].ids[0])
        and np.array_equal(pieces[0].places[0], place)
    )
