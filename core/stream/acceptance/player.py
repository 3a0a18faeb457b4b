"""A program that plays a slow movement, and is ended by a signal."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from ...track import csv
from ...track.command_track import CommandTrack
from ...work.child import command, environment
from ..protocols.wire import Wire
from .bench import RAMPING, SAFE_MS, Bench

PLAY_SECONDS = 30.0  # [s] duration of the slow movement


def play_and_end(bench: Bench, away: Array, play: list[str], number: signal.Signals, seconds: float) -> str:
    """Play a slow movement in another process, and end it by a signal.

    Return the failure in words; '' if there is none.

    Args:
        bench: bench whose link is closed meanwhile. away: far end of the movement [units], shape (channels,).
        play: arguments of `stream play` for this device. number: the signal.
        seconds: longest duration of the movement to the safe pose [s].

    Raises:
        DermisError: the program does not end.
    """
    with tempfile.TemporaryDirectory(prefix="dermis-accept-") as folder:
        track = Path(folder) / "slow.csv"
        csv.write(slow_track(bench.wire, away), track)
        pipe, verb = subprocess.PIPE, command("stream", "play", str(track), *play, "--yes")
        child = subprocess.Popen(verb, env=environment(), stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe)
        longest = 30.0 + min(bench.wire.safe_seconds, RAMPING)
        try:
            bench.until(lambda: child.poll() is not None, 6.0)  # time for its start, a board's reset and the ramp
            if child.poll() is not None:
                return "it did not play: " + child.communicate()[1].decode("utf-8", "replace").strip()[-200:]
            child.send_signal(number)
            _, said = child.communicate(timeout=longest)
        except subprocess.TimeoutExpired as error:
            raise DermisError("the playing program did not end", value=number.name) from error
        finally:
            _ended(child, longest)
        # After a killed program only the board's own watchdog acts.
        bench.run(SAFE_MS / 1e3 + seconds)
        if child.returncode == (-number if number.name == "SIGKILL" else 128 + number):
            return ""
        return f"it ended with {child.returncode}: " + said.decode("utf-8", "replace").strip()[-200:]


def _ended(child: subprocess.Popen[bytes], longest: float) -> None:
    """End a playing program, which first brings its device to the safe state.

    If it does not end within `longest` [s], it is killed.
    """
    if child.poll() is None:
        child.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.communicate(timeout=longest)
    child.kill()
    child.communicate()


def slow_track(wire: Wire, away: Array) -> CommandTrack:
    """Return a track with a slow movement between the safe pose and another one.

    `away`: the other pose in driven values [units], shape (channels,).
    """
    spec = wire.spec
    times = np.arange(int(PLAY_SECONDS * spec.rate)) / spec.rate
    values = np.tile([c.rest for c in spec.channels], (len(times), 1)).astype(np.float64)
    part = 0.5 - 0.5 * np.cos(2 * np.pi * times / 4.0)
    for k, column in enumerate(wire.columns):
        goal, start = (away[k] - wire.zero[k]) / wire.gain[k], (wire.safe[k] - wire.zero[k]) / wire.gain[k]
        values[:, column] = start + part * (goal - start)
    return CommandTrack(spec, times, values)
