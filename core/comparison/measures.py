"""In which measures a device's rendering is judged against the touch, and how far it misses.

Devices that press on skin are judged by stress where receptors lie, and by the force into the skin and along it; a
shear tactor by the displacement that its effects ask for, a friction screen by the friction that is perceived, a voice
coil by the voltage.
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
from ..errors import DermisError
from ..pipeline.bake import Output
from ..skin.model import SkinModel
from ..skin.stimulus import Stimulus
from .rendered_forces import rendered_touches

MOST = 60  # samples of a touch at which skin is looked at
FELT = 0.01  # [N] below which a touch asks for nothing
REACHED = 0.05  # of the force asked for: a device that presses less does not reach the skin
BEYOND = 1.0 + 1e-9  # of a range


@dataclass(frozen=True, eq=False)
class Measure:
    """A quantity as the touch asks for it and as the device renders it.

    Attributes:
        name, unit: for people; values are SI.
        times: [s], shape (k,). target, rendered: shape (k,), or of a field its norm.
        off: RMS of the difference over the RMS of the target; of a field that of the field itself.
    """

    name: str
    unit: str
    times: Array
    target: Array
    rendered: Array
    off: float


@dataclass(frozen=True, eq=False)
class PadMap:
    """Pressure on the pad at the strongest sample: nodes (m, 2) [m], target and rendered (m,) [Pa]; its time [s]."""

    nodes: Array
    target: Array
    rendered: Array
    time: float


@dataclass(frozen=True, eq=False)
class Judged:
    """One device: its measures, the main one first, and the share of the touched samples that is out of its reach."""

    measures: tuple[Measure, ...]
    out_of_reach: float
    pad: PadMap | None = None
    limited: float = field(default=0.0)  # share of all samples at which the method itself was at a limit


def judge(output: Output, skin: SkinContact | None, parameters: Mapping[str, Any]) -> Judged | None:
    """Judge one device; None where the touch does not use it.

    Args:
        skin: states of the finger's skin, for a device that presses on it.
        parameters: parameters of the device's use.

    Raises:
        DermisError: a track that the device cannot play, or a kind without a measure.
    """
    if output.track.spec.follows_skin:
        return None if skin is None or not len(skin.contact) else _pressing(output, skin, parameters)
    judges = {"shear_tactor": _tactor, "friction_screen": _screen, "voice_coil": _coil}
    if output.track.spec.kind not in judges:
        raise DermisError("there is no measure for its kind", where=output.device, value=output.track.spec.kind)
    return judges[output.track.spec.kind](output)


def measure(name: str, unit: str, times: Array, target: Array, rendered: Array) -> Measure:
    """Return a measure of one number a sample."""
    return Measure(name, unit, times, target, rendered, rms(rendered - target) / max(rms(target), 1e-300))


def rms(values: Array) -> float:
    """Return the root of the mean square; 0 of nothing."""
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
    """Judge a voice coil by its vibration, within the track's limits, against the requested one in its band."""
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
    shown, given = rendered_touches(output.track, skin, samples, parameters)
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
    )


def _looked_at(skin: SkinContact) -> NDArray[np.intp]:
    """Return touched samples at equal distances, the strongest among them."""
    touched = skin.contact
    chosen = touched[np.unique(np.linspace(0, len(touched) - 1, min(MOST, len(touched))).round().astype(int))]
    return np.union1d(chosen, touched[skin.normal_force[touched].argmax()])


def _stress(model: SkinModel, forces: Array, amounts: Sequence[Array | None]) -> Array:
    """Return stress where receptors lie under the pad [Pa], shape (k, probes, 6)."""
    both = zip(forces, amounts, strict=True)
    return np.stack([Stimulus(model, force, given=given).probe_stress for force, given in both])
