"""ScreenPath: path of a pad on a screen at the device's times, and the settings of the device."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.friction_screen import AMPLITUDE, CARRIER, FrictionScreen
from ..devices.spec import DeviceSpec
from ..effects.heading import STILL_SPEED
from ..errors import DermisError, Finding
from ..memory import Carry
from ..motion import Spline
from ..motion.vectors import cross, dot
from ..parameters.device import DEVICE
from ..parameters.finger import FINGER
from ..scene.tactile_scene import DeviceUse, TactileScene

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact


T = TypeVar("T")
BEHIND = 0.02  # largest depth of a touching pad below the screen [m], more than the thickness of a fingertip
SCALE_CHANGE = 1e-4  # relative change of scale that is reported; rounding of float32 matrices is smaller
SHEAR = 1e-3  # cosine between a screen's axes that is reported


@dataclass(frozen=True)
class ScreenPath:
    """A pad's path in a screen's own axes, at the device's times.

    Attributes:
        x, y, z: positions [m], shape (n,).
        inside: whether the pad is over the screen, shape (n,).
        touching: whether it is also within the touch distance of the plane, shape (n,).
        resting: whether it rests, shape (n,).
    """

    x: Array
    y: Array
    z: Array
    inside: NDArray[np.bool_]
    touching: NDArray[np.bool_]
    resting: NDArray[np.bool_]


def screens_of(scene: TactileScene, use: DeviceUse) -> Sequence[int]:
    """Return the indices of a use's screens: the one that it names, or all.

    Raises:
        DermisError: the screen does not exist, or the scene has no screen.
    """
    names = [screen.name for screen in scene.screens]
    if not names:
        raise DermisError(
            "no touch screen in the scene",
            where=f"device '{use.preset}'",
            remedy="Add one with Add > Dermis > Touch Screen",
        )
    if not use.screen:
        return range(len(names))
    if use.screen not in names:
        raise DermisError(
            "no such touch screen",
            where=f"device '{use.preset}'",
            value=use.screen,
            limit=", ".join(names),
            remedy="Choose a touch screen for the device",
        )
    return [names.index(use.screen)]


def screen_path(
    pad_contact: PadContact, scene: TactileScene, finger: int, index: int, settings: Settings
) -> ScreenPath:
    """Return the pad's path in the axes of a screen; a finger that moves with a moving screen is at rest.

    Raises:
        DermisError: the scale of the screen is zero.
    """
    screen, matrices = scene.screens[index], pad_contact.screens[index]
    where = f"screen '{screen.name}'"
    pads = pad_contact.fingers[finger, :, :3, 3]
    axes = matrices[:, :3, :3]
    lengths = np.sqrt(np.add.reduce(axes * axes, axis=1))
    volume = np.abs(np.linalg.det(axes))
    flat = volume <= 1e-9 * lengths.prod(axis=1)
    if flat.any():
        raise DermisError(
            "the screen's scale is zero",
            where=where,
            value=f"frame {pad_contact.frames[flat][0]:g}",
            limit="a scale other than zero",
        )
    local = np.linalg.solve(axes, (pads - matrices[:, :3, 3])[..., None])[..., 0]
    # Along the screen, positions are relative to the size at the start, as in the map. Distances from it are true ones.
    local[:, :2] *= lengths[0, :2]
    across = cross(axes[:, :, 0], axes[:, :, 1])
    local[:, 2] *= volume / np.sqrt(dot(across, across))
    x, y, z = Spline(pad_contact.knots, local).at(settings.times).T
    reach = settings.touch_distance(index)
    inside = (np.abs(x) <= 0.5 * screen.size[0] * lengths[0, 0]) & (np.abs(y) <= 0.5 * screen.size[1] * lengths[0, 1])
    resting = _resting(pad_contact.times, local, settings.times)
    return ScreenPath(x, y, z, inside, inside & (z <= reach) & (z >= -BEHIND), resting)


def _resting(sampled: Array, local: Array, times: Array) -> NDArray[np.bool_]:
    """Return whether the pad rests at each time, shape (n,): the samples before and after have the same position.

    After an abrupt stop, a spline oscillates by micrometres. Without this test, the last oscillation would determine
    the direction that is held.
    """
    if len(sampled) < 2:
        return np.ones(len(times), bool)
    chord = local[1:, :2] - local[:-1, :2]
    still = np.hypot(chord[:, 0], chord[:, 1]) <= STILL_SPEED * (sampled[1:] - sampled[:-1])
    middle = times - 0.5 * (times[1] - times[0] if len(times) > 1 else 0.0)
    return np.asarray(still.take(np.searchsorted(sampled, middle) - 1, mode="clip"))


class Settings:
    """Settings of one use of a device, animated or constant.

    Attributes:
        times: the device's times [s], shape (n,).
        told: whether findings are reported; those of a preview are not.
    """

    def __init__(
        self, pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, rate: float, where: str
    ) -> None:
        # The times are those of all devices of this rate. The last sample of the sweep may be before the end of the
        # range.
        self.times = pad_contact.device_times(scene, rate)
        self.told = pad_contact.memory is None
        self._pad_contact, self._scene, self._finger, self._where = pad_contact, scene, finger, where
        self._given: Mapping[str, Any] = use.parameters
        devices = scene.fingers[finger].devices
        place = next((i for i, d in enumerate(devices) if d is use), None)
        place = place if place is not None else (devices.index(use) if use in devices else 0)
        self._prefix = f"device/{finger}/{place}/"

    def carry(self, key: Hashable) -> AbstractContextManager[Carry]:
        """Return a context with a state of this use, see `PadContact.carry`."""
        return self._pad_contact.carry((self._prefix, key), self.times)

    def lasting(self, name: str, make: Callable[[], T]) -> T:
        """Return a value of this use that holds for the whole scene, see `PadContact.lasting`."""
        return self._pad_contact.lasting((self._prefix, name), make)

    def constant(self, name: str) -> Any:
        """Return a constant setting."""
        return DEVICE[name].of(self._given, self._where)

    def series(self, name: str) -> Array | None:
        """Return a setting at the device's times, shape (n,); None if it is not set."""
        animated = self._animated(self._prefix + name)
        if animated is not None:
            return animated
        constant = self.constant(name) if name in self._given else None
        return None if constant is None else np.full(len(self.times), float(constant))

    def touch_distance(self, screen: int) -> Array:
        """Return the touch distance [m], shape (n,): the screen's own, or else the finger's."""
        for prefix, owner in (
            (f"screen/{screen}/", self._scene.screens[screen]),
            (f"finger/{self._finger}/", self._scene.fingers[self._finger]),
        ):
            animated = self._animated(prefix + "touch_distance")
            if animated is not None:
                return animated
            if "touch_distance" in owner.parameters:
                return np.full(len(self.times), float(owner.parameters["touch_distance"]))
        return np.full(len(self.times), float(FINGER["touch_distance"].absent))

    def _animated(self, key: str) -> Array | None:
        values = self._pad_contact.animated.get(key)
        if values is None:
            return None
        return np.interp(self.times, self._pad_contact.times, values)


def driven_values(
    friction: Array, settings: Settings, device: FrictionScreen, spec: DeviceSpec, where: str
) -> tuple[Array, Sequence[Finding]]:
    """Return the values of the channels, shape (n, channels), for a friction, shape (n,), and findings."""
    volts = device.law.volts(friction)
    animated = settings.series("carrier")
    carrier = np.full(len(friction), device.carrier) if animated is None else animated
    values = np.empty((len(friction), len(spec.channels)))
    for column, channel in enumerate(spec.channels):
        known = {AMPLITUDE: volts, CARRIER: carrier}.get(channel.name)
        values[:, column] = channel.rest if known is None else known
    return values, device.check(volts, carrier, where) if settings.told else ()


def scale_findings(matrices: Array, name: str) -> list[Finding]:
    """Report a screen whose scale changes, since its map keeps the size at the start, or that is sheared."""
    findings = []
    lengths = np.linalg.norm(matrices[:, :3, :3], axis=1)
    changed = (np.abs(lengths / np.maximum(lengths[0], 1e-30) - 1.0) > SCALE_CHANGE).any(axis=1)
    if changed.any():
        findings.append(
            Finding(
                "warning",
                "screen-scale-animated",
                "the screen's scale changes; slopes are those of its size at the start",
                where=f"screen '{name}'",
                count=int(changed.sum()),
            )
        )
    units = matrices[:, :3, :3] / np.maximum(lengths, 1e-30)[:, None, :]
    sheared = np.abs(np.einsum("ni,ni->n", units[:, :, 0], units[:, :, 1])) > SHEAR
    if sheared.any():
        findings.append(
            Finding(
                "warning",
                "screen-sheared",
                "the screen is sheared; directions on it are distorted",
                where=f"screen '{name}'",
                remedy="Apply its scale, or its parent's",
                count=int(sheared.sum()),
            )
        )
    return findings
