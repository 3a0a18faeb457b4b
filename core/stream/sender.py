"""The sender's process, which runs the streamer for Blender.

It reads requests and heartbeats from the shared state, ticks the streamer on a monotonic clock, and writes the status.

Its standard input is the parent pipe. When the pipe ends, Blender is gone, and the device goes to its safe state, at
its own speed. The process outlives Blender until the device is in its safe state and all messages have left the link,
or until the attempt is given up. A signal that asks the process to end has the same effect. A second signal changes
nothing.
"""

from __future__ import annotations

import contextlib
import gc
import signal
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .. import clock
from ..work.child import follow_parent
from .request import request_of
from .shared_state import SharedState
from .signals import Signals
from .state import State
from .streamer import Streamer
from .touch_panel_source import Screen
from .virtual.link import open_any_link

STATUS_EVERY = 0.05  # [s] between two writings of the status
# FAILURES: number of failed ticks after which the way to the safe state is given up.
# AGAIN: [s] from a failed tick to the next tick.
FAILURES, AGAIN = 1000, 0.002


def run(path: Path, load_screen: Callable[[Path], Screen] | None = None) -> int:
    """Serve a shared state until its owner is gone or a signal comes.

    Returns the exit status.
    """
    shared = SharedState.open(path)
    # The reasons to end. A list, since an Event would wait for itself if a signal came while another one is handled.
    ended: list[str] = []
    follow_parent(lambda: ended.append("parent pipe"))
    for name in Signals.NAMES:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), lambda number, _: ended.append(str(number)))
    streamer = Streamer(open_any_link, load_screen, clock.now)
    gc.collect()
    gc.freeze()  # a garbage collection in the middle of a stream then has few objects to examine
    try:
        _loop(shared, streamer, ended)
    finally:  # a defect of this program must not leave a device under voltage either
        _finish(shared, streamer)
    return 0


def _loop(shared: SharedState, streamer: Streamer, ended: list[str]) -> None:
    seen_request = seen_heartbeat = 0
    status_at, shown = 0.0, ""
    while not ended:
        now = clock.now()
        if shared.heartbeat_number != seen_heartbeat:
            heartbeat = shared.read_heartbeat()
            if heartbeat is not None and heartbeat.number != seen_heartbeat:
                seen_heartbeat = heartbeat.number
                streamer.heartbeat(heartbeat, now)
        if shared.request_number != seen_request:
            number = shared.request_number
            request = shared.read_request()
            if request:
                seen_request = number
                streamer.apply(request_of(request), clock.now())
        due = streamer.tick(clock.now())
        now = clock.now()
        if now >= status_at or streamer.state != shown:
            shown, status_at = streamer.state, now + STATUS_EVERY
            _tell(shared, streamer)
            now = clock.now()
        if due > now:
            time.sleep(due - now)


def _finish(shared: SharedState, streamer: Streamer) -> None:
    """Bring the device to its safe state, and remove the shared state.

    The ramp to the safe state takes as long as it needs. The link is closed after it. After `FAILURES` failed ticks
    both are given up.
    """
    streamer.shut(clock.now())
    status_at, failures = 0.0, 0
    while not streamer.finished and failures < FAILURES:
        try:
            due = streamer.tick(clock.now())
        except Exception:  # a defect in one tick must not end the way to the safe state
            failures += 1
            traceback.print_exc()
            due = clock.now() + AGAIN
        if (now := clock.now()) >= status_at:
            status_at = now + STATUS_EVERY
            _tell(shared, streamer)
        time.sleep(max(due - clock.now(), 0.0))
    _tell(shared, streamer, state=State.DISCONNECTED, ended=streamer.finished)
    shared.remove()  # its owner may be gone without having removed it


def _tell(shared: SharedState, streamer: Streamer, **more: Any) -> None:
    """Write the status, or its most important part if the whole fails."""
    try:
        shared.write_status({**streamer.status(), **more})
    except Exception as error:  # the status is too long, or an adapter's value in it is no plain JSON
        least: dict[str, Any] = {
            "state": str(streamer.state),
            "armed": streamer.armed,
            "message": f"{str(streamer.message)[:2000]} (the rest cannot be told: {type(error).__name__})",
            "counters": {name: int(count) for name, count in streamer.counters.items()},
            "astray": streamer.drive is not None and streamer.drive.astray,
        }
        with contextlib.suppress(Exception):
            shared.write_status({**least, **more})
