"""Two Blender lines side by side: what no Python can change runs on one of them, and everything runs on one alone."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

import tests.conftest as rule

pytest_plugins = ["pytester"]
ROOT = Path(__file__).resolve().parents[2]
BODY = """
import pytest

@pytest.mark.one_line("3.11", "it is C")
@pytest.mark.parametrize("n", range(3))
def test_here(n):
    assert n < {most}

@pytest.mark.one_line("3.13", "it is C")
def test_there():
    pass

def test_on_both():
    pass
"""
# A Python that says what it is asked for, and that it passed.
STAND_IN = (
    '#!/bin/sh\n[ "$1" = -c ] && exit 0\n[ "$2" = test ] && echo "asked for: $*" && echo "total: 1 passed"\nexit 0\n'
)


@pytest.fixture
def told(pytester: pytest.Pytester) -> pytest.Pytester:
    """A folder whose tests obey the marks of this project."""
    pytester.makeconftest(
        "from tests.conftest import pytest_addoption, pytest_collection_modifyitems, pytest_terminal_summary\n"
        "def pytest_configure(config):\n    config.addinivalue_line('markers', 'one_line: as in the project')\n"
    )
    return pytester


def ran(pytester: pytest.Pytester, *options: str, body: str = BODY.format(most=3)) -> pytest.RunResult:
    pytester.makepyfile(body)
    return pytester.runpytest_inprocess("-p", "no:cacheprovider", *options)


def test_one_line_alone_runs_everything(told: pytest.Pytester) -> None:
    assert ran(told).parseoutcomes() == {"passed": 5}


@pytest.mark.parametrize(("beside", "passed", "left"), [("3.11", 2, 3), ("3.13", 4, 1)])
def test_two_lines_run_what_is_marked_once_and_say_so(
    told: pytest.Pytester, beside: str, passed: int, left: int
) -> None:
    found = ran(told, f"--beside={beside}")
    assert found.parseoutcomes() == {"passed": passed, "deselected": left}
    found.stdout.fnmatch_lines([f"left to Python {beside}: {left} tests"])


def test_what_fails_fails_on_the_line_that_runs_it(told: pytest.Pytester) -> None:
    assert ran(told, "--beside=3.13", body=BODY.format(most=2)).parseoutcomes()["failed"] == 1


@pytest.mark.parametrize("mark", ['"3.12", "there is no such line"', '"3.13", ""'])
def test_a_mark_names_a_line_and_why(told: pytest.Pytester, mark: str) -> None:
    found = ran(told, "--beside=3.11", body=BODY.replace('"3.13", "it is C"', mark).format(most=3))
    assert found.ret != 0 and "one_line names a Python" in found.stdout.str() + found.stderr.str()


@pytest.mark.skipif(os.name == "nt" or not shutil.which("bash"), reason="the script needs bash")
@pytest.mark.parametrize("paths", [(), ("tests/unit/track",)])
def test_only_whole_runs_of_both_lines_are_shared(tmp_path: Path, paths: tuple[str, ...]) -> None:
    for name in (*(f"python{line}" for line in rule.LINES), "apt-get"):  # nothing is installed
        (tmp_path / name).write_text(STAND_IN)
        (tmp_path / name).chmod(0o755)
    path = os.pathsep.join([str(tmp_path), os.environ["PATH"]])
    done = subprocess.run(
        [str(ROOT / ".ci" / "run"), *paths],
        env={**os.environ, "PATH": path, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    asked = [line for line in done.stdout.splitlines() if line.startswith("asked for: ")]
    shares = ["--beside=3.13", "--beside=3.11"] if not paths else [*paths, *paths]
    assert asked == [f"asked for: build_addon.py test {share}" for share in shares]
