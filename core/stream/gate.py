"""The last thing before the wire: calibration, limits, slew and ramp, whatever the track or a person asks for."""

from __future__ import annotations

from collections import Counter

import numpy as np

from .wire import Array, Wire

SLACK = 1e-9
KINDS = ("range", "disc", "slew", "not_finite")


class Gate:
    """Turns wanted values into driven ones that can do no harm; every limit applied is counted.

    Attributes:
        last: what was driven last [units], shape (channels,).
    """

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self._counts = {kind: np.zeros(wire.count, np.int64) for kind in KINDS}
        self.last: Array = self.driven(wire.rest)
        self._time = -np.inf
        self._ramp: tuple[Array, float, float] | None = None

    @property
    def limited(self) -> Counter[str]:
        """How many values 'range', 'disc', 'slew' or 'not_finite' changed, per 'channel.kind'."""
        names = self.wire.names
        return Counter({f"{names[i]}.{kind}": int(counts[i]) for kind, counts in self._counts.items()
                        for i in np.flatnonzero(counts)})  # fmt: skip

    def driven(self, wanted: Array) -> Array:
        """Return calibrated values within the limits, without counting."""
        wire = self.wire
        return np.minimum(np.maximum(wire.zero + wire.gain * wanted, wire.least), wire.most)

    def begin(self, pose: Array, time: float, seconds: float) -> None:
        """Start from a pose [units]: blend from there to what is wanted over some seconds, never faster than slew.

        A pose outside the limits is left at that speed too, not at once.
        """
        self.last = np.where(np.isfinite(pose), pose, self.driven(self.wire.rest))
        self._time = time
        self._ramp = (self.last.copy(), time, seconds) if seconds > 0 else None

    @property
    def ramping(self) -> bool:
        """Tell whether the blend from the first pose still goes on."""
        return self._ramp is not None

    def step(self, wanted: Array, time: float) -> Array:
        """Return what to drive at a time [s] that never goes back, and remember it."""
        wire = self.wire
        driven = wire.zero + wire.gain * wanted
        finite = np.isfinite(driven)
        if not finite.all():
            self._counts["not_finite"] += ~finite
            driven = np.where(finite, driven, self.last)
        held = np.minimum(np.maximum(driven, wire.least), wire.most)
        if not (held == driven).all():
            # What a rounding of the preset's units does is no violation.
            self._counts["range"] += np.abs(held - driven) > SLACK * np.maximum(np.abs(held), 1e-3)
        if wire.disc is not None:
            held = self._disc(held, wire.disc)
        ramping = self._ramp is not None
        if self._ramp is not None:
            start, since, seconds = self._ramp
            part = (time - since) / seconds
            if part >= 1:
                self._ramp, ramping = None, False
            else:
                part = max(part, 0.0)
                held = start + (held - start) * (part * part * (3 - 2 * part))
        most = wire.slew * max(time - self._time, 1e-9)  # not 0: inf * 0 is no number
        change = held - self.last
        allowed = np.minimum(np.maximum(change, -most), most)
        fast = np.abs(change) > most * (1 + 1e-6) + 1e-12
        if fast.any():
            if not ramping:
                self._counts["slew"] += fast
            held = np.where(fast, self.last + allowed, held)
        self.last, self._time = held, time
        return held

    def _disc(self, values: Array, disc: tuple[int, int, float]) -> Array:
        i, j, radius = disc
        reach = float(np.hypot(values[i], values[j]))
        if reach <= radius * (1 + SLACK):
            return values
        values = values.copy()
        values[[i, j]] *= radius / reach
        self._counts["disc"][i] += 1
        return values
