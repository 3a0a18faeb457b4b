"""What every level of the tests shares: the switches, real time, and an exit that Blender cannot hang."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from _pytest.runner import runtestprotocol

_status = 1
STARVED = 0.03  # [s] by which a thread that only sleeps may wake too late before the machine is to blame
CROWDED = 0.1  # part of a test's time in which somebody waited for a processor, from which the machine is to blame
TRIES = 5
FREE = 2  # failures that do not count beside the other line
PAUSE = 1.0  # [s] by which the wait before a try beside the other line is longer than that before the last one
LINES = ("3.11", "3.13")
LEFT = pytest.StashKey[list[str]]()  # the tests that the other line runs
# Folders of tests/unit that hold equations: numbers in, numbers out, by numpy, scipy and the kernels.
EQUATIONS = frozenset(
    "comparison contact design devices effects images kernels matching motion pipeline plot skin studies surface"
    " surrogate track".split()
)
PRESSURE = Path("/proc/pressure/cpu")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --long, which also runs the tests marked `long`, and what two lines that run side by side need."""
    parser.addoption("--long", action="store_true", default=False, help="also run the tests that take minutes")
    parser.addoption("--beside", metavar="PYTHON", help="leave to this Python, which runs too, its share of the tests")
    parser.addoption("--shares", metavar="FILE", help="append the names of the tests that run and that are left")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what is marked `long` unless it was asked for; leave out what the other line runs."""
    if not config.getoption("--long"):
        skip = pytest.mark.skip(reason="runs with --long only")
        for item in items:
            if item.get_closest_marker("long"):
                item.add_marker(skip)
    beside = config.getoption("--beside")
    if beside:
        lines = lines_of(items)
        left = [item for item, line in zip(items, lines, strict=True) if line == beside]
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item, line in zip(items, lines, strict=True) if line != beside]
        config.stash[LEFT] = [item.nodeid for item in left]


def pytest_collection_finish(session: pytest.Session) -> None:
    """Write down who runs what; keep the collector of garbage from walking through thousands of collected tests."""
    gc.freeze()
    if shares := session.config.getoption("--shares"):
        names = [f"run {item.nodeid}" for item in session.items]
        names += [f"left {name}" for name in session.config.stash.get(LEFT, [])]
        with open(shares, "a", encoding="utf-8") as file:
            file.writelines(f"{name}\n" for name in names)


def lines_of(items: Sequence[pytest.Item]) -> list[str | None]:
    """Return for each test the Python whose line alone has to run it where both run side by side, None for both lines.

    The mark `one_line` decides where there is one. Else a test runs on both lines, but for two kinds:

    * cases of a parametrized test after its first one, in tests/unit and where the mark `shared_cases` allows it: a
      checksum of the file's name and the case's draws the line;
    * all tests in those folders of tests/unit that hold equations (`EQUATIONS`) and in files with the mark
      `shared_tests`, but for those that walk through Blender's undo: the lines take turns, from one that a checksum of
      the file's name draws, so that each has half of every file. A file with one test runs on both.

    Tests of the same case in a file go to the same line, so that what is made once for a case is made on one of them.
    """
    turns: dict[str, dict[str, int]] = {}  # of shared files: the cases, and tests without cases, in their order
    functions: set[str] = set()
    lines: list[str | None] = []
    for item in items:
        lines.append(line_of(item))
        if lines[-1] is None and is_shared(item):
            cases = turns.setdefault(file_of(item), {})
            cases.setdefault(case_of(item), len(cases))
    for i, item in enumerate(items):
        file, function = file_of(item), item.nodeid.partition("[")[0]
        if lines[i] is not None:
            continue
        if is_shared(item):
            if len(turns[file]) > 1:
                lines[i] = LINES[(zlib.crc32(file.encode()) + turns[file][case_of(item)]) % 2]
        elif file.startswith("tests/unit/") or item.get_closest_marker("shared_cases"):
            if function in functions:
                lines[i] = LINES[zlib.crc32(f"{file}{case_of(item)}".encode()) % 2]
            functions.add(function)
    return lines


def file_of(item: pytest.Item) -> str:
    """Return the file of a test."""
    return item.nodeid.partition("::")[0]


def case_of(item: pytest.Item) -> str:
    """Return the case of a test in brackets, the test's whole name where it has no cases."""
    function, bracket, case = item.nodeid.partition("[")
    return bracket + case or function


def is_shared(item: pytest.Item) -> bool:
    """Return whether the lines take turns at a test."""
    if item.get_closest_marker("shared_tests"):
        return not item.get_closest_marker("undo")
    parts = file_of(item).split("/")
    return parts[:2] == ["tests", "unit"] and parts[2] in EQUATIONS


def line_of(item: pytest.Item) -> str | None:
    """Return the Python that the mark `one_line` names, None where a test has no such mark."""
    mark = item.get_closest_marker("one_line")
    if mark is None:
        return None
    python, why = mark.args
    assert python in LINES and why, f"{item.nodeid}: one_line names a Python of {', '.join(LINES)}, and why"
    return str(python)


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how many tests the other line has to run."""
    if left := config.stash.get(LEFT, []):
        terminalreporter.write_line(f"left to Python {config.getoption('--beside')}: {len(left)} tests")


class _Sleeper(threading.Thread):
    """Sleeps for 5 ms again and again, and notes the latest that it woke."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.worst, self._ends = 0.0, threading.Event()

    def run(self) -> None:
        """Note how late every wake-up is."""
        while not self._ends.is_set():
            start = time.perf_counter()
            time.sleep(0.005)
            self.worst = max(self.worst, time.perf_counter() - start - 0.005)

    def end(self) -> float:
        """Return the worst delay [s]."""
        self._ends.set()
        self.join()
        return self.worst


def _waited() -> float:
    """Return for how long somebody has waited for a processor since the machine began [s]; 0 where it does not say."""
    try:
        return float(PRESSURE.read_text().partition("total=")[2].split()[0]) * 1e-6
    except (OSError, IndexError, ValueError):
        return 0.0


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
    counts at once where a thread that only sleeps always woke in time, and hardly anybody waited for a processor: of
    two processes that work the one that sleeps more is served first, so the sleeper alone does not see what the
    sender, the device and their starts are kept from. It is tried again while no other of its kind runs.

    Beside the other line the first `FREE` failures never count, and each try waits longer, so that a busy phase ends.
    Neither measure sees a pause of 50 ms there: the sleeper is served before the sender, the time that somebody waited
    is spread over the whole test, and a virtual machine is not told when its host was busy.
    """
    beside = bool(item.config.getoption("--beside", None))
    if item.get_closest_marker("real_time") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(TRIES):
        time.sleep(PAUSE * attempt if beside else 0)
        with _turn(alone=attempt > 0):
            sleeper, began, waited = _Sleeper(), time.perf_counter(), _waited()
            sleeper.start()
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
            crowded = _waited() - waited >= CROWDED * (time.perf_counter() - began)
            starved = sleeper.end() >= STARVED or crowded or (beside and attempt < FREE)
        if attempt == TRIES - 1 or not starved or not any(report.failed for report in reports):
            break
        _forget_failed(item)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _forget_failed(item: Any) -> None:
    """Let fixtures that failed be made again: those of a module or session else keep their error for the next try."""
    for fixtures in item._fixtureinfo.name2fixturedefs.values():
        for fixture in fixtures:
            if fixture.cached_result is not None and fixture.cached_result[2] is not None:
                fixture.finish(SimpleNamespace(node=item))


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
