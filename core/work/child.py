"""Child processes of this engine: how they are started, watched and ended; senders and jobs run in them.

Python's multiprocessing does not work inside Blender: its children import Blender's main module again. A child's
standard input is its parent pipe: when that ends, the parent has let go or is gone, and the child ends in its own way.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from ..errors import DermisError

HOME = Path(__file__).resolve().parents[2]  # the folder that contains `core`
PACKAGE = Path(__file__).resolve().parents[1].name
MAX_SILENT_SECONDS = 5.0  # a child that was told to end and gives no sign of life for this long hangs
MAX_UNSEEN_SECONDS = 1.0  # whoever has not looked for so long may have slept itself, and knows nothing of the child
MAX_LAST_SECONDS = 2.0  # from the last that a dying child replies to its end
MAX_LOG_CHARACTERS = 500  # the end of a child's output, which says why it died


class Owner(Protocol):
    """Whoever has child processes and ends them in its own way."""

    def close(self) -> None:
        """End them. Safe to call twice."""


_owners: weakref.WeakSet[Owner] = weakref.WeakSet()


def command(*arguments: str) -> list[str]:
    """Return the command line that runs this engine in a child process."""
    return [sys.executable, "-s", "-m", PACKAGE, *arguments]


def environment() -> dict[str, str]:
    """Return a child's environment: it finds this engine and the same installed packages, in the same order."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)  # where this process was told to look, so does its child
    paths = [str(HOME), *(p for p in sys.path if p.rstrip("/\\").endswith("-packages") or (p and p in given))]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)), "OPENBLAS_NUM_THREADS": "1"}


class ChildProcess(subprocess.Popen[bytes]):
    """A process that this one has started, and that ends with it.

    Args:
        name: for errors, such as 'the sender'.
        line: the command line, see `command`.
        replies: read its standard output from `stdout`; dropped otherwise.

    Raises:
        DermisError: it cannot be started.
    """

    def __init__(self, name: str, line: list[str], *, replies: bool = False) -> None:
        self._sign: object = None
        self._looked = 0.0  # when this process looked after it last
        self._heard = 0.0  # when the last sign of life came
        self._log = tempfile.TemporaryFile(prefix="dermis-log-")  # without a name: it goes with its last user
        try:
            super().__init__(
                line,
                env=environment(),
                cwd=tempfile.gettempdir(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if replies else subprocess.DEVNULL,
                stderr=self._log,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            self._log.close()
            raise DermisError(f"{name} cannot be started", where=line[0], value=error.strerror) from error

    @property
    def alive(self) -> bool:
        """Return whether it still runs."""
        return self.poll() is None

    def said(self) -> str:
        """Return why one that ends does, when it has: its exit status and the end of its log."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(MAX_LAST_SECONDS)
        text = ""
        with contextlib.suppress(OSError, ValueError):  # closed
            self._log.seek(0)
            text = self._log.read().decode("utf-8", "replace").strip()
        return f"status {self.returncode}: {text[-MAX_LOG_CHARACTERS:]}".removesuffix(": ")

    def kill(self) -> None:
        """End it at once, whatever it does; it is gone then."""
        super().kill()
        self.wait()

    def end(self, seconds: float, *, kill: bool = False) -> None:
        """Close the parent pipe, and wait for the end.

        Args:
            seconds: the longest to wait [s]. kill: it is killed after that, instead of going on by itself.
        """
        assert self.stdin is not None
        with contextlib.suppress(OSError):
            self.stdin.close()
        try:
            self.wait(seconds)
        except subprocess.TimeoutExpired:
            if kill:
                self.kill()
        self._heard = time.monotonic()
        self.gone(self._sign)

    def gone(self, sign: object = None) -> bool:
        """Return whether it has ended, and close its pipes then; one that hangs in its ending is killed.

        Args:
            sign: anything that changes while it lives.
        """
        assert self.stdin is not None
        now, looked = time.monotonic(), self._looked
        self._looked = now
        if sign != self._sign or now - looked > MAX_UNSEEN_SECONDS:
            self._sign, self._heard = sign, now
        elif self.stdin.closed and now - self._heard > MAX_SILENT_SECONDS:
            self.kill()
        if self.alive:
            return False
        for file in filter(None, (self._log, self.stdin, self.stdout)):
            with contextlib.suppress(OSError):
                file.close()
        return True


def follow_parent(gone: Callable[[], None], take: Callable[[bytes], object] = len) -> None:
    """Watch the parent pipe from a thread of its own; this is the child's side.

    Args:
        gone: called when the parent has let go or is gone. take: called with each line that comes before.
    """

    def watch() -> None:
        # Not by sys.stdin: a thread that waits there holds its lock, which aborts the end of the program.
        rest, stdin = b"", sys.stdin.fileno()
        while data := os.read(stdin, 65536):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                take(line + b"\n")
        if rest:
            take(rest)
        gone()

    threading.Thread(target=watch, daemon=True).start()


def close_at_exit(owner: Owner) -> None:
    """Close an owner of child processes when Python ends, if it is still there then."""
    _owners.add(owner)


def close_all() -> None:
    """Close every owner of child processes; a sender whose device needs longer finishes by itself."""
    for owner in list(_owners):
        owner.close()


atexit.register(close_all)
if hasattr(os, "register_at_fork"):  # whoever splits off has no threads to wait for, and no child to end
    os.register_at_fork(after_in_child=_owners.clear)
