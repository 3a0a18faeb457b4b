"""Write baked commands as F-curves, to be viewed beside the animation.

The curves are keys of custom properties that nothing reads. They are on the finger's mesh; if that is linked, shared or
has an action, they are on the finger itself, provided that it is not linked and has no action. In both places they have
an action of their own, so that no existing animation is changed, and the Graph Editor shows them with the finger.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes, compat, identity, marks, scene_time
from .._core import DermisError, core

MARK = marks.COMMANDS
DISPLAYED = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / math.pi)}  # shown unit and factor; other units are not converted
LIMIT_COLOUR = (0.85, 0.33, 0.27)
LONGEST = 60  # [letters] longest name of a property; Blender allows 63


class Written(NamedTuple):
    """Numbers of written curves and values, and findings.

    Attributes:
        curves: number of curves, those of limits among them.
        keys: number of values of commands, as keys or samples.
        findings: the reasons why fingers have no curves.
    """

    curves: int
    keys: int
    findings: tuple[Any, ...]


def write(scene: bpy.types.Scene, result: Any, *, rate: float = 0.0) -> Written:
    """Write the commands of a stored `Result` as locked curves.

    They replace existing ones. Values between the bake's samples are interpolated.

    Args:
        result: the stored result of the scene's last bake.
        rate: rate of the keys, which may lie between frames [Hz]. 0 gives a value at each whole frame; these are
            samples, not keys, if Blender evaluates whole frames there.

    Raises:
        DermisError: no finger of the bake can hold curves; the error is that of the first.
    """
    curves = keys = 0
    findings: list[Any] = []
    with changes.muted():
        remove(scene)
        fingers = dict.fromkeys(output.finger for output in result.bake.outputs)
        for finger in fingers:
            outputs = [o for o in result.bake.outputs if o.finger == finger]
            try:
                more = _write(scene, _holder(scene, finger), finger, outputs, result, rate)
            except DermisError as error:
                findings.append(error.as_finding(severity="warning"))
            else:
                curves, keys = curves + more[0], keys + more[1]
        _settle(scene)
    if findings and not curves:
        raise DermisError(findings[0].what, where=findings[0].where, remedy=findings[0].remedy)
    return Written(curves, keys, tuple(findings))


def remove(scene: bpy.types.Scene) -> int:
    """Remove all curves of a scene's fingers, with properties and actions.

    Returns the number of holders of curves; copies of a finger may share one.
    """
    found = _holders(scene)
    with changes.muted():
        for holder in found:
            for name in str(holder[MARK]).split("\n"):
                holder.pop(name, None)
            del holder[MARK]
            animation = holder.animation_data
            action = animation.action if animation is not None else None
            if action is not None and action.get(MARK):
                animation.action = None
                bpy.data.actions.remove(action)
                if not animation.drivers and not animation.nla_tracks:
                    holder.animation_data_clear()
        if found:
            _settle(scene)
    return len(found)


def present(scene: bpy.types.Scene) -> bool:
    """Return whether any finger has curves."""
    # Panels call this often. Most files have few actions, none of which has the mark.
    return any(MARK in action for action in bpy.data.actions) and bool(_holders(scene))


def _holders(scene: bpy.types.Scene) -> list[Any]:
    fingers = (obj for obj in scene.objects if obj.dermis.role == "FINGER")
    places = (place for obj in fingers for place in (obj, obj.data) if place is not None and MARK in place)
    return list({place.session_uid: place for place in places}.values())  # copies may share a mesh


def _holder(scene: bpy.types.Scene, finger: str) -> Any:
    """Return the holder of a finger's curves.

    Raises:
        DermisError: the finger is gone, or everything of it is linked, shared or animated already.
    """
    obj = identity.named(scene, finger)
    where = f"finger '{finger}'"
    if obj is None:
        raise DermisError("the finger is not in the scene", where=where, remedy="Bake again")
    if obj.data is not None and obj.data.users == 1 and _free(obj.data):
        return obj.data
    if _free(obj):
        return obj
    raise DermisError(
        "it cannot hold the curves: it is animated or linked, and shares its mesh",
        where=where,
        remedy="Make its mesh single-user (Object > Relations > Make Single User)",
    )


def _free(place: Any) -> bool:
    animation = place.animation_data
    return place.is_editable and (animation is None or animation.action is None)


def _write(
    scene: bpy.types.Scene, holder: Any, finger: str, outputs: list[Any], result: Any, rate: float
) -> tuple[int, int]:
    """Write the curves of one finger; return the numbers of curves and keys."""
    action = bpy.data.actions.new(f"{finger} Commands")
    action[MARK] = True
    slot = action.slots.new(id_type=holder.id_type, name=holder.name)
    bag = compat.slot_bag(action, slot)
    names: list[str] = []
    keys = 0
    devices = core.track.file_names.numbered([output.device for output in outputs])
    for device, output in zip(devices, outputs, strict=True):
        track, spec = output.track, output.track.spec
        frames = _frames(track, result, rate)
        at = scene_time.evaluated(scene, frames)
        sampled = not rate and bool((at == np.round(at)).all())  # Blender's samples lie at whole evaluated frames
        times = result.clock.seconds(frames)
        said = f"{spec.name}, {rate:g} Hz of {spec.rate:g}" if rate else f"{spec.name}, at frames, of {spec.rate:g} Hz"
        group = bag.groups.new(f"{said} ({device})" if device != output.device else said)
        limits: dict[str, float] = {}

        def curve_of(name: str, at: Any, values: Any, group: Any = group, sampled: bool = sampled) -> Any:
            holder[name] = float(values[0])
            curve = bag.fcurves.new(f'["{bpy.utils.escape_identifier(name)}"]', index=0)
            curve.group = group
            compat.fill(curve, at, values)
            if sampled:  # samples cannot be edited, and the timeline does not jump to them as it does to keys
                curve.convert_to_samples(int(at[0]), int(at[-1]) + 1)
            names.append(name)
            return curve

        for channel, values in zip(spec.channels, track.values.T, strict=True):
            unit, factor = DISPLAYED.get(channel.unit, (channel.unit, 1.0))
            shown = f" ({unit})" if unit != "1" else ""
            curve = curve_of(
                f"{device[:24]} {channel.name}{shown}"[:LONGEST], at, factor * np.interp(times, track.times, values)
            )
            curve.lock, keys = True, keys + len(frames)
            for limit in (channel.low, channel.high):
                if limit is not None:
                    limits[f"{device[:24]} limit {factor * limit:.4g}{shown}"[:LONGEST]] = factor * limit
        for name, limit in limits.items():
            curve = curve_of(name, at[[0, -1]], [limit, limit])
            curve.color_mode, curve.color, curve.lock = "CUSTOM", LIMIT_COLOUR, True
    holder[MARK] = "\n".join(names)
    animation = holder.animation_data or holder.animation_data_create()
    animation.action = action  # after all curves are made; a property whose curve came later would stay at rest
    animation.action_slot = slot
    return len(names), keys


def _frames(track: Any, result: Any, rate: float) -> Any:
    """Return the scene frames of the values."""
    clock = result.clock
    step = clock.count(1.0 / rate) if rate else 1.0
    lasting = clock.count(float(track.times[-1])) if len(track.times) else 0.0
    return clock.first + step * np.arange(int(lasting / step + 1e-3) + 1)


def _settle(scene: bpy.types.Scene) -> None:
    """Let Blender evaluate changes now, so that they do not count as edits."""
    for layer in scene.view_layers:
        layer.update()
