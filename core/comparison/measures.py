"""Measures of the difference between a touch and its rendering.

Devices that press on skin are judged by the stress where receptors lie, by the normal force and by the tangential
force. A shear tactor is judged by the displacement that its effects request, a friction screen by the perceived
friction and the voltage, and a voice coil by the voltage.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.skin_contact import SkinContact
from ..devices.friction_screen import AMPLITUDE, FrictionScreen
from ..devices.shear_tactor import ShearTactor
from ..devices.voice_coil import DISPLACEMENT, VOLTAGE, VoiceCoil
from ..errors import DermisError, Finding
from ..pipeline.bake import Output
from ..skin.model import SkinModel
from ..skin.stimulus import Stimulus
from .rendered_forces import rendered_touches

MOST = 60  # number of samples of a touch at which the skin is evaluated; the strongest sample is added
FELT = 0.01  # [N] normal force; at or below it, a sample of a touch counts as untouched
REACHED = 0.05  # share of the target normal force; a device that presses with less does not reach the skin
BEYOND = 1.0 + 1e-9  # a value above this many times a limit is outside the range; the excess over 1 is for rounding


@dataclass(frozen=True, eq=False)
class Measure:
    """Target and rendered values of a quantity.

    Attributes:
        name, unit: name and SI unit of the quantity, for display.
        times: times of the samples [s], shape (k,).
        target, rendered: values of the touch and of the device, shape (k,). For a field they are its RMS values.
        off: RMS of the difference, divided by the RMS of the target. For a field it is computed from the components of
            the field, not from the RMS values.
    """

    name: str
    unit: str
    times: Array
    target: Array
    rendered: Array
    off: float


@dataclass(frozen=True, eq=False)
class PadMap:
    """Pressure on the pad at the sample of the largest normal force.

    Attributes:
        nodes: positions of the pad nodes [m], shape (m, 2).
        target, rendered: pressure of the touch and of the device [Pa], shape (m,).
        time: time of the sample [s].
    """

    nodes: Array
    target: Array
    rendered: Array
    time: float


@dataclass(frozen=True, eq=False)
class Judged:
    """Measures of one device.

    Attributes:
        measures: the measures, the main one first.
        out_of_reach: share of the touched samples that the device cannot render.
        pad: pressure on the pad; None for a device that does not press on skin.
        limited: share of all samples at which the matching method was at a limit.
        findings: problems found while the track was played.
    """

    measures: tuple[Measure, ...]
    out_of_reach: float
    pad: PadMap | None = None
    limited: float = field(default=0.0)
    findings: tuple[Finding, ...] = ()


def judge(output: Output, skin: SkinContact | None, parameters: Mapping[str, Any]) -> Judged | None:
    """Compare the rendering of one device with the touch.

    Args:
        output: result of rendering for the device.
        skin: states of the finger's skin; needed for a device that presses on skin.
        parameters: settings of the device in the scene.

    Returns:
        The measures; None if the touch does not use the device.

    Raises:
        DermisError: the device cannot play the track, or there is no measure for its kind.
    """
    if output.track.spec.follows_skin:
        return None if skin is None or not len(skin.contact) else _pressing(output, skin, parameters)
    judges = {"shear_tactor": _tactor, "friction_screen": _screen, "voice_coil": _coil}
    if output.track.spec.kind not in judges:
        raise DermisError("there is no measure for its kind", where=output.device, value=output.track.spec.kind)
    return judges[output.track.spec.kind](output)


def measure(name: str, unit: str, times: Array, target: Array, rendered: Array) -> Measure:
    """Return the measure of a scalar quantity."""
    return Measure(name, unit, times, target, rendered, rms(rendered - target) / max(rms(target), 1e-300))


def rms(values: Array) -> float:
    """Return the root mean square; 0 for an empty array."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else 0.0


def _tactor(output: Output) -> Judged | None:
    track, asked = output.track, output.signals["magnitude"]
    felt = asked > 0.0
    if not felt.any():
        return None
    shown = np.hypot(track.column("tactor_x"), track.column("tactor_y"))
    target = ShearTactor.from_spec(track.spec).radius * asked
    made = measure("shear displacement", "m", track.times, target, shown)
    return Judged((made,), float((asked[felt] > BEYOND).mean()))


def _coil(output: Output) -> Judged | None:
    """Judge a voice coil by its voltage.

    The voltage of the track, within its limits, is compared with the voltage that the requested vibration needs.
    """
    track, coil = output.track, VoiceCoil.of(output.track.spec)
    target = track.column(DISPLACEMENT)
    if not target.any():
        return None
    asked = output.signals["magnitude"]
    driven = coil.volts(target)
    low, high = (track.spec.channel(VOLTAGE).low or 0.0), (track.spec.channel(VOLTAGE).high or 0.0)
    made = measure("voltage", "V", track.times, driven, track.column(VOLTAGE))
    beyond = (asked > BEYOND) | (driven < low * BEYOND) | (driven > high * BEYOND)
    return Judged((made,), float(beyond[asked > 0.0].mean()))


def _screen(output: Output) -> Judged | None:
    track, asked = output.track, output.signals["friction"]
    felt = output.signals["contact"] > 0.5
    if not felt.any() or not asked.any():
        return None
    device, volts = FrictionScreen.of(track.spec), track.column(AMPLITUDE)
    wanted = device.law.volts(asked)
    made = (
        measure("perceived friction", "1", track.times, asked, device.law.friction(volts)),
        measure("voltage", "V", track.times, wanted, volts),
    )
    return Judged(made, float((wanted[felt] > device.limit * BEYOND).mean()))


def _pressing(output: Output, skin: SkinContact, parameters: Mapping[str, Any]) -> Judged:
    samples = _looked_at(skin)
    times = skin.times[samples]
    target = np.stack([skin.force_at(i) for i in samples.tolist()])
    shown, given, findings = rendered_touches(output.track, skin, samples, parameters)
    felt = [skin.amounts_at(i) for i in samples.tolist()]
    wanted_stress, stress = _stress(skin.model, target, felt), _stress(skin.model, shown, given)
    wanted_size, size = (np.sqrt(np.square(s).mean(axis=(1, 2))) for s in (wanted_stress, stress))
    off = rms(stress - wanted_stress) / max(rms(wanted_stress), 1e-300)
    total, made = target.sum(axis=1), shown.sum(axis=1)
    asked = total[:, 2] > FELT
    missed = asked & (made[:, 2] < REACHED * total[:, 2])
    strongest = int(total[:, 2].argmax())
    wanted_pad, pad = (Stimulus(skin.model, f[strongest]).pressure for f in (target, shown))
    signals = output.signals
    limits = [np.asarray(signals[name]) > 0.0 for name in ("at_limit", "clipped") if name in signals]
    held = next((f.count for f in output.findings if f.code == "servo-limit"), 0) / max(len(output.track.times), 1)
    return Judged(
        (
            Measure("stress", "Pa", times, wanted_size, size, off),
            measure("normal force", "N", times, total[:, 2], made[:, 2]),
            measure("shear force", "N", times, np.hypot(*total[:, :2].T), np.hypot(*made[:, :2].T)),
        ),
        float(missed.sum() / max(asked.sum(), 1)),
        PadMap(skin.model.positions[:, :2], wanted_pad, pad, float(times[strongest])),
        max([float(at.mean()) for at in limits] + [held]),
        findings,
    )


def _looked_at(skin: SkinContact) -> NDArray[np.intp]:
    """Return the samples at which a touch is judged.

    They are up to `MOST` equally spaced samples, and the sample of the largest normal force.
    """
    touched = skin.contact
    chosen = touched[np.unique(np.linspace(0, len(touched) - 1, min(MOST, len(touched))).round().astype(int))]
    return np.union1d(chosen, touched[skin.normal_force[touched].argmax()])


def _stress(model: SkinModel, forces: Array, amounts: Sequence[Array | None]) -> Array:
    """Return the stress at the receptors under the pad [Pa].

    The shape is (k, probes, 6).
    """
    both = zip(forces, amounts, strict=True)
    return np.stack([Stimulus(model, force, given=given).probe_stress for force, given in both])
