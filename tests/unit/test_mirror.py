"""Tests lie where what they test lies: tests/unit mirrors core, folder by folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.mutate import imported

pytestmark = pytest.mark.one_line("3.11", "the text of the sources is read")

ROOT = Path(__file__).resolve().parents[2]
CORE, UNIT = ROOT / "core", ROOT / "tests" / "unit"
# Folders of tests about the engine as a whole, which no folder of it mirrors.
OF_THE_WHOLE = {"library"}
IN_CHILDREN = {"test_toy_device.py"}  # they use a copy of the engine


def folders(root: Path, pattern: str) -> list[str]:
    """Return the folders below a root that hold files of a pattern, the root itself left out."""
    found = {p.parent.relative_to(root).as_posix() for p in root.rglob(pattern) if "__pycache__" not in p.parts}
    return sorted(found - {"."})


def reached(path: Path) -> set[str]:
    """Return the modules that a test imports, itself or through files beside the tests."""
    names, todo = set(), [path]
    while todo:
        new = imported(todo.pop()) - names
        names |= new
        own = (ROOT.joinpath(*name.split(".")).with_suffix(".py") for name in new if name.startswith("tests."))
        todo += [p for p in own if p.is_file()]
    return names


@pytest.mark.parametrize("folder", folders(UNIT, "*.py"))
def test_a_folder_of_tests_is_a_folder_of_the_engine(folder: str) -> None:
    assert folder.split("/")[0] in OF_THE_WHOLE or (CORE / folder).is_dir(), f"core/{folder} is not there"


@pytest.mark.parametrize("folder", folders(CORE, "*.py"))
def test_a_folder_of_the_engine_has_tests(folder: str) -> None:
    assert list((UNIT / folder).glob("test_*.py")), f"tests/unit/{folder} has no tests"


@pytest.mark.parametrize("path", sorted(UNIT.glob("*/**/test_*.py")), ids=lambda p: p.relative_to(UNIT).as_posix())
def test_a_test_uses_what_its_folder_mirrors(path: Path) -> None:
    folder = path.parent.relative_to(UNIT)
    if folder.parts[0] in OF_THE_WHOLE or path.name in IN_CHILDREN:
        return
    wanted = ".".join(("core", *folder.parts))
    if wanted == "core.command_line":
        wanted = "core"  # it runs in a process of its own
    assert any(name == wanted or name.startswith(f"{wanted}.") for name in reached(path)), f"it never imports {wanted}"
