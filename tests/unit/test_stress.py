"""The stress suite: a short form of it, and that it can fail, makes failing cases simple, and tells known ones."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from tests.stress import invariances, known, run
from tests.stress.__main__ import FAMILIES, main, table, value_of
from tests.stress.case import Dice, Family, Values, Verdict, apart
from tests.stress.known import KNOWN, MENDED, Known
from tests.stress.run import judged, simple

# Of each family the first seed and how many: those that are quick, the others are for `build_addon.py stress`.
SHORT = {
    "touch": (501, 1),
    "turned": (500, 2),
    "scaled": (502, 4),
    "named": (500, 2),
    "rate": (503, 1),
    "press": (502, 3),
    "inside": (502, 4),
    "again": (500, 1),
    "card": (504, 2),
    "meshed": (502, 2),
    "crowd": (500, 2),
    "drift": (500, 1),
    "stretched": (500, 2),
    "bake": (501, 2),
    "surface": (500, 40),
    "pins": (500, 40),
    "thimble": (500, 60),
    "hexapod": (500, 60),
    "cables": (500, 60),
}
BY_NAME = {family.name: family for family in FAMILIES}
INVARIANCES = {family.name for family in invariances.FAMILIES}  # `test_invariances.py` has a short form of them


@pytest.mark.parametrize("name", [name for name in BY_NAME if name not in INVARIANCES])
def test_cases_of_every_family_obey_their_laws(name: str) -> None:
    seed, count = SHORT[name]
    tallies, failures, _ = run.run([BY_NAME[name]], seed, runs=count, simplify=False, again=False)
    assert not failures, "\n".join(f"{failure.measured} {failure.command}" for failure in failures)
    counts = tallies[name].counts
    assert counts["tried"] == count and counts["passed"] > 0


@pytest.mark.parametrize("name", MENDED)
def test_what_failed_once_does_not_fail_again(name: str) -> None:
    for seed in MENDED[name]:
        family = BY_NAME[name]
        values = family.values(seed)
        verdict = judged(family, values)
        new = [c for c in verdict.failed if known.known_failure(name, c, verdict.measured[c][0], values) is None]
        assert not new, f"{name} {seed}: {new}"


def test_every_known_failure_is_of_a_family_and_has_a_case_that_it_covers() -> None:
    for row in KNOWN:
        assert row.reason and row.seeds
        assert all(row.covers(BY_NAME[row.family].values(seed)) for seed in row.seeds)


def _draw(dice: Dice) -> Values:
    return {"depth": dice.between(1.0, 2.0), "friction": dice.between(0.0, 5.0), "tilt": dice.between(5.0, 9.0)}


def _judge(values: Values) -> Verdict:
    verdict = Verdict(told=frozenset({"too-deep"}), excuses={"told": frozenset({"too-deep"})})
    verdict.hold("too tilted", float(values["tilt"]), 3.0)
    verdict.hold("told", 2.0, 1.0)
    verdict.hold("fine", 0.5, 1.0)
    return verdict


BAD = Family("bad", "fails wherever it is tilted", _draw, _judge, {"depth": 1.0, "friction": 0.0, "tilt": 0.0})


def test_what_breaks_a_law_fails_and_is_told_with_a_command_that_judges_it_alone() -> None:
    heard: list[str] = []
    tallies, failures, _ = run.run([BAD], 7, runs=2, tell=heard.append)
    assert [failure.seed for failure in failures] == [7, 8] and tallies["bad"].counts["failed"] == 2
    assert list(failures[0].measured) == ["too tilted"]  # what a finding told of is flagged
    assert (
        failures[0].command == "python3 build_addon.py stress bad --seed 7 --runs 1 --set depth=1.0 --set friction=0.0"
    )
    assert failures[0].command in heard[0]
    changed = dict(value_of(text) for text in ("depth=1.0", "friction=0.0"))
    _, alone, _ = run.run([BAD], 7, runs=1, changed=changed)
    assert alone[0].measured == failures[0].measured
    assert "bad" in table(tallies) and "0.5 of 1" in table(tallies)


def test_a_failing_case_is_made_plain_only_where_it_stays_failing() -> None:
    drawn = BAD.values(3)
    assert simple(BAD, drawn, "too tilted", 10.0) == {**drawn, "depth": 1.0, "friction": 0.0}
    assert BAD.values(3) == drawn != BAD.values(4)


def test_a_known_failure_is_counted_apart_and_told_where_it_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = (
        Known("bad", "too tilted", (1,), "it is tilted", below=9.0),
        Known("bad", "fine", (2,), "it was not fine once"),
    )
    monkeypatch.setattr(known, "KNOWN", rows)
    monkeypatch.setattr(run, "KNOWN", rows)
    tallies, failures, passing = run.run([BAD], runs=3)
    assert not failures and tallies["bad"].counts == {"tried": 5, "known": 5}
    assert passing == ["bad --seed 2: fine"]
    monkeypatch.setattr(known, "KNOWN", (Known("bad", "too tilted", (1,), "only a little", below=3.5),))
    assert run.run([BAD], runs=3, simplify=False)[1]


def test_errors_and_warnings_of_arithmetic_fail() -> None:
    def broken(values: Values) -> Verdict:
        raise ZeroDivisionError("by nothing")

    def warns(values: Values) -> Verdict:
        import numpy as np

        np.zeros(1) / np.zeros(1)
        return Verdict()

    for judge, word in ((broken, "ZeroDivisionError at tests/unit/test_stress.py"), (warns, "warns at tests/unit")):
        assert word in judged(Family("f", "", _draw, judge), {}).failed[0]


def test_what_is_not_a_number_passes_nothing() -> None:
    verdict = Verdict()
    verdict.hold("x", math.nan, 1.0)
    verdict.hold("x", 0.1, 1.0)
    verdict.hold("y", math.inf, 1.0)
    assert verdict.failed == ["x", "y"]
    assert apart([[math.nan, 0.0]], [[0.0, 0.0]]) == math.inf and apart([[0.0]], [[0.0]]) == 0.0


def test_an_unknown_family_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["nothing"])
    assert "no such family: nothing" in capsys.readouterr().err
    assert main(["thimble", "--runs", "1", "--seed", "3"]) == 0
    assert "thimble" in capsys.readouterr().out


def test_of_equal_cases_the_first_seed_is_named_in_whatever_order_they_come() -> None:
    (pins,) = (family for family in FAMILIES if family.name == "pins")
    for seeds in ((7, 5, 6), (5, 6, 7)):
        tally = run.Tally()
        for seed in seeds:
            verdict = Verdict()
            verdict.hold("bounds", 0.5, 1.0)
            verdict.hold("kkt", seed / 10, 1.0)
            run.count(pins, seed, pins.values(seed), verdict, 0.1, tally, [], print, False)
        assert tally.worst == {"bounds": (0.5, 0.5, 1.0, 5), "kkt": (0.7, 0.7, 1.0, 7)}


@pytest.mark.parametrize("who", ["processes", "cluster"])
def test_whoever_judges_cases_the_counts_are_the_same(
    who: str, tmp_path: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["pins", "hexapod", "--runs", "12", "--seed", "300"]
    given = ["--workers", "2"] if who == "processes" else ["--scheduler", request.getfixturevalue("cluster").address]
    found = []
    for name, more in (("here.json", []), ("there.json", given)):
        assert main([*words, *more, "--json", str(tmp_path / name)]) == 0
        told = json.loads((tmp_path / name).read_text())
        for family in told["families"].values():
            assert family.pop("seconds") > 0.0 and family.pop("slowest")
        found.append(told)
    assert found[0] == found[1] and found[0]["families"]["hexapod"]["tried"] == 12
    with pytest.raises(SystemExit):
        main([*words[:2], *given, "--seconds", "1"])
    assert "give --runs" in capsys.readouterr().err
