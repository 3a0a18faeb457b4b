"""Blender's side of the sender: starts the process, writes requests and signs of life, reads the status.

Only `close` and `wait` wait for the sender. A closed sender brings its device to the safe state at the device's own
speed. If `close` does not wait long enough for that, the sender finishes alone. A client that connects to the same port
meanwhile reports that it is waiting. The closed sender's shared state is removed after it has ended.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

from .. import clock
from ..errors import DermisError
from ..work.child import ChildProcess, close_at_exit, command
from .request import request_of
from .shared_state import MAX_VALUES, SharedState
from .state import State

# If a sender has written no status for longer than this, it is reported as stalled [s]. A sender writes a status every
# 0.05 s, but none while it reads a track.
QUIET = 1.0
UNSEEN = 0.5  # if the status has not been read for this long, the sender's silence is counted from the next reading [s]
MAX_CLOSE_SECONDS = 0.2  # `close` waits this long for the sender, which then finishes alone [s]

_ending: list[SenderClient] = []  # closed clients whose senders are still on the way to the safe state
_lost: list[str] = []  # reports: a stream failed, or a device may not be in its safe state; `connect` deletes them


class SenderClient:
    """A sender in a child process. When its parent process ends, it brings its device to the safe state and ends too.

    Raises:
        DermisError: the process cannot be started.
    """

    def __init__(self, verb: Sequence[str] = ("stream", "send")) -> None:
        self._shared = SharedState.create()
        self._request: dict[str, Any] = {}
        self._stops = 0
        self._arm_id = 0
        self._closed = False
        self._number = 0  # number of the last status seen; below: when it changed, and when it was last read [s]
        self._changed = self._looked = 0.0
        self._before: SenderClient | None = None  # closed client of the same port whose sender has not ended
        _reap()
        try:
            self._child = ChildProcess("the sender", command(*verb, "--state", str(self._shared.path)))
        except DermisError:
            self._shared.remove()
            raise
        close_at_exit(self)

    @property
    def pid(self) -> int:
        """Process id of the sender."""
        return self._child.pid

    @property
    def alive(self) -> bool:
        """Return whether the sender still runs."""
        return self._child.alive

    def connect(self, url: str, protocol: str, device: str, preset: Mapping[str, Any], **more: Any) -> None:
        """Hold a link; `more` are other fields of `request.StreamRequest`. Nothing is armed by this.

        If a closed sender of this process still needs the port to reach its safe state, the new one connects when the
        port is free.
        """
        _reap()
        _lost.clear()
        self._before = next((one for one in _ending if one._request.get("url") == url), None)
        self.set(connect=True, url=url, protocol=protocol, device={"key": device, "preset": dict(preset)}, **more)

    def set(self, **fields: Any) -> None:
        """Change fields of the request.

        Raises:
            DermisError: an unknown field, or a value that is not allowed; the request then stays as it was.
        """
        request_of({**self._request, **fields}).check()
        if any(self._request.get(k, _NONE) != v for k, v in fields.items()):
            self._request |= fields
            self._write()

    def arm(self) -> None:
        """Arm the device: it may move until it is sent to its safe state. Call this only when a person asks for it."""
        self._arm_id += 1
        self.set(arm_id=self._arm_id, arm_at=clock.now(), stops=self._stops)

    def disarm(self) -> None:
        """Bring the device to its safe state."""
        self.set(arm_id=0)

    def stop(self) -> None:
        """Send the device to its safe state now; this goes through the heartbeat and needs no request."""
        self._stops += 1
        self._shared.write_heartbeat(self._stops, False, None)

    def heartbeat(self, *, playing: bool = False, time: float | None = None, values: Sequence[float] = ()) -> None:
        """Give a sign of life, with the state that Blender shows."""
        if len(values) > MAX_VALUES:
            raise DermisError("more values than a heartbeat can hold", value=len(values), limit=str(MAX_VALUES))
        self._shared.write_heartbeat(self._stops, playing, time, tuple(values))

    def status(self) -> dict[str, Any]:
        """Return the sender's status; its `state` is 'dead' if the process has ended."""
        status = self._shared.read_status()
        if self._before is not None:
            message = self._before._ends()
            self._write()
            if self._before is not None:
                return {
                    **status,
                    "state": State.CONNECTING,
                    "armed": False,
                    "message": f"waiting for the port: the previous sender still uses it ({message})",
                }
        if not self.alive:
            message = f"The sender has ended: {self._child.said().rstrip('.')}"
            silence = status.get("silence", {})
            if status.get("astray"):
                message += (
                    f". The device may not be in its safe state, and {silence.get('text', '')}: switch the supply off"
                )
            return {**status, "state": State.DEAD, "armed": False, "pose_known": False, "message": message}
        if quiet := self._quiet():
            message = f"The sender has given no sign for {quiet:.1f} s, so Stop may not reach the device"
            return {**status, "state": State.STALLED, "message": f"{message}. Switch its supply off"}
        return status or {"state": State.DISCONNECTED, "message": "", "armed": False}

    def _quiet(self) -> float:
        """Return the time since the sender's last status if this time exceeds `QUIET`, else 0 [s]."""
        now, number = time.monotonic(), self._shared.status_number
        if number != self._number or now - self._looked > UNSEEN:
            self._number, self._changed = number, now
        self._looked = now
        return now - self._changed if number and now - self._changed > QUIET else 0.0

    def close(self) -> None:
        """End the sender after its device is safe, and wait at most `MAX_CLOSE_SECONDS`. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(OSError, ValueError):
            self.stop()
        self._child.end(MAX_CLOSE_SECONDS)
        _ending.append(self)
        _reap()

    def _ends(self) -> str:
        """Return the remaining task of a closed sender, in words."""
        return str(self._shared.read_status().get("message", "")) or "going to the safe state"

    def _gone(self) -> bool:
        """Return whether a closed sender has ended, and remove its shared state if so; one that hangs is killed."""
        gone = self._child.gone(self._shared.status_number)
        if gone:
            status = self._shared.read_status()
            url = self._request.get("url", "")
            if status.get("counters", {}).get("safe states not confirmed"):
                _lost.append(f"{status.get('message', '')} ({url})")
            elif status.get("astray") and not status.get("ended"):
                _lost.append(f"the sender at {url} ended on the way to the safe state: switch the device's supply off")
            self._shared.remove()
        return gone

    def _write(self) -> None:
        """Write the request, unless an earlier sender has the port."""
        _reap()
        if self._before not in _ending:
            self._before = None
            self._shared.write_request(self._request)

    def wait(self, state: str, seconds: float = 5.0) -> dict[str, Any]:
        """Wait for a state. No heartbeat is sent meanwhile. For scripts and tests, never for a user interface.

        Raises:
            DermisError: the state was not reached in this time.
        """
        end = time.monotonic() + seconds
        while True:
            status = self.status()
            if status["state"] == state:
                return status
            if time.monotonic() > end:
                raise DermisError(f"the sender did not reach the state '{state}'", value=str(status))
            time.sleep(0.002)

    def __enter__(self) -> SenderClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


_NONE = object()


def _reap() -> None:
    """Forget closed senders that have ended."""
    _ending[:] = [client for client in _ending if not client._gone()]


def note_loss(text: str) -> None:
    """Note why a stream ended with an error; `leaving` returns it until the next `connect`."""
    _lost.append(text)


def leaving() -> str:
    """Return, as text, the unfinished tasks of closed senders and the reasons why streams failed; '' for none."""
    _reap()
    return "; ".join([*_lost, *(f"{one._ends()} ({one._request.get('url', '')})" for one in _ending)])
