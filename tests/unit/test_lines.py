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
CASES = """
import pytest

@pytest.mark.parametrize("n", range(20))
def test_cases(n):
    pass

@pytest.mark.parametrize("n", range(20))
def test_same_cases(n):
    pass

def test_one():
    pass

@pytest.mark.one_line("3.13", "it is C")
def test_marked():
    pass
""" + "".join(f"def test_{n}():\n    pass\n" for n in range(20))
# A Python that says what it is asked for, and that it passed; it runs one test and leaves one to the other line.
STAND_IN = """#!/bin/sh
[ "$1" = -c ] && exit 0
[ "$2" = test ] && echo "asked for: $*" && echo "total: 1 passed"
for word; do case $word in --shares=*) printf 'run {run}\\nleft {left}\\n' >"${{word#*=}}" ;; esac; done
exit 0
"""


@pytest.fixture
def told(pytester: pytest.Pytester) -> pytest.Pytester:
    """A folder whose tests obey the marks of this project."""
    pytester.makeconftest(
        "from tests.conftest import pytest_addoption, pytest_collection_finish, pytest_collection_modifyitems\n"
        "from tests.conftest import pytest_terminal_summary\n"
        "def pytest_configure(config):\n"
        "    for mark in ('one_line', 'shared_cases', 'shared_tests'):\n"
        "        config.addinivalue_line('markers', f'{mark}: as in the project')\n"
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


def shares(pytester: pytest.Pytester, folder: str, body: str = CASES, count: int = 62) -> dict[str, set[str]]:
    """Return the names of the tests in a folder that each line runs, and check them against those that it leaves."""
    path = pytester.path / folder
    path.mkdir(parents=True)
    (path / "test_file.py").write_text(body)
    run, left = {}, {}
    for line, other in (("3.11", "3.13"), ("3.13", "3.11")):
        found = pytester.runpytest_inprocess("-p", "no:cacheprovider", f"--beside={other}", f"--shares={line}", folder)
        names = [name.partition(f" {folder}/test_file.py::test_") for name in Path(line).read_text().splitlines()]
        run[line] = {name for what, _, name in names if what == "run"}
        left[line] = {name for what, _, name in names if what == "left"}
        outcomes = found.parseoutcomes()
        assert outcomes["passed"] == len(run[line]) and outcomes.get("deselected", 0) == len(left[line])
    assert left["3.11"] <= run["3.13"] and left["3.13"] <= run["3.11"]
    assert not left["3.11"] & run["3.11"] and not left["3.13"] & run["3.13"]
    assert len(run["3.11"] | run["3.13"]) == count
    return run


def test_cases_are_shared_and_the_first_runs_on_both_lines(told: pytest.Pytester) -> None:
    run = shares(told, "tests/unit/stream")
    both = run["3.11"] & run["3.13"]
    assert both == {"cases[0]", "same_cases[0]", "one", *map(str, range(20))}
    assert min(map(len, run.values())) > len(both) + 10
    # What is made once for a case is made on one line: of a case after the first all tests of the file are together.
    assert all((f"cases[{n}]" in run["3.11"]) == (f"same_cases[{n}]" in run["3.11"]) for n in range(1, 20))


def test_at_equations_the_lines_take_turns(told: pytest.Pytester) -> None:
    run = shares(told, "tests/unit/contact/solver")
    assert not run["3.11"] & run["3.13"] and run["3.13"] > {"marked"}
    one, other = run.values()
    assert {n % 2 for n in range(20) if f"cases[{n}]" in one} != {n % 2 for n in range(20) if f"cases[{n}]" in other}
    assert all((f"cases[{n}]" in one) == (f"same_cases[{n}]" in one) for n in range(20))
    assert {f"{n}" for n in range(20)} & one and {f"{n}" for n in range(20)} & other


def test_a_file_of_equations_with_one_test_runs_on_both_lines(told: pytest.Pytester) -> None:
    run = shares(told, "tests/unit/contact", "def test_one():\n    pass\n", count=1)
    assert run["3.11"] == run["3.13"] == {"one"}


def test_blender_and_the_installer_are_shared_by_marks_alone(told: pytest.Pytester) -> None:
    run = shares(told, "tests/blender")
    assert run["3.13"] - run["3.11"] == {"marked"} and run["3.11"] <= run["3.13"]


def test_cases_in_blender_are_shared_where_a_mark_allows_it(told: pytest.Pytester) -> None:
    run = shares(told, "tests/blender", CASES.replace("@pytest", "@pytest.mark.shared_cases('presets')\n@pytest", 1))
    assert run["3.11"] & run["3.13"] >= {f"same_cases[{n}]" for n in range(20)} | {"cases[0]"}
    assert sum(f"cases[{n}]" in run["3.11"] and f"cases[{n}]" in run["3.13"] for n in range(20)) == 1


@pytest.mark.parametrize("folder", ["tests/blender", "tests/unit/stream"])
def test_a_file_is_shared_where_a_mark_allows_it(told: pytest.Pytester, folder: str) -> None:
    run = shares(
        told, folder, CASES.replace("import pytest\n", "import pytest\npytestmark = pytest.mark.shared_tests('x')\n")
    )
    assert not run["3.11"] & run["3.13"] and min(map(len, run.values())) > 20


def test_folders_of_equations_are_there() -> None:
    assert all((ROOT / "tests" / "unit" / name).is_dir() for name in rule.EQUATIONS)


def ran_script(folder: Path, *paths: str, tests: dict[str, tuple[str, str]]) -> subprocess.CompletedProcess[str]:
    """Run the script with Pythons that only say what they are asked for, run one test and leave another."""
    for line, (run, left) in tests.items():
        (folder / f"python{line}").write_text(STAND_IN.format(run=run, left=left))
    (folder / "apt-get").write_text("#!/bin/sh\n")  # nothing is installed
    for path in folder.iterdir():
        path.chmod(0o755)
    return subprocess.run(
        [str(ROOT / ".ci" / "run"), *paths],
        env={**os.environ, "PATH": os.pathsep.join([str(folder), os.environ["PATH"]]), "HOME": str(folder)},
        capture_output=True,
        text=True,
        timeout=60,
    )


with_bash = pytest.mark.skipif(os.name == "nt" or not shutil.which("bash"), reason="the script needs bash")


@with_bash
@pytest.mark.parametrize("paths", [(), ("tests/unit/track",)])
def test_only_whole_runs_of_both_lines_are_shared(tmp_path: Path, paths: tuple[str, ...]) -> None:
    done = ran_script(tmp_path, *paths, tests={"3.11": ("a[1 2]", "b"), "3.13": ("b", "a[1 2]")})
    assert done.returncode == 0, done.stdout + done.stderr
    asked = [line.split() for line in done.stdout.splitlines() if line.startswith("asked for: ")]
    assert [words[4:5] for words in asked] == ([["--beside=3.13"], ["--beside=3.11"]] if not paths else [[*paths]] * 2)
    assert all(len(words) == (5 if paths else 6) for words in asked)


@with_bash
def test_a_test_that_each_line_leaves_to_the_other_fails_the_run(tmp_path: Path) -> None:
    done = ran_script(tmp_path, tests={"3.11": ("a", "b"), "3.13": ("a", "b")})
    assert done.returncode == 1 and "FAILED: tests that neither line ran, 1: b" in done.stdout
