"""The rule for tests in real time: a failure counts, unless the machine let nobody run meanwhile."""

from __future__ import annotations

from pathlib import Path

import pytest

import tests.conftest as rule

pytestmark = pytest.mark.one_line("3.11", "a rule of these tests; the product does not use it")

pytest_plugins = ["pytester"]


def outcome(
    pytester: pytest.Pytester, late: float, body: str, crowded: float = 0.0, beside: str = ""
) -> dict[str, int]:
    """Run a test file in this process, with a sleeper that says how late it was, and a machine that says how full."""
    pytester.makeconftest(
        f"""
        import time
        import tests.conftest as rule
        from tests.conftest import pytest_runtest_protocol

        class Sleeper(rule._Sleeper):
            def end(self):
                super().end()
                return {late}

        def pytest_addoption(parser):
            parser.addoption("--beside", default={beside!r})

        def pytest_configure(config):
            config.addinivalue_line("markers", "real_time: as in the project")
            config.was = rule._Sleeper, rule._waited, rule.PAUSE
            rule._Sleeper, rule._waited = Sleeper, lambda: {crowded} * time.perf_counter()
            rule.PAUSE = 0.0

        def pytest_unconfigure(config):
            rule._Sleeper, rule._waited, rule.PAUSE = config.was
        """
    )
    pytester.makepyfile(body)
    found: dict[str, int] = pytester.runpytest_inprocess("-p", "no:cacheprovider").parseoutcomes()
    return found


SECOND_TIME = """
    import pytest
    tries = []

    @pytest.mark.real_time
    def test_passes_the_second_time(tmp_path):
        tries.append(tmp_path)
        assert len(tries) == 2
"""


def test_a_failure_on_a_starved_machine_is_tried_again(pytester: pytest.Pytester) -> None:
    assert outcome(pytester, 0.1, SECOND_TIME) == {"passed": 1}


def test_a_failure_where_others_want_the_processors_is_tried_again(pytester: pytest.Pytester) -> None:
    assert outcome(pytester, 0.01, SECOND_TIME, crowded=0.2) == {"passed": 1}


def test_a_fixture_of_a_module_that_failed_is_made_again(pytester: pytest.Pytester) -> None:
    body = """
        import pytest
        pytestmark = pytest.mark.real_time
        tries = []

        @pytest.fixture(scope="module")
        def made(tmp_path_factory):
            tries.append(1)
            assert len(tries) == 2
            return tries

        def test_one(made):
            assert len(made) == 2

        def test_other(made):
            assert len(made) == 2
        """
    assert outcome(pytester, 0.1, body) == {"passed": 2}


def test_a_failure_on_a_machine_that_runs_counts_at_once(pytester: pytest.Pytester) -> None:
    assert outcome(pytester, 0.01, SECOND_TIME, crowded=0.05) == {"failed": 1}


def test_two_failures_beside_the_other_line_never_count_and_the_third_does(pytester: pytest.Pytester) -> None:
    assert outcome(pytester, 0.01, SECOND_TIME, beside="3.13") == {"passed": 1}
    assert outcome(pytester, 0.01, SECOND_TIME.replace("== 2", "== 3"), beside="3.13") == {"passed": 1}
    assert outcome(pytester, 0.01, SECOND_TIME.replace("== 2", "== 4"), beside="3.13") == {"failed": 1}


def test_a_machine_that_does_not_say_how_full_it_is_blames_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rule, "PRESSURE", tmp_path / "cpu")
    assert rule._waited() == 0.0
    (tmp_path / "cpu").write_text("some avg10=0.00 avg60=1.00 avg300=2.00 total=1500000\nfull avg10=0.00 total=7\n")
    assert rule._waited() == 1.5


def test_a_test_that_always_fails_fails_however_starved(pytester: pytest.Pytester) -> None:
    body = "import pytest\n\n@pytest.mark.real_time\ndef test_never():\n    assert False\n"
    assert outcome(pytester, 1.0, body) == {"failed": 1}
