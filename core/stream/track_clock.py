"""The time of the track while Blender plays.

Blender reports it now and then, by its frames, but commands leave all the time.
"""

from __future__ import annotations

LEAD = 0.1  # [s] how far the track may run ahead of the last frame that Blender showed
JUMP = 0.25  # [s] A frame further off than this is a jump, not a playback that is a little late.


class TrackClock:
    """Follows a playback by its frames, and gives the time between them.

    Attributes:
        free: go on while no frame arrives, instead of waiting at `LEAD` after the last one.
    """

    def __init__(self, *, free: bool = False) -> None:
        self.free = free
        self.running = False
        self._at = 0.0  # track time at the moment `_when` [s]
        self._when = 0.0  # [s]
        self._speed = 1.0
        self._shown, self._seen = 0.0, 0.0  # the last frame's track time, and the moment when it came [s]

    def report(self, time: float, playing: bool, now: float) -> None:
        """Take Blender's state now: track time [s] and whether it plays."""
        if not playing:
            self.running, self._at, self._when, self._shown, self._seen = False, time, now, time, now
            return
        if self.running and time == self._shown:
            return  # the same frame is still on the screen
        error = time - self.at(now, now)
        if not self.running or abs(error) > JUMP:
            self._at, self._when, self._speed = time, now, 1.0
        else:
            period = max(now - self._seen, 1e-3)
            self._at, self._when = self.at(now, now) + 0.1 * error, now
            self._speed = min(max(self._speed + 0.02 * error / period, 0.05), 2.0)
        self.running, self._shown, self._seen = True, time, now

    def at(self, moment: float, now: float) -> float:
        """Return the track time at a moment [s] that is `now` or later."""
        if not self.running:
            return self._at
        time = self._at + (moment - self._when) * self._speed
        return time if self.free else min(time, self._shown + LEAD + max(moment - now, 0.0))
