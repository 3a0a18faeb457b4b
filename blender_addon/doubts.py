"""Probable mistakes in a scene: sizes, units and places that few people mean.

A click corrects each of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import bpy
from mathutils import Matrix

from . import changes, compat, fingertip_mesh
from ._core import DermisError, core
from .devices import active_presets
from .placing import presses, surfaces
from .properties import skin_properties
from .quantities import length_text, metres_per_unit
from .sampling import participants

HUGE = 3.0  # [m] objects that a fingertip touches are usually smaller than this
OUTLIER = 2.0  # a finger is doubted if it is this many times as wide or as narrow as the others of its hand
UNLIKE = 4.0  # a fingertip is doubted if it is this many times as long or as short as its bone
_KEYS = 40  # at most so many keys of a finger are examined
_DEEPEST = 2e-3  # [m] depth to which linear skin is trusted, as in the engine's finding 'too-deep'
_PRESS = 1e-3  # [m] depth of the press that is left when a finger is raised because its bone was inside an object
# _NEAR [m]: a finger passes an object at less than this distance. _AWAY: a finger is doubted if all objects that it
# passes lie on a side below this, where 1 is straight before the pad and -1 straight before the nail.
_NEAR, _AWAY = 3e-3, -0.5
_LENGTHS = core.parameters.skin.LENGTHS

_kept: core.recent.Recent[tuple[int, int, int], tuple[Doubt, ...]] = core.recent.Recent(4)


@dataclass(frozen=True)
class Doubt:
    """A probable mistake: code, object, text, and the effect of its button.

    The object's name is '' if the mistake is in the scene's settings.
    """

    code: str
    name: str
    text: str
    remedy: str


def of(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> tuple[Doubt, ...]:
    """Return a scene's doubts; the search is done once after each change."""
    key = (scene.session_uid, changes.edits(), len(scene.objects))
    return _kept.make(key, lambda: look(scene, view_layer))


def look(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> tuple[Doubt, ...]:
    """Search for doubts at the current frame, as it was evaluated last."""
    fingers = [obj for obj in scene.objects if obj.dermis.role == "FINGER" and obj.is_editable]
    if not fingers:
        return ()
    unit, solids = metres_per_unit(scene), bodies(scene, view_layer)
    found = [*_units(unit, solids)]
    for finger in fingers:
        found += [*_finger(finger, unit), *_unlike(finger, fingers)]
        if view_layer.depsgraph is not None:
            found += _off_skin(finger, view_layer, view_layer.depsgraph, unit)
            found += _swallowed(finger, solids, view_layer.depsgraph, unit)
            found += _pressed(finger, solids, view_layer.depsgraph, unit)
    return tuple(found)


def bodies(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, *, screens: bool = False) -> list[bpy.types.Object]:
    """Return the touchable meshes that Blender evaluates.

    Args:
        screens: return touch screens, too.
    """
    roles = ("TOUCHABLE", "SCREEN") if screens else ("TOUCHABLE",)
    return [
        obj
        for obj in scene.objects
        if obj.dermis.role in roles and obj.type == "MESH" and not participants.is_disabled(obj, view_layer)
    ]


def mend(context: bpy.types.Context, code: str, name: str) -> None:
    """Correct the mistake of a doubt.

    Raises:
        DermisError: the finger is gone, or the mistake cannot be corrected here.
    """
    scene, obj = context.scene, context.scene.objects.get(name)
    if code == "units":
        scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1e-3
        for finger in scene.objects:
            if finger.dermis.role == "FINGER":
                fingertip_mesh.fit(finger, skin_properties.lengths(finger.dermis.finger.skin), metres_per_unit(scene))
    elif obj is None or obj.dermis.role != "FINGER" or not obj.is_editable:
        raise DermisError("there is no such finger in this file", value=name)
    elif code == "finger-scale":
        place, turn, _ = obj.matrix_world.decompose()
        obj.matrix_world = Matrix.LocRotScale(place, turn, None)
    elif code == "finger-size":
        skin = obj.dermis.finger.skin
        lengths = _bone_lengths(obj)
        if not lengths:
            raise DermisError("its bone has no length", where=f"finger '{name}'")
        scale = lengths[0] * metres_per_unit(scene) / skin_properties.lengths(skin)["length"]
        values = skin_properties.shape_and_material(skin)
        skin_properties.apply_preset(skin, {n: v * (scale if n in _LENGTHS else 1.0) for n, v in values.items()})
    elif code == "finger-unlike":
        skin = obj.dermis.finger.skin
        scale = _others_width(obj, list(scene.objects)) / skin_properties.lengths(skin)["width"]
        values = skin_properties.shape_and_material(skin)
        skin_properties.apply_preset(skin, {n: v * (scale if n in _LENGTHS else 1.0) for n, v in values.items()})
    elif code == "pad-off-skin":
        spot = _skin_near(obj, context.view_layer, context.evaluated_depsgraph_get())
        if spot is None:
            raise DermisError("its hand has no skin", where=f"finger '{name}'")
        if spot.normal.dot(obj.matrix_world.to_3x3().col[2]) > 0.0:
            raise DermisError(
                "the nearest skin faces the nail's side",
                where=f"finger '{name}'",
                remedy="Move the finger onto its pad by hand, or attach fingers to the hand again",
            )
        obj.matrix_world = Matrix.Translation(spot.point - obj.matrix_world.translation) @ obj.matrix_world
        if "location" in compat.animated_paths(obj):
            obj.keyframe_insert("location")
    elif code == "inside":
        into_open(context, obj)
    elif code == "away":
        thick = skin_properties.lengths(obj.dermis.finger.skin)["thickness"] / metres_per_unit(scene)
        presses.repose(obj, lambda pose: presses.turned(pose, thick))
    elif code == "deep":
        obj.dermis.finger.skin.depth_mode = "compliant"
    elif code == "thin":
        out_of_bone(context, obj)
    changes.mark_dirty(name)


def into_open(context: bpy.types.Context, finger: bpy.types.Object) -> None:
    """Put a finger that is inside a solid on that solid's surface.

    Raises:
        DermisError: it is not inside a solid.
    """
    depsgraph = context.evaluated_depsgraph_get()
    place = finger.matrix_world.translation
    spot = surfaces.way_out(bodies(context.scene, context.view_layer), place, depsgraph)
    if spot is None:
        raise DermisError("it is not inside any object", where=f"finger '{finger.name}'")
    surfaces.lie(finger, spot, 0.0)


def out_of_bone(context: bpy.types.Context, finger: bpy.types.Object) -> None:
    """Raise a finger in every pose in which an object goes through its bone.

    It then presses that object by 1 mm.
    """
    unit, depsgraph = metres_per_unit(context.scene), context.evaluated_depsgraph_get()
    thick, bone = (length / unit for length in _to_nail_and_bone(finger))
    solids = bodies(context.scene, context.view_layer)

    def raised(pose: Matrix) -> Matrix:
        deep = max((presses.depth(body, pose, thick, depsgraph) for body in solids), default=0.0)
        up = pose.to_3x3().col[2].normalized()
        return Matrix.Translation((deep - _PRESS / unit) * up) @ pose if deep > bone else pose

    presses.repose(finger, raised)


def _units(unit: float, solids: list[bpy.types.Object]) -> Iterator[Doubt]:
    sizes = sorted(max(obj.dimensions) for obj in solids)
    middle = sizes[len(sizes) // 2] if sizes else 0.0
    if unit == 1.0 and middle > HUGE:
        text = f"Touchable objects are {middle:.3g} m large: is the scene in millimetres?"
        yield Doubt("units", "", text, "One Unit Is a Millimetre")


def _finger(finger: bpy.types.Object, unit: float) -> Iterator[Doubt]:
    scale = [abs(s) for s in finger.matrix_world.to_scale()]
    if any(abs(s - 1.0) > participants.UNSCALED for s in scale):
        text = f"{finger.name} is drawn {participants.farthest_scale(scale):.3g} times as large as its skin is"
        yield Doubt("finger-scale", finger.name, text, "Clear Its Scale")
    own = skin_properties.lengths(finger.dermis.finger.skin)["length"]
    bones = [length * unit for length in _bone_lengths(finger)]
    if bones and all(not 1.0 / UNLIKE < own / bone < UNLIKE for bone in bones):
        text = f"{finger.name} is {length_text(own)} long, its bone {length_text(bones[0])}"
        yield Doubt("finger-size", finger.name, text, "Make It as Long as Its Bone")


def _unlike(finger: bpy.types.Object, fingers: Sequence[bpy.types.Object]) -> Iterator[Doubt]:
    """Doubt a finger that is much wider or narrower than the others of its hand."""
    others = _others_width(finger, fingers)
    width = skin_properties.lengths(finger.dermis.finger.skin)["width"]
    if others and not 1.0 / OUTLIER < width / others < OUTLIER:
        text = f"{finger.name} is {length_text(width)} wide, the other fingers of its hand {length_text(others)}"
        yield Doubt("finger-unlike", finger.name, text, "Make It as Wide as the Others")


def _off_skin(
    finger: bpy.types.Object, view_layer: bpy.types.ViewLayer, depsgraph: bpy.types.Depsgraph, unit: float
) -> Iterator[Doubt]:
    """Doubt a finger of a hand whose pad does not lie on the hand's skin."""
    spot = _skin_near(finger, view_layer, depsgraph)
    if spot is None:
        return
    miss = unit * (spot.point - finger.matrix_world.translation).length
    if miss > fingertip_mesh.OFF * skin_properties.lengths(finger.dermis.finger.skin)["width"]:
        text = f"The pad of {finger.name} is {length_text(miss)} off the skin of its hand"
        yield Doubt("pad-off-skin", finger.name, text, "Put It on the Skin")


def _skin_near(
    finger: bpy.types.Object, view_layer: bpy.types.ViewLayer, depsgraph: bpy.types.Depsgraph
) -> surfaces.Spot | None:
    """Return the spot of a hand's skin that is nearest to a finger's pad.

    The skin is that of visible meshes that follow the finger's bone; None if there is none.
    """
    hand, bone = finger.parent, finger.parent_bone
    if hand is None or hand.type != "ARMATURE" or finger.parent_type != "BONE" or bone not in hand.data.bones:
        return None
    if not hand.data.bones[bone].use_deform:
        return None
    spots = [
        surfaces.nearest(obj, finger.matrix_world.translation, depsgraph)
        for obj in view_layer.objects
        if obj.type == "MESH" and bone in obj.vertex_groups and obj.visible_get(view_layer=view_layer)
        if any(m.type == "ARMATURE" and m.object == hand and m.show_viewport for m in obj.modifiers)
    ]
    place = finger.matrix_world.translation
    return min(filter(None, spots), key=lambda spot: (spot.point - place).length, default=None)


def _others_width(finger: bpy.types.Object, objects: Sequence[bpy.types.Object]) -> float:
    """Return the median width of the other fingers on the same armature [m].

    0 if there are fewer than two.
    """
    if finger.parent is None or finger.parent_type != "BONE":
        return 0.0
    widths = sorted(
        skin_properties.lengths(obj.dermis.finger.skin)["width"]
        for obj in objects
        if obj != finger and obj.dermis.role == "FINGER" and obj.parent == finger.parent
    )
    return widths[len(widths) // 2] if len(widths) > 1 else 0.0


def _bone_lengths(finger: bpy.types.Object) -> list[float]:
    """Return the lengths of the bone before a finger's own and of its own.

    They are in scene units. The list is empty if there is no such pair of bones, and for a skin from a mesh file. An
    importer invents the end of a last bone, so that the own bone's length alone proves nothing.
    """
    if finger.parent_type != "BONE" or finger.parent is None or finger.dermis.finger.skin.mesh_file:
        return []
    bone = finger.parent.data.bones.get(finger.parent_bone)
    if bone is None or bone.parent is None:
        return []
    scale = max(abs(s) for s in finger.parent.matrix_world.to_scale())
    lengths = ((bone.head_local - bone.parent.head_local).length * scale, bone.length * scale)
    return [length for length in lengths if length > 0.0]


def _swallowed(
    finger: bpy.types.Object, solids: list[bpy.types.Object], depsgraph: bpy.types.Depsgraph, unit: float
) -> Iterator[Doubt]:
    if finger.parent_type == "BONE":
        return  # the pose of its hand moves it, so it cannot be put elsewhere itself
    place = finger.matrix_world.translation
    deep = 0.5 * skin_properties.lengths(finger.dermis.finger.skin)["thickness"]
    for body in solids:
        spot = surfaces.nearest(body, place, depsgraph) if surfaces.inside(body, place, depsgraph) else None
        if spot is not None and (spot.point - place).length * unit > deep:
            text = f"The pad of {finger.name} is inside {body.name}"
            yield Doubt("inside", finger.name, text, "Put It on the Surface")


def _pressed(
    finger: bpy.types.Object, solids: list[bpy.types.Object], depsgraph: bpy.types.Depsgraph, unit: float
) -> Iterator[Doubt]:
    """Doubt the depth and the side of a finger's presses.

    All objects are examined at the current frame. At the finger's keys, only objects that do not move are examined.
    """
    thick, bone = (length / unit for length in _to_nail_and_bone(finger))
    reach = _NEAR / unit
    balls = [(body, *presses.ball(body)) for body in solids]
    still = [ball for ball in balls if not presses.moves(ball[0])]
    deepest, sides, through = 0.0, [], ""
    poses = [(finger.matrix_world.copy(), balls), *((p, still) for p in presses.keyed(finger, _KEYS).values())]
    for pose, near in poses:
        for body, middle, radius in near:
            if (pose.translation - middle).length > radius + thick + reach:
                continue
            deep = presses.depth(body, pose, thick, depsgraph)
            inside = deep > 0.0 and surfaces.inside(body, pose.translation, depsgraph)
            if deep > bone and not inside:
                through = body.name
            elif deep <= 0.5 * thick:  # deeper is inside, not pressed
                deepest = max(deepest, deep)
            side = 1.0 if deep > 0.0 else presses.side(body, pose, thick, reach, depsgraph)
            sides += [side] if side is not None else []
    if sides and max(sides) < _AWAY:
        text = f"{finger.name} passes objects with its nail, not with its pad"
        yield Doubt("away", finger.name, text, "Turn the Pad to Them")
    if through:
        text = f"{through} is thinner than {finger.name} presses: it goes through the bone, and is not felt there"
        yield Doubt("thin", finger.name, text, "Raise It to a Press of 1 mm")
    elif (
        deepest * unit > 1.02 * (trusted := _trusted(finger))
        and _solves_skin(finger)
        and finger.dermis.finger.skin.depth_mode == "animated"
    ):
        text = (
            f"{finger.name} is pressed {1e3 * deepest * unit:.1f} mm deep; its skin is trusted to {1e3 * trusted:g} mm"
        )
        yield Doubt("deep", finger.name, text, "Let the Bone Give Way")


def _to_nail_and_bone(finger: bpy.types.Object) -> tuple[float, float]:
    """Return the distances of nail and bone from the pad [m]."""
    lengths = skin_properties.lengths(finger.dermis.finger.skin)
    return lengths["thickness"], lengths["thickness"] - lengths["bone_bed"] - lengths["bone_thickness"]


def _trusted(finger: bpy.types.Object) -> float:
    """Return the depth to which a finger's tissue is trusted [m]."""
    tissue = skin_properties.tissue(finger.dermis.finger.skin)
    return _DEEPEST if tissue == "linear" else float(core.contact.trusted.trusted(tissue).depth)


def _solves_skin(finger: bpy.types.Object) -> bool:
    own = finger.dermis.finger
    return own.skin.shown or any(d.enabled and active_presets.follows_skin(d.preset) for d in own.devices)
