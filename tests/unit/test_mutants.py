"""The mutation run itself: one change at a time, the same draw from the same seed, and verdicts that are true."""

from __future__ import annotations

import ast
import contextlib
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests import mutate
from tests.mutants import Mutation, mutations

pytestmark = pytest.mark.one_line("3.11", "a tool of developers: the product does not use it")

ROOT = Path(__file__).resolve().parents[2]
SOURCE = b'''"""Docstring with 1 and 2."""
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    LIMIT = 3
STRAIGHT = 1e-6
def f(a: int | None, n=2):
    """Another 3."""
    if not a and n <= 4.5:
        raise DermisError("words", value=7, limit=f"{8}")
    total = (a + n) * 0.0  # \xc3\xa4 is two bytes
    return max(total, -a), a[n:], b"x" + c, "y" + d, a is True
def g(solver):
    for x in solver:
        solver.reset()
        continue
'''


def smallest(one: ast.AST, other: ast.AST) -> ast.AST:
    """Return the smallest subtree of a tree that holds all its differences from another."""
    if type(one) is type(other):
        pairs = []
        for (_, a), (_, b) in zip(ast.iter_fields(one), ast.iter_fields(other), strict=True):
            ours, theirs = (x if isinstance(x, list) else [x] for x in (a, b))
            if len(ours) != len(theirs):
                return one
            pairs += [(x, y) for x, y in zip(ours, theirs, strict=True) if shown(x) != shown(y)]
        if len(pairs) == 1 and all(isinstance(x, ast.AST) for x in pairs[0]):
            return smallest(*pairs[0])
    return one


def shown(value: Any) -> str:
    return ast.dump(value) if isinstance(value, ast.AST) else repr(value)


def one_node_changed(source: bytes, mutation: Mutation) -> bool:
    """Return whether all differences of the syntax trees lie in the node that the mutation names."""
    found = smallest(ast.parse(source), ast.parse(mutation.applied(source)))
    if not isinstance(found, ast.expr | ast.stmt):
        return isinstance(found, ast.operator | ast.boolop | ast.unaryop | ast.cmpop)
    text = ast.get_source_segment(source.decode(), found)
    return text is not None and text.encode() in source[mutation.start : mutation.end]


def test_each_mutation_changes_one_node_and_nothing_that_only_people_read() -> None:
    found = mutations("core/x.py", SOURCE)
    assert all(one_node_changed(SOURCE, m) for m in found)
    told = {m.what.partition("  in  ")[0] for m in found}
    assert told == {
        "1e-06 -> 0.001", "2 -> 3", "not removed", "and -> or", "<= -> <", "<= -> >", "4.5 -> 9.0", "+ -> -",
        "* -> /", "0.0 -> 1.0", "max -> min", "- removed", "begins one later", "ends one earlier", "is -> is not",
        "True -> False", "call removed", "continue -> break",
    }  # fmt: skip
    assert not {3, 4, 9, 1} & {m.line for m in found}, "docstrings, types and messages stay as they are"


@pytest.mark.parametrize("path", ["core/units.py", "core/surface/winding.py", "core/stream/protocols/cobs.py"])
def test_mutants_of_real_files_are_python_with_one_change(path: str) -> None:
    source = (ROOT / path).read_bytes()
    found = mutations(path, source)
    assert len(found) > 20 and len({(m.start, m.end, m.text) for m in found}) == len(found)
    for mutation in found:
        assert one_node_changed(source, mutation), mutation


def test_the_same_seed_draws_the_same_list(tmp_path: Path) -> None:
    for name in ("b.py", "a.py"):
        (tmp_path / name).write_bytes(SOURCE)
    one, same, other = (mutate.drawn(12, seed, [tmp_path], tmp_path) for seed in (3, 3, 4))
    assert one == same != other and len(set(one)) == 12
    assert {m.path for m in mutate.drawn(10**6, 0, [tmp_path], tmp_path)} == {"a.py", "b.py"}


def test_fitting_tests_are_those_that_import_it_and_those_of_its_folder() -> None:
    fits = mutate.fitting("core/surface/winding.py")  # nobody imports it: its folder's tests fit
    assert "tests/unit/surface/test_gap.py" in fits and not any("stream" in name for name in fits)
    fits = mutate.fitting("core/matching/pins.py")
    assert fits.index("tests/unit/matching/test_pins.py") < fits.index("tests/unit/matching/test_descent.py")
    assert "tests/unit/test_units.py" in mutate.fitting("core/units.py")


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tree of one module and one test."""
    (tmp_path / "core").mkdir()
    (tmp_path / "tests" / "unit").mkdir(parents=True)
    (tmp_path / "core" / "__init__.py").touch()
    (tmp_path / "core" / "own.py").write_text("def double(x):\n    while x < 0:\n        x += 1\n    return x + x\n")
    (tmp_path / "pyproject.toml").write_text('[tool.pytest.ini_options]\npythonpath = ["."]\n')
    test = "from core.own import double\n\ndef test_it():\n    assert double(3) == 6 and double(-1) == 0\n"
    (tmp_path / "tests" / "unit" / "test_own.py").write_text(test)
    monkeypatch.setattr(mutate, "ROOT", tmp_path)
    return tmp_path


def changed(tree: Path, what: str) -> Mutation:
    found = mutations("core/own.py", (tree / "core" / "own.py").read_bytes())
    return next(m for m in found if m.what.startswith(what))


def test_a_verdict_names_the_test_and_leaves_the_tree_alone(tree: Path) -> None:
    before = (tree / "core" / "own.py").read_bytes()
    killed = mutate.judge(changed(tree, "+ -> -  in  return"))
    assert (killed.fate, killed.by) == ("killed", "tests/unit/test_own.py::test_it")
    assert mutate.judge(changed(tree, "< -> <=")).fate == "killed"
    assert (tree / "core" / "own.py").read_bytes() == before
    (tree / "tests" / "unit" / "test_own.py").write_text("import core.own\n\ndef test_it():\n    assert core\n")
    assert mutate.judge(changed(tree, "+ -> -  in  return")).fate == "SURVIVED"


def test_a_test_that_fails_anyway_kills_nothing(tree: Path) -> None:
    (tree / "tests" / "unit" / "test_own.py").write_text("import core.own\n\ndef test_it():\n    assert not core\n")
    verdict = mutate.judge(changed(tree, "+ -> -  in  return"))
    assert verdict.fate == "SURVIVED" and "1 tests fail without it" in verdict.by
    true = "\n\ndef test_other():\n    assert core.own.double(3) == 6\n"
    with (tree / "tests" / "unit" / "test_own.py").open("a") as file:
        file.write(true)
    assert mutate.judge(changed(tree, "+ -> -  in  return")).by == "tests/unit/test_own.py::test_other"


@pytest.mark.real_time
def test_what_a_run_leaves_behind_is_ended(tree: Path) -> None:
    """A test that starts a process and never ends takes it along."""
    hangs = (
        "import subprocess, sys, time, pathlib\n\ndef test_it():\n"
        f"    child = subprocess.Popen([{sys.executable!r}, '-c', 'import time; time.sleep(60)'])\n"
        f"    pathlib.Path({str(tree / 'pid')!r}).write_text(str(child.pid))\n    time.sleep(60)\n"
    )
    (tree / "tests" / "unit" / "test_own.py").write_text(hangs + "    import core.own\n")
    assert mutate.judge(changed(tree, "< -> <="), limit=3.0).fate == "timeout"
    stat, end = Path(f"/proc/{(tree / 'pid').read_text()}/stat"), time.monotonic() + 5.0
    with contextlib.suppress(OSError):  # no such process any more
        while stat.read_text().rpartition(")")[2].split()[0] != "Z":
            assert time.monotonic() < end, "it was killed with its group: the system needs a moment for that"
            time.sleep(0.01)
