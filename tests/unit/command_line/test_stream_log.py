"""`stream log`: CSV of a binary log, all files of one, and what is said of one that is not whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.__main__ import main
from core.stream.log import binary
from tests.unit.stream.log.test_files import HEADER, rows, written


def test_csv_of_a_binary_log_is_what_a_csv_log_would_have_been(tmp_path: Path) -> None:
    for suffix in ("dlog", "csv"):
        written(tmp_path / f"a.{suffix}", 500).close({"lost": 0, "time": 0.5})
    assert main(["stream", "log", str(tmp_path / "a.dlog"), "--out", str(tmp_path / "b.csv")]) == 0
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()


def test_all_files_of_a_log_become_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = written(tmp_path / "a.dlog", 1000, size=20_000)
    files.close({"lost": 0})
    names = sorted(map(str, tmp_path.glob("a*.dlog")), reverse=True)
    assert main(["stream", "log", *names, "--out", str(tmp_path / "b.csv")]) == 0 and len(names) > 3
    lines = [line for line in (tmp_path / "b.csv").read_text().splitlines() if not line.startswith("#")]
    assert [line.split(",")[0] for line in lines[1:]] == [str(k) for k in range(1000)]
    assert main(["stream", "log", *names]) == 0
    said = capsys.readouterr().out
    assert "1,000 rows in 0.999 s" in said and "dropped 200" in said and "HapTip, left (haptip)" in said
    assert "temperature up to 1 degC" in said and "current up to 1 A" in said
    middle = str(tmp_path / "a.2.dlog")
    assert main(["stream", "log", *(n for n in names if n != middle)]) == 1
    assert "files 2 of the log are not among those given" in capsys.readouterr().err


def test_a_log_that_is_not_whole_is_told_and_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.dlog"
    written(path, 40).give_up()
    path.write_bytes(path.read_bytes()[:-30])
    assert main(["stream", "log", str(path), "--out", str(tmp_path / "b.csv")]) == 1
    said = capsys.readouterr().err
    assert "was not finished" in said and "bytes at its end that are no whole rows" in said
    assert (tmp_path / "b.csv").read_text().count("\n") == 30 + 18 + 1


def test_lost_rows_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path / "a.dlog", 40).close({"lost": 7})
    assert main(["stream", "log", str(tmp_path / "a.dlog")]) == 1
    assert "7 rows are missing" in capsys.readouterr().err


def test_files_of_several_logs_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from dataclasses import replace

    form = binary.BinaryForm()
    for name in ("a", "b"):
        header = replace(HEADER, log=f"{name}123456789abcdef")
        (tmp_path / f"{name}.dlog").write_bytes(form.head(header) + form.rows(rows(3)) + form.end({}))
    assert main(["stream", "log", str(tmp_path / "a.dlog"), str(tmp_path / "b.dlog")]) == 2
    assert "of several logs" in capsys.readouterr().err
    assert main(["stream", "log", str(tmp_path / "a.dlog"), str(tmp_path / "a.dlog")]) == 2
    assert "given twice" in capsys.readouterr().err
