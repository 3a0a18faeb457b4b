"""What every level of the tests shares: the --long switch, and an exit that Blender cannot hang."""

from __future__ import annotations

import os
import sys

import pytest

_status = 1


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --long, which also runs the tests marked `long`."""
    parser.addoption("--long", action="store_true", default=False, help="also run the tests that take minutes")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what is marked `long` unless it was asked for."""
    if config.getoption("--long"):
        return
    skip = pytest.mark.skip(reason="runs with --long only")
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(skip)


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
