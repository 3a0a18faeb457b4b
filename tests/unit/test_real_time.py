"""The rule for tests in real time: a failure counts, unless the machine let nobody run meanwhile."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tests.conftest as rule

pytest_plugins = ["pytester"]


def outcome(pytester: pytest.Pytester, late: float, body: str, crowded: float = 0.0) -> dict[str, int]:
    """Run a test file in this process, with a sleeper that says how late it was, and a machine that says how full."""
    pytester.makeconftest(
        f"""
        import time
        import tests.conftest as rule
        from tests.conftest import pytest_runtest_protocol

        class Sleeper(rule._Sleeper):
            def start(self):
                self.began = time.perf_counter()
                super().start()

            def end(self):
                super().end()
                return {late}

            def waited(self):
                return {crowded} * (time.perf_counter() - self.began)

        def pytest_configure(config):
            config.addinivalue_line("markers", "real_time: as in the project")
            config.was, rule._Sleeper = rule._Sleeper, Sleeper

        def pytest_unconfigure(config):
            rule._Sleeper = config.was
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


def test_a_failure_on_a_machine_that_runs_counts_at_once(pytester: pytest.Pytester) -> None:
    assert outcome(pytester, 0.01, SECOND_TIME, crowded=0.05) == {"failed": 1}


def process(proc: Path, number: int, parent: int, *waited: float) -> None:
    """Write down a process as Linux does: its parent, and for how long each of its threads has waited [s]."""
    for thread, seconds in enumerate(waited):
        task = proc / str(number) / "task" / str(number + thread)
        task.mkdir(parents=True, exist_ok=True)
        (task / "schedstat").write_text(f"7 {round(1e9 * seconds)} 3\n")
    (proc / str(number) / "stat").write_text(f"{number} (a) name) S {parent} 1 1\n")


def test_only_what_the_test_has_started_counts_and_from_then_on(tmp_path: Path) -> None:
    own = os.getpid()
    (tmp_path / "pressure").mkdir()
    process(tmp_path, own, 1, 5.0)
    process(tmp_path, own + 1, own, 40.0)  # of an earlier test
    tree = rule._Tree(tmp_path)
    process(tmp_path, own, 1, 5.5)
    process(tmp_path, own + 2, own, 0.25, 1.0)
    process(tmp_path, own + 3, own + 2, 2.0)
    process(tmp_path, own + 4, own + 1, 300.0)
    process(tmp_path, own + 5, 1, 300.0)
    tree.look()
    assert tree.waited() == pytest.approx(0.5 + 1.25 + 2.0)
    shutil.rmtree(tmp_path / str(own + 2))  # what has ended has waited all the same
    process(tmp_path, own + 5, own, 400.0)
    process(tmp_path, own + 3, 1, 3.0)
    tree.look()
    assert tree.waited() == pytest.approx(0.5 + 1.25 + 3.0)


def test_a_machine_that_does_not_say_how_long_they_waited_blames_nobody(tmp_path: Path) -> None:
    tree = rule._Tree(tmp_path / "none")
    tree.look()
    assert tree.waited() == 0.0


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="this system does not say who waited")
def test_processes_that_want_one_processor_have_waited() -> None:
    busy = "import os, time; os.sched_setaffinity(0, {%d}); end = time.monotonic() + 0.6; exec('while %s: pass')"
    sleeper, (processor, *_) = rule._Sleeper(), os.sched_getaffinity(0)
    sleeper.start()
    for each in [
        subprocess.Popen([sys.executable, "-c", busy % (processor, "time.monotonic() < end")]) for _ in range(3)
    ]:
        each.wait()
    sleeper.end()
    assert sleeper.waited() > 0.6  # of three, two wait


def test_a_test_that_always_fails_fails_however_starved(pytester: pytest.Pytester) -> None:
    body = "import pytest\n\n@pytest.mark.real_time\ndef test_never():\n    assert False\n"
    assert outcome(pytester, 1.0, body) == {"failed": 1}
