"""List the participants of a sweep: fingers, things to touch and screens.

They are known by session uid, never by pointer. They are listed at one frame for the whole sweep, in the order of the
engine's header and chunks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import bpy

from .. import compat, identity
from .._core import Finding, core
from ..properties import object_properties

UNSCALED = 0.01  # [-] largest distance of a finger's scale from 1 that is not reported
_NAMED = 4  # number of objects that one finding names at most


class InstanceKey(NamedTuple):
    """The identity of an instance from frame to frame."""

    instancer: int
    object: int
    ids: tuple[int, ...]


@dataclass(frozen=True)
class Entry:
    """One finger, body or screen.

    Attributes:
        uid: session uid of the object; of an instance, that of the object whose material it has.
        instance: set for instances that are bodies of their own.
        shows_instances: it may show instances as its own surface, or hide its surface.
        mirrored: its matrix reflects; the reflection is moved from the matrix to the mesh.
        deforming: its surface depends on time.
        simulated: it depends on a simulation and is swept at whole frames.
        blinking: it may appear or vanish within the range.
        stretch: the largest factor by which its pose stretches it in the range.
        drawn: it is a finger with a mesh, whose size is visible.
        curved: [m] largest distance of its surface from the curved one that its shading shows; None for flat faces.
    """

    name: str
    uid: int
    instance: InstanceKey | None = None
    shows_instances: bool = False
    mirrored: bool = False
    deforming: bool = False
    simulated: bool = False
    blinking: bool = False
    stretch: float = 1.0
    drawn: bool = False
    curved: float | None = None
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)  # of a screen's middle from its origin [scene units, in its space]
    animated: tuple[tuple[str, str, float], ...] = ()  # (name, path below `dermis`, factor to SI)

    @property
    def shown_as(self) -> Any:
        """The key of its instances in `instances.Shown`; None without instances."""
        return self.instance or (self.uid if self.shows_instances else None)


@dataclass
class Participants:
    """Everything that is swept."""

    scene: str
    view_layer: str
    unit: float
    fingers: tuple[Entry, ...] = ()
    bodies: tuple[Entry, ...] = ()
    screens: tuple[Entry, ...] = ()
    findings: list[Any] = field(default_factory=list)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Fingers, bodies and screens, in this order."""
        return self.fingers + self.bodies + self.screens


def role_of(obj: bpy.types.Object) -> str:
    """Return 'NONE', 'FINGER', 'TOUCHABLE' or 'SCREEN'."""
    return str(obj.dermis.role)


def is_disabled(obj: bpy.types.Object, view_layer: bpy.types.ViewLayer) -> bool:
    """Return whether Blender leaves an object out of evaluation.

    An object that is hidden with the eye is still evaluated.
    """
    if not identity.is_in_layer(obj, view_layer):
        return True
    shown = obj.visible_get(view_layer=view_layer) or obj.hide_get(view_layer=view_layer)
    return bool(obj.hide_viewport or not shown)


def taking_part(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, findings: list[Any], *, scripted: bool = False
) -> list[bpy.types.Object]:
    """Return the scene's objects with a role, in order of name.

    Disabled objects are left out and reported, unless they may be enabled later.

    Args:
        scripted: whether scripts run when the frame changes; they may enable touchable objects later.
    """
    found = []
    for obj in sorted(scene.objects, key=lambda o: o.name_full):
        if role_of(obj) == "NONE":
            continue
        later = comes_and_goes(obj) or (scripted and role_of(obj) == "TOUCHABLE")
        if is_disabled(obj, view_layer) and not later:
            findings.append(
                Finding(
                    "warning",
                    "disabled",
                    "it is disabled or excluded in the view layer, so it is left out",
                    where=f"object '{obj.name_full}'",
                    remedy="Enable it in the Outliner, or set its role to Nothing",
                )
            )
            continue
        found.append(obj)
    return found


def instancers(scene: bpy.types.Scene) -> frozenset[int]:
    """Return session uids of the objects of a scene that can make instances."""
    return frozenset(
        o.session_uid
        for o in scene.objects
        if o.is_instancer or len(o.particle_systems) or any(m.type == "NODES" for m in o.modifiers)
    )


def in_instances(depsgraph: bpy.types.Depsgraph, role: str) -> list[str]:
    """Return the names of objects with a role that are shown as instances.

    The fingers of a linked hand are an example.
    """
    return sorted(
        {
            i.object.original.name_full
            for i in depsgraph.object_instances
            if i.is_instance and role_of(i.object.original) == role
        }
    )


def in_background_sets(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the objects with a role in a scene's background sets.

    These are its background set, the background set of that, and so on.
    """
    known, found, shown = {scene.session_uid}, {}, scene.background_set
    own = {o.session_uid for o in scene.objects}
    while shown is not None and shown.session_uid not in known:
        known.add(shown.session_uid)
        for obj in shown.objects:
            if role_of(obj) != "NONE" and obj.session_uid not in own and (not obj.hide_viewport or comes_and_goes(obj)):
                found[obj.session_uid] = obj
        shown = shown.background_set
    return sorted(found.values(), key=lambda o: o.name_full)


def instance_name(shown: bpy.types.Object, maker: bpy.types.Object, key: InstanceKey) -> str:
    """Return the name of an instance, such as 'Cube @ Scatter 0.3'.

    It has the names of the shown object and of its maker, and the persistent id.
    """
    return f"{shown.name_full} @ {maker.name_full} {'.'.join(map(str, key.ids))}"


def hidden_instances(obj: bpy.types.Object, view_layer: bpy.types.ViewLayer) -> list[Any]:
    """Report an object that is hidden with the eye and has instances.

    Blender does not show these instances, so they are not felt; the object's mesh is. A disabled object is not
    evaluated, so its instances are unknown.
    """
    if is_disabled(obj, view_layer) or not obj.hide_get(view_layer=view_layer):
        return []
    makes = obj.is_instancer or len(obj.particle_systems) > 0
    if not makes and any(m.type == "NODES" and m.show_viewport for m in obj.modifiers):
        geometry = obj.evaluated_get(view_layer.depsgraph).evaluated_geometry()
        makes = geometry.instances_pointcloud() is not None
    if not makes:
        return []
    return [
        Finding(
            "warning",
            "instances-hidden",
            "it is hidden, so Blender shows no instances of it: they are not touchable",
            where=f"object '{obj.name_full}'",
            remedy="Show it with the eye in the Outliner, or realize its instances",
        )
    ]


def hidden_with_eye(felt: Iterable[bpy.types.Object], view_layer: bpy.types.ViewLayer) -> list[Any]:
    """Report in one finding the felt objects that are hidden with the eye."""
    hidden = sorted(
        obj.name_full for obj in felt if obj.hide_get(view_layer=view_layer) and not is_disabled(obj, view_layer)
    )
    if not hidden:
        return []
    names = ", ".join(f"'{name}'" for name in hidden[:_NAMED])
    more = f" and {len(hidden) - _NAMED} more" if len(hidden) > _NAMED else ""
    return [
        Finding(
            "info",
            "hidden-and-felt",
            "hidden with the eye in the Outliner, but touchable",
            where=f"object{'s' if len(hidden) > 1 else ''} {names}{more}",
            remedy="Show it again, or turn on Disable in Viewports to leave it out",
        )
    ]


def comes_and_goes(obj: bpy.types.Object) -> bool:
    """Return whether an object's visibility in the viewport is animated."""
    return "hide_viewport" in compat.animated_paths(obj)


def group_of(obj: bpy.types.Object) -> Any:
    """Return the property group that holds the parameters of an object's role."""
    return {"FINGER": obj.dermis.finger, "SCREEN": obj.dermis.screen}.get(role_of(obj), obj.dermis.material)


def farthest_scale(scale: Iterable[float]) -> float:
    """Return the scale farthest from 1 by ratio, whether smaller or larger."""
    return max(scale, key=lambda s: max(s, 1.0 / max(s, 1e-30)))


def animated_parameters(obj: bpy.types.Object) -> tuple[tuple[str, str, float], ...]:
    """Return the animated parameters of an object.

    Each has a name, a path below `obj.dermis`, and a factor to SI. A parameter of a device is named
    'device/<index>/<name>', where the index counts the enabled devices.
    """
    paths = {p for p in compat.animated_paths(obj) if p.startswith("dermis.")}
    return tuple(a for a in keyable_parameters(obj) if f"dermis.{a[1]}" in paths) if paths else ()


def keyable_parameters(obj: bpy.types.Object) -> list[tuple[str, str, float]]:
    """Return the parameters of an object that can change within a bake.

    They have the form of `animated_parameters`.
    """
    branch = {"FINGER": "finger", "SCREEN": "screen"}.get(role_of(obj), "material")
    out = [(a.name, f"{branch}.{a.saved}", a.factor) for a in _animatable(group_of(obj))]
    if branch == "finger":
        enabled = [d for d in enumerate(obj.dermis.finger.devices) if d[1].enabled]
        for number, (index, device) in enumerate(enabled):
            out += [
                (f"device/{number}/{a.name}", f"finger.devices[{index}].{a.saved}", a.factor)
                for a in _animatable(device)
            ]
    return out


def idle_curves(obj: bpy.types.Object) -> list[Any]:
    """Report curves and drivers of settings that are constant over a bake.

    Blender does not evaluate them.
    """
    idle = set()
    for path in compat.animated_paths(obj):
        group_path, _, attribute = path.rpartition(".")
        if not path.startswith("dermis.") or "[" in attribute:
            continue
        try:
            prop = obj.path_resolve(group_path).bl_rna.properties.get(attribute)
        except (ValueError, AttributeError):
            continue  # its owner is gone
        if prop is not None and not prop.is_animatable:
            idle.add(prop.name)
    return [
        Finding(
            "warning",
            "keyed-constant",
            "a setting is keyed or driven, but it is constant over a bake",
            where=f"object '{obj.name_full}'",
            value=name,
            remedy="Delete its keys or driver, and set the value",
        )
        for name in sorted(idle)
    ]


def _animatable(group: Any) -> list[core.parameters.parameter.Parameter]:
    return [row for row in object_properties.TABLES[type(group)].values() if row.keyed]


def animated_key(kind: str, index: int, name: str) -> str:
    """Return a chunk's key of an animated parameter.

    Examples are 'body/3/friction' and 'device/0/1/use_weight'.
    """
    if name.startswith("device/"):
        return f"device/{index}/{name.removeprefix('device/')}"
    return f"{kind}/{index}/{name}"


def look_up(uids: set[int]) -> dict[int, bpy.types.Object]:
    """Return the objects with these session uids; deleted ones are missing."""
    return {o.session_uid: o for o in bpy.data.objects if o.session_uid in uids}


def at_place(place: int, uid: int) -> bpy.types.Object:
    """Return the object with a session uid, given its likely list index.

    Blender's list is in order of name, so the index changes when a script renames objects.
    """
    obj = bpy.data.objects[place]
    return obj if obj.session_uid == uid else look_up({uid})[uid]
