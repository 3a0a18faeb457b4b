"""Report the parts of shapes that Edit Mode and Sculpt Mode leave out.

Blender evaluates the shapes without these parts, and they are felt without them.

Measured in Blender 4.5 and 5.2:

* A mesh in Edit Mode is evaluated without the modifiers whose *Edit Mode* display is off, the default of Armature,
  Displace and Boolean, for example. Some types are never shown there. This holds for all objects that have the mesh.
* Shape keys are not mixed there: the active one is shown, unless *Shape Key Edit Mode* is on. The same holds for
  lattices.
* Objects show no particles while they are in Edit Mode.
* An armature in Edit Mode has no pose: its Armature modifiers do nothing, and children of its bones stay.
* Edits are shown, and felt, before Edit Mode is left.
* Sculpt Mode leaves out all modifiers with Dyntopo, and with *Deform Only* those that do more than move vertices.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

from .. import compat
from .._core import Finding
from . import dependence, participants
from .participants import Participants

_NEVER = {"BUILD", "CLOTH", "DECIMATE", "DYNAMIC_PAINT", "EXPLODE", "FLUID", "MULTIRES", "PARTICLE_SYSTEM", "SOFT_BODY"}
_NAMED = 4  # number of parts that one finding names at most
_REFERS = ("object", "object_from", "object_to", "texture_coords_object")
_BONES = ("subtarget", "bone_from", "bone_to", "texture_coords_bone")
"""Properties of modifiers that name an object, and that name a bone of it."""
_SHAPELESS = {"COLLISION", "SURFACE"}
_DEFORM = {
    "ARMATURE",
    "CAST",
    "CLOTH",
    "CORRECTIVE_SMOOTH",
    "CURVE",
    "DISPLACE",
    "HOOK",
    "LAPLACIANDEFORM",
    "LAPLACIANSMOOTH",
    "LATTICE",
    "MESH_CACHE",
    "MESH_DEFORM",
    "SHRINKWRAP",
    "SIMPLE_DEFORM",
    "SMOOTH",
    "SOFT_BODY",
    "SURFACE_DEFORM",
    "WARP",
    "WAVE",
}


def findings(swept: Participants, scene: bpy.types.Scene) -> list[Any]:
    """Return findings on objects that are felt differently because of a mode.

    They are compared with Object Mode.
    """
    makers = {e.instance.instancer for e in swept.bodies if e.instance is not None}
    felt = participants.look_up({e.uid for e in swept.bodies} | makers).values()
    left_out = {o: said for o in bpy.data.objects if (said := list(_left_out(o, scene)))}
    shapes = dependence.Shapes() if left_out else None
    out = []
    for obj in sorted(felt if shapes else (), key=lambda o: str(o.name_full)):
        said = list(left_out.get(obj, ()))
        for source, words in left_out.items():
            if source != obj and shapes is not None and obj.session_uid in shapes.of(source):
                said += [f"{source.name_full}: {word}" for word in words]
        if said:
            what = "Edit Mode or Sculpt Mode does not show a part of its shape, and it is felt without that"
            out.append(_finding(obj, what, said))
    taking_part = {e.uid for e in swept.entries} | makers
    for armature in [o for o in bpy.data.objects if o.type == "ARMATURE" and o.data.is_editmode]:
        moved = dependence.dependants({armature}, leads=_follows_bones) - {armature}
        named = sorted(o.name_full for o in moved if isinstance(o, bpy.types.Object) and o.session_uid in taking_part)
        if named:
            what = "an armature in Edit Mode has no pose, and what hangs on it does not follow its bones"
            out.append(_finding(armature, what, named))
    return out


def _follows_bones(used: Any, user: Any) -> bool:
    """Return whether a user of an ID depends on it.

    On an armature in Edit Mode, only users of its pose depend. An object that is parented to the armature itself, or
    whose constraints name no bone, follows it as in Object Mode.
    """
    if isinstance(user, bpy.types.Collection):
        return False
    if getattr(used, "type", "") != "ARMATURE" or not used.data.is_editmode or not isinstance(user, bpy.types.Object):
        return True
    parented = user.parent == used and user.parent_type in ("BONE", "ARMATURE")
    return parented or any(_names_bones(m, used) for m in user.modifiers if m.show_viewport) or _asks(user, used)


def _names_bones(modifier: Any, armature: bpy.types.Object) -> bool:
    """Return whether a modifier uses the bones of an armature."""
    refers = any(getattr(modifier, name, None) == armature for name in _REFERS)
    return refers and (modifier.type == "ARMATURE" or any(getattr(modifier, name, "") for name in _BONES))


def _asks(user: bpy.types.Object, armature: bpy.types.Object) -> bool:
    """Return whether constraints or drivers of an object use an armature.

    Constraints count if they use its bones, drivers in any case.
    """
    constraints = [*user.constraints, *(c for bone in (user.pose.bones if user.pose else ()) for c in bone.constraints)]
    for constraint in constraints:
        for target in (constraint, *getattr(constraint, "targets", ())):
            if getattr(target, "target", None) == armature and getattr(target, "subtarget", ""):
                return True
        if getattr(constraint, "pole_target", None) == armature and constraint.pole_subtarget:
            return True
    drivers = [] if user.animation_data is None else user.animation_data.drivers
    targets = (t for d in drivers for variable in d.driver.variables for t in variable.targets)
    return any(target.id == armature for target in targets)


def _finding(obj: bpy.types.Object, what: str, said: list[str]) -> Any:
    more = [f"{len(said) - _NAMED} more"] if len(said) > _NAMED else []
    return Finding(
        "warning",
        "mode-leaves-out",
        what,
        where=f"object '{obj.name_full}'",
        value="; ".join([*said[:_NAMED], *more]),
        remedy="Go to Object Mode before a bake",
    )


def _left_out(obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[str]:
    """Yield the names of the parts that are left out of an object's shape."""
    shown = [m for m in obj.modifiers if m.show_viewport and m.type not in _SHAPELESS]
    if getattr(obj.data, "is_editmode", False):
        yield from (m.name for m in shown if not m.show_in_editmode or m.type in _NEVER)
        if _mixes_keys(obj):
            yield "shape keys"
    elif obj.mode == "SCULPT":
        sculpt = scene.tool_settings.sculpt
        if obj.use_dynamic_topology_sculpting:
            yield from (m.name for m in shown)
        elif sculpt is not None and sculpt.use_deform_only:
            yield from (m.name for m in shown if m.type not in _DEFORM)


def _mixes_keys(obj: bpy.types.Object) -> bool:
    """Return whether shape keys may give a shape other than the active key's.

    Edit Mode shows the active one.
    """
    keys = getattr(obj.data, "shape_keys", None)
    if keys is None or (obj.type == "MESH" and obj.use_shape_key_edit_mode):
        return False
    moved = any(block.value for block in keys.key_blocks[1:])
    return moved or obj.active_shape_key_index > 0 or any(p.endswith(".value") for p in compat.animated_paths(keys))
