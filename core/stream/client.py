"""Blender's side of the sender: starts the process, pins wishes and signs of life, reads the status. Never waits."""

from __future__ import annotations

import atexit
import contextlib
import os
import subprocess
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import DermisError
from ..work import command, environment
from .board import MOST_VALUES, Board
from .wish import wish_of

GRACE = 1.0  # the sender may take this long to end by itself [s]

_open: weakref.WeakSet[SenderClient] = weakref.WeakSet()


class SenderClient:
    """A sender process of this one; it dies with it.

    Raises:
        DermisError: the process cannot be started.
    """

    def __init__(self, verb: Sequence[str] = ("stream", "send")) -> None:
        self._board = Board.create()
        self._wish: dict[str, Any] = {}
        self._stops = 0
        self._ticket = 0
        self._log = Path(tempfile.mkstemp(prefix="dermis-sender-", suffix=".log")[1])
        try:
            with self._log.open("wb") as log:
                self._process = subprocess.Popen(
                    command(*verb, "--board", str(self._board.path)), env=environment(), stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL, stderr=log, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                    cwd=tempfile.gettempdir(),
                )  # fmt: skip
        except OSError as error:
            self._board.remove()
            raise DermisError("the sender cannot be started", value=error.strerror) from error
        _open.add(self)

    @property
    def pid(self) -> int:
        """Process id of the sender."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Tell whether the sender still runs."""
        return self._process.poll() is None

    def connect(self, url: str, protocol: str, device: str, preset: Mapping[str, Any], **more: Any) -> None:
        """Hold a link; `more` are other fields of `wish.Wish`. Nothing is armed by this."""
        self.set(connect=True, url=url, protocol=protocol, device={"key": device, "preset": dict(preset)}, **more)

    def disconnect(self) -> None:
        """Let the link go; an armed device goes to its safe state first."""
        self.set(connect=False, arm=0)

    def set(self, **fields: Any) -> None:
        """Change fields of the wish.

        Raises:
            DermisError: a field that there is none of, or that cannot be; nothing is changed then.
        """
        wish_of({**self._wish, **fields}).check()
        if any(self._wish.get(k, _NONE) != v for k, v in fields.items()):
            self._wish |= fields
            self._board.wish(self._wish)

    def arm(self) -> None:
        """Let the device move, once; call it because a person asked for it."""
        self._ticket += 1
        self.set(arm=self._ticket, stops=self._stops)

    def disarm(self) -> None:
        """Bring the device to its safe state."""
        self.set(arm=0)

    def stop(self) -> None:
        """Safe state, now. Works where nothing else does."""
        self._stops += 1
        self._board.beat(self._stops, False, None)

    def beat(self, *, playing: bool = False, time: float | None = None, values: Sequence[float] = ()) -> None:
        """Give a sign of life, with what Blender shows."""
        if len(values) > MOST_VALUES:
            raise DermisError("more values than a beat can hold", value=len(values), limit=str(MOST_VALUES))
        self._board.beat(self._stops, playing, time, tuple(values))

    def status(self) -> dict[str, Any]:
        """Return how things stand; `state` is 'dead' where the sender has died."""
        status = self._board.read_status()
        if not self.alive:
            words = self._said() or f"status {self._process.returncode}"
            return {**status, "state": "dead", "armed": False, "words": f"The sender has ended: {words}"}
        return status or {"state": "disconnected", "words": "", "armed": False}

    def close(self) -> None:
        """End the sender, the device safe first. Safe to call twice."""
        if self not in _open:
            return
        _open.discard(self)
        with contextlib.suppress(OSError, ValueError):
            self.stop()
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._board.remove()
        with contextlib.suppress(OSError):
            os.unlink(self._log)

    def wait(self, state: str, seconds: float = 5.0) -> dict[str, Any]:
        """Wait for a state, giving signs of life meanwhile; for scripts and tests, never for a user interface.

        Raises:
            DermisError: it did not come.
        """
        end = time.monotonic() + seconds
        while True:
            status = self.status()
            if status["state"] == state:
                return status
            if time.monotonic() > end:
                raise DermisError(f"the sender did not come to '{state}'", value=str(status))
            time.sleep(0.002)

    def __enter__(self) -> SenderClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _said(self) -> str:
        try:
            return self._log.read_bytes().decode("utf-8", "replace").strip()[-300:]
        except OSError:
            return ""


_NONE = object()


def close_all() -> None:
    """End every sender that is still open."""
    for client in list(_open):
        client.close()


atexit.register(close_all)
