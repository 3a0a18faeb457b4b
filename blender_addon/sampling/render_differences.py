"""What a render shows otherwise than the viewport, whose surfaces are felt: which settings differ, and how far apart.

Only surfaces whose settings differ are compared; the others cost nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import bpy

from .. import scene_time
from .._core import Finding, core
from . import participants, render_surfaces, simulated_motion
from .participants import Participants

LARGEST = 200_000
"""Triangles up to which a surface is compared with another: measuring them takes seconds."""
_ALWAYS = 2**31 - 1  # a level that Simplify leaves as it is
_OFF_IN = {True: "is off in renders", False: "is on in renders only"}


def findings(
    swept: Participants,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    depsgraph: bpy.types.Depsgraph,
    simulated: frozenset[int],
) -> list[Any]:
    """Return what a render shows otherwise of all that can be touched, at the current frame.

    Args:
        simulated: session uids of what hangs on simulations: those are not run again for this.
    """
    differing = {o: said for o in scene.objects if (said := settings(o, scene))}
    uids = {e.uid for e in swept.bodies} | {u for e in swept.bodies if e.instance is not None for u in e.instance[:2]}
    screens = participants.look_up({e.uid for e in swept.screens}).values()
    reliefs = {o.dermis.screen.mesh_object for o in screens if o.dermis.screen.mesh_object is not None}
    felt = sorted({*participants.look_up(uids).values(), *reliefs}, key=lambda o: str(o.name_full))
    why = _with_sources(felt, differing)
    out = [_hidden(o) for o in felt if hidden_in_renders(o, view_layer)]
    shown = [o for o in why if not hidden_in_renders(o, view_layer)]
    known = [o for o in shown if o.session_uid not in simulated and _triangles(o, scene, depsgraph) <= LARGEST]
    apart = dict(zip(known, render_surfaces.distances(known, scene, view_layer), strict=True))
    for obj in shown:
        distance = apart.get(obj)
        if distance is None or distance > core.surface.curved.TOLERANCE:
            out.append(_other(obj, why[obj], distance, scene_time.shown(scene)))
    out += [_other(o, [f"displacement of {n}" for n in names], None, None) for o in felt if (names := displacing(o))]
    return out


def settings(obj: bpy.types.Object, scene: bpy.types.Scene) -> list[str]:
    """Return in words what makes an object's surface another in a render."""
    out: list[str] = []
    most = _simplified(scene)
    for modifier in obj.modifiers:
        if modifier.show_viewport != modifier.show_render:
            out.append(f"{modifier.name} {_OFF_IN[modifier.show_viewport]}")
        elif modifier.show_viewport:
            pair = _levels(modifier, most)
            if pair is not None and pair[0] != pair[1]:
                out.append(f"{modifier.name}: {pair[0]}, in renders {pair[1]}")
            elif modifier.type == "NODES" and _asks_for_viewport(modifier.node_group, set()):
                out.append(f"{modifier.name} asks whether it is in the viewport")
    data = obj.data
    if isinstance(data, bpy.types.Curve):
        for name in ("resolution_u", "resolution_v"):
            shown, rendered = getattr(data, name), getattr(data, f"render_{name}")
            if rendered not in (0, shown):
                out.append(f"{name}: {shown}, in renders {rendered}")
    elif isinstance(data, bpy.types.MetaBall) and data.resolution != data.render_resolution:
        out.append(f"resolution: {data.resolution:g}, in renders {data.render_resolution:g}")
    if obj.is_instancer and obj.show_instancer_for_viewport != obj.show_instancer_for_render:
        out.append(f"the instancer {_OFF_IN[obj.show_instancer_for_viewport]}")
    return out


def displacing(obj: bpy.types.Object) -> list[str]:
    """Return the names of the materials that move an object's surface in a render."""
    found = []
    for slot in obj.material_slots:
        material = slot.material
        if material is None or material.displacement_method == "BUMP" or material.node_tree is None:
            continue
        output = material.node_tree.get_output_node("ALL")
        if output is not None and output.inputs["Displacement"].is_linked:
            found.append(material.name)
    return found


def hidden_in_renders(obj: bpy.types.Object, view_layer: bpy.types.ViewLayer) -> bool:
    """Return whether renders do not show an object: itself, or every collection that it is in."""
    return bool(obj.hide_render) or not any(_rendering(view_layer.layer_collection, obj.name))


def _rendering(layer: bpy.types.LayerCollection, name: str) -> Iterator[bool]:
    if layer.exclude or layer.collection.hide_render:
        return
    if name in layer.collection.objects:
        yield True
    for child in layer.children:
        yield from _rendering(child, name)


def _simplified(scene: bpy.types.Scene) -> tuple[int, int]:
    """Return the most that Simplify lets surfaces be subdivided in the viewport and in renders."""
    render = scene.render
    if not render.use_simplify:
        return _ALWAYS, _ALWAYS
    return render.simplify_subdivision, render.simplify_subdivision_render


def _levels(modifier: Any, most: tuple[int, int]) -> tuple[float, float] | None:
    """Return a modifier's fineness in the viewport and in renders; None where it has only one."""
    if modifier.type == "SUBSURF":
        return min(modifier.levels, most[0]), min(modifier.render_levels, most[1])
    if modifier.type == "MULTIRES":
        return min(modifier.levels, most[0]), min(modifier.render_levels, most[1])
    if modifier.type == "SCREW":
        return modifier.steps, modifier.render_steps
    if modifier.type == "OCEAN":
        return modifier.viewport_resolution, modifier.resolution
    return None


def _asks_for_viewport(tree: Any, seen: set[str]) -> bool:
    if tree is None or tree.name_full in seen:
        return False
    seen.add(tree.name_full)
    return any(
        node.bl_idname == "GeometryNodeIsViewport" or _asks_for_viewport(getattr(node, "node_tree", None), seen)
        for node in tree.nodes
    )


def _with_sources(felt: Iterable[bpy.types.Object], differing: dict[Any, list[str]]) -> dict[Any, list[str]]:
    """Return the felt objects that are another in a render, or that are made of one that is, with what differs."""
    out = {o: differing[o] for o in felt if o in differing}
    if differing:
        for source, said in differing.items():
            users = simulated_motion.dependants({source})
            for obj in felt:
                if obj in users and obj not in out and obj.modifiers:
                    out[obj] = [f"{source.name_full}: {s}" for s in said]
    return out


def _triangles(obj: bpy.types.Object, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> float:
    """Return about how many triangles an object has in a render."""
    evaluated = obj.evaluated_get(depsgraph)
    if not isinstance(evaluated.data, bpy.types.Mesh):
        return 0.0
    finer = 0.0
    for modifier in obj.modifiers:
        pair = _levels(modifier, _simplified(scene)) if modifier.type in ("SUBSURF", "MULTIRES") else None
        if pair is not None:
            finer += pair[1] * modifier.show_render - pair[0] * modifier.show_viewport
    return 2.0 * len(evaluated.data.polygons) * 4.0**finer


def _hidden(obj: bpy.types.Object) -> Any:
    return Finding(
        "info",
        "render-differs",
        "renders do not show it, but it is felt",
        where=f"object '{obj.name_full}'",
        remedy="Show it in renders, or ignore this where it stands for something else",
    )


def _other(obj: bpy.types.Object, said: list[str], distance: float | None, frame: float | None) -> Any:
    far = "how far apart they are is not known" if distance is None else f"up to {1e3 * distance:.3g} mm apart"
    return Finding(
        "warning",
        "render-differs",
        f"renders show another surface than the viewport, whose surface is felt: {far}",
        where=f"object '{obj.name_full}'",
        value="; ".join(said),
        remedy="Give the viewport and renders the same settings, or ignore this where the viewport's surface is meant",
        frame=frame,
    )
