"""The stress suite: a short form of it, and that it can fail, and makes failing cases simple."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import numpy as np
import pytest

from core.surface.gap import Surface
from tests.stress import __main__ as command
from tests.stress import families, invariances, run
from tests.stress.__main__ import FAMILIES, main, table, unseen, value_of
from tests.stress.__main__ import costly as told_per_thousand
from tests.stress.case import Dice, Family, Values, Verdict, apart
from tests.stress.contacts import Felt
from tests.stress.facts import FARTHEST, REDUCED, RINGS, SHARP_WITHIN, costly, ring_of, together
from tests.stress.families import PARTS, TOUCHES, chosen
from tests.stress.job import judge, verdicts_of
from tests.stress.mended import MENDED
from tests.stress.paths import PLAIN, Press, dragged, pressing
from tests.stress.run import judged, simple
from tests.stress.tolerances import LAW, SAME

pytestmark = pytest.mark.one_line("3.13", "a tool of developers: the product does not use it")

# Of each family the first seed and how many: those that are quick, the others are for `build_addon.py stress`.
SHORT = {
    "touch": (501, 1),
    "turned": (500, 2),
    "scaled": (502, 4),
    "named": (500, 2),
    "rate": (503, 1),
    "dragged": (527, 1),
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
    tallies, failures = run.run([BY_NAME[name]], seed, runs=count, simplify=False, again=False)
    assert not failures, "\n".join(f"{failure.measured} {failure.command}" for failure in failures)
    counts = tallies[name].counts
    assert counts["tried"] == count and counts["passed"] > 0


@pytest.mark.parametrize("name", MENDED)
def test_what_failed_once_does_not_fail_again(name: str) -> None:
    failures: list[run.Failure] = []
    tally = run.Tally()
    run.try_anew(BY_NAME[name], tally, failures, simplify=False)
    assert tally.anew["tried"] == len(MENDED[name]) and not tally.counts  # a mended case is none that was drawn
    assert not failures, [(failure.seed, failure.measured) for failure in failures]


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
    tallies, failures = run.run([BAD], 7, runs=2, tell=heard.append)
    assert [failure.seed for failure in failures] == [7, 8] and tallies["bad"].counts["failed"] == 2
    assert list(failures[0].measured) == ["too tilted"]  # what a finding told of is flagged
    assert (
        failures[0].command == "python3 build_addon.py stress bad --seed 7 --runs 1 --set depth=1.0 --set friction=0.0"
    )
    assert failures[0].command in heard[0]
    changed = dict(value_of(text) for text in ("depth=1.0", "friction=0.0"))
    _, alone = run.run([BAD], 7, runs=1, changed=changed)
    assert alone[0].measured == failures[0].measured
    assert "bad" in table(tallies) and "0.5 of 1" in table(tallies)


def test_a_failing_case_is_made_plain_only_where_it_stays_failing() -> None:
    drawn = BAD.values(3)
    assert simple(BAD, drawn, "too tilted", 10.0) == {**drawn, "depth": 1.0, "friction": 0.0}
    assert BAD.values(3) == drawn != BAD.values(4)


TOUCHED = {"peak": 1.0, "dragged": 0.0, "edge": FARTHEST}


# -- costly touches ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("facts", "is_costly"),
    [
        ({"peak": 0.1, "edge": SHARP_WITHIN}, True),
        ({"peak": 0.099, "edge": SHARP_WITHIN}, False),
        ({"peak": 5.0, "edge": 2.5e-3}, False),
        ({"peak": 0.001, "dragged": 60.0}, True),
        ({"peak": 5.0, "dragged": 59.0}, False),
    ],
)
def test_costly_is_force_on_something_sharp_or_long_friction(facts: dict[str, float], is_costly: bool) -> None:
    assert costly({**TOUCHED, **facts}) is is_costly
    assert not costly({})  # nothing was touched


def felt(shape: str, size: float, offsets: np.ndarray, friction: float = 0.0, **more: object) -> Felt:
    """Return how a plain touch of a solid is felt."""
    drawn = {**BY_NAME["press"].values(0), **PLAIN, "poisson": 0.48, "contact": "points", "facets": 5120}
    press = Press({**drawn, "shape": shape, "size": size, **more})
    return press.feel([press.thing(offsets, friction)])


@pytest.mark.parametrize(
    ("shape", "size", "angle", "sharp"),
    [
        ("block", 0.05, 1.0, False),
        ("pillar", 2e-3, 1.0, True),
        ("edge", 0.01, 1.6, True),
        ("ball", 2.2e-3, 1.0, True),
        ("ball", 4e-3, 1.0, False),
        ("ribs", 4e-3, 1.0, True),
    ],
)
def test_what_is_sharp_is_measured_where_the_finger_is_loaded(
    shape: str, size: float, angle: float, sharp: bool
) -> None:
    facts = felt(shape, size, pressing(1e-3, 8), angle=angle).facts
    assert (facts["edge"] <= SHARP_WITHIN) is sharp and (facts["edge"] == FARTHEST) is (shape == "block")
    assert facts["peak"] > 0.05 and facts["dragged"] == 0.0


def test_an_edge_counts_only_near_the_load() -> None:
    away = [felt("block", 0.05, pressing(0.4e-3, 6), x=x).facts["edge"] for x in (0.0, 0.0235)]
    assert away[0] == FARTHEST and away[1] <= SHARP_WITHIN  # the block ends at 25 mm


def test_rings_find_an_edge_at_their_radius() -> None:
    block = Surface.block(0.05, 0.05, 0.02)
    for radius, nearer in zip(RINGS[1:], RINGS, strict=False):
        place = np.array([[0.025 - 0.97 * radius, 0.0, 0.0]])
        assert ring_of(block, place) == radius > nearer
    assert ring_of(block, np.zeros((1, 3))) == FARTHEST


def test_friction_is_counted_in_samples_in_which_it_acts() -> None:
    way = dragged(0.5e-3, 2e-3, 0.1e-3, 30)
    assert felt("block", 0.05, way).facts["dragged"] == 0.0
    facts = felt("block", 0.05, way, 0.5).facts
    assert 20.0 < facts["dragged"] < 30.0  # not before it touches
    assert felt("block", 0.05, way - [0.0, 0.0, 5e-3], 0.5).facts == {}


def test_a_drag_turns_at_samples_that_half_the_rate_knows() -> None:
    way = dragged(1e-3, 2e-3, 0.13e-3, 120)
    assert len(way) == 120 and np.linalg.norm(np.diff(way, axis=0), axis=1).max() <= 0.13e-3 + 1e-12
    middle = 0.5 * (way[:-2:2] + way[2::2])
    assert np.abs(middle - way[1:-1:2]).max() < 1e-12
    assert way[:, 0].max() == pytest.approx(2e-3) and way[:, 0].min() == pytest.approx(-2e-3)


@pytest.mark.parametrize(("seed", "more"), [(35112967, 0.0), (35113055, 2.0 * LAW)])
def test_two_rates_may_differ_by_no_less_than_two_solutions_of_one_problem(seed: int, more: float) -> None:
    values = BY_NAME["rate"].values(seed)
    found, limit = judged(BY_NAME["rate"], values).measured["rate"]
    assert found < limit and limit >= SAME[str(values["contact"])] + more


def test_facts_of_several_paths_are_the_worst_of_them() -> None:
    one, two = dict.fromkeys(REDUCED, 1.0), dict.fromkeys(REDUCED, 2.0)
    found = {"peak": 2.0, "dragged": 2.0, "edge": 1.0}
    assert together(one, two, {}) == together(two, one) == found


def test_a_worker_returns_the_facts_as_well() -> None:
    ((seed, _, verdict),) = verdicts_of(judge({}, {"family": "press", "seeds": [502], "changed": {}}, None))
    here = judged(BY_NAME["press"], BY_NAME["press"].values(502))
    assert seed == 502 and verdict == here and set(verdict.facts) == set(REDUCED)


def test_what_is_told_is_per_thousand_costly_touches_and_names_the_seed() -> None:
    tallies = {name: run.Tally() for name in ("touch", "press", "pins")}
    tallies["touch"].costly.update({"tried": 40, "failed": 3, "flagged": 10, "passed": 27})
    tallies["touch"].counts.update({"tried": 400, "failed": 200})
    tallies["pins"].counts.update({"tried": 7, "failed": 2})
    lines = told_per_thousand(tallies, "seed 5, which was given").splitlines()
    assert lines[2].split() == ["touch", "40", "75", "250"] and lines[3].split() == ["press", "0", "-", "-"]
    assert lines[4] == "no touches: pins 2 of 7 failed"
    assert lines[5] == "per 1,000 costly touches: 75 failed, 250 flagged; of 40, on seed 5, which was given"


def test_a_seed_is_new_where_none_is_given(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = []

    def only_drawn(some: list[Family], seed: int, **more: object) -> tuple[dict[str, run.Tally], list[str]]:
        drawn.append(seed)
        time.sleep(0.002)
        return {family.name: run.Tally() for family in some}, []

    monkeypatch.setattr(command, "run", only_drawn)
    told = []
    for words in ([], [], ["--seed", "3"]):
        assert main(["hexapod", "press", "--runs", "1", *words]) == 0
        told.append(capsys.readouterr().out.splitlines())
    seeds = [lines[0].split()[3].rstrip(",") for lines in told]
    assert len(set(seeds)) == 3 and seeds == list(map(str, drawn)) and drawn[2] == 3 < drawn[0] < drawn[1] < unseen()
    for lines, seed in zip(told, seeds, strict=True):
        assert lines[0].endswith(f"python3 build_addon.py stress hexapod press --seed {seed} --runs 1")
    assert [lines[-1].endswith(", which nobody has seen") for lines in told] == [True, True, False]
    assert told[2][-1].endswith("on seed 3, which was given") and not any("nobody" in line for line in told[2])


def test_all_families_but_invariances_are_tried_where_none_is_named() -> None:
    assert {family.name for family in chosen([])} == set(BY_NAME) - INVARIANCES
    assert {family.name for family in chosen(["invariance_*", "pins"])} == INVARIANCES | {"pins"}
    assert [*TOUCHES, *PARTS] == chosen([])


def test_some_family_drags_long_enough_to_be_costly() -> None:
    drawn = [BY_NAME["dragged"].values(seed) for seed in range(200)]
    assert sum(int(values["samples"]) >= 80 for values in drawn) > 40
    assert all(float(values["friction"]) > 0.0 for values in drawn)


def test_the_status_says_that_something_failed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in (families, command):
        monkeypatch.setattr(module, "FAMILIES", (*FAMILIES, BAD))
    assert main(["bad", "--seed", "7", "--runs", "2"]) == 1
    out = capsys.readouterr().out
    assert "FAILED bad 7: too tilted" in out and "no touches: bad 2 of 2 failed" in out


def test_errors_and_warnings_of_arithmetic_fail() -> None:
    def broken(values: Values) -> Verdict:
        raise ZeroDivisionError("by nothing")

    def warns(values: Values) -> Verdict:
        import numpy as np

        np.zeros(1) / np.zeros(1)
        return Verdict()

    for law, word in ((broken, "ZeroDivisionError at tests/unit/test_stress.py"), (warns, "warns at tests/unit")):
        assert word in judged(Family("f", "", _draw, law), {}).failed[0]


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
