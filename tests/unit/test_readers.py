"""Readers of foreign files: the table is complete, and damage of every kind is refused in words."""

from __future__ import annotations

import ast
import os
import socket
import sys
import warnings
from pathlib import Path

import pytest

from core.errors import DermisError
from core.presets import Library
from tests.fuzz import Found, attempt, fuzz
from tests.readers import OWN, READERS, Reader

ROOT = Path(__file__).resolve().parents[2]
DOORS = ("core/files.py", "core/foreign.py", "core/npz.py")
CALLS = {
    "open",
    "read_bytes",
    "read_text",
    "read_json",
    "opened",
    "opened_npz",
    "read_npz",
    "array_of",
    "json_of",
    "toml_of",
    "ZipFile",
    "frombuffer",
    "fromfile",
    "loadtxt",
    "genfromtxt",
    "memmap",
    "unpack",
    "unpack_from",
    "iter_unpack",
    "TarFile",
    "InferenceSession",
    "PngImageFile",
    "TiffImageFile",
    "imread",
    "decompress",
    "decompressobj",
    "literal_eval",
}
OF_MODULES = {
    "json": {"load", "loads"},
    "np": {"load"},
    "numpy": {"load"},
    "tomllib": {"load", "loads"},
    "csv": {"reader", "DictReader"},
    "wave": {"open"},
    "pickle": {"load", "loads"},
}


def readers_in(path: Path, module: str) -> set[str]:
    """Return the functions of a file that open or parse something, as 'module:function'."""
    found = set()

    def visit(node: ast.AST, name: str, inside: bool) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.ClassDef) and not inside:
                visit(child, f"{name}.{child.name}".lstrip("."), False)
            elif isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef) and not inside:
                visit(child, f"{name}.{child.name}".lstrip("."), True)
            else:
                if isinstance(child, ast.Call) and reads(child.func):
                    found.add(f"{module}:{name or '<module>'}")
                visit(child, name, inside)

    visit(ast.parse(path.read_text(encoding="utf-8")), "", False)
    return found


def reads(function: ast.expr) -> bool:
    if isinstance(function, ast.Name):
        return function.id in CALLS
    if not isinstance(function, ast.Attribute):
        return False
    owner = function.value.id if isinstance(function.value, ast.Name) else ""
    return function.attr in CALLS or function.attr in OF_MODULES.get(owner, set())


def every_reader() -> set[str]:
    found: set[str] = set()
    for package in ("core", "blender_addon"):
        for path in sorted((ROOT / package).rglob("*.py")):
            if path.relative_to(ROOT).as_posix() not in DOORS:
                name = path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__")
                found |= readers_in(path, name)
    return found


@pytest.mark.one_line("3.13", "the text of the sources is read")
def test_no_reader_is_missing_in_the_table() -> None:
    covered = {place for reader in READERS for place in reader.covers}
    known = covered | set(OWN)
    readers = every_reader()
    missing = sorted(place for place in readers if not {place, place.partition(":")[0]} & known)
    assert not missing, (
        f"these functions read and are in no table: {missing}. Give each an entry in tests/readers.py with a whole "
        "example, so that it is tried with damaged files; or name it in OWN there and say why nothing foreign comes in"
    )
    there = readers | {place.partition(":")[0] for place in readers}
    gone = sorted(known - there)
    assert not gone, f"tests/readers.py names functions that read nothing any more: {gone}"


def test_a_new_reader_is_found(tmp_path: Path) -> None:
    (tmp_path / "new.py").write_text(
        "import json, numpy as np\nclass A:\n  def a(self, p):\n    def b():\n      return np.load(p)\n    return b()\n"
        "def c(p):\n  return json.loads(p.read_bytes())\ndef d(x):\n  return x.closed\n"
    )
    assert readers_in(tmp_path / "new.py", "m") == {"m:A.a", "m:c"}


@pytest.mark.filterwarnings("ignore")
def test_damaged_files_are_refused_and_nothing_else(tmp_path: Path) -> None:
    found = fuzz(READERS, 75, sys.version_info[1] - 9, tmp_path)  # on each Python other damages
    assert not found.others, f"of {found.tried}: {found.others.most_common(20)}"
    silent = [r.name for r in READERS if not found.accepted[r.name] or found.accepted[r.name] == 75]
    cached = {"cached skin", "cached tables", "cached description"}
    assert (
        set(silent)
        <= {"packets", "torque board", "Dynamixel's answers", "Feetech's answers", "request", "part of a sweep"}
        | {"sealed datagrams"}
        | cached
    )


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_hundred_thousand_damaged_files(tmp_path: Path) -> None:
    found = fuzz(READERS, 100_000 // len(READERS) + 1, 2, tmp_path)
    assert found.tried >= 100_000 and not found.others, found.others.most_common(20)


def files() -> list[Reader]:
    return [reader for reader in READERS if reader.file]


@pytest.mark.parametrize("reader", files(), ids=lambda r: r.name)
def test_what_is_no_file_is_refused_at_once(reader: Reader, tmp_path: Path) -> None:
    """Folders, pipes, sockets, devices, links to nowhere or to themselves, and names that no system takes."""
    places = {kind: tmp_path / f"{kind}{reader.suffix}" for kind in ("folder", "none", "empty", "nowhere", "circle")}
    places["folder"].mkdir()
    places["empty"].touch()
    if hasattr(os, "mkfifo"):
        places["nowhere"].symlink_to(tmp_path / "gone")
        places["circle"].symlink_to(places["circle"])
        places["pipe"] = tmp_path / f"pipe{reader.suffix}"
        os.mkfifo(places["pipe"])
        places["zeros"] = tmp_path / f"zeros{reader.suffix}"
        places["zeros"].symlink_to("/dev/zero")
        places["terminal"] = tmp_path / f"terminal{reader.suffix}"
        places["terminal"].symlink_to("/dev/ptmx")
        with socket.socket(socket.AF_UNIX) as listening, warnings.catch_warnings():
            places["socket"] = tmp_path / f"socket{reader.suffix}"
            listening.bind(str(places["socket"]))
    places["zero byte"] = tmp_path / f"a\0b{reader.suffix}"
    places["long"] = tmp_path / ("x" * 5000 + reader.suffix)
    places["surrogate"] = tmp_path / f"\ud800{reader.suffix}"
    found = Found()
    accepted = [kind for kind, path in places.items() if attempt(reader, path, found)]
    assert not found.others, found.others
    assert not accepted or reader.name.startswith("cached") or reader.name == "part of a sweep"


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="who may read everything")
@pytest.mark.parametrize("reader", files(), ids=lambda r: r.name)
def test_what_may_not_be_read_is_refused(reader: Reader, tmp_path: Path) -> None:
    path = tmp_path / f"mine{reader.suffix}"
    path.write_bytes(reader.seeds()[0])
    path.chmod(0)
    found = Found()
    attempt(reader, path, found)
    assert not found.others


@pytest.mark.filterwarnings("ignore")
@pytest.mark.one_line("3.13", "words of refusals; the rest of this file runs on both lines")
def test_every_reader_refuses_the_files_of_all_others(tmp_path: Path) -> None:
    found = Found()
    for reader in READERS:
        path = tmp_path / f"other{reader.suffix}"
        reader.beside(path)
        for other in READERS:
            for whole in other.seeds():
                path.write_bytes(whole)
                attempt(reader, path, found)
    assert not found.others, found.others


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_among_the_presets_is_listed_as_broken_and_does_not_wait(tmp_path: Path) -> None:
    (tmp_path / "devices").mkdir()
    os.mkfifo(tmp_path / "devices" / "mine.json")
    (entry,) = (e for e in Library(tmp_path).list("devices") if e.key == "mine")
    assert entry.error is not None and "a pipe" in entry.error
    with pytest.raises(DermisError, match="a pipe"):
        Library(tmp_path).device("mine")
