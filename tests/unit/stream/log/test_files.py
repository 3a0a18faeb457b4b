"""Files of a log: their forms, rotation, the bound on all of them, and disks that are full."""

from __future__ import annotations

import csv as plain_csv
import json
import os
import struct
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.stream.log import binary
from core.stream.log.binary import BinaryForm
from core.stream.log.csv_form import CsvForm
from core.stream.log.files import SYNC, LogFiles
from core.stream.log.row import Channel, Fate, LogHeader, Phase, Rows, file_rows, header_of

pytestmark = pytest.mark.shared_tests("bytes of the log")

HEADER = LogHeader(
    log="0123456789abcdef",
    started="2026-01-02T03:04:05.000006+00:00",
    started_unix=1767323045.000006,
    clock=12.5,
    device="haptip",
    name="HapTip, left",
    preset="ab",
    protocol="native",
    url="virtual:",
    rate=1000.0,
    channels=(Channel("pulley_1", "rad"), Channel("pulley_2", "rad")),
    zero=(0.0, 0.1),
    gain=(1.0, -1.0),
    program="dermis 0",
    sensed=(Channel("temperature", "degC"), Channel("current", "A")),
)
FORMS = {"csv": CsvForm(2, 2), "dlog": BinaryForm()}


def rows(count: int, first: int = 0) -> Rows:
    """Rows that can be told apart; every third has no play-out time, every fourth no pose, every fifth was dropped."""
    made = np.zeros(count, file_rows(2, 2))
    number = np.arange(first, first + count)
    made["number"], made["time"], made["play"] = number, number * 1e-3, number * 1e-3 + 0.1
    made["track"], made["heard"] = number * 1e-3 - 0.5, number * 1e-3 - 0.002
    made["play"][number % 3 == 0] = np.nan
    made["heard"][number % 4 == 0] = np.nan
    made["phase"] = np.where(number % 7 == 6, Phase.RAMP, Phase.LIVE)
    made["fate"] = np.where(number % 5 == 4, Fate.DROPPED, Fate.SENT)
    made["skipped"] = number % 2
    for k, name in enumerate(("commanded", "limited", "sent", "reported")):
        made[name] = np.sin(number[:, None] * 0.1 + k + np.arange(2))
    made["sent"][number % 5 == 4] = np.nan
    made["sensed"] = np.cos(number[:, None, None] * 0.1 + np.arange(4).reshape(2, 2))
    for name in ("reported", "sensed"):
        made[name][number % 4 == 0] = np.nan
    return made


def written(path: Path, count: int, *, size: float = 1e9, total: float = 1e9, at_once: int = 10) -> LogFiles:
    files = LogFiles(path, FORMS[path.suffix[1:]], HEADER, size, total)
    for first in range(0, count, at_once):
        files.take(rows(min(at_once, count - first), first), first * 1e-3)
    return files


def numbers_in(path: Path) -> list[int]:
    if path.suffix == ".dlog":
        return binary.read(path).rows["number"].tolist()
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return [int(row["number"]) for row in plain_csv.DictReader(lines)]


def test_a_csv_is_read_by_others_and_holds_every_bit(tmp_path: Path) -> None:
    written(tmp_path / "a.csv", 50).close({"lost": 3})
    text = (tmp_path / "a.csv").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    found, made = list(plain_csv.DictReader(lines)), rows(50)
    assert len(found) == 50
    for row, wanted in zip(found, made, strict=True):
        assert int(row["number"]) == wanted["number"] and row["phase"] == Phase(wanted["phase"]).name.lower()
        assert row["fate"] == Fate(wanted["fate"]).name.lower() and int(row["skipped"]) == wanted["skipped"]
        for block in ("commanded", "limited", "sent", "reported"):
            cells = [row[f"{block}.pulley_{k}[rad]"] for k in (1, 2)]
            back = np.array([float(cell) if cell else np.nan for cell in cells], np.float32)
            assert np.array_equal(back, wanted[block], equal_nan=True), "nine digits keep a float32"
        for quantity, values in zip(
            ("temperature.pulley_{}[degC]", "current.pulley_{}[A]"), wanted["sensed"], strict=True
        ):
            cells = [row[quantity.format(k)] for k in (1, 2)]
            back = np.array([float(cell) if cell else np.nan for cell in cells], np.float32)
            assert np.array_equal(back, values, equal_nan=True)
        for name, column in (("t_s", "time"), ("play_s", "play"), ("track_s", "track"), ("reported_t_s", "heard")):
            back = float(row[name]) if row[name] else np.nan
            assert np.isclose(back, wanted[column], atol=5e-7, equal_nan=True)
    header = dict(line[2:].split(": ", 1) for line in text.splitlines() if line.startswith("# ") and ": " in line)
    assert json.loads(header["started"]) == HEADER.started and json.loads(header["name"]) == "HapTip, left"
    assert header["end.rows"] == "50" and header["end.lost"] == "3"


def test_binary_and_csv_hold_the_same(tmp_path: Path) -> None:
    written(tmp_path / "a.csv", 300).close({"lost": 0})
    written(tmp_path / "a.dlog", 300).close({"lost": 0})
    file = binary.read(tmp_path / "a.dlog")
    assert file.header == HEADER and file.end == {"rows": 300, "lost": 0} and file.unread == 0
    assert np.array_equal(file.rows, rows(300), equal_nan=False) or file.rows.tobytes() == rows(300).tobytes()
    form = CsvForm(2, 2)
    assert form.head(file.header) + form.rows(file.rows) + form.end(file.end) == (tmp_path / "a.csv").read_bytes()


@pytest.mark.parametrize("suffix", ["csv", "dlog"])
def test_another_file_begins_at_the_size(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    files = written(path, 1000, size=20_000)
    files.close({"lost": 0})
    names = [path, *(tmp_path / f"a.{k}.{suffix}" for k in range(2, files.count + 1))]
    assert sorted(tmp_path.iterdir()) == sorted(names) and files.count > 3
    assert all(name.stat().st_size <= 20_000 + 200 for name in names), "and its last words"
    assert [n for name in names for n in numbers_in(name)] == list(range(1000)), "no row is lost where files meet"
    if suffix == "dlog":
        found = [binary.read(name) for name in names]
        assert [f.header.file for f in found] == list(range(1, files.count + 1))
        assert found[0].end is not None and found[0].end["continued"] == "a.2.dlog"


@pytest.mark.parametrize("suffix", ["csv", "dlog"])
def test_rows_that_come_in_one_heap_are_rotated_too(suffix: str, tmp_path: Path) -> None:
    files = written(tmp_path / f"a.{suffix}", 1000, size=20_000, at_once=1000)
    files.close({"lost": 0})
    assert files.count > 3 and max(path.stat().st_size for path in tmp_path.iterdir()) <= 20_000 + 200


def test_all_files_together_stay_within_their_bound_and_only_its_own_are_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    others = [tmp_path / "b.csv", tmp_path / "a.0.csv", tmp_path / "a.2.csv.bak"]
    for other in others:
        other.write_text("three years")
    files = LogFiles(path, FORMS["csv"], HEADER, 20_000, 60_000)
    largest = 0
    for first in range(0, 3000, 10):
        files.take(rows(10, first), 0.0)
        mine = [p for p in tmp_path.iterdir() if p not in others]
        largest = max(largest, sum(p.stat().st_size for p in mine))
    files.close({"lost": 0})
    assert largest <= 60_000 + 600 and len(files.removed) == files.count - 3 > 5
    assert str(path) in files.removed and all(other.read_text() == "three years" for other in others)
    left = sorted(int(p.name.split(".")[1]) for p in tmp_path.iterdir() if p not in others)
    assert left == [files.count - 2, files.count - 1, files.count]
    newest = tmp_path / f"a.{files.count}.csv"
    assert f"# removed: {len(files.removed)}" in newest.read_text(), "it says so itself"


def test_a_file_that_took_its_place_is_not_removed(tmp_path: Path) -> None:
    files = written(tmp_path / "a.csv", 150, size=20_000, total=40_000)
    assert files.count == 2
    (tmp_path / "new").write_text("three years")
    os.replace(tmp_path / "new", tmp_path / "a.csv")
    for first in range(150, 900, 10):
        files.take(rows(10, first), 0.0)
    assert (tmp_path / "a.csv").read_text() == "three years" and str(tmp_path / "a.csv") not in files.removed
    files.give_up()


@pytest.mark.parametrize("suffix", sorted(FORMS))
@pytest.mark.parametrize(
    ("happens", "said"), [("removed", "has removed"), ("replaced", "another file"), ("cut", "changed the file")]
)
def test_a_log_that_another_program_takes_away_is_told(happens: str, said: str, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"log.{suffix}"
    made = LogFiles(path, FORMS[suffix], HEADER, 1e6, 1e6)
    made.take(rows(20), 0.0)
    if happens == "cut":
        os.truncate(path, 100)
    else:
        path.unlink()
        if happens == "replaced":
            path.write_bytes(b"other")
    with pytest.raises(OSError, match=said):
        made.take(rows(20, 20), SYNC + 1.0)  # under way, not at the end only
    made.give_up()


@pytest.mark.parametrize("name", ["a.csv", "a.2.csv"])
def test_no_file_is_overwritten(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("three years")
    with pytest.raises(FileExistsError):
        written(tmp_path / "a.csv", 1000, size=20_000)
    assert (tmp_path / name).read_text() == "three years" and not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("suffix", ["csv", "dlog"])
def test_wherever_a_file_ends_its_whole_rows_are_read(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    written(path, 40).give_up()
    data = path.read_bytes()
    start = len(FORMS[suffix].head(HEADER))
    for cut in range(start, len(data), 37):
        path.write_bytes(data[:cut])
        if suffix == "csv":
            whole = data[start:cut].count(b"\n")
            path.write_bytes(data[:cut].rpartition(b"\n")[0])
            assert numbers_in(path) == list(range(whole))
            continue
        file = binary.read(path)
        assert file.end is None and file.rows["number"].tolist() == list(range(len(file.rows)))
        assert (
            len(file.rows) >= 40 * (cut - start) // (len(data) - start) - 10
            and file.unread < 10 * file.rows.itemsize + 8
        )


def test_damage_in_the_middle_ends_the_reading_there_and_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.dlog"
    written(path, 40).close({"lost": 0})
    data = bytearray(path.read_bytes())
    data[len(BinaryForm().head(HEADER)) + 1000] ^= 1
    path.write_bytes(data)
    file = binary.read(path)
    assert file.rows["number"].tolist() == list(range(10)) and file.end is None and file.unread > 30 * 80


WRITES = """
import resource, sys
from pathlib import Path
from tests.unit.stream.log.test_files import FORMS, HEADER, rows
from core.stream.log.files import SYNC, LogFiles
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
path = Path(sys.argv[1])
files = LogFiles(path, FORMS[path.suffix[1:]], HEADER, 1e9, 1e9)
done = 0
try:
    while done < 1000:
        files.take(rows(10, done), 0.0)
        done += 10
except OSError as error:
    print(done, error.strerror)
"""


@pytest.mark.skipif(os.name != "posix", reason="limits of a process are Unix")
@pytest.mark.parametrize("suffix", ["csv", "dlog"])
@pytest.mark.parametrize("room", [3000, 20_011])
def test_a_full_disk_ends_a_file_with_a_whole_row(suffix: str, room: int, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    done = subprocess.run([sys.executable, "-c", WRITES, str(path), str(room)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    count = int(done.stdout.split()[0])
    assert 0 < count < 1000 and numbers_in(path) == list(range(count)) and path.stat().st_size <= room
    assert suffix == "dlog" or path.read_bytes().endswith(b"\n")


def test_a_log_of_the_first_version_is_read() -> None:
    """It has no measurements beside the pose: neither in its header nor in its rows."""
    plain = {**json.loads(json.dumps(HEADER.plain())), "schema": "dermis-stream-log 1"}
    del plain["sensed"]
    text = json.dumps(plain).encode()
    head = b"\x89DRML\r\n\x01" + struct.pack("<I", len(text)) + text
    made = np.zeros(5, file_rows(2))
    for name in made.dtype.names or ():
        if name != "sensed":
            made[name] = rows(5)[name]
    assert made.dtype.itemsize == 48 + 16 * 2
    count = struct.pack("<I", 5)
    block = count + struct.pack("<I", zlib.crc32(made.tobytes(), zlib.crc32(count))) + made.tobytes()
    old = head + struct.pack("<I", zlib.crc32(head)) + block
    file = binary.loads(old)
    assert file.header == replace(HEADER, sensed=()) and file.rows.tobytes() == made.tobytes() and not file.unread
    form = CsvForm(2)
    names = form.head(file.header).decode().splitlines()[-1]
    assert names.endswith("reported.pulley_2[rad]") and form.rows(file.rows).count(b"\n") == 5
    with pytest.raises(DermisError, match="another version"):
        binary.loads(old[:7] + b"\x03" + old[8:])


def test_headers_that_are_none_are_refused() -> None:
    plain = json.loads(json.dumps(HEADER.plain()))
    assert header_of(plain, "x") == HEADER
    bad: list[dict[str, Any]] = [
        {"schema": "dermis-stream-log 3"},
        {"schema": "dermis-stream-log 1"},
        {"sensed": None},
        {"sensed": [{"name": "a"}]},
        {"sensed": [{"name": "a", "unit": "b"}] * 17},
        {"channels": []},
        {"channels": [{"name": "a"}] * 2},
        {"zero": [1.0]},
        {"gain": [1.0, True]},
        {"rate": "fast"},
        {"file": 1.5},
        {"more": 1},
    ]
    for change in bad:
        with pytest.raises(DermisError):
            header_of({**plain, **change}, "x")
    assert replace(HEADER, file=2).plain()["file"] == 2
