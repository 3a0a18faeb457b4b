"""The command `stream loopback`: measure a sound card.

A cable leads from the card's output to its input. Results are gain, latency, jitter, corner frequency and loudest
level. The output has clicks at uneven times, then tones of several frequencies, then a tone of 1 kHz at rising levels.
Each is searched for at its expected time in the input.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, field

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from .card import Card, open_card
from .measured_card import MeasuredCard

QUIET = 0.25  # [s] silence around the clicks, longer than the latency of any card; twice as long after the last tone
CLICKS, LEVEL = 24, 0.25  # number of clicks, and amplitude of clicks and tones: -12 dB
GAP = 0.08  # [s] shortest time between two clicks; a card with a longer latency is not measured
TONES = (10.0, 20.0, 40.0, 80.0, 160.0, 320.0)  # [Hz] tones that show a card's corner frequency
REFERENCE = 1000.0  # [Hz] tone for the gain and for the levels
SECONDS = 0.5  # [s] duration of each tone, of which the first fifth and the last twentieth are not evaluated
LEVELS = (0.1, 0.25, 0.5, 0.7, 0.8, 0.9, 1.0)  # [1] amplitudes of the tone of 1 kHz, in parts of full scale
STRAIGHT = 0.005  # [1] largest change of the gain up to the loudest level, which is the tolerated error of an amplitude
TORN = 0.05  # [1] largest part of other signals in a received tone (RMS); with more its gain is uncertain
HEARD = 1e-3  # [1] gain below which the input counts as silent
DRIFT = 1e-4  # [1] largest difference of rate between input and output; more shows another clock, or another rate


@dataclass
class _Tape:
    """The output, made of parts.

    `add` returns the sample at which a part begins.
    """

    rate: int
    parts: list[Array] = field(default_factory=list)
    length: int = 0

    def add(self, part: Array) -> int:
        self.parts.append(part)
        self.length += len(part)
        return self.length - len(part)

    def tone(self, hertz: float, level: float) -> Array:
        t = np.arange(round(SECONDS * self.rate)) / self.rate
        fade = np.clip(np.minimum(t, SECONDS - t) / 0.01, 0.0, 1.0)
        return level * fade * np.sin(2.0 * np.pi * hertz * t)


def measure(card: Card) -> MeasuredCard:
    """Return the response of a card, from its output to its input.

    Raises:
        DermisError: the input is silent, has another rate, or has too much noise or distortion; or the card is gone.
    """
    tape, rate = _Tape(card.rate), card.rate
    rng = np.random.default_rng(1)
    tape.add(np.zeros(round(QUIET * rate)))
    click = LEVEL * _click(rate)
    clicks = []
    for gap in rng.uniform(GAP, 1.5 * GAP, CLICKS):
        clicks.append(tape.add(click))
        tape.add(np.zeros(round(gap * rate)))
    tape.add(np.zeros(round(QUIET * rate)))
    tones = {hertz: tape.add(tape.tone(hertz, LEVEL)) for hertz in (*TONES, REFERENCE)}
    levels = {level: tape.add(tape.tone(REFERENCE, level)) for level in LEVELS}
    tape.add(np.zeros(round(2 * QUIET * rate)))
    heard = _played(card, np.concatenate(tape.parts))
    where = f"sound card '{card.name}'"
    if np.abs(heard).max(initial=0.0) < HEARD * LEVEL:
        raise DermisError(
            "the input received nothing of the output",
            where=where,
            value=f"{np.abs(heard).max(initial=0.0):.2g}",
            limit=f">= {HEARD * LEVEL:g}",
            remedy="Connect the card's output with its line input, and turn both up",
        )
    sent = np.array(clicks, np.float64)
    late = np.array([_arrival(heard, click, k, round(QUIET * rate)) for k in clicks]) - sent
    drift = float(np.polyfit(sent, late, 1)[0])
    if abs(drift) > DRIFT:
        raise DermisError(
            "input and output run at different rates",
            where=where,
            value=f"{1e6 * drift:+.0f} ppm",
            limit=f"{1e6 * DRIFT:.0f} ppm",
            remedy="Choose an input and output of one card, at a rate that it has itself",
        )
    delay = float(np.median(late))
    gains = {}
    for hertz, start in tones.items():
        gains[hertz], left = _gain(heard, start + delay, hertz, LEVEL, rate)
        if left > TORN:
            raise DermisError(
                "the received tone differs from the sent one: it has gaps, noise or distortion",
                where=f"{where}, {hertz:g} Hz",
                value=f"{left:.1%} of it are something else",
                limit=f"{TORN:.0%}",
                remedy="End other programs, use a larger buffer, or turn the input down",
            )
    reference = gains[REFERENCE]
    loudest = 0.0
    for level, start in levels.items():
        if abs(_gain(heard, start + delay, REFERENCE, level, rate)[0] / reference - 1.0) > STRAIGHT:
            break
        loudest = level
    return MeasuredCard(
        name=card.name,
        rate=rate,
        gain=reference,
        latency=delay / rate,
        jitter=float(np.ptp(late)) / rate,
        corner=max(_corner(hertz, gain / reference) for hertz, gain in gains.items() if hertz in TONES),
        loudest=loudest,
    )


def loopback(options: argparse.Namespace) -> int:
    """Measure a card, and print the results; return the exit status.

    They are also written to a file if one is named.
    """
    found = measure(open_card(options.card, options.rate, records=True))
    print(f"gain {found.gain:.4f}")
    print(f"latency {1e3 * found.latency:.2f} ms, jitter {1e3 * found.jitter:.3f} ms")
    print(f"corner {found.corner:.2f} Hz: carriers and bands from {lowest(found):.0f} Hz are right within 0.5 %")
    print(f"straight up to {found.loudest:g} of full scale")
    if options.out is not None:
        found.save(options.out)
        print(options.out, file=sys.stderr)
    return 0


def lowest(card: MeasuredCard) -> float:
    """Return the lowest frequency [Hz] that a card transmits.

    It is the lowest one whose amplitude the card changes by no more than 0.5 %. The gain of a first-order high-pass at
    the frequency f is 1 / sqrt(1 + (corner / f)^2).
    """
    return card.corner / float(np.sqrt(1.0 / (1.0 - STRAIGHT) ** 2 - 1.0))


def _click(rate: int) -> Array:
    """Return a sweep of 10 ms from 1 to 6 kHz.

    Its arrival can be found to a part of a sample.
    """
    t = np.arange(round(0.01 * rate)) / rate
    return np.sin(2.0 * np.pi * (1000.0 * t + 0.5 * 5000.0 / 0.01 * t**2)) * np.sin(np.pi * t / 0.01) ** 2


def _played(card: Card, out: Array) -> Array:
    """Play samples; return as many recorded samples.

    A recording that is too short is filled up with zeros.
    """
    heard: list[Array] = []
    sent = 0

    def source(count: int) -> Array:
        nonlocal sent
        part = out[sent : sent + count]
        sent += count
        return np.pad(part, (0, count - len(part)))

    card.run(source, lambda: sent >= len(out), heard.append)
    return np.concatenate([*heard, np.zeros(len(out))])[: len(out)]


def _arrival(heard: Array, click: Array, sent: int, latest: int) -> float:
    """Return the arrival of a click in the input [samples].

    It is the vertex of a parabola through the peak of the correlation with the click.

    Args:
        heard: samples of the input. click: samples of the click. sent: index of the click in the output.
        latest: length of the searched part beyond the click [samples].
    """
    part = heard[sent : sent + latest + len(click)]
    match = np.correlate(part, click, "valid")[: round(GAP / QUIET * latest)]
    k = int(np.argmax(np.abs(match)))
    if 0 < k < len(match) - 1:
        a, b, c = np.abs(match[k - 1 : k + 2])
        return sent + k + 0.5 * float((a - c) / (a - 2.0 * b + c))
    return float(sent + k)


def _gain(heard: Array, start: float, hertz: float, level: float, rate: int) -> tuple[float, float]:
    """Return the gain of a tone, and the part of other signals in it (RMS).

    The gain is the ratio of its amplitude at the input to that at the output.
    """
    count = round(SECONDS * rate)
    part = heard[round(start) : round(start) + count]
    whole = part[count // 5 : count - count // 20]
    angle = 2.0 * np.pi * hertz / rate * np.arange(len(whole))
    basis = np.column_stack([np.sin(angle), np.cos(angle), np.ones(len(whole))])
    found = np.linalg.lstsq(basis, whole, rcond=None)[0]
    size = float(np.hypot(found[0], found[1]))
    left = float(np.sqrt(np.mean((whole - basis @ found) ** 2)))
    return size / level, left / max(size / np.sqrt(2.0), 1e-12)


def _corner(hertz: float, gain: float) -> float:
    """Return the corner frequency [Hz] of a first-order high-pass.

    It is the one that has the given gain at the frequency `hertz` [Hz].
    """
    return hertz * float(np.sqrt(max(1.0 / max(gain, 1e-6) ** 2 - 1.0, 0.0)))
