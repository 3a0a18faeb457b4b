"""A simulated sound card, 'virtual:', that records its own output.

Faults of real cards are options. With a pace of 1 it plays in real time, as a real card does. With the default pace of
0 it plays as fast as it computes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from urllib.parse import parse_qsl

import numpy as np

from ...arrays import Array
from ...errors import DermisError

BLOCK = 256  # [samples] size of a block
OPTIONS = {
    "gain": 0.8,
    "latency_ms": 12.0,
    "corner": 2.0,
    "clip": 1.0,
    "jitter_ms": 0.0,
    "drift": 0.0,
    "tears": 0.0,
    "noise": 1e-5,
    "pace": 0.0,
}


class SoundLoop:
    """A sound card that records its own output; see `Card`.

    Attributes:
        gain: gain of the whole loop [1]. latency: latency of the loop [s]. corner: corner frequency of its high-pass of
            first order [Hz]. clip: largest sample of the output. jitter: largest additional delay of a block [s].
        drift: relative excess of the input's rate [1]. tears: whether the input loses 1 ms in every 50 ms.
        pace: time that it takes to play one second [s]. noise: standard deviation of the input's noise.
        gone: number of samples after which the card is gone; 0: never. played: all samples of the output.
    """

    def __init__(self, name: str, rate: int, options: dict[str, float]) -> None:
        said = {**OPTIONS, **options}
        self.name, self.rate, self.dry = name, rate, 0
        self.gain, self.corner, self.clip = said["gain"], said["corner"], said["clip"]
        self.latency, self.jitter = 1e-3 * said["latency_ms"], 1e-3 * said["jitter_ms"]
        self.tears, self.pace = bool(said["tears"]), said["pace"]
        self.drift, self.noise, self.gone = said["drift"], said["noise"], int(said.get("gone", 0))
        self.played: Array = np.zeros(0)

    def run(
        self, source: Callable[[int], Array], done: Callable[[], bool], sink: Callable[[Array], None] | None = None
    ) -> None:
        """Play until done; see `Card`."""
        parts: list[Array] = []
        while not done():
            if self.gone and BLOCK * len(parts) >= self.gone:
                raise DermisError("the sound card is gone", where=f"sound card '{self.name}'")
            parts.append(np.asarray(source(BLOCK), np.float64))
            if self.pace:
                time.sleep(self.pace * BLOCK / self.rate)
            if sink is not None and len(parts) % 64 == 0:
                sink(np.zeros(0))
        self.played = np.concatenate(parts) if parts else np.zeros(0)
        if sink is not None:
            sink(self._heard(self.played))

    def _heard(self, out: Array) -> Array:
        """Return the input for an output, with high-pass, latency and faults."""
        rng = np.random.default_rng(0)
        through = self.gain * np.clip(out, -self.clip, self.clip)
        frequency = np.fft.rfftfreq(2 * len(through), 1.0 / self.rate)
        ratio = 1j * frequency / max(self.corner, 1e-9)
        high = ratio / (1.0 + ratio)
        through = np.fft.irfft(np.fft.rfft(through, 2 * len(through)) * high)[: len(out)]
        at = np.arange(len(out)) / self.rate * (1.0 + self.drift)
        silent = np.convolve(out == 0.0, np.ones(BLOCK), "same") >= BLOCK  # the delay of a block changes in silence
        span = np.cumsum(np.diff(silent, prepend=False))
        at -= self.latency + rng.uniform(0.0, self.jitter, int(span[-1]) + 1)[span]
        if self.tears:
            at += 1e-3 * np.floor(np.arange(len(out)) * 20.0 / self.rate)
        heard = np.interp(at, np.arange(len(out)) / self.rate, through, left=0.0, right=0.0)
        return np.asarray(heard + rng.normal(0.0, self.noise, len(out)))


def virtual_card(name: str, rate: int) -> SoundLoop:
    """Return the card of 'virtual:?gain=0.5&corner=10'.

    Raises:
        DermisError: an option is unknown, or its value is no number.
    """
    options = {}
    for key, value in parse_qsl(name.partition("?")[2], keep_blank_values=True):
        if key not in (*OPTIONS, "gone"):
            raise DermisError("no such option of the simulated card", where=name, value=key, limit=", ".join(OPTIONS))
        try:
            options[key] = float(value)
        except ValueError:
            raise DermisError("not a number", where=f"{name}, {key}", value=value) from None
    return SoundLoop(name, rate, options)
