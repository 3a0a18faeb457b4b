"""The page on accuracy has the tables that its stored values print, and these leave nothing out."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.errors import DermisError
from tests.stress import invariance_table
from tests.stress.invariance_table import COLUMNS, FAMILY, PAGE, STORED, Measured, page_with, read, tables, write
from tests.stress.solids import SHAPES

pytestmark = pytest.mark.one_line("3.13", "a tool of developers: the product does not use it")

TOUCH = {"shape": "block", "contact": "points", "friction": 0.3}


def test_the_page_has_the_tables_that_are_stored() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert page_with(text, tables(read(STORED))) == text


def test_every_invariance_is_measured_on_every_solid() -> None:
    measured = read(STORED).values()
    for name in FAMILY:
        assert {each.values["shape"] for each in measured if name in each.changes} == set(SHAPES), name
    assert {each.values["friction"] for each in measured} == {0.0, 0.3, 0.6}
    assert {name for names in COLUMNS.values() for name in names} == set(FAMILY)


def test_the_worst_is_told_with_its_touch_and_what_is_beyond_is_counted() -> None:
    quiet = {name: {"force": 0.0, "nodal": 0.0} for name in FAMILY}
    loud = {**quiet, "names": {"force": 0.25, "nodal": 0.5}}
    printed = tables({1: Measured(TOUCH, quiet), 2: Measured({**TOUCH, "shape": "needle"}, loud)})
    (row,) = (line for line in printed.splitlines() if line.startswith("| `names`"))
    where = "(needle on points, friction 0.3)"
    assert row.endswith(f"| 0.1 % | 1 of 2 | 25 % {where} | nodal: 50 % {where} |")
    assert "| needle | 25 % | 0 |" in printed and "| block | 0 | 0 |" in printed


def test_what_is_gone_without_friction_says_so() -> None:
    slid = Measured(TOUCH, {name: {"force": 0.25 if name == "slid" else 0.0} for name in FAMILY})
    assert "| 25 % (block on points, friction 0) |" in tables({1: slid})


def test_what_is_stored_is_read_again_and_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "measured.json"
    measured = {5: Measured(TOUCH, {"names": {"force": 0.25}})}
    write(path, measured)
    assert read(path) == measured
    path.write_text(path.read_text(encoding="utf-8").replace('"version": 1', '"version": 2'), encoding="utf-8")
    with pytest.raises(DermisError, match="unknown version"):
        read(path)


def test_a_run_that_was_stopped_measures_what_is_missing_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []

    def measure(seed: int, known: object) -> Measured:
        asked.append((seed, len(known)))  # type: ignore[arg-type]
        return Measured(TOUCH, {name: {"force": 0.0} for name in FAMILY})

    page, stored = tmp_path / "page.md", tmp_path / "measured.json"
    page.write_text(f"before\n{invariance_table.START}other tables\n{invariance_table.END}after\n", encoding="utf-8")
    write(stored, {8: Measured(TOUCH, {name: {"force": 0.0} for name in FAMILY}), 9: Measured(TOUCH, {"names": {}})})
    monkeypatch.setattr(invariance_table, "measure", measure)
    monkeypatch.setattr(invariance_table, "STORED", stored)
    monkeypatch.setattr(invariance_table, "PAGE", page)
    assert invariance_table.main(["--seed", "8", "--runs", "3"]) == 0
    assert asked == [(9, 1), (10, 0)] and set(read(stored)) == {8, 9, 10}
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n") and text.endswith("after\n") and "other tables" not in text
    assert "0 of 3" in capsys.readouterr().out
