"""Manage the objects made for films: find, create, parent and remove them.

Each carries a mark. When it is made anew, the old object is found and gets the new contents. An artist's changes of its
material, collection or visibility are kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Literal

import bpy
from mathutils import Matrix

from .. import changes, marks
from ..quantities import metres_per_unit

Kind = Literal["skin", "twin", "legend"]
COLLECTIONS: dict[Kind, str] = {"skin": "Dermis Skins", "twin": "Dermis Twins", "legend": "Dermis Legend"}
MODIFIER = "Dermis Frames"
MARK, PIECE, HIDES = marks.FILM, "dermis_piece", marks.FILM_HIDES


@contextmanager
def unnoticed(context: bpy.types.Context) -> Iterator[None]:
    """Allow changes of objects for films without outdating a bake.

    No such object takes part in a bake.
    """
    with changes.muted():
        try:
            yield
        finally:
            context.view_layer.update()


@contextmanager
def paused(scene: bpy.types.Scene) -> Iterator[None]:
    """Stop a scene's skins and pins from playing inside the context.

    At each sample of a sweep, playing them would take longer than all other work.
    """
    uid = scene.session_uid
    playing = [obj.name for obj in scene.objects if MARK in obj and any(m.show_viewport for m in _players(obj))]
    try:
        _let_play(uid, playing, shown=False)
        yield
    finally:
        _let_play(uid, playing, shown=True)


def of_kind(scene: bpy.types.Scene, kind: Kind) -> list[bpy.types.Object]:
    """Return a scene's objects of a kind."""
    return [obj for obj in scene.objects if obj.get(MARK) == kind]


def named(
    scene: bpy.types.Scene, kind: Kind, parent: bpy.types.Object, piece: str, name: str, data: type | None
) -> bpy.types.Object:
    """Return a parent's child of a kind and piece; make it if it is missing.

    Args:
        name: name of a new object.
        data: type of its data, `bpy.types.Mesh` or `bpy.types.TextCurve`; None for an empty.
    """
    for child in parent.children:
        if child.get(MARK) == kind and child.get(PIECE) == piece and child.name in scene.objects:
            return child
    made: Any = None
    if data is bpy.types.Mesh:
        made = bpy.data.meshes.new(name)
    elif data is bpy.types.TextCurve:
        made = bpy.data.curves.new(name, "FONT")
    obj = bpy.data.objects.new(name, made)
    obj[MARK], obj[PIECE] = kind, piece
    _collection(scene, kind).objects.link(obj)
    obj.parent = parent
    return obj


def hang(obj: bpy.types.Object, finger: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Put an object with data in metres into its finger's frame.

    The scales of the finger and of the scene's unit are cancelled.
    """
    size = finger.matrix_world.to_scale()
    obj.matrix_parent_inverse = Matrix.Diagonal((*(1.0 / (s or 1.0) for s in size), 1.0)) @ Matrix.Scale(
        1.0 / metres_per_unit(scene), 4
    )


def remove(scene: bpy.types.Scene, kind: Kind) -> int:
    """Remove a scene's objects of a kind; return their number.

    Their data, keys and collection are removed as well. Fingers that a skin had hidden from renders are shown again.
    """
    found = of_kind(scene, kind)
    for obj in found:
        if obj.get(HIDES) and obj.parent is not None:
            obj.parent.hide_render = False
        _remove(obj)
    for collection in list(scene.collection.children_recursive):
        if collection.get(MARK) == kind and not collection.all_objects:
            bpy.data.collections.remove(collection)
    return len(found)


def remove_others(parent: bpy.types.Object, kind: Kind, kept: set[str]) -> None:
    """Remove a parent's pieces of a kind that are not among those kept."""
    for child in list(parent.children):
        if child.get(MARK) == kind and child.get(PIECE) not in kept:
            _remove(child)


def fill(mesh: bpy.types.Mesh, vertices: Any, faces: Iterable[Any]) -> None:
    """Give a mesh new vertices and smooth faces; its materials stay."""
    mesh.clear_geometry()
    mesh.from_pydata(vertices.tolist(), [], [list(face) for face in faces])
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.update()


def _players(obj: bpy.types.Object) -> list[Any]:
    """Return the modifiers that play a table."""
    return [m for m in obj.modifiers if m.name == MODIFIER]


def _let_play(uid: int, names: list[str], *, shown: bool) -> None:
    """Switch existing players on or off without outdating a bake."""
    scene = next((s for s in bpy.data.scenes if s.session_uid == uid), None)
    if scene is None or not names:
        return
    with changes.muted():
        for obj in (scene.objects.get(name) for name in names):
            for player in _players(obj) if obj is not None else ():
                player.show_viewport = shown
        for layer in scene.view_layers:
            layer.update()


def _remove(obj: bpy.types.Object) -> None:
    """Remove an object, with its data if nothing else uses them."""
    belongings: list[Any] = [m.node_group for m in obj.modifiers if m.type == "NODES" and m.node_group is not None]
    tables = [n.inputs[0].default_value for group in belongings for n in group.nodes if n.type == "OBJECT_INFO"]
    action = obj.animation_data.action if obj.animation_data is not None else None
    data = obj.data
    bpy.data.objects.remove(obj)
    for group in belongings:
        if not group.users:
            bpy.data.node_groups.remove(group)
    for table in tables:
        if table is not None and not table.users:
            mesh = table.data
            bpy.data.objects.remove(table)
            bpy.data.meshes.remove(mesh)
    for left in (data, action):
        if left is not None and not left.users:
            bpy.data.batch_remove([left])


def _collection(scene: bpy.types.Scene, kind: Kind) -> bpy.types.Collection:
    for collection in scene.collection.children_recursive:
        if collection.get(MARK) == kind:
            return collection
    made = bpy.data.collections.new(COLLECTIONS[kind])
    made[MARK] = kind
    scene.collection.children.link(made)
    return made
