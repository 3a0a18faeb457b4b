"""Voice coil: contact transients and textures as a vibration along one axis, with its voltage.

An impact counts by its speed and a texture by its height under the pad, whatever their directions, because people
hardly perceive the direction of a vibration. The displacements of all bodies are added as fractions of the range A and
limited to it. The voltage follows from the measured response of the actuator.

Source: [S3] eq. 1, 2 and 6 along one axis; direction and vibration: Landin et al., *Dimensional reduction of
high-frequency accelerations for haptic rendering*, EuroHaptics 2010 (inspired by, not read)
"""

from __future__ import annotations

import numpy as np

from ..contact.pad_contact import PadContact
from ..devices.spec import DeviceSpec
from ..devices.voice_coil import DISPLACEMENT, VoiceCoil
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..track.command_track import CommandTrack
from .effect_sum import EffectSum
from .rendered import Rendered

SLACK = 1e-9  # a value that exceeds 1 by no more than this counts as rounding and not as limited


def render(pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec) -> Rendered:
    """Render one finger's voice coil.

    Signals: 'contact' (0 or 1), 'magnitude' (displacement before the limit, as a fraction of the range).

    Raises:
        DermisError: a setting of an effect is unknown, or the preset lacks a parameter of the actuator.
    """
    coil = VoiceCoil.of(spec)
    times = pad_contact.device_times(scene, spec.rate)
    sums = EffectSum(
        pad_contact, scene, finger, use, None, times, effects=("transient", "texture"), band=coil.response.band
    )
    for body in range(len(scene.bodies)):
        sums.add_body(body)
    sums.add_earlier_taps()
    asked = np.zeros(len(times)) if sums.sum is None else sums.sum[:, 0]
    displacement = coil.radius * np.clip(asked, -1.0, 1.0)
    with pad_contact.carry(("coil", finger, sums.device), times) as carry:
        volts = coil.volts(displacement, carry.start)
        carry.found = coil.history(displacement, carry.start, carry.index)
    columns = {DISPLACEMENT: displacement, "voltage": volts}
    limited = int((np.abs(asked) > 1.0 + SLACK).sum())
    track = CommandTrack(
        spec,
        times,
        np.stack([columns[c.name] for c in spec.channels], axis=1),
        limited={f"{DISPLACEMENT}.range": limited} if limited else {},
    )
    signals = {"contact": sums.contact.astype(np.float64), "magnitude": np.abs(asked)}
    return Rendered(track, signals, tuple(sums.findings), {k: v for k, v in sums.skipped.items() if v})
