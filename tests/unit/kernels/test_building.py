"""The build: the interface is written once, in `kernels.h`; names follow the sources; failures are told."""

from __future__ import annotations

import ctypes
import re
import subprocess
from pathlib import Path

import pytest

from core.contact.solver import cone
from core.kernels import building, records
from core.surface import topology
from tests.kernel_cases.case import gcc

from .test_compiled import needs_gcc

HERE = building.this_platform()
LAST = "    int64_t wrong;            /* out: index of the point that was refused */\n} dermis_settled;"


@pytest.fixture
def header(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of `kernels.h` that the build reads, beside copies of the other sources."""
    folder = tmp_path / "sources"
    folder.mkdir()
    for path in building.sources():
        (folder / path.name).write_bytes(path.read_bytes())
    monkeypatch.setattr(building, "FOLDER", folder)
    return folder / "kernels.h"


def changed(header: Path, old: str, new: str) -> int:
    """Replace a part of the header that it has once, and return its line."""
    text = header.read_text()
    assert text.count(old) == 1
    header.write_text(text.replace(old, new))
    return 1 + text[: text.index(old)].count("\n")


def test_each_record_has_a_class_with_its_fields() -> None:
    assert list(records.RECORDS) == list(records.HEADER.records)
    for name, record in records.RECORDS.items():
        assert getattr(records, f"{name.capitalize()}Record") is record
        assert [field[0] for field in record._fields_] == [field.name for field in records.HEADER.records[name]]
    assert records.layout() == building.of_layout(building.layout(records.HEADER))
    assert records.PosedRecord.rotation.size == 72 and records.PosedRecord._fields_[0] == ("body", ctypes.c_void_p)
    assert (records.ROW, records.POSE, records.NOT_FINITE) == (16, 32, 2)


def test_constants_that_python_repeats_are_those_of_the_header() -> None:
    for module, names in ((topology, ("REGULAR", "BOUNDARY", "IRREGULAR")), (cone, ("STICK", "SLIP"))):
        for name in names:
            assert getattr(module, name) == records.HEADER.constants[name]


def test_a_field_that_is_added_to_the_header_is_read(header: Path) -> None:
    before = building.declared()
    changed(header, LAST, "    const float *first, *second; /* two; and\n  a comment */ double third[5];\n" + LAST)
    found = building.declared().records["settled"]
    added = [building.Field(name, "const float *", 1) for name in ("first", "second")]
    assert found == [*before.records["settled"][:-1], *added, building.Field("third", "double", 5), found[-1]]
    assert building.of_layout(building.layout(building.declared())) != records.layout()


@pytest.mark.parametrize(
    "text",
    [
        "int32_t less;",
        "float more;",
        "double many[DERMIS_KEPT];",
        "const double fixed;",
        "unsigned bits : 3;",
        "int64_t *one, other;",
        "int64_t *several[3];",
        "struct { int64_t inner; } inside;",
        "int64_t",
    ],
)
def test_a_field_of_an_unknown_form_is_refused(text: str, header: Path) -> None:
    """A record of Python would be another one than that of C."""
    line = changed(header, LAST, f"    {text}\n{LAST}")
    first = "typedef" if "{" in text else text.rstrip(";")
    with pytest.raises(
        building.NotBuilt, match=rf"^kernels.h, line (\d+): .* unknown form: {re.escape(first)}"
    ) as told:
        building.described()
    assert "{" in text or f"line {line}:" in str(told.value)


@pytest.mark.parametrize("text", ["enum { DERMIS_ODD = 1 << 3 };", "union dermis_odd;", "typedef int dermis_odd;", "{"])
def test_a_statement_of_an_unknown_form_is_refused(text: str, header: Path) -> None:
    place = "/* Sort the triangles of a tree"
    line = changed(header, place, f"/* one */ {text}\n{place}")
    with pytest.raises(building.NotBuilt, match=rf"^kernels.h, line {line}: "):
        building.declared()


@needs_gcc
@pytest.mark.parametrize("change", ["field", "order", "constant"])
def test_the_compiler_refuses_a_header_that_was_read_otherwise(change: str, header: Path, tmp_path: Path) -> None:
    command = gcc(tmp_path / "a.so", "-fsyntax-only")
    assert subprocess.run(command, capture_output=True).returncode == 0
    if change == "field":
        changed(header, LAST, "    int32_t more;\n" + LAST)
    elif change == "order":
        changed(header, "double low, high;", "double high, low;")
    else:
        changed(header, "DERMIS_POSE = 32", "DERMIS_POSE = 33")
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode != 0 and "reads it otherwise" in done.stderr


@pytest.mark.parametrize("change", ["kernels.h", "FLAGS", "new.c"])
def test_the_name_changes_with_sources_and_flags(change: str, header: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = building.stem("linux-x64")
    if change == "FLAGS":
        monkeypatch.setattr(building, "FLAGS", (*building.FLAGS, "-O3"))
    else:
        with header.with_name(change).open("a") as file:
            file.write("\n/* changed */\n")
    assert building.stem("linux-x64") != before


def test_line_ends_do_not_change_the_name(header: Path) -> None:
    before = building.digest()
    for path in building.sources():
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert building.digest() == before


def test_a_compiler_that_fails_is_told(tmp_path: Path) -> None:
    with pytest.raises(building.NotBuilt, match="cannot be started: .*nowhere"):
        building.build("linux-x64", tmp_path, [str(tmp_path / "nowhere")])
    if HERE == "linux-x64":
        with pytest.raises(building.NotBuilt, match="do not compile for linux-x64"):
            building.build("linux-x64", tmp_path, ["/bin/false"])
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "file"
    folder.write_text("no folder")
    with pytest.raises(building.NotBuilt, match="cannot be written: .*file"):
        building.build("linux-x64", folder, ["zig"])
