"""Compare settings that have separate values for the viewport and renders.

Differences are returned as texts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

from .. import compat

_FINENESS = {
    "SUBSURF": ("levels", "render_levels"),
    "MULTIRES": ("levels", "render_levels"),
    "SCREW": ("steps", "render_steps"),
    "OCEAN": ("viewport_resolution", "resolution"),
}
"""Settings of modifiers for the viewport and for renders, by type."""
_CURVE = (("resolution_u", "render_resolution_u"), ("resolution_v", "render_resolution_v"))
_RESOLVED = {"CURVE", "SURFACE", "FONT", "META"}
_META = ("resolution", "render_resolution")
_SHOWN = ("show_viewport", "show_render")
_INSTANCER = ("show_instancer_for_viewport", "show_instancer_for_render")
_PARTICLES = (
    "display_method",
    "render_type",
    "display_percentage",
    "child_type",
    "child_percent",
    "rendered_child_count",
)

_VISIBILITY = ("hide_viewport", "hide_render", "visible_camera")

_ANIMATED = frozenset({*_META, *_SHOWN, *_VISIBILITY, *_INSTANCER, *_PARTICLES}.union(*_FINENESS.values(), *_CURVE))
_SIMPLIFY = ("simplify_subdivision", "simplify_subdivision_render")
_SIMPLIFY_CHILDREN = ("simplify_child_particles", "simplify_child_particles_render")
_SIMPLIFIED = frozenset({"use_simplify", *_SIMPLIFY, *_SIMPLIFY_CHILDREN})

_ALWAYS = 2**31 - 1  # a level that Simplify does not reduce
_OFF_IN = {True: "is off in renders", False: "is on in renders only"}


def settings(obj: bpy.types.Object, scene: bpy.types.Scene) -> list[str]:
    """Return texts on the settings by which an object differs in a render.

    Its surface, or its instances, may differ.
    """
    out = [f"{m.name}{said}" for m in obj.modifiers if (said := _modifier(m, scene))]
    out += [f"{name}: {shown:g}, in renders {rendered:g}" for name, shown, rendered in _data(obj.data)]
    for system in obj.particle_systems:
        out += [f"{system.name}: {said}" for said in _particles(system.settings, scene)]
    return out


def has_settings(obj: bpy.types.Object) -> bool:
    """Return whether an object has anything that `settings` compares."""
    return len(obj.modifiers) > 0 or obj.type in _RESOLVED or len(obj.particle_systems) > 0


def instancer(obj: bpy.types.Object) -> list[str]:
    """Return a text if only the viewport or only renders show an instancer."""
    if not obj.is_instancer:
        return []
    shown, rendered = (getattr(obj, name) for name in _INSTANCER)
    return [f"the instancer {_OFF_IN[shown]}"] if shown != rendered else []


def visibility(shown: bpy.types.Object | bpy.types.Collection) -> list[str]:
    """Return a text if only the viewport or only renders show a data-block.

    It is an object or a collection.
    """
    hidden = shown.hide_viewport
    if hidden == shown.hide_render:
        return []
    return ["is shown in renders only" if hidden else "is hidden in renders"]


def displaces(material: bpy.types.Material | None) -> bool:
    """Return whether a material moves surfaces in a render."""
    if material is None or material.displacement_method == "BUMP" or material.node_tree is None:
        return False
    output = material.node_tree.get_output_node("ALL")
    return output is not None and bool(output.inputs["Displacement"].is_linked)


def seen_by_camera(obj: bpy.types.Object) -> bool:
    """Return whether cameras see an object, if its collections are rendered."""
    return bool(obj.visible_camera) and not obj.hide_render


def rendering(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Collection]:
    """Yield the collections of a view layer that renders show."""
    if layer.exclude or layer.indirect_only or layer.collection.hide_render:
        return
    yield layer.collection
    for child in layer.children:
        yield from rendering(child)


def animated(obj: bpy.types.Object) -> bool:
    """Return whether a setting that is compared here is animated."""
    owners = {obj, obj.data, *(system.settings for system in obj.particle_systems)}
    return any(o is not None and not _ANIMATED.isdisjoint(_attributes(o)) for o in owners)


def simplify_animated(scene: bpy.types.Scene) -> bool:
    """Return whether Simplify is animated; it applies to all objects."""
    return not _SIMPLIFIED.isdisjoint(_attributes(scene))


def finer(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the ratio of faces in a render to those in the viewport.

    Only the subdivision of the object is considered.
    """
    levels = 0
    for modifier in obj.modifiers:
        if modifier.type in ("SUBSURF", "MULTIRES"):
            shown, rendered = _levels(modifier, scene)
            levels += rendered * modifier.show_render - shown * modifier.show_viewport
    return 4.0**levels


def _attributes(owner: bpy.types.ID) -> set[str]:
    return {path.rpartition(".")[2] for path in compat.animated_paths(owner)}


def _modifier(modifier: Any, scene: bpy.types.Scene) -> str:
    shown, rendered = (getattr(modifier, name) for name in _SHOWN)
    if shown != rendered:
        return f" {_OFF_IN[shown]}"
    if shown and modifier.type in _FINENESS:
        levels = _levels(modifier, scene)
        return "" if levels[0] == levels[1] else f": {levels[0]}, in renders {levels[1]}"
    if shown and modifier.type == "NODES" and _asks_for_viewport(modifier.node_group, set()):
        return " asks whether it is in the viewport"
    return ""


def _levels(modifier: Any, scene: bpy.types.Scene) -> tuple[int, int]:
    """Return a modifier's fineness in the viewport and in renders."""
    shown, rendered = (getattr(modifier, name) for name in _FINENESS[modifier.type])
    if modifier.type not in ("SUBSURF", "MULTIRES") or not scene.render.use_simplify:
        return shown, rendered
    most, most_rendered = (getattr(scene.render, name) for name in _SIMPLIFY)
    return min(shown, most), min(rendered, most_rendered)


def _data(data: bpy.types.ID | None) -> Iterator[tuple[str, float, float]]:
    """Yield the names of resolutions that differ, and both values."""
    if isinstance(data, bpy.types.Curve):
        for name, in_renders in _CURVE:
            shown, rendered = getattr(data, name), getattr(data, in_renders)
            if rendered not in (0, shown):
                yield name, shown, rendered
    elif isinstance(data, bpy.types.MetaBall):
        shown, rendered = (getattr(data, name) for name in _META)
        if shown != rendered:
            yield _META[0], shown, rendered


def _particles(of: bpy.types.ParticleSettings, scene: bpy.types.Scene) -> Iterator[str]:
    """Yield texts on objects at particles that only renders show."""
    shows = {"OBJECT": of.instance_object, "COLLECTION": of.instance_collection}.get(of.render_type)
    if shows is None:
        return
    if of.display_method != "RENDER":
        yield "its objects are in renders only"
        return
    if of.display_percentage < 100:
        yield f"{of.display_percentage} % of its particles, in renders all"
    if of.child_type != "NONE":
        shares = (1.0, 1.0)
        if scene.render.use_simplify:
            shares = tuple(getattr(scene.render, name) for name in _SIMPLIFY_CHILDREN)
        shown, rendered = int(of.child_percent * shares[0]), int(of.rendered_child_count * shares[1])
        if shown != rendered:
            yield f"{shown} children of each particle, in renders {rendered}"


def _asks_for_viewport(tree: Any, seen: set[str]) -> bool:
    if tree is None or tree.name_full in seen:
        return False
    seen.add(tree.name_full)
    return any(
        node.bl_idname == "GeometryNodeIsViewport" or _asks_for_viewport(getattr(node, "node_tree", None), seen)
        for node in tree.nodes
    )
