"""The pins of an array in the view: each a disc at its point of action, and all of them as a map in the corner.

Colour and size follow the force. Points of action are where a pin's line meets the skin at rest, from the engine; they
are computed once for a size of finger and a device.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import changes
from .._core import DermisError, core
from ..devices import active_presets, skin_models
from ..preferences import library
from ..properties import skin_properties
from . import drawing, paint, tactor_twin
from .drawing import finger_matrix

if TYPE_CHECKING:
    from ..preview import device_preview
    from ..preview.skin_preview import SkinState

Array = NDArray[np.float64]

SIDES = 14  # of a disc
STEM = 2.4e-3  # [m] how far a pin is drawn to stick out
LIFT = 0.12e-3  # [m] of a disc above the skin, so that both do not fight for the same pixels
IDLE = (0.55, 0.58, 0.62, 0.55)
MOST = 8
KINDS = ("pin_array",)
_handlers = drawing.Handlers()


class Pins(NamedTuple):
    """Where a device's pins act on a finger, in the finger's frame.

    Attributes:
        points: [m], shape (pins, 3), NaN where a pin misses. directions: of their motion, shape (pins, 3).
        radius: of a pin [m]. force_limit: [N]. rows, columns: of the array.
    """

    points: Array
    directions: Array
    radius: float
    force_limit: float
    rows: int
    columns: int


_pins: dict[str, Pins | None] = {}
_states: dict[str, tuple[SkinState, tuple[Any, ...], tuple[SkinState, Array]]] = {}


def pins_of(obj: bpy.types.Object, device: str) -> Pins | None:
    """Return the pins of a device on a finger; None while the skin is being made or where the layout cannot be used."""
    skin = skin_properties.parameters(obj.dermis.finger.skin)
    key = json.dumps([skin["skin"], skin["skin_level"], device, changes.generation()], sort_keys=True)
    if key not in _pins:
        while len(_pins) >= MOST:
            _pins.pop(next(iter(_pins)))
        pin_array = core.devices.pin_array
        try:
            model = skin_models.get(skin["skin"], skin["skin_level"])
            if model is None:
                return None
            spec = library().device(device)
            layout = pin_array.layout(spec)
            met = pin_array.contacts(layout, model.mesh.nodes, model.mesh.surface)
            met = pin_array.on_pad(met, layout, model.positions)
            points = np.where(met.hits[:, None], met.points, np.nan)
            rows, columns = int(spec.parameters["rows"]), int(spec.parameters["columns"])
            radius = float(spec.parameters["pin_radius"])
            _pins[key] = Pins(points, layout.directions, radius, layout.force_limit, rows, columns)
        except DermisError:
            _pins[key] = None  # the bake says why
    return _pins[key]


def discs(pins: Pins, forces: Array) -> tactor_twin.Part:
    """Return a disc a pin that meets the skin, a larger and warmer one for a larger force, and its stem."""
    hits = np.flatnonzero(np.isfinite(pins.points[:, 0]))
    share = np.clip(forces[hits] / pins.force_limit, 0.0, 1.0)
    inward = pins.directions[hits]
    side = np.cross(inward, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, inward)
    angle = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    radius = pins.radius * (0.35 + 0.75 * np.sqrt(share))
    centre = pins.points[hits] - LIFT * inward
    rim = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    rim = centre[:, None] + radius[:, None, None] * rim
    back = centre - STEM * inward
    thin = 0.18 * pins.radius
    stems = np.stack([centre - thin * side, centre + thin * side, back + thin * side, back - thin * side], axis=1)
    positions = np.concatenate([centre[:, None], rim, stems], axis=1)
    colours = np.array([tactor_twin.heat(s) if s > 1e-3 else IDLE for s in share.tolist()]).reshape(-1, 4)
    shades = np.repeat(colours[:, None], positions.shape[1], axis=1)
    shades[:, SIDES + 1 :, 3] *= 0.4
    i = np.arange(SIDES)
    one = np.vstack(
        [np.stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % SIDES], axis=1), SIDES + 1 + np.array([[0, 1, 2], [0, 2, 3]])]
    )
    triangles = one[None] + positions.shape[1] * np.arange(len(hits))[:, None, None]
    return tactor_twin.Part(
        positions.reshape(-1, 3).astype(np.float32),
        shades.reshape(-1, 4).astype(np.float32),
        triangles.reshape(-1, 3).astype(np.int32),
    )


def rendered(scene: bpy.types.Scene, targets: Sequence[SkinState]) -> tuple[SkinState, ...]:
    """Return, for every skin with a pin array, the skin as its pins render this very frame.

    Fades and lead, which belong to the track, are left out: shown is the best that the method can do for the target.
    """
    found = []
    for target in targets:
        obj = scene.objects.get(target.finger)
        if obj is None or target.model is None or not target.touching:
            continue
        for device in obj.dermis.finger.devices:
            if device.enabled and (spec := spec_of(device.preset)) is not None:
                found.append(_matched(target, device, spec)[0])
                break
    for gone in set(_states) - {t.finger for t in targets}:
        del _states[gone]
    return tuple(found)


def live_rows(scene: bpy.types.Scene) -> tuple[device_preview.Row, ...]:
    """Return what the pin arrays of fingers whose skin is shown press at the current frame, without a bake."""
    from ..preview import device_preview, skin_preview

    rows = []
    for target in skin_preview.own(scene):
        obj = scene.objects.get(target.finger)
        if obj is None or target.model is None or target.source != "live":
            continue
        for device in obj.dermis.finger.devices:
            spec = spec_of(device.preset) if device.enabled else None
            if spec is None:
                continue
            low = np.array([-np.inf if c.low is None else c.low for c in spec.channels])
            high = np.array([np.inf if c.high is None else c.high for c in spec.channels])
            forces = _matched(target, device, spec)[1] if target.touching else np.zeros(len(low))
            names = [c.name for c in spec.channels]
            rows.append(
                device_preview.Row(
                    finger=target.finger,
                    device=device.preset,
                    title=spec.name,
                    kind=spec.kind,
                    values=dict(zip(names, np.clip(forces, low, high).tolist(), strict=True)),
                    low={c.name: c.low for c in spec.channels},
                    high={c.name: c.high for c in spec.channels},
                    units={c.name: c.unit for c in spec.channels},
                    path=np.empty((0, 2)),
                    contact=float(target.touching),
                )
            )
            break
    return tuple(rows)


def _matched(target: SkinState, device: Any, spec: Any) -> tuple[SkinState, Array]:
    """Return the skin as the pins render it, and the pins' forces [N]; kept while skin and settings stay."""
    key = (device.preset, device.pin_method, device.pin_nodes, device.pin_bounded, changes.generation())
    known = _states.get(target.finger)
    if known is not None and known[0] is target and known[1] == key:
        return known[2]
    pressed: Array = np.zeros(len(spec.channels))
    pins = core.matching.pins
    deformation = core.matching.deformation
    name = f"{target.finger}: {device.pin_method} pins"
    with skin_models.one_thread():
        try:
            ready = pins.setup(target.model, spec, device.pin_nodes)
            limit = ready.pins.force_limit if device.pin_bounded else None
            found = deformation.PinSolver(ready.matcher, device.pin_method, force_limit=limit).solve(target.force)
            pressed = found.forces
            force = pins.rendered_force(ready, pressed)
            note = f"u_err {1e3 * found.displacement_error:.2f} mm"
        except DermisError as error:
            force, note = np.zeros_like(target.force), str(error)
    total = force.sum(axis=0)
    made = replace(
        target,
        finger=name,
        force=force,
        normal_force=float(total[2]),
        note=note,
        sticking=0,
        slipping=0,
        tangential_force=float(np.hypot(total[0], total[1])),
        work="rendered",
        counters={},
    )
    _states[target.finger] = (target, key, (made, pressed))
    return made, pressed


def spec_of(preset: str) -> Any | None:
    """Return a pin array's preset; None for other devices and for presets that cannot be read."""
    return active_presets.spec_of(preset, KINDS)


def forces_of(row: device_preview.Row) -> Array:
    """Return a row's pin forces [N], in the order of the device's channels."""
    return np.array(list(row.values.values()))


def card(row: device_preview.Row, left: float, bottom: float, width: float, height: float, scale: float) -> None:
    """Draw the map of a pin array as its wearer would see it through the nail, tip up, and its figures [px]."""
    forces = forces_of(row)
    high = max((h for h in row.high.values() if h), default=0.4)
    rows, columns = grid(row)
    cell = min(width / columns, (height - 22 * scale) / rows)
    x0, y0 = left, bottom + 20 * scale
    paint.rectangle(
        x0 - 2 * scale, y0 - 2 * scale, columns * cell + 4 * scale, rows * cell + 4 * scale, (*paint.FAINT[:3], 0.10)
    )
    for pin, force in enumerate(forces.tolist()):
        r, c = divmod(pin, columns)
        share = min(max(force / high, 0.0), 1.0)
        centre = np.array([x0 + (c + 0.5) * cell, y0 + (r + 0.5) * cell])
        if share > 1e-3:
            paint.disc(centre, 0.48 * cell * np.sqrt(share) + 0.5, tactor_twin.heat(share))
    total, full = float(forces.sum()), int((forces >= 0.999 * high).sum())
    words = f"{total:.2f} N in all, {int((forces > 1e-3 * high).sum())} pins, {full} at {high:g} N"
    paint.text(words, left, bottom + 2 * scale, paint.INK, scale)


def grid(row: device_preview.Row) -> tuple[int, int]:
    """Return rows and columns of a row's device; one line of pins where its preset cannot be read."""
    obj = bpy.context.scene.objects.get(row.finger)
    pins = pins_of(obj, row.device) if obj is not None else None
    if pins is not None and pins.rows * pins.columns == len(row.values):
        return pins.rows, pins.columns
    return 1, max(len(row.values), 1)


def _draw() -> None:
    scene = bpy.context.scene
    for row in drawing.rows_of(KINDS):
        frame, obj = finger_matrix(scene, row.finger), scene.objects.get(row.finger)
        pins = pins_of(obj, row.device) if obj is not None else None
        if frame is None or pins is None or len(pins.points) != len(row.values):
            continue
        with drawing.in_finger(frame):
            drawing.solid(discs(pins, forces_of(row)), mask=False)


def register() -> None:
    """Draw pins from now on."""
    _handlers.add(_draw)


def unregister() -> None:
    """Draw them no more, and forget what was computed for it."""
    _handlers.clear()
    _pins.clear()
    _states.clear()
    active_presets.forget()
