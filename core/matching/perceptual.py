"""Gradient friction: a finger's path over a touch screen becomes amplitude and carrier of its voltage.

path on the screen -> direction (eq. 4) -> slope (eq. 3) -> friction (eq. 5) -> volts (eq. 1). Source: [S4]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..devices.friction_screen import AMPLITUDE, CARRIER, FrictionScreen
from ..devices.spec import DeviceSpec
from ..effects.gradient import check_map, metres_of
from ..effects.slide import FULL, LEAST, STILL_SPEED, directions
from ..errors import DermisError, Finding
from ..motion import Spline
from ..scene import DeviceUse, Screen, TactileScene
from ..track import CommandTrack
from .rendered import Rendered
from .screen_map import ScreenMap, height_range, steepest_of_all

if TYPE_CHECKING:
    from ..contact.touch import SampledTouch

Array = NDArray[np.float64]

TOUCH_DISTANCE = 0.0005  # [m], where neither screen nor finger says
BEHIND = 0.02  # [m]; a pad deeper than a fingertip is thick lies behind the screen and does not touch it
DIRECTION_WINDOW = 0.02  # [s]
THRESHOLD = 0.5
SCALE_CHANGE = 1e-4  # relative; float32 matrices differ by less
SHEAR = 1e-3


@dataclass(frozen=True)
class _Path:
    """A pad's path in a screen's own axes, at the device's times: x, y, z [m], touching, at rest."""

    x: Array
    y: Array
    z: Array
    touching: NDArray[np.bool_]
    resting: NDArray[np.bool_]


def render(touch: SampledTouch, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec) -> Rendered:
    """Return the voltage of a friction screen along a finger's path.

    `DeviceUse.screen` names the screen; empty, the finger feels every screen, at each moment the one it is nearest
    to among those it touches. A screen's `height_map` may be a sequence (k, rows, columns): `map_fps` maps a second
    (default: one a frame), the first at scene frame `sequence_start` (default: the range's first).

    Raises:
        DermisError: no such screen, a map or setting that cannot be used, a screen without area.

    Source: [S4] eq. 1 to 5
    """
    device = FrictionScreen.of(spec)
    where = f"finger '{scene.fingers[finger].name}', {spec.name}"
    settings = _Settings(touch, scene, finger, use, spec.rate, where)
    findings: list[Finding] = []
    relevant = _screens(scene, use)
    maps = screen_maps(scene, touch.screens, use, spec)
    for index in maps:
        findings += _scale_findings(touch.screens[index], scene.screens[index].name)

    paths = [_path(touch, scene, finger, index, settings) for index in relevant]
    # Of several screens under one finger the nearest counts; the earlier in the scene's order where they tie.
    distance = np.array([np.where(p.touching, np.abs(p.z), np.inf) for p in paths])
    chosen = np.argmin(distance, axis=0)
    contact = np.isfinite(distance).any(axis=0)

    n = len(settings.times)
    scale = settings.series("scale") if settings.constant("scale_mode", "auto") == "manual" else None
    threshold = settings.series("threshold")
    window = float(settings.constant("direction_window", DIRECTION_WINDOW))
    signals = {name: np.zeros(n) for name in ("x", "y", "distance", "direction_x", "direction_y", "grad_x", "grad_y",
                                             "height", "friction")}  # fmt: skip
    for place, (index, path) in enumerate(zip(relevant, paths, strict=True)):
        mine = chosen == place
        for name, values in (("x", path.x), ("y", path.y), ("distance", path.z)):
            signals[name][mine] = values[mine]
        felt = mine & contact
        if not felt.any():
            continue
        direction = directions(path.x, path.y, felt, spec.rate, window, path.resting)[felt]
        relief = maps[index].relief(
            path.x[felt], path.y[felt], direction, settings.times[felt],
            scale=None if scale is None else scale[felt], threshold=None if threshold is None else threshold[felt],
        )  # fmt: skip
        for name, values in (("direction_x", direction[:, 0]), ("direction_y", direction[:, 1]),
                             ("grad_x", relief.grad_x), ("grad_y", relief.grad_y), ("height", relief.height),
                             ("friction", relief.friction)):  # fmt: skip
            signals[name][felt] = values
    volts = device.law.volts(signals["friction"])
    animated = settings.series("carrier")
    carrier = np.full(n, device.carrier) if animated is None else animated
    signals = {
        "contact": contact.astype(np.float64),
        "screen": np.where(contact, np.array(relevant)[chosen], -1.0),
        **signals,
    }

    if not contact.any():
        nearest = min(float(np.abs(p.z).min()) for p in paths)
        findings.append(Finding("warning", "never-touches", "the finger never touches a screen", where=where,
                                value=f"{nearest * 1e3:.3g} mm from its plane at the nearest",
                                remedy="Bring the pad to the screen, or raise its touch distance"))  # fmt: skip
    findings += _flat_findings(maps, scene)
    findings += device.check(volts, carrier, where)
    values = np.empty((n, len(spec.channels)))
    for column, channel in enumerate(spec.channels):
        known = {AMPLITUDE: volts, CARRIER: carrier}.get(channel.name)
        values[:, column] = channel.rest if known is None else known
    track = CommandTrack(spec, settings.times, values, _meta(maps, scene, device))
    return Rendered(track, signals, tuple(findings))


def screen_maps(scene: TactileScene, matrices: Array, use: DeviceUse, spec: DeviceSpec) -> dict[int, ScreenMap]:
    """Return the map of each screen that a use concerns, by the screen's index, ready to export with `save`.

    The automatic scale is one for the whole bake: over every map of every one of these screens the steepest slope
    (for 'height' the tallest relief) becomes friction 100.

    Args:
        scene: its header; no chunk is read.
        matrices: object-to-world of all screens at one or more samples, shape (S, n, 4, 4); the first gives the scale.

    Raises:
        DermisError: no such screen, an unusable map or setting, a screen without area.
    """
    device = FrictionScreen.of(spec)
    given = use.parameters
    profile, mode = given.get("profile", "slope"), given.get("scale_mode", "auto")
    where = f"device '{use.preset}'"
    if mode not in ("auto", "manual"):
        raise DermisError("unknown way to scale", where=where, value=mode, limit="auto, manual")
    screens = {index: _map_of(scene.screens[index], matrices[index]) for index in _screens(scene, use)}
    manual = float(given.get("scale", 0.0)) if mode == "manual" else 0.0
    if mode == "manual" and profile != "rectangle" and not (np.isfinite(manual) and manual != 0.0):
        raise DermisError("the scale must not be zero", where=where, value=manual, remedy="Choose the automatic scale")
    scale, offset = manual, 0.0
    ranges = {index: height_range(heights) for index, (heights, _, _) in screens.items()}
    if mode == "auto" and profile == "slope":
        steepest = max(steepest_of_all(*entry) for entry in screens.values())
        scale = FULL / steepest if steepest > 0 else 0.0
    elif mode == "auto" and profile == "height":
        tallest = max((ranges[i][1] - ranges[i][0]) * metres_of(size, unit) for i, (_, size, unit) in screens.items())
        scale, offset = ((FULL - LEAST) / tallest if tallest > 0 else 0.0), LEAST
    result = {}
    for index, (heights, size, unit) in screens.items():
        parameters = scene.screens[index].parameters
        begin = float(parameters.get("sequence_start", scene.frame_range[0]))
        result[index] = ScreenMap(
            heights, size, unit, device, profile, given.get("downhill", "rectify"), scale, offset,
            float(given.get("threshold", THRESHOLD)), *ranges[index],
            maps_per_second=float(parameters.get("map_fps", scene.fps)),
            start=(begin - scene.frame_range[0]) / float(scene.fps),
            direction_window=float(given.get("direction_window", DIRECTION_WINDOW)),
        )  # fmt: skip
    return result


def _screens(scene: TactileScene, use: DeviceUse) -> Sequence[int]:
    names = [screen.name for screen in scene.screens]
    if not names:
        raise DermisError("no touch screen in the scene", where=f"device '{use.preset}'",
                          remedy="Add one with Add > Dermis > Touch Screen")  # fmt: skip
    if not use.screen:
        return range(len(names))
    if use.screen not in names:
        raise DermisError("no such touch screen", where=f"device '{use.preset}'", value=use.screen,
                          limit=", ".join(names), remedy="Choose a touch screen for the device")  # fmt: skip
    return [names.index(use.screen)]


def _map_of(screen: Screen, matrices: Array) -> tuple[NDArray[np.float32], tuple[float, float], float]:
    """Return maps (k, rows, columns), size in metres as the object is scaled at the start, and the height unit."""
    where = f"screen '{screen.name}'"
    lengths = np.linalg.norm(matrices[0, :3, :3], axis=0)
    size = (screen.size[0] * float(lengths[0]), screen.size[1] * float(lengths[1]))
    heights = np.asarray(screen.height_map, dtype=np.float32)
    check_map(heights, size, screen.height_unit, where)
    return (heights if heights.ndim == 3 else heights[None]), size, screen.height_unit


def _path(touch: SampledTouch, scene: TactileScene, finger: int, index: int, settings: _Settings) -> _Path:
    """Interpolate the pad's path in the screen's axes: a finger that rides on a moving screen is at rest there."""
    screen, matrices = scene.screens[index], touch.screens[index]
    where = f"screen '{screen.name}'"
    pads = touch.fingers[finger, :, :3, 3]
    axes = matrices[:, :3, :3]
    lengths = np.linalg.norm(axes, axis=1)
    volume = np.abs(np.linalg.det(axes))
    flat = volume <= 1e-9 * lengths.prod(axis=1)
    if flat.any():
        raise DermisError("the screen is scaled to nothing", where=where, value=f"frame {touch.frames[flat][0]:g}",
                          limit="a scale other than zero")  # fmt: skip
    local = np.linalg.solve(axes, (pads - matrices[:, :3, 3])[..., None])[..., 0]
    # Across the screen the map goes with its object; from its plane the true distance counts.
    local[:, :2] *= lengths[0, :2]
    local[:, 2] *= volume / np.linalg.norm(np.cross(axes[:, :, 0], axes[:, :, 1]), axis=1)
    x, y, z = Spline(touch.times, local).at(settings.times).T
    reach = settings.touch_distance(index)
    inside = (np.abs(x) <= 0.5 * screen.size[0] * lengths[0, 0]) & (np.abs(y) <= 0.5 * screen.size[1] * lengths[0, 1])
    resting = _resting(touch.times, local, settings.times)
    return _Path(x, y, z, inside & (z <= reach) & (z >= -BEHIND), resting)


def _resting(sampled: Array, local: Array, times: Array) -> NDArray[np.bool_]:
    """Return at which times the two samples around the step that ends there lie at one place of the screen.

    After an abrupt stop a spline swings by micrometres, and its last swing would be taken for the direction to hold.
    """
    if len(sampled) < 2:
        return np.ones(len(times), bool)
    chord = np.diff(local[:, :2], axis=0)
    still = np.hypot(chord[:, 0], chord[:, 1]) <= STILL_SPEED * np.diff(sampled)
    middle = times - 0.5 * (times[1] - times[0] if len(times) > 1 else 0.0)
    return np.asarray(still[np.clip(np.searchsorted(sampled, middle) - 1, 0, len(still) - 1)])


class _Settings:
    """The settings of one use: animated where a channel says so, else constant."""

    def __init__(
        self, touch: SampledTouch, scene: TactileScene, finger: int, use: DeviceUse, rate: float, where: str
    ) -> None:
        # The last sample is the last moment that is known; a rounding error must not cost it.
        self.times = np.arange(int(touch.times[-1] * rate + 1e-6) + 1) / rate
        self._touch, self._scene, self._finger, self._where = touch, scene, finger, where
        self._given: Mapping[str, Any] = use.parameters
        devices = scene.fingers[finger].devices
        place = next((i for i, d in enumerate(devices) if d is use), None)
        place = place if place is not None else (devices.index(use) if use in devices else 0)
        self._prefix = f"device/{finger}/{place}/"

    def constant(self, name: str, default: Any) -> Any:
        """Return a setting that does not change over a scene."""
        return self._given.get(name, default)

    def series(self, name: str) -> Array | None:
        """Return a setting at the device's times, or None where nobody set it."""
        animated = self._channel(self._prefix + name)
        if animated is not None:
            return animated
        return np.full(len(self.times), float(self._given[name])) if name in self._given else None

    def touch_distance(self, screen: int) -> Array:
        """Return the distance [m] from which the pad touches: the screen's own, else the finger's."""
        for prefix, owner in ((f"screen/{screen}/", self._scene.screens[screen]),
                              (f"finger/{self._finger}/", self._scene.fingers[self._finger])):  # fmt: skip
            animated = self._channel(prefix + "touch_distance")
            if animated is not None:
                return animated
            if "touch_distance" in owner.parameters:
                return np.full(len(self.times), float(owner.parameters["touch_distance"]))
        return np.full(len(self.times), TOUCH_DISTANCE)

    def _channel(self, key: str) -> Array | None:
        values = self._touch.channels.get(key)
        if values is None:
            return None
        return np.interp(self.times, self._touch.times, values)


def _scale_findings(matrices: Array, name: str) -> list[Finding]:
    """Say where a screen is deformed while it moves, because the map keeps the size that it has at the start."""
    findings = []
    lengths = np.linalg.norm(matrices[:, :3, :3], axis=1)
    changed = (np.abs(lengths / np.maximum(lengths[0], 1e-30) - 1.0) > SCALE_CHANGE).any(axis=1)
    if changed.any():
        findings.append(Finding("warning", "screen-scale-animated", "the screen's scale changes; slopes are those of "
                                "its size at the start", where=f"screen '{name}'",
                                count=int(changed.sum())))  # fmt: skip
    units = matrices[:, :3, :3] / np.maximum(lengths, 1e-30)[:, None, :]
    sheared = np.abs(np.einsum("ni,ni->n", units[:, :, 0], units[:, :, 1])) > SHEAR
    if sheared.any():
        findings.append(Finding("warning", "screen-sheared", "the screen is sheared; directions on it are distorted",
                                where=f"screen '{name}'", remedy="Apply its scale, or its parent's",
                                count=int(sheared.sum())))  # fmt: skip
    return findings


def _flat_findings(maps: Mapping[int, ScreenMap], scene: TactileScene) -> list[Finding]:
    return [
        Finding("warning", "flat-map", "the map is flat: no slope, no bump", where=f"screen '{scene.screens[i].name}'",
                remedy="Check its image, or its mesh")
        for i, m in maps.items()
        if m.highest == m.lowest
    ]  # fmt: skip


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
