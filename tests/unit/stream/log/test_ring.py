"""Rows between two processes: their order, a ring that is full, and memory that is not there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.stream.log import ring as rings
from core.stream.log.ring import Ring
from core.stream.log.row import HEAD, Fate, Phase, file_rows, ring_rows
from core.work import mapped


def put(ring: Ring, value: float, reported: bool = True) -> None:
    values = np.full(ring.channels, value)
    pose, sensed = (values, (values + 1, values + 2)) if reported else (None, ())
    ring.put(value, value + 1, value + 2, value + 3, 4, Phase.RAMP, Fate.LATE, values, -values, pose, sensed)


def test_rows_come_out_as_they_went_in() -> None:
    mine = Ring.create(3, 8, {"what": ["the", "writer", "knows"]}, sensed=2)
    theirs = Ring.open(mine.path)
    assert theirs.setup == {"what": ["the", "writer", "knows"]}
    put(mine, 7.0)
    put(mine, 8.0, reported=False)
    rows = theirs.take(last=True)
    assert rows["number"].tolist() == [0, 1]
    assert [rows[0][name] for name in ("time", "play", "track", "heard")] == [7.0, 8.0, 9.0, 10.0]
    assert (rows["skipped"] == 4).all() and (rows["phase"] == Phase.RAMP).all() and (rows["fate"] == Fate.LATE).all()
    assert rows["commanded"].tolist() == [[7.0] * 3, [8.0] * 3] and rows["limited"][1].tolist() == [-8.0] * 3
    assert rows["reported"][0].tolist() == [7.0] * 3 and np.isnan(rows["reported"][1]).all()
    assert rows["sensed"][0].tolist() == [[8.0] * 3, [9.0] * 3] and np.isnan(rows["sensed"][1]).all()
    for ring in (theirs, mine, mine):
        ring.close()
        ring.remove()
    assert not mine.path.exists()


def test_a_full_ring_loses_rows_counts_them_and_leaves_a_gap_in_their_numbers() -> None:
    ring = Ring.create(1, 5, {})
    for value in range(8):
        put(ring, value)
    assert ring.lost == 3 and ring.waiting == 5
    first = ring.take(last=True)
    put(ring, 9)
    rest = ring.take(last=True)
    assert [*first["number"], *rest["number"]] == [0, 1, 2, 3, 4, 8]
    assert ring.lost == 3
    ring.close()
    ring.remove()


def test_order_holds_over_the_seam_whatever_is_taken_when() -> None:
    ring, seen = Ring.create(2, 16, {}), []
    for value in range(100):
        put(ring, value)
        if value % 3 == 0:
            seen += ring.take()["number"].tolist()
    while len(rows := ring.take(last=True)):
        seen += rows["number"].tolist()
    assert seen == list(range(100)) and ring.lost == 0
    ring.close()
    ring.remove()


def test_a_row_is_taken_only_once_it_was_seen_before() -> None:
    ring = Ring.create(1, 4, {})
    put(ring, 1)
    assert len(ring.take()) == 0
    put(ring, 2)
    assert ring.take()["time"].tolist() == [1.0]
    assert ring.take(last=True)["time"].tolist() == [2.0]
    ring.close()
    ring.remove()


def test_another_processs_rows() -> None:
    ring = Ring.create(2, 64, {})
    code = (
        "import sys\nfrom pathlib import Path\nfrom core.stream.log.ring import Ring\n"
        "ring = Ring.open(Path(sys.argv[1]))\n"
        "print(*[row['number'] for row in ring.take(last=True)])"
    )
    for value in range(40):
        put(ring, value)
    done = subprocess.run([sys.executable, "-c", code, str(ring.path)], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(k) for k in range(40)] and ring.waiting == 0
    ring.close()
    ring.remove()


def test_what_is_no_ring_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    for data in (b"", b"DERMIS-RING 2\0\0\0" + bytes(100), rings.MAGIC + bytes(50)):
        path.write_bytes(data)
        with pytest.raises(DermisError, match="ring"):
            Ring.open(path)
    with pytest.raises(DermisError, match="cannot be opened"):
        Ring.open(tmp_path / "none")


@pytest.mark.skipif(not hasattr(__import__("os"), "posix_fallocate"), reason="Linux asks for all of it at once")
def test_memory_that_is_not_there_is_refused_and_leaves_nothing_behind() -> None:
    """A page that is missing later would end the sender by a signal, the device armed."""
    with pytest.raises(DermisError, match="no room for shared memory"):
        mapped.create("dermis-no-room-", 1 << 50)
    assert not list(Path("/dev/shm").glob("dermis-no-room-*"))


def test_the_layouts_have_no_gaps() -> None:
    """What stands in files is stated byte by byte on the page."""
    assert sum(np.dtype(kind).itemsize for _, kind in HEAD) == 48
    assert file_rows(3).itemsize == 48 + 4 * 4 * 3 and ring_rows(3).itemsize == 48 + 8 * 3 * 3
