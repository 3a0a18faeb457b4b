"""EffectSum: sum of the effects of all bodies on one finger, before the device's range limits it.

A device that moves along one axis does not render directions: an impact counts by its speed, and a texture by its
height. Each effect has a switch on the device and one on the object. Effects that are switched off, and bodies that the
finger never touches, are not computed. Both are counted in `skipped`.

Source: [S3] section 4
"""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.encounter import Encounter, Which, indices_of, turned, turned_back
from ..contact.holding_times import holding_times, meet
from ..contact.pad_contact import PadContact
from ..effects import content, patterns, texture, transient, weight
from ..errors import Finding
from ..memory import Carry
from ..parameters.device import DEVICE
from ..parameters.finger import FINGER
from ..parameters.material import BODY
from ..scene.tactile_scene import DeviceUse, TactileScene
from .content_offset import content_offset

SLOWEST = 1.0  # [Hz] a texture that passes at a lower frequency is not felt as a vibration
Tap = tuple[float, Array, float, float, float]  # instant, velocity, amplitude, decay, frequency
EFFECTS = ("transient", "texture", "weight", "content", "pattern")
PLAYED = ("pattern_play", "pattern_frequency", "pattern_amplitude", "pattern_angle")


@dataclass
class EffectSum:
    """Displacement of one finger's device, to which effects are added one by one.

    Attributes:
        pad_contact: contact of the pads over the whole range.
        scene: the scene's header.
        finger: index of the finger.
        use: the device on this finger.
        tap_axis: direction in the pad's plane into which the normal part of an impact is turned; None for a device with
            one axis.
        times: the device's times [s], shape (n,).
        effects: effects that the device can render.
        band: lowest and highest frequency that the device can render [Hz].
        findings: findings so far.
        skipped: how often each kind of computation was left out.
        sum: displacement as fractions of the range, in the finger's frame, shape (n, 3), or (n, 1) for one axis; None
            before anything was added.
        contact, held: whether the finger touches something, and whether it holds something, shape (n,).
        device: index of the device among the finger's devices.
    """

    pad_contact: PadContact
    scene: TactileScene
    finger: int
    use: DeviceUse
    tap_axis: tuple[float, float] | None
    times: Array
    effects: tuple[str, ...] = EFFECTS
    band: tuple[float, float] = (0.0, math.inf)
    findings: list[Finding] = field(default_factory=list)
    skipped: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        options = self.use.parameters
        self.axis = DEVICE["transient_axis"].of(options, self._where)
        self.sign = DEVICE["weight_sign"].of(options, self._where)
        devices, count = self.scene.fingers[self.finger].devices, len(self.times)
        self.device = next((i for i, use in enumerate(devices) if use is self.use), 0)
        self.sum: Array | None = None
        self.contact = np.zeros(count, dtype=bool)
        self.held = np.zeros(count, dtype=bool)
        self._taps: list[Tap] = []
        self._switches: dict[tuple[int, str], Any] = {}

    def add_body(self, b: int) -> None:
        """Add the effects of body `b` on the finger."""
        wants_content = self._wants_content(b)
        if self.pad_contact.memory is not None and wants_content:
            self._content(b, np.zeros(0, dtype=np.intp))  # the content also moves while nobody holds the body
        met = meet(self.pad_contact, self.scene, self.finger, b, self.times)
        if met is None:
            self._skip("bodies_never_touched")
            return
        self.contact |= met.touching
        self._add_transient(met, b)
        self._add_texture(met, b)
        wants_weight = self._wants_weight(b)
        if not wants_weight:
            self._skip("effects_off")
        if not wants_content:
            self._skip("effects_off")
        if not (wants_weight or wants_content):
            return
        holds = holding_times(self.pad_contact, self.scene, self.finger, b, self.times)
        if holds is None:
            self._skip("bodies_never_held")
            return
        self.held |= holds
        index = indices_of(holds)
        if wants_weight:
            self._add_world(index, self._weight(b, index) * self._weight_factor())
        if wants_content:
            self._add_world(index, self._content(b, index))

    def add_pattern(self) -> None:
        """Add the finger's own pattern."""
        own = self.scene.fingers[self.finger].parameters
        kind = FINGER["pattern"].of(own, self._where)
        on = self._used("pattern")
        if kind == "none" or not _ever(on):
            self._skip("effects_off")
            return
        at = (self.pad_contact.series(f"finger/{self.finger}", FINGER[name], own, self.times) for name in PLAYED)
        repeat = bool(FINGER["pattern_repeat"].of(own))
        with self._carry("pattern") as carry:
            shape = patterns.played(kind, self.times, *at, repeat=repeat, carry=carry)
        if np.ndim(on):  # a pattern continues while its switch is off, but is not rendered
            shape *= on[:, None]
        if shape.any():
            self._total[:, :2] += shape

    def add_earlier_taps(self) -> None:
        """Add the transients that began before the first time and have not decayed yet."""
        with self._carry("taps") as carry:
            taps = [tap for tap in carry.start or () if transient.rings(tap, self.times[0])]
            if taps:
                self._add_taps(*(np.array(column) for column in zip(*taps, strict=True)))
            carry.found = [*taps, *(tap for tap in self._taps if tap[0] <= self.times[carry.index])]

    # -- effects -------------------------------------------------------------------------------------------------

    def _add_transient(self, met: Encounter, b: int) -> None:
        amplitude = self._parameter(b, "transient_amplitude")
        on = self._switch(b, "transient")
        if on is None or not _ever(amplitude):
            self._skip("effects_off")
            return
        onsets = met.onsets
        if onsets.size == 0:
            return
        at = np.clip(np.searchsorted(self.times, onsets), 0, len(self.times) - 1)
        alpha, decay, hertz, live = (
            np.broadcast_to(v, self.times.shape)[at]
            for v in (amplitude, self._parameter(b, "transient_decay"), self._parameter(b, "transient_frequency"), on)
        )
        self._audible(b, float(np.max(hertz)))
        self._check_band(b, "contact transient", hertz[np.abs(alpha * live) > 0.0])
        velocities = met.onset_velocities
        if self.tap_axis is None:
            velocities = np.sqrt(np.einsum("ij,ij->i", velocities, velocities))[:, None]
        elif self.axis == "tilted":
            # The axis belongs to the finger, so the direction stays fixed in the pad after the impact.
            there = self.pad_contact.finger_motion(self.finger).at(onsets)
            local = turned_back(there, slice(None), velocities)
            velocities = transient.tilted(local, np.asarray(self.tap_axis))
        self._add_taps(onsets, velocities, alpha * live, decay, hertz)
        self._taps += zip(onsets, velocities, alpha * live, decay, hertz, strict=True)

    def _add_texture(self, met: Encounter, b: int) -> None:
        amplitudes = self._parameter(b, "texture_amplitude_x"), self._parameter(b, "texture_amplitude_y")
        on = self._switch(b, "texture")
        if on is None or not (_ever(amplitudes[0]) or _ever(amplitudes[1])):
            self._skip("effects_off")
            return
        which = met.which
        normal = met.normal
        place = texture.coordinates(met.point, normal)
        velocity = texture.tangential(met.velocity, normal)
        threshold = self._at(self._parameter(b, "texture_speed_threshold"), which)
        with self._carry("texture", b) as carry:
            direction = texture.held_direction(velocity, threshold, carry.start)
            earlier = met.touching[: carry.index].sum()
            carry.found = direction[earlier - 1] if earlier else carry.start
        friction = self._at(self._parameter(b, "friction"), which) * self._at(on, which)
        heights = (self._at(amplitudes[0], which), self._at(amplitudes[1], which))
        periods = tuple(self._at(self._parameter(b, f"texture_period_{axis}"), which) for axis in "xy")
        if self.tap_axis is None:
            moved = np.any(direction != 0.0, axis=1, keepdims=True)
            shape = texture.displacement(place, moved.astype(np.float64), friction, heights, periods)
            self._add_eased(b, which, shape[:, 0], moved[:, 0] & (self._at(on, which) > 0.0))
            self._check_band(b, "texture", self._texture_frequency(place, which, heights, periods))
            return
        shape = texture.displacement(place, direction, friction, heights, periods)
        self._add_world(which, turned(self.pad_contact.body_at(b, self.times), which, shape))

    def _add_taps(self, onsets: Array, velocities: Array, amplitude: Array, decay: Array, hertz: Array) -> None:
        shape = transient.displacement(self.times, onsets, velocities, amplitude, decay, hertz)
        if self.tap_axis is None or self.axis == "tilted":
            self._total[:] += shape
        else:
            index = np.flatnonzero(shape.any(axis=1))
            self._add_world(index, shape[index])

    def _wants_weight(self, b: int) -> bool:
        return self._switch(b, "weight") is not None and bool(
            _ever(self._parameter(b, "weight_acceleration")) or _ever(self._parameter(b, "weight_gravity"))
        )

    def _wants_content(self, b: int) -> bool:
        return self._switch(b, "content") is not None and _ever(self._parameter(b, "content_amplitude"))

    def _weight(self, b: int, index: Which) -> Array:
        """Return the displacement by a held body's weight at some samples, in world axes, shape (k, 3)."""
        on = self._switch(b, "weight")
        assert on is not None
        live = self._at(on, index)
        return weight.displacement(
            self._acceleration(b)[index],
            np.asarray(self.scene.gravity),
            self._at(self._parameter(b, "weight_acceleration"), index) * live,
            self._at(self._parameter(b, "weight_gravity"), index) * live,
            self.sign,
        )

    def _weight_factor(self) -> float:
        """Return the factor by which all weights of the scene are multiplied; 1 without auto-range.

        With it, the strongest weight of the scene uses the whole range.
        """
        if not DEVICE["auto_range"].of(self.use.parameters):
            return 1.0
        key = ("weight factor", self.use.preset, len(self.times))
        known: float | None = self.pad_contact.kept.get(key)
        if known is None:
            with self.pad_contact.carry(key[:2], self.times) as carry:
                carry.found = max(self._strongest_weight(), carry.start or 0.0)
            known = self.pad_contact.kept[key] = weight.fitting(carry.found)
        if known < 1.0 and not any(f.code == "auto-range" for f in self.findings):
            self.findings.append(
                Finding(
                    "info",
                    "auto-range",
                    "weights were scaled: the strongest of the scene uses the whole range",
                    self._where,
                    value=f"factor {known:.4g}",
                )
            )
        return known

    def _strongest_weight(self) -> float:
        """Return the largest weight in its pad's plane of any finger with this preset and auto-range."""
        peak = 0.0
        for f, finger in enumerate(self.scene.fingers):
            for use in finger.devices:
                if use.preset != self.use.preset or not DEVICE["auto_range"].of(use.parameters):
                    continue
                other = EffectSum(self.pad_contact, self.scene, f, use, self.tap_axis, self.times)
                for b in range(len(self.scene.bodies)):
                    if not other._wants_weight(b):
                        continue
                    holds = holding_times(self.pad_contact, self.scene, f, b, self.times)
                    if holds is not None:
                        index = indices_of(holds)
                        there = self.pad_contact.finger_at(f, self.times)
                        flat = turned_back(there, index, other._weight(b, index))[:, :2]
                        peak = max(peak, math.sqrt(float((flat**2).sum(axis=1).max())))
        return peak

    def _content(self, b: int, index: Which) -> Array:
        """Return the displacement by a held body's content at some samples, in world axes, shape (k, 3)."""
        on = self._switch(b, "content")
        assert on is not None
        offset, findings = self.pad_contact.keep(
            ("content", b, len(self.times)),
            lambda: content_offset(self.pad_contact, self.scene, b, self.times, self._acceleration(b)),
        )
        self.findings += findings
        amplitude = self._at(self._parameter(b, "content_amplitude"), index) * self._at(on, index)
        return content.displacement(offset[index], amplitude)

    # -- parts ---------------------------------------------------------------------------------------------------

    @property
    def _where(self) -> str:
        return f"finger '{self.scene.fingers[self.finger].name}'"

    @property
    def _total(self) -> Array:
        if self.sum is None:
            self.sum = np.zeros((1 if self.tap_axis is None else 3, len(self.times))).T  # Fortran order
        return self.sum

    def _add_world(self, index: Which, displacement: Array) -> None:
        """Add a displacement in world axes, shape (k, 3), at some samples; it is turned into the finger's frame."""
        there = self.pad_contact.finger_at(self.finger, self.times)
        self._total[index] += np.asfortranarray(turned_back(there, index, displacement))

    def _acceleration(self, b: int) -> Array:
        """Return the acceleration of a body's centre of gravity [m/s^2], shape (n, 3)."""
        return self.pad_contact.keep(
            ("acceleration", b, len(self.times)),
            lambda: self.pad_contact.centre(b, self.scene.bodies[b].mesh).at(self.times, 2),
        )

    def _carry(self, effect: str, b: int | None = None) -> AbstractContextManager[Carry]:
        return self.pad_contact.carry((effect, self.finger, self.device, b), self.times)

    def _parameter(self, b: int, name: str) -> Any:
        return self.pad_contact.series(f"body/{b}", BODY[name], self.scene.bodies[b].parameters, self.times)

    def _switch(self, b: int, effect: str) -> Any:
        """Return 1 where an effect is on for both the device and body `b`, else 0; None if it never is."""
        if (b, effect) not in self._switches:
            on = (self._parameter(b, f"{effect}_on") > 0.5) & self._used(effect)
            if isinstance(on, np.ndarray):
                self._switches[b, effect] = on.astype(np.float64) if on.any() else None
            else:
                self._switches[b, effect] = 1.0 if on else None
        return self._switches[b, effect]

    def _used(self, effect: str) -> Any:
        """Return whether this device renders an effect, as one value or at each time, shape (n,)."""
        if effect not in self.effects:
            return False
        owner, row = f"device/{self.finger}/{self.device}", DEVICE[f"use_{effect}"]
        return self.pad_contact.series(owner, row, self.use.parameters, self.times) > 0.5

    def _at(self, value: Any, index: Which) -> Any:
        return value[index] if isinstance(value, np.ndarray) else value

    def _add_eased(self, b: int, which: Any, shape: Array, felt: NDArray[np.bool_]) -> None:
        """Add a texture that fades in and out over one period of the lowest frequency of the device."""
        whole, active = np.zeros(len(self.times)), np.zeros(len(self.times), dtype=bool)
        whole[which], active[which] = shape, felt
        step = self.times[1] - self.times[0] if len(self.times) > 1 else 1.0
        samples = max(round(1.0 / (self.band[0] * step)), 1)
        with self._carry("texture ends", b) as carry:
            whole, carry.found = texture.eased(whole, active, samples, carry.start, carry.index)
        self._total[:, 0] += whole

    def _texture_frequency(self, place: Array, which: Any, heights: Any, periods: Any) -> Array:
        """Return the frequencies of a texture along both its axes while the finger slides over it [Hz]."""
        step = self.times[1] - self.times[0] if len(self.times) > 1 else math.inf
        rows = np.arange(len(self.times))[which]
        found = []
        for axis, (height, period) in enumerate(zip(heights, periods, strict=True)):
            cycles = np.abs(np.diff(place[:, axis] / period)) / step
            on = (np.broadcast_to(height, len(place))[1:] != 0.0) & (np.diff(rows) == 1) & (cycles > SLOWEST)
            found.append(cycles[on])
        return np.concatenate(found)

    def _check_band(self, b: int, effect: str, hertz: Array) -> None:
        """Report frequencies outside the band at which the device's response was measured."""
        low, high = self.band
        lost = (hertz < low) | (hertz > high)
        if not lost.any():
            return
        worst = hertz[lost][[np.argmin(hertz[lost]), np.argmax(hertz[lost])]]
        share = float(lost.mean())
        self.findings.append(
            Finding(
                "warning" if share > 0.5 else "info",
                "outside-band",
                f"{share:.0%} of the {effect} is outside of the frequencies that the device makes, and weaker",
                f"object '{self.scene.bodies[b].name}'",
                value=f"{worst[0]:.4g} to {worst[1]:.4g} Hz",
                limit=f"{low:g} to {high:g} Hz",
                remedy="Change the material's frequency or period, or the speed of the finger",
            )
        )

    def _audible(self, b: int, hertz: float) -> None:
        rate = (len(self.times) - 1) / (self.times[-1] - self.times[0]) if len(self.times) > 1 else math.inf
        if hertz > rate / 2.0:
            self.findings.append(
                Finding(
                    "warning",
                    "above-nyquist",
                    "a transient's frequency is above half of the device's rate",
                    f"object '{self.scene.bodies[b].name}'",
                    value=f"{hertz:g} Hz",
                    limit=f"{rate / 2.0:g} Hz",
                    remedy="Lower the frequency, or use a faster device",
                )
            )

    def _skip(self, name: str) -> None:
        self.skipped[name] = self.skipped.get(name, 0) + 1


def _ever(value: float | Array) -> bool:
    """Return whether a setting, one number or one for each time, is ever other than 0."""
    return bool(np.count_nonzero(value)) if isinstance(value, np.ndarray) else value != 0.0
