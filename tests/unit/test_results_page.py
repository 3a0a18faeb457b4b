"""The page of benchmark results takes its figures from a run, and says when and where it was."""

from __future__ import annotations

import pytest

from tests.benchmarks import REGISTRY, Benchmark, Result, bench_play
from tests.benchmarks.__main__ import table
from tests.benchmarks.results_page import PAGE, RUNS, updated

pytestmark = pytest.mark.one_line("3.11", "a page is rewritten")

ROWS = """| benchmark | what | median | p95 | limit | error | peers take |
|---|---|---|---|---|---|---|
| `a_ms` | a | 9.99 ms | 12.0 ms | ≤ 10 ms | exact | numpy 2.00x |
| `b_us` | b | 5.00 us | | ≤ 4 us: over (3.9 in a quieter hour); p95 ≤ 9 us | | |
| `c_error` | c | 57.6 % | | floor + 3 points | | |
| `d_lost` | d | 0 of 250 | | 0 | | |
| `e_ms` | e | 1.00 ms | | | | |
"""


def run(**values: float | None) -> dict[str, object]:
    rows = [
        {"name": n, "value": v, "unit": n.rpartition("_")[2], "p95": 2.0 if n == "a_ms" else None, "error": None}
        for n, v in values.items()
    ]
    machine = {"processor": "a processor", "cores": 2, "system": "Linux"}
    return {"machine": machine, "noise": {"most_over_least": 1.25}, "results": rows}


def test_measured_rows_change_and_others_stay() -> None:
    page = updated(RUNS + ROWS, run(a_ms=10.5, b_us=3.14159, c_error=0.5, d_lost=3.0, e_ms=None), "2026-11-27")
    assert "| `a_ms` | a | 10.5 ms | 2.00 ms | ≤ 10 ms: over | exact | numpy 2.00x |" in page
    assert "| `b_us` | b | 3.14 us | | ≤ 4 us; p95 ≤ 9 us | | |" in page
    assert "| `c_error` | c | 50 % | | floor + 3 points | | |" in page
    for kept in ("| `d_lost` | d | 0 of 250 | | 0 | | |", "| `e_ms` | e | 1.00 ms | | | | |"):
        assert kept in page
    assert (
        "* 2026-11-27, a processor, 2 cores, Linux; the same work took up to 1.25 times as long: `a_ms`, `b_us`" in page
    )


def test_a_run_without_its_rows_changes_nothing() -> None:
    assert updated(RUNS + ROWS, run(unknown=1.0), "2026-11-27") == RUNS + ROWS


def test_the_page_has_a_place_for_runs_and_rows_that_fit() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text.count(RUNS) == 1
    rows = [line for line in text.splitlines() if line.startswith("| `") and line.count("|") > 4]
    assert len(rows) > 60 and all(row.count("|") == 8 for row in rows)


@pytest.mark.parametrize(("p95", "late"), [(3.9, False), (4.1, True), (None, False)])
def test_a_long_tail_is_told(p95: float | None, late: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    result = Result("a_ms", 2.0, "ms", p95)
    monkeypatch.setitem(REGISTRY, "a_ms", Benchmark("a_ms", 10.0, lambda: result, tail=2.0))
    assert ("P95 OVER 2 MEDIANS" in table([result])) == late
    row = {"name": "a_ms", "value": 2.0, "unit": "ms", "p95": p95, "error": None}
    page = updated(RUNS + ROWS, {**run(), "results": [row]}, "2026-11-27")
    assert ("| 4.10 ms: over 2 medians | ≤ 10 ms |" in page) == late


def test_frames_of_a_playback_are_judged_by_their_tail_too() -> None:
    assert {REGISTRY[f"scrub_{name}_ms"].tail for name in ("demo", "thimble", "pins", "5fingers")} == {bench_play.TAIL}
