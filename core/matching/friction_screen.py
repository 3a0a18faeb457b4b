"""Gradient friction: voltage of a friction screen from the path of a finger over it.

The steps are: path on the screen, direction (eq. 4), slope (eq. 3), friction (eq. 5), voltage (eq. 1).

Source: [S4]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.friction_screen import FrictionScreen
from ..devices.spec import DeviceSpec
from ..effects.gradient import check_map, metres_of
from ..effects.slide import MAX_FRICTION, MIN_FRICTION, directions
from ..errors import DermisError, Finding
from ..parameters.device import DEVICE
from ..parameters.screen import SEQUENCE
from ..scene.tactile_scene import DeviceUse, Screen, TactileScene
from ..track.command_track import CommandTrack
from .rendered import Rendered
from .screen_map import ScreenMap, height_range, steepest_of_all
from .screen_path import Settings, driven_values, scale_findings, screen_path, screens_of

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact


def render(pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec) -> Rendered:
    """Render a friction screen along one finger's path.

    `DeviceUse.screen` names the screen. If it is empty, the finger feels all screens: at each moment the nearest one of
    those that it touches. With `relief` 'mesh', the normals of the touchable objects replace the map, see
    `mesh_relief`. A screen's `height_map` may be a sequence, shape (k, rows, columns). It then shows `map_fps` maps a
    second (default: one for each frame), the first one at scene frame `sequence_start` (default: first of the range).

    Raises:
        DermisError: the screen does not exist or has no area, or a map or setting cannot be used.

    Source: [S4] eq. 1 to 6
    """
    device = pad_contact.lasting(("screen", spec.key), lambda: FrictionScreen.of(spec))
    where = f"finger '{scene.fingers[finger].name}', {spec.name}"
    if DEVICE["relief"].of(use.parameters, where) == "mesh":
        from . import mesh_relief

        return mesh_relief.render(pad_contact, scene, finger, use, spec)
    settings = Settings(pad_contact, scene, finger, use, spec.rate, where)
    findings: list[Finding] = []
    relevant = screens_of(scene, use)
    scale = settings.series("scale") if settings.constant("scale_mode") == "manual" else None
    if scale is not None and scale.any():  # an animated scale may begin at zero
        largest = float(scale[np.argmax(np.abs(scale))])
        use = replace(use, parameters={**use.parameters, "scale": largest})
    maps = settings.lasting("maps", lambda: screen_maps(scene, pad_contact.screens, use, spec))
    for index in maps if settings.told else ():
        findings += scale_findings(pad_contact.screens[index], scene.screens[index].name)

    paths = [screen_path(pad_contact, scene, finger, index, settings) for index in relevant]
    # Of several screens under one finger, the nearest counts. At equal distance it is the first in the scene's order.
    if len(paths) == 1:
        chosen, contact = np.zeros(len(settings.times), np.intp), paths[0].touching
    else:
        distance = np.array([np.where(p.touching, np.abs(p.z), np.inf) for p in paths])
        chosen, contact = np.argmin(distance, axis=0), np.isfinite(distance).any(axis=0)

    n = len(settings.times)
    threshold = settings.series("threshold")
    window = float(settings.constant("direction_window"))
    signals = {
        name: np.zeros(n)
        for name in ("x", "y", "distance", "direction_x", "direction_y", "grad_x", "grad_y", "height", "friction")
    }
    for place, (index, path) in enumerate(zip(relevant, paths, strict=True)):
        mine = chosen == place
        for name, values in (("x", path.x), ("y", path.y), ("distance", path.z)):
            signals[name][mine] = values[mine]
        touching = mine & contact
        count = np.count_nonzero(touching)
        if not count:
            with settings.carry(("heading", index)):
                pass  # no state is carried while the finger is off the screen
            continue
        with settings.carry(("heading", index)) as carry:
            direction = directions(path.x, path.y, touching, spec.rate, window, path.resting, carry=carry)
        felt: NDArray[np.bool_] | slice = touching if count < n else slice(None)  # a slice copies nothing
        direction = direction[felt]
        relief = maps[index].relief(
            path.x[felt],
            path.y[felt],
            direction,
            settings.times[felt],
            scale=None if scale is None else scale[felt],
            threshold=None if threshold is None else threshold[felt],
        )
        if settings.told:
            findings += _hole_findings(path.x, path.y, touching, settings.times, maps[index], scene, index)
        for name, values in (
            ("direction_x", direction[:, 0]),
            ("direction_y", direction[:, 1]),
            ("grad_x", relief.grad_x),
            ("grad_y", relief.grad_y),
            ("height", relief.height),
            ("friction", relief.friction),
        ):
            signals[name][felt] = values
    values, driven = driven_values(signals["friction"], settings, device, spec, where)
    signals = {
        "contact": contact.astype(np.float64),
        "screen": np.where(contact, np.array(relevant)[chosen], -1.0),
        **signals,
    }

    if not np.count_nonzero(contact):
        nearest = min(float(np.abs(p.z).min()) for p in paths)
        findings.append(
            Finding(
                "warning",
                "never-touches",
                "the finger never touches a screen",
                where=where,
                value=f"{nearest * 1e3:.3g} mm from its plane at the nearest",
                remedy="Bring the pad to the screen, or raise its touch distance",
            )
        )
    if settings.told:
        findings += _flat_findings(maps, scene)
        findings += _unit_findings(maps, scene, absolute=scale is not None or len(maps) > 1)
        findings += _short_findings(maps, scene, settings.times)
    findings += driven
    track = CommandTrack(spec, settings.times, values, _meta(maps, scene, device))
    return Rendered(track, signals, tuple(findings), {"slopes_untouched": int((~contact).sum())})


def screen_maps(scene: TactileScene, matrices: Array, use: DeviceUse, spec: DeviceSpec) -> dict[int, ScreenMap]:
    """Return the maps of the screens of a use, by the index of the screen.

    With the automatic scale, one scale holds for the whole bake: the steepest slope on any map of these screens, or the
    largest range of heights for the profile 'height', becomes friction 100.

    Args:
        scene: the scene's header; no chunk is read.
        matrices: object-to-world matrices of all screens at one or more samples, shape (S, n, 4, 4). The first sample
            decides the size.
        use: the device on a finger.
        spec: preset of the device.

    Raises:
        DermisError: the screen does not exist or has no area, or a map or setting cannot be used.
    """
    device = FrictionScreen.of(spec)
    where = f"device '{use.preset}'"
    names = ("profile", "scale_mode", "scale", "downhill", "threshold", "direction_window")
    profile, mode, given_scale, downhill, threshold, window = (DEVICE[n].of(use.parameters, where) for n in names)
    screens = {index: _map_of(scene.screens[index], matrices[index]) for index in screens_of(scene, use)}
    manual = float(given_scale) if mode == "manual" else 0.0
    if mode == "manual" and profile != "rectangle" and not (np.isfinite(manual) and manual != 0.0):
        raise DermisError("the scale must not be zero", where=where, value=manual, remedy="Choose the automatic scale")
    scale, offset = manual, 0.0
    ranges = {index: height_range(heights) for index, (heights, _, _) in screens.items()}
    if mode == "auto" and profile == "slope":
        steepest = max(steepest_of_all(*entry) for entry in screens.values())
        scale = MAX_FRICTION / steepest if steepest > 0 else 0.0
    elif mode == "auto" and profile == "height":
        tallest = max((ranges[i][1] - ranges[i][0]) * metres_of(size, unit) for i, (_, size, unit) in screens.items())
        scale, offset = ((MAX_FRICTION - MIN_FRICTION) / tallest if tallest > 0 else 0.0), MIN_FRICTION
    result = {}
    for index, (heights, size, unit) in screens.items():
        parameters = scene.screens[index].parameters
        begin = SEQUENCE["sequence_start"].of(parameters, where)
        begin = float(scene.frame_range[0] if begin is None else begin)
        result[index] = ScreenMap(
            heights,
            size,
            unit,
            device,
            profile,
            downhill,
            scale,
            offset,
            float(threshold),
            *ranges[index],
            maps_per_second=float(SEQUENCE["map_fps"].of(parameters, where) or scene.fps),
            start=(begin - scene.frame_range[0]) / float(scene.fps),
            direction_window=float(window),
        )
    return result


def _map_of(screen: Screen, matrices: Array) -> tuple[NDArray[np.float32], tuple[float, float], float]:
    """Return a screen's maps, shape (k, rows, columns), its size at the first sample [m] and its height unit [m]."""
    where = f"screen '{screen.name}'"
    lengths = np.linalg.norm(matrices[0, :3, :3], axis=0)
    size = (screen.size[0] * float(lengths[0]), screen.size[1] * float(lengths[1]))
    heights = np.asarray(screen.height_map, dtype=np.float32)
    check_map(heights, size, screen.height_unit, where)
    return (heights if heights.ndim == 3 else heights[None]), size, screen.height_unit


def _flat_findings(maps: Mapping[int, ScreenMap], scene: TactileScene) -> list[Finding]:
    return [
        Finding(
            "warning",
            "flat-map",
            "the map is flat: no slope, no bump",
            where=f"screen '{scene.screens[i].name}'",
            remedy="Check its image, or its mesh",
        )
        for i, m in maps.items()
        if m.highest == m.lowest
    ]


def _unit_findings(maps: Mapping[int, ScreenMap], scene: TactileScene, *, absolute: bool) -> list[Finding]:
    """Report maps without a unit of height if commands depend on it.

    They do not for a single screen with the automatic scale.
    """
    return [
        Finding(
            "warning",
            "no-unit",
            "its map has no unit of height, so 1 was taken as the screen's width",
            where=f"screen '{scene.screens[i].name}'",
            value=f"{1e3 * m.metres:.3g} mm",
            remedy="Give the screen's height_unit, metres that 1 stands for, or let the scale be automatic",
        )
        for i, m in maps.items()
        if m.height_unit == 0.0 and m.profile != "rectangle" and absolute
    ]


def _hole_findings(
    x: Array, y: Array, touching: NDArray[np.bool_], times: Array, map_: ScreenMap, scene: TactileScene, screen: int
) -> list[Finding]:
    """Report a finger that passes over a hole in the measurements, where heights were estimated from its rim."""
    holes = scene.screens[screen].holes
    if holes is None:
        return []
    layers = holes if holes.ndim == 3 else holes[None]
    count, rows, columns = layers.shape
    at = np.clip(np.rint((times - map_.start) * map_.maps_per_second), 0, count - 1).astype(int)
    across = np.clip(((x / map_.size[0] + 0.5) * columns).astype(int), 0, columns - 1)
    up = np.clip(((y / map_.size[1] + 0.5) * rows).astype(int), 0, rows - 1)
    over = touching & layers[at, up, across]
    if not over.any():
        return []
    return [
        Finding(
            "warning",
            "over-hole",
            "the finger passes over a part of the map without heights; the heights there were filled in from the rims",
            where=f"screen '{scene.screens[screen].name}'",
            count=int(over.sum()),
            remedy="Measure the part, or lead the finger around it",
            frame=scene.frame_range[0] + float(times[np.argmax(over)]) * float(scene.fps),
        )
    ]


def _short_findings(maps: Mapping[int, ScreenMap], scene: TactileScene, times: Array) -> list[Finding]:
    found = []
    for i, m in maps.items():
        count = len(m.heights)
        if count < 2 or m.maps_per_second <= 0:
            continue
        # The last map is shown as long as each other one, so that half of this time is allowed after it.
        late = times > m.start + (count - 0.5) / m.maps_per_second
        if late.any():
            found.append(
                Finding(
                    "warning",
                    "sequence-short",
                    "the image sequence ends before the range does; its last map is held",
                    where=f"screen '{scene.screens[i].name}'",
                    value=f"{count} maps",
                    count=int(late.sum()),
                    remedy="Add images, or shorten the range",
                    frame=scene.frame_range[0] + float(times[np.argmax(late)]) * float(scene.fps),
                )
            )
    return found


def _meta(maps: Mapping[int, ScreenMap], scene: TactileScene, device: FrictionScreen) -> dict[str, str]:
    first = next(iter(maps.values()))
    law = device.law
    return {
        "screen": ", ".join(scene.screens[i].name for i in maps),
        "profile": first.profile,
        "downhill": first.downhill,
        "scale": f"{first.scale:.9g}",
        "law": f"slope {law.slope:.9g} intercept {law.intercept:.9g} base {law.base:.9g}",
    }
