"""What every level of the tests shares: the switches, real time, and an exit that Blender cannot hang."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

_status = 1
STARVED = 0.03  # [s] by which a thread that only sleeps may wake too late before the machine is to blame
CROWDED = 0.1  # part of a test's time that its processes waited for a processor, from which the machine is to blame
TRIES = 5
LINES = ("3.11", "3.13")
LEFT = pytest.StashKey[int]()  # how many tests the other line runs
PROC = Path("/proc")
LOOKS = 0.05  # between two looks at the processes of a test [s]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --long, which also runs the tests marked `long`, and --beside, which leaves some to the other line."""
    parser.addoption("--long", action="store_true", default=False, help="also run the tests that take minutes")
    parser.addoption("--beside", metavar="PYTHON", help="leave to this Python, which runs too, what is marked for it")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what is marked `long` unless it was asked for; leave out what the other line runs."""
    if not config.getoption("--long"):
        skip = pytest.mark.skip(reason="runs with --long only")
        for item in items:
            if item.get_closest_marker("long"):
                item.add_marker(skip)
    beside = config.getoption("--beside")
    left = [item for item in items if line_of(item) == beside] if beside else []
    if left:
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if line_of(item) != beside]
        config.stash[LEFT] = len(left)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Keep the collector of garbage from walking through thousands of collected tests again and again."""
    gc.freeze()


def line_of(item: pytest.Item) -> str | None:
    """Return the Python whose line alone has to run a test, None where each line has to."""
    mark = item.get_closest_marker("one_line")
    if mark is None:
        return None
    python, why = mark.args
    assert python in LINES and why, f"{item.nodeid}: one_line names a Python of {', '.join(LINES)}, and why"
    return str(python)


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how many tests the other line has to run."""
    if count := config.stash.get(LEFT, 0):
        terminalreporter.write_line(f"left to Python {config.getoption('--beside')}: {count} tests")


class _Sleeper(threading.Thread):
    """Sleeps for 5 ms again and again, and notes the latest that it woke; looks at the test's processes on the way.

    Attributes:
        worst: by how much it woke too late [s].
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.worst, self._ends = 0.0, threading.Event()
        self._tree = _Tree()

    def run(self) -> None:
        """Note how late every wake-up is, and how long the processes have waited."""
        looks = time.perf_counter()
        while not self._ends.is_set():
            start = time.perf_counter()
            time.sleep(0.005)
            self.worst = max(self.worst, time.perf_counter() - start - 0.005)
            if start >= looks:
                self._tree.look()
                looks = time.perf_counter() + LOOKS

    def end(self) -> float:
        """Return the worst delay [s]."""
        self._ends.set()
        self.join()
        return self.worst

    def waited(self) -> float:
        """Return for how long this process and those that it has started waited for a processor [s]; after the end."""
        self._tree.look()
        return self._tree.waited()


class _Tree:
    """This process and what it starts from now on: how long they have waited for a processor, as far as Linux says."""

    def __init__(self, proc: Path = PROC) -> None:
        self._proc, self._own = proc, os.getpid()
        self._seen = {self._own: _delay(proc, self._own)}  # the latest, by process
        self._before, self._strange = dict(self._seen), set(_processes(proc)) - {self._own}

    def look(self) -> None:
        """Note what they have waited until now."""
        for process in sorted(_processes(self._proc) - self._strange - self._seen.keys()):
            if _parent(self._proc, process) in self._seen:
                self._seen[process] = 0.0
            else:
                self._strange.add(process)
        for process, known in self._seen.items():
            self._seen[process] = max(known, _delay(self._proc, process))

    def waited(self) -> float:
        """Return the sum [s]."""
        return sum(self._seen.values()) - sum(self._before.values())


def _processes(proc: Path) -> set[int]:
    try:
        return {int(name) for name in os.listdir(proc) if name.isdigit()}
    except OSError:  # no Linux
        return set()


def _parent(proc: Path, process: int) -> int:
    try:
        return int((proc / str(process) / "stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, IndexError, ValueError):  # it has ended
        return 0


def _delay(proc: Path, process: int) -> float:
    """Return for how long the threads of a process have been ready to run and did not [s]; 0 where it does not say."""
    found = 0.0
    with contextlib.suppress(OSError, IndexError, ValueError):
        for thread in (proc / str(process) / "task").iterdir():
            found += 1e-9 * float((thread / "schedstat").read_text().split()[1])
    return found


@contextlib.contextmanager
def _turn(alone: bool) -> Iterator[None]:
    """Take part in real time, or have it alone: two lines of tests on one machine would starve each other's senders."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with open(Path(tempfile.gettempdir()) / f"dermis-real-time-{os.getuid()}.lock", "a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a test marked `real_time`; where it fails while the machine let nobody run, it has not been tried yet.

    A watchdog of 50 ms acts when a process gets no processor for so long: that is its task, and no defect. A failure
    counts at once where a thread that only sleeps always woke in time, and the test's processes hardly waited for a
    processor: of two that work the one that sleeps more is served first, so the sleeper alone does not see what the
    sender, the device and their starts are kept from. It is tried again while no other of its kind runs.
    """
    if item.get_closest_marker("real_time") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(TRIES):
        with _turn(alone=attempt > 0):
            sleeper, began = _Sleeper(), time.perf_counter()
            sleeper.start()
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
            took, late = time.perf_counter() - began, sleeper.end()
            starved = late >= STARVED or sleeper.waited() >= CROWDED * took
        if attempt == TRIES - 1 or not starved or not any(report.failed for report in reports):
            break
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Remember pytest's own verdict for the exit below."""
    global _status
    _status = int(session.exitstatus if session.exitstatus is not None else exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Leave at once where Blender is loaded: 4.5 hangs while the interpreter ends, with all tests long passed."""
    if "bpy" not in sys.modules or hasattr(config, "workerinput"):
        return
    config.get_terminal_writer().flush()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(_status)
