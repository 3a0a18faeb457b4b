"""The command `stream sound`: play a track through a sound card.

The track's voltage is played once, for an amplifier at the card. Silence is played before the card is closed, after a
signal, too.
Exit status: 0; 1 if the card ran dry; 2 if the track could not be played to its end; 128 plus a signal's number.
"""

from __future__ import annotations

import argparse
import math
import sys

import numpy as np

from ...arrays import Array
from ...devices.kinds import KINDS
from ...devices.mechanism import mechanism_of
from ...errors import DermisError, Finding
from ...track import export
from ...track.command_track import CommandTrack
from ...track.wav import Wave, stated, wave_of
from ..signals import Interrupted, Signals
from .card import Card, open_card
from .loopback import lowest
from .measured_card import MeasuredCard

FADE = 0.005  # [s] time of the fade to silence after a signal
SILENCE = 0.2  # [s] silence after the last sample: longer than the buffers of a card


def sound(options: argparse.Namespace) -> int:
    """Play a track; return the exit status.

    Raises:
        DermisError: the full scale or the gain is not stated, the track must not be played on this card, or the card
            is gone.
    """
    settings = stated(vars(options), ("full_scale", "gain"), f"sound card '{options.card}'")
    track = export.read(options.track)
    measured = MeasuredCard.load(options.measured)
    samples, wave = samples_of(track, settings, measured, options.card)
    for finding in wave.findings:
        print(finding, file=sys.stderr)
    card, signals = open_card(options.card, wave.rate), Signals()
    with signals.caught():
        try:
            if not options.yes:
                peak = float(np.abs(wave.volts).max())
                print(
                    f"{track.spec.name} gets up to {peak:.4g} V from {card.name}, whose full scale is stated as "
                    f"{settings['full_scale']:g} V, times {settings['gain']:g}. Enter: play; Ctrl-C: stop.",
                    flush=True,
                )
                if not signals.line():
                    raise DermisError("it was not confirmed", where=card.name, remedy="Press Enter, or give --yes")
            played = play(card, samples, signals)
        except Interrupted:
            return 128 + signals.number
    print(f"played {played / card.rate:.2f} of {len(samples) / card.rate:.2f} s, dry {card.dry}")
    if signals.number:
        return 128 + signals.number
    if card.dry:
        said = "the sound card had nothing to play for a moment"
        remedy = "End other programs, and play it again"
        print(Finding("error", "card-dry", said, where=card.name, count=card.dry, remedy=remedy), file=sys.stderr)
    return int(card.dry > 0)


def samples_of(track: CommandTrack, settings: dict[str, object], card: MeasuredCard, name: str) -> tuple[Array, Wave]:
    """Return the samples of a track, from -1 to 1, and its `Wave`.

    Raises:
        DermisError: the card or the rate is not the measured one; the card blocks the voltage's offset or its lowest
            frequency; a sample exceeds the loudest level without distortion; see also `wave_of`.
    """
    wave = wave_of(track, settings)
    where = f"sound card '{name}'"
    if (card.name, card.rate) != (name, wave.rate):
        raise DermisError(
            "card or rate differ from the measured ones",
            where=where,
            value=f"{card.name} at {card.rate} Hz was measured",
            limit=f"{name} at {wave.rate} Hz",
            remedy="Measure it with 'stream loopback', at this rate",
        )
    if wave.header["offset"]:
        raise DermisError(
            "a sound card blocks a constant voltage",
            where=where,
            value=f"{wave.header['offset']:g} V",
            limit="0 V",
            remedy="Add the offset behind the card",
        )
    least, low = lowest(card), lowest_frequency(track, float(wave.header["carrier"] or 0.0))
    if low < least:
        raise DermisError(
            "the card weakens the lowest frequencies by more than 0.5 %",
            where=where,
            value=f"{low:g} Hz",
            limit=f">= {least:.3g} Hz: its corner was measured at {card.corner:.3g} Hz",
            remedy="Raise the carrier, or use a card that goes lower",
            code="below-corner",
        )
    samples = np.clip(wave.volts / wave.limit, -1.0, 1.0)
    peak = float(np.abs(samples).max())
    if peak > card.loudest:
        raise DermisError(
            "louder than the card plays without distortion",
            where=where,
            value=f"{peak:.3f} of full scale",
            limit=f"{card.loudest:g}",
            remedy="Raise the amplifier's gain, and state it",
        )
    return samples, wave


def lowest_frequency(track: CommandTrack, carrier: float) -> float:
    """Return the lowest frequency of a track's voltage [Hz].

    For a coil it is the lower end of its band; otherwise that of the carrier, or of the track's own tones.
    """
    kind = KINDS[track.spec.kind]
    if kind.wave:
        return float(mechanism_of(track.spec).response.band[0])
    shown = track.column(kind.sine[0]) > 0.0
    return carrier or (float(track.column(kind.sine[1])[shown].min()) if shown.any() else math.inf)


def play(card: Card, samples: Array, signals: Signals) -> int:
    """Play samples, then silence; return the number of samples played.

    After a signal the samples fade to silence within 5 ms.

    Raises:
        DermisError: the card is gone.
    """
    fade = max(round(FADE * card.rate), 1)
    at = sent = 0
    end = len(samples)
    whole = samples

    def source(count: int) -> Array:
        nonlocal at, end, sent, whole
        if signals.number and end == len(samples) and at < end:
            end = min(at + fade, len(samples))
            falling = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade)
            whole = np.concatenate([samples[:at], samples[at:end] * falling[: end - at]])
        part = whole[at:end][:count]
        at += len(part)
        sent += count
        return np.pad(part, (0, count - len(part)))

    behind = round(SILENCE * card.rate)
    card.run(source, lambda: at >= end and sent >= at + behind)
    return at
