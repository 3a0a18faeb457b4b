"""Read the header of a `TactileScene`: all that precedes its samples.

The header has names, parameters, surfaces and reliefs. Flaws of the scene are reported as findings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from .._core import Array, DermisError, Finding, core
from ..devices import platform_devices, thimble_devices
from ..properties import object_properties, scene_properties, skin_properties
from ..quantities import metres_per_unit
from . import curved_surfaces, frames, height_maps, participants, script_changes, unfelt
from .instance_survey import Instances, Present
from .instances import InstanceReader
from .meshes import SURFACE_TYPES, MeshReader, zero_area_finding
from .participants import Entry, InstanceKey, Participants
from .simulated_motion import Simulations

_LEFT_OUT, _SO_LEFT_OUT = "It is left out", ", so it is left out"

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
"""[m/s^2] Gravity of a new Blender scene."""


@dataclass(frozen=True)
class Header:
    """The usable participants and, in the same order, their engine headers."""

    participants: Participants
    fingers: tuple[Any, ...]
    bodies: tuple[Any, ...]
    screens: tuple[Any, ...]


def scene_findings(scene: bpy.types.Scene) -> list[Any]:
    """Report peculiarities of a scene's settings.

    Raises:
        DermisError: a newer Dermis saved the file, so settings that this one does not know would be lost silently.
    """
    findings = []
    where = f"scene '{scene.name_full}'"
    version = int(scene.dermis.file_version)
    if version > scene_properties.FILE_VERSION:
        raise DermisError(
            "the file comes from a newer Dermis, whose settings this one cannot read",
            where=where,
            value=version,
            limit=f"up to {scene_properties.FILE_VERSION}",
            remedy="Update Dermis",
        )
    if bpy.app.autoexec_fail:
        findings.append(
            Finding(
                "warning",
                "scripts-blocked",
                "Blender did not run the file's scripts, so their drivers have no effect",
                where=where,
                value=bpy.app.autoexec_fail_message,
                remedy="If you trust the file, allow its scripts (-y)",
            )
        )
    told = frames.range_finding(scene)
    return findings if told is None else [*findings, told]


def gravity(scene: bpy.types.Scene, findings: list[Any]) -> tuple[float, float, float]:
    """Return gravity [m/s^2] in world space.

    Blender keeps gravity in scene units. Its default value is a fraction of the Earth's gravity in a scene of
    millimetres or feet. There, the default is replaced by the Earth's gravity, and a finding is added.
    """
    if not scene.use_gravity:
        return (0.0, 0.0, 0.0)
    unit = metres_per_unit(scene)
    g = tuple(float(f"{c:.7g}") for c in scene.gravity)
    if unit != 1.0 and g == STANDARD_GRAVITY:
        findings.append(
            Finding(
                "info",
                "default-gravity",
                "gravity was left at Blender's default, so weight uses the Earth's",
                where=f"scene '{scene.name_full}'",
                value=f"{g[2] * unit:.6g} m/s^2 in this scene's units",
            )
        )
        return STANDARD_GRAVITY
    return (g[0] * unit, g[1] * unit, g[2] * unit)


def list_participants(
    scene: bpy.types.Scene,
    depsgraph: bpy.types.Depsgraph,
    view_layer: bpy.types.ViewLayer,
    simulations: Simulations,
    deforming: frozenset[int] | None,
    instances: Instances,
    reader: InstanceReader,
    stretches: Mapping[int, float] | None = None,
    *,
    scripted: bool = False,
) -> Participants:
    """List the fingers, bodies and screens of a scene at the current frame.

    Args:
        scripted: whether scripts run when the frame changes; they may enable a touchable object later that is disabled
            now.
        deforming: session uids of objects whose surface depends on time; None if every surface may.
        instances: the instances of the whole range. reader: reads the instances of the current frame.
        stretches: the largest stretch in the range of each object that may grow, by session uid; None if unknown.
    """
    out = Participants(scene.name_full, view_layer.name, metres_per_unit(scene))
    fingers, bodies, screens = [], [], []
    shown = participants.look_up({p.material for p in instances.bodies.values()}).values()
    # The instances of these objects can be touched, even where the object itself is disabled.
    felt = {f"object '{obj.name_full}'" for obj in shown}
    for obj in participants.taking_part(scene, view_layer, out.findings, scripted=scripted):
        matrix = np.array(obj.evaluated_get(depsgraph).matrix_world, np.float64)
        entry = Entry(
            obj.name_full,
            obj.session_uid,
            mirrored=bool(np.linalg.det(matrix[:3, :3]) < 0),
            simulated=obj.session_uid in simulations.uids,
            blinking=participants.comes_and_goes(obj) or participants.is_disabled(obj, view_layer),
            animated=participants.animated_parameters(obj),
        )
        out.findings += participants.idle_curves(obj)
        role = participants.role_of(obj)
        if role == "FINGER":
            fingers.append(_finger_entry(replace(entry, drawn=obj.type == "MESH"), out.findings))
        elif role == "SCREEN":
            screens.append(entry)
        elif obj.name_full in simulations.fluids:
            out.findings.append(
                Finding(
                    "error",
                    "fluid",
                    "the surface of a fluid simulation cannot be followed, so it is left out",
                    where=f"object '{obj.name_full}'",
                    remedy="Touch a mesh that stands for it",
                )
            )
        else:
            uid = obj.session_uid
            own = deforming is None or uid in deforming or instances.objects.get(uid, False)
            stretch = _stretch(obj, matrix, stretches)
            curved, shows = curved_surfaces.tolerance_of(obj, stretch), uid in instances.objects
            bodies.append(replace(entry, deforming=own, shows_instances=shows, stretch=stretch, curved=curved))
            out.findings += participants.hidden_instances(obj, view_layer)
    out.findings[:] = [f for f in out.findings if f.code != "disabled" or f.where not in felt]
    out.findings += unfelt.findings(instances.unfelt.items())
    if instances.bodies or participants.instancers(scene):
        out.findings += _in_instances(depsgraph)
    out.findings += [
        Finding(
            "warning",
            "background-set",
            "it belongs to the background set, whose objects neither touch nor are touched",
            where=f"object '{obj.name_full}'",
            limit=f"the objects of scene '{scene.name_full}'",
            remedy="Link it to this scene",
        )
        for obj in participants.in_background_sets(scene)
    ]
    if instances.bodies:
        bodies += _instance_entries(reader.read(depsgraph).places, simulations, deforming, instances.bodies)
    out.fingers, out.bodies, out.screens = tuple(fingers), tuple(bodies), tuple(screens)
    return out


def header(
    depsgraph: bpy.types.Depsgraph,
    swept: Participants,
    reader: MeshReader,
    instances: InstanceReader,
    *,
    live: bool = False,
) -> Header:
    """Read parameters, surfaces and reliefs at the current frame.

    Bodies and screens that cannot be used are left out, and findings report them.

    Args:
        reader: reads the surfaces of objects. instances: reads the surfaces of instances.
        live: read for the preview: the chunks hold the surfaces, reliefs are cached, and animated parameters have
            their default values.
    """
    findings = swept.findings
    objects = participants.look_up({e.uid for e in swept.entries})
    screens, screen_entries = [], []
    for entry in swept.screens:
        obj = objects[entry.uid]
        try:
            made = height_maps.build(obj, depsgraph, swept.unit, mirrored=entry.mirrored, keep=live)
            centre, _ = height_maps.bounds(obj, depsgraph)
        except DermisError as error:
            findings.append(_left_out(error, "screen-unusable"))
            continue
        screens.append(made)
        screen_entries.append(replace(entry, offset=tuple(centre.tolist())))
    names = {s.name for s in screens}
    if live:
        screens = [
            replace(s, parameters=_defaults(s.parameters, objects[e.uid], e))
            for s, e in zip(screens, screen_entries, strict=True)
        ]
    fingers = [_finger(objects[e.uid], names, findings) for e in swept.fingers]
    if live:
        fingers = [_live_finger(f, objects[e.uid], e) for f, e in zip(fingers, swept.fingers, strict=True)]
    bodies, body_entries = [], []
    shown = instances.read(depsgraph) if any(e.shown_as is not None for e in swept.bodies) else None
    makers = {e.instance.instancer for e in swept.bodies if e.instance is not None}
    unusable: set[tuple[int, int]] = set()
    shared: dict[int, dict[str, Any]] = {}
    for entry in swept.bodies:
        obj = objects[entry.uid]
        if shown is not None and entry.shown_as is not None:
            geometry = shown.surfaces.get(entry.shown_as)
        else:
            geometry = reader.geometry_of(obj.evaluated_get(depsgraph), entry.curved is not None or not live)
        mesh = reader.surface(geometry, swept.unit, entry.mirrored, entry.curved)
        if not (live or len(mesh.triangles)) and obj.type in SURFACE_TYPES and script_changes.run_here():
            entry = replace(entry, blinking=True)  # a script may give it faces later
        # Bodies that deform or blink may get their faces later; then the chunks have them.
        if live or not (entry.deforming or entry.blinking):
            try:
                core.scene.tactile_scene.check_mesh(mesh, f"object '{entry.name}'")
            except DermisError as error:
                if entry.instance is None and entry.uid in makers:
                    continue  # its instances are separate bodies
                kind = (entry.uid, entry.uid) if entry.instance is None else entry.instance[:2]
                if kind not in unusable:
                    findings.append(_left_out(error, "mesh-unusable"))
                unusable.add(kind)
                continue
        if entry.instance is None and not live:
            if flaw := zero_area_finding(mesh, entry.name):
                findings.append(flaw)
            made = reader.curved(geometry, swept.unit, entry.mirrored, entry.curved)
            findings += curved_surfaces.findings(geometry, entry.stretch, swept.unit, made, f"object '{entry.name}'")
        parameters = shared.get(entry.uid)
        if parameters is None:
            parameters = object_properties.parameters(obj.dermis.material)
            parameters = shared[entry.uid] = _defaults(parameters, obj, entry) if live else parameters
        own = entry.deforming or entry.blinking
        bodies.append(
            core.scene.tactile_scene.Body(entry.name, None if own else mesh, parameters, simulated=entry.simulated)
        )
        body_entries.append(entry)
    names = {x.name for x in bodies}
    bodies = [_with_content(b, e, objects, names, findings) for b, e in zip(bodies, body_entries, strict=True)]
    kept = replace(swept, bodies=tuple(body_entries), screens=tuple(screen_entries))
    themselves = (objects[e.uid] for e in (*body_entries, *screen_entries) if e.instance is None)
    findings += participants.hidden_with_eye(themselves, depsgraph.view_layer)
    return Header(kept, tuple(fingers), tuple(bodies), tuple(screens))


def _in_instances(depsgraph: bpy.types.Depsgraph) -> list[Any]:
    """Report fingers and touch screens that are shown as instances."""
    remedy = "Make the instance real, or a library override of it"
    fingers = [
        Finding(
            "warning",
            "finger-instance",
            "it is shown by an instance, and instances cannot be fingers",
            where=f"finger '{name}'",
            remedy=remedy,
        )
        for name in participants.in_instances(depsgraph, "FINGER")
    ]
    screens = [
        Finding(
            "warning",
            "screen-instance",
            "it is shown by an instance, and an instance cannot be a touch screen",
            where=f"screen '{name}'",
            remedy=remedy,
        )
        for name in participants.in_instances(depsgraph, "SCREEN")
    ]
    return fingers + screens


def _stretch(obj: bpy.types.Object, matrix: Array, stretches: Mapping[int, float] | None) -> float:
    """Return the largest factor by which an object's pose stretches it.

    It is the factor over the range where `stretches` has the object, else that of the current frame. Without
    `stretches`, the factor of a curved object that may grow is rounded up.
    """
    now = curved_surfaces.stretch_of(matrix)
    if stretches is not None:
        return stretches.get(obj.session_uid) or now
    if curved_surfaces.is_curved(obj) and curved_surfaces.grows(obj):
        return curved_surfaces.rounded_up(now)
    return now


def _finger_entry(entry: Entry, findings: list[Any]) -> Entry:
    if entry.mirrored:
        findings.append(
            Finding(
                "warning",
                "mirrored-finger",
                "it has a negative scale; its frame stays right-handed along its own Y and Z",
                where=f"finger '{entry.name}'",
                remedy="Apply the scale",
            )
        )
    return replace(entry, mirrored=False)


def _finger(obj: bpy.types.Object, screens: set[str], findings: list[Any]) -> Any:
    where = f"finger '{obj.name_full}'"
    uses = []
    for device in obj.dermis.finger.devices:
        if not device.enabled:
            continue
        screen = device.screen.name_full if device.screen is not None else ""
        if not device.preset:
            findings.append(
                Finding(
                    "error",
                    "no-preset",
                    "one of its devices has no preset",
                    where=where,
                    remedy="Choose one in the Dermis tab under Wear",
                )
            )
        elif screen and screen not in screens:
            findings.append(
                Finding(
                    "error",
                    "screen-missing",
                    "its touch screen is not in the scene, or cannot be used",
                    where=where,
                    value=screen,
                    limit=", ".join(sorted(screens)) or "no usable touch screen here",
                    remedy="Choose another screen in the Dermis tab under Wear",
                )
            )
        # A device with a flaw stays in the list, so that the channels of the others keep their numbers.
        values = platform_devices.absolute(thimble_devices.parameters_of(device))
        uses.append(core.scene.tactile_scene.DeviceUse(device.preset, values, screen))
    finger = obj.dermis.finger
    values = {**object_properties.parameters(finger), **skin_properties.parameters(finger.skin)}
    return core.scene.tactile_scene.Finger(obj.name_full, tuple(uses), values)


def _with_content(body: Any, entry: Entry, objects: Mapping[int, Any], names: set[str], findings: list[Any]) -> Any:
    material = objects[entry.uid].dermis.material
    if entry.instance is not None or material.content_kind != "child":
        return body
    inside = tuple(sorted(c.name_full for c in objects[entry.uid].children if c.name_full in names))
    if material.content_on and not inside:
        findings.append(
            Finding(
                "warning",
                "no-content",
                "its content should be its child objects, but none of them is touchable",
                where=f"object '{body.name}'",
                remedy="Parent a touchable object to it, or choose another kind of content",
            )
        )
    return replace(body, content=inside)


def _instance_entries(
    now: Mapping[InstanceKey, Any],
    simulations: Simulations,
    deforming: frozenset[int] | None,
    instances: Mapping[InstanceKey, Present],
) -> list[Entry]:
    """Return the entries of the instances that are bodies, in order of name.

    Args:
        now: the matrices of the instances that exist at the current frame.
    """
    objects = participants.look_up({u for key in instances for u in (key.instancer, key.object)})
    animated = {p.material: participants.animated_parameters(objects[p.material]) for p in instances.values()}
    out = []
    for key, present in instances.items():
        shown, maker = objects[key.object], objects[key.instancer]
        matrix = now.get(key, present.first)
        out.append(
            Entry(
                participants.instance_name(shown, maker, key),
                present.material,
                key,
                mirrored=matrix is not None and bool(np.linalg.det(matrix[:3, :3]) < 0),
                deforming=deforming is None or present.changing or key.object in deforming,
                simulated=key.object in simulations.uids or key.instancer in simulations.uids,
                blinking=present.first is not None,
                stretch=present.stretch,
                curved=curved_surfaces.tolerance_of(objects[present.material], present.stretch),
                animated=animated[present.material],
            )
        )
    return sorted(out, key=lambda e: e.name)


def _defaults(parameters: Mapping[str, Any], obj: bpy.types.Object, entry: Entry) -> dict[str, Any]:
    """Return an object's parameters with defaults for the animated ones.

    Parameters of devices are not among them.
    """
    out = dict(parameters)
    for name, path, factor in entry.animated:
        if not name.startswith("device/"):
            out[name] = _default(obj, path) * factor
    return out


def _live_finger(finger: Any, obj: bpy.types.Object, entry: Entry) -> Any:
    uses = list(finger.devices)
    for name, path, factor in entry.animated:
        if name.startswith("device/"):
            _, number, parameter = name.split("/")
            use = uses[int(number)]
            uses[int(number)] = replace(use, parameters={**use.parameters, parameter: _default(obj, path) * factor})
    return replace(finger, devices=tuple(uses), parameters=_defaults(finger.parameters, obj, entry))


def _default(obj: bpy.types.Object, path: str) -> Any:
    group_path, _, attribute = path.rpartition(".")
    return obj.dermis.path_resolve(group_path).bl_rna.properties[attribute].default


def reason(tactile: Any, error: Any) -> Any:
    """Return an error that names the refused finger or object; else `error`.

    A scene without a finger, or without anything to touch, is refused. Where a finding says that a finger, or an
    object to touch, was left out, that is the cause, and the returned error states it.

    Args:
        tactile: the refused `TactileScene`. error: the exception that its `validate` raised.
    """
    if error.code not in ("no-finger", "nothing-to-touch"):
        return error
    fingers = {f"object '{o.name_full}'" for o in bpy.data.objects if participants.role_of(o) == "FINGER"}
    for finding in tactile.findings:
        refused = finding.code in ("disabled", "mesh-unusable", "screen-unusable")
        if refused and (finding.where in fingers) == (not tactile.fingers):
            return error.changed(
                what=f"{error.what}: {finding.what.removesuffix(_SO_LEFT_OUT)}",
                where=finding.where,
                value=finding.value,
                limit=finding.limit,
                remedy=finding.remedy.removesuffix(_LEFT_OUT).removesuffix(". "),
            )
    return error


def _left_out(error: Any, code: str) -> Any:
    remedy = f"{error.remedy}. {_LEFT_OUT}" if error.remedy else _LEFT_OUT
    return error.as_finding(code=code, remedy=remedy)
