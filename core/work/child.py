"""Child processes of this engine: start, supervision and end.

Senders and jobs run in child processes. Python's multiprocessing does not work inside Blender, because its children
import Blender's main module again. The standard input of a child is its parent pipe. When the pipe closes, the parent
has closed it or has ended, and the child ends by itself.
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
MAX_SILENT_SECONDS = 5.0  # [s] a child that shall end hangs if it gives no sign of life for this time
# [s] After a longer interval between two checks this process may have been suspended itself, so the child's silence
# during this interval does not count.
MAX_UNSEEN_SECONDS = 1.0
MAX_LAST_SECONDS = 2.0  # [s] longest wait for the end of a child after its last reply
MAX_LOG_CHARACTERS = 500  # number of last characters of a child's output that an error quotes


class Owner(Protocol):
    """Owner of child processes, which ends them in its own way."""

    def close(self) -> None:
        """End the child processes. Safe to call twice."""


_owners: weakref.WeakSet[Owner] = weakref.WeakSet()


def command(*arguments: str) -> list[str]:
    """Return the command line that runs this engine in a child process."""
    return [sys.executable, "-s", "-m", PACKAGE, *arguments]


def environment() -> dict[str, str]:
    """Return the environment variables of a child.

    With them, the child finds this engine and the same packages in the same order.
    """
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)  # folders given to this process
    paths = [str(HOME), *(p for p in sys.path if p.rstrip("/\\").endswith("-packages") or (p and p in given))]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)), "OPENBLAS_NUM_THREADS": "1"}


class ChildProcess(subprocess.Popen[bytes]):
    """A process that this process starts and that ends with it.

    Args:
        name: name for errors, such as 'the sender'.
        line: command line, see `command`.
        replies: whether the process's standard output can be read from `stdout`. If not, it is dropped.

    Raises:
        DermisError: the process cannot be started.
    """

    def __init__(self, name: str, line: list[str], *, replies: bool = False) -> None:
        self._sign: object = None
        self._looked = 0.0  # time of the last check by `gone`
        self._heard = 0.0  # time of the last sign of life
        self._log = tempfile.TemporaryFile(prefix="dermis-log-")  # deleted when the last process closes it
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
        """Whether the process still runs."""
        return self.poll() is None

    def said(self) -> str:
        """Return exit status and end of the log of a process that is ending."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(MAX_LAST_SECONDS)
        text = ""
        with contextlib.suppress(OSError, ValueError):  # closed
            self._log.seek(0)
            text = self._log.read().decode("utf-8", "replace").strip()
        return f"status {self.returncode}: {text[-MAX_LOG_CHARACTERS:]}".removesuffix(": ")

    def kill(self) -> None:
        """Kill the process and wait for its end."""
        super().kill()
        self.wait()

    def end(self, seconds: float, *, kill: bool = False) -> None:
        """Close the parent pipe and wait for the end of the process.

        Args:
            seconds: longest wait [s].
            kill: whether the process is killed after this time. If not, it continues to its own end.
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
        """Return whether the process has ended, and close its pipes in this case.

        A process that shall end is killed if it gives no sign of life for `MAX_SILENT_SECONDS`.

        Args:
            sign: any value that changes while the process lives.
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
    """Watch the parent pipe in a thread of its own; the child calls this.

    Args:
        gone: function that is called when the parent has closed the pipe or has ended.
        take: function that is called with each line from the pipe.
    """

    def watch() -> None:
        # sys.stdin is not used: a thread that waits for it holds its lock, and Python aborts at exit because of it.
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
    """Close an owner of child processes when Python ends.

    Nothing is done if the owner no longer exists then.
    """
    _owners.add(owner)


def close_all() -> None:
    """Close every owner of child processes.

    A sender whose device needs more time finishes by itself.
    """
    for owner in list(_owners):
        owner.close()


atexit.register(close_all)
if hasattr(os, "register_at_fork"):  # a forked process has no child to end
    os.register_at_fork(after_in_child=_owners.clear)
