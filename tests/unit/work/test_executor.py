"""Jobs by name through both executors, with real processes: results, refusals, cancelling, crashes, nothing left."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, as_completed, wait
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import core
from core.errors import DermisError
from core.work import child
from core.work.executor import InlineExecutor, JobExecutor
from core.work.processes import ProcessExecutor
from tests.unit.work.jobs_lab import LINE, TABLE

pytestmark = pytest.mark.shared_tests("each line starts processes in half of them")

CORE = Path(core.__file__).parent
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


def processes(workers: int = 1) -> ProcessExecutor:
    return ProcessExecutor(workers, table=TABLE, line=LINE)


@pytest.fixture(params=["inline", "processes"])
def executor(request: Any) -> Iterator[JobExecutor]:
    with InlineExecutor(table=TABLE) if request.param == "inline" else processes() as made:
        yield made


def gone(pid: int, seconds: float = 60.0) -> bool:
    """Wait until a process has ended, with all its threads."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
            dead = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
            if dead and len(os.listdir(f"/proc/{pid}/task")) <= 1:  # the others may be there longer than the first
                return True
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.02)
    return False


def begun(file: Path) -> int:
    """Wait until a dawdling job has begun; return its process."""
    end = time.monotonic() + 60.0
    while not (file.exists() and file.read_text()):
        assert time.monotonic() < end, "it never began"
        time.sleep(0.005)
    return int(file.read_text())


def test_arrays_go_there_and_back_to_the_bit(executor: JobExecutor) -> None:
    assert isinstance(executor, Executor)
    arrays = {"a": np.random.default_rng(0).normal(size=(3, 4)), "b": np.arange(5, dtype=np.int16), "c": np.array("é")}
    future = executor.submit("echo", arrays, {"k": [1, "x"]})
    found = future.result(60)
    assert future.progress() == (1, 1) and future.done() and not future.cancelled()
    assert {k: (found[k].dtype, found[k].tolist()) for k in arrays} == {
        k: (v.dtype, v.tolist()) for k, v in arrays.items()
    }
    report = json.loads(str(found["found"]))
    assert report["parameters"] == {"k": [1, "x"]}
    assert report["python"] == sys.version.split()[0] and report["numpy"] == np.__version__
    assert int(executor.submit("echo").result(60)["pid"]) == int(found["pid"]), "one worker does many jobs"


def test_refusals_come_back_whole_and_the_worker_lives(executor: JobExecutor) -> None:
    pid = int(executor.submit("echo").result(60)["pid"])
    with pytest.raises(DermisError) as caught:
        executor.submit("refuse").result(60)
    error = caught.value
    assert (error.code, error.what, error.where) == ("too-thick", "the disc is too thick", "disc")
    assert (str(error.value), error.limit, error.remedy) == ("x", "1 mm", "File it")
    assert int(executor.submit("echo").result(60)["pid"]) == pid


def test_a_defect_in_a_job_is_named_not_swallowed(executor: JobExecutor) -> None:
    error = executor.submit("fail").exception(60)
    assert isinstance(error, DermisError) and error.code == "job-failed"
    assert error.what == "the job failed: KeyError" and "missing" in error.value and error.where == "job 'fail'"


def test_what_a_careless_job_returns_is_made_an_array_or_refused(executor: JobExecutor) -> None:
    future = executor.submit("plain", {}, {"what": "numbers"})
    found = future.result(60)
    assert {k: (type(v), v.tolist()) for k, v in found.items()} == {"x": (np.ndarray, [1, 2]), "3": (np.ndarray, 4.5)}
    assert future.progress() == (1, 1), "numpy's numbers are numbers"
    pid = int(executor.submit("echo").result(60)["pid"])
    for what, code in (("nothing", "job-failed"), ("object", "not-plain")):
        error = executor.submit("plain", {}, {"what": what}).exception(60)
        assert isinstance(error, DermisError) and error.code == code
    error = executor.submit("leave").exception(60)
    assert isinstance(error, DermisError) and (error.code, error.what) == ("job-failed", "the job failed: SystemExit")
    assert int(executor.submit("echo").result(60)["pid"]) == pid


def test_after_nonsense_in_the_pipe_no_reply_goes_to_another_job() -> None:
    with processes() as executor:
        futures = [executor.submit(name, {"i": np.array(i)}) for i, name in enumerate(("echo", "babble", "echo"))]
        error = futures[1].exception(60)
        assert isinstance(error, DermisError) and error.code == "job-crashed" and "cannot be read" in error.what
        assert [int(futures[i].result(60)["i"]) for i in (0, 2)] == [0, 2]


@pytest.mark.parametrize("workers", [0, -1])
def test_nobody_to_do_the_jobs_is_refused(workers: int) -> None:
    with pytest.raises(DermisError, match="workers: .* >= 1"):
        processes(workers)


def test_wrong_names_and_python_objects_are_refused_before_anything_starts(executor: JobExecutor) -> None:
    with pytest.raises(DermisError) as caught:
        executor.submit("brew")
    assert (caught.value.code, caught.value.value) == ("no-such-job", "brew")
    assert "echo" in caught.value.limit.split(", ")
    for plain in (Path("/x"), np.int64(1), {1, 2}, object(), float):
        with pytest.raises(DermisError, match="must be plain values") as caught:
            executor.submit("echo", {}, {"k": plain})
        assert caught.value.code == "not-plain"
    with pytest.raises(DermisError, match="an array of Python objects") as caught:
        executor.submit("echo", {"x": np.array([{}], dtype=object)})
    assert caught.value.code == "not-plain" and "'x'" in caught.value.where
    assert not getattr(executor, "_threads", [])


@pytest.mark.real_time
def test_results_keep_their_order_and_may_be_taken_as_they_come() -> None:
    """`map` and `as_completed` of the standard library work as ever: the first job here is the last to be done."""
    waits = [{"seconds": s} for s in (1.0, 0.3, 0.0)]
    with processes(2) as executor:
        list(executor.map("echo", [{}, {}]))  # both processes are there
        numbers = [{"i": np.array(i)} for i in range(3)]
        results = list(executor.map("dawdle", numbers, waits))
        assert [int(r["i"]) for r in results] == [0, 1, 2]
        assert results[0]["span"][1] > results[1]["span"][0], "two at a time"
        futures = [executor.submit("dawdle", a, p) for a, p in zip(numbers, waits, strict=True)]
        assert [int(f.result()["i"]) for f in as_completed(futures)] == [1, 2, 0]


@pytest.mark.real_time
def test_progress_is_followed_to_the_end_and_callbacks_are_called() -> None:
    called: list[object] = []
    with processes() as executor:
        future = executor.submit("dawdle", {}, {"steps": 5, "seconds": 0.1})
        future.add_done_callback(called.append)
        seen = list(future.follow())
        assert seen == sorted(seen) and seen[-1] == (5, 5) and len(set(seen)) > 3
        assert future.result() and called == [future]


@posix
@pytest.mark.real_time
@pytest.mark.parametrize("stopped", [False, True])
def test_cancelling_a_running_job_ends_its_process_at_once(stopped: bool, tmp_path: Path) -> None:
    with processes() as executor:
        future = executor.submit("dawdle", {}, {"seconds": 60.0, "file": str(tmp_path / "pid")})
        pid = begun(tmp_path / "pid")
        if stopped:
            os.kill(pid, signal.SIGSTOP)
        began = time.monotonic()
        assert future.cancel() and future.cancelled() and future.done()
        assert time.monotonic() - began < 1.0 and gone(pid, 1.0)
        with pytest.raises(CancelledError):
            future.result()
        assert future.cancel(), "safe to call twice"
        assert int(executor.submit("echo").result(60)["pid"]) != pid, "the next job gets another process"


@pytest.mark.real_time
def test_a_job_cancelled_before_it_began_is_never_begun(tmp_path: Path) -> None:
    with processes() as executor:
        first = executor.submit("dawdle", {}, {"seconds": 0.3, "file": str(tmp_path / "first")})
        second = executor.submit("dawdle", {}, {"file": str(tmp_path / "second")})
        pid = begun(tmp_path / "first")
        assert second.cancel() and second.cancelled()
        assert int(first.result(60)["pid"]) == pid
        assert int(executor.submit("echo").result(60)["pid"]) == pid
    assert not (tmp_path / "second").exists()


def test_cancelling_what_is_done_changes_nothing(executor: JobExecutor) -> None:
    future = executor.submit("echo")
    pid = int(future.result(60)["pid"])
    assert not future.cancel() and not future.cancelled() and int(future.result()["pid"]) == pid
    assert int(executor.submit("echo").result(60)["pid"]) == pid


def test_no_job_is_ended_in_anothers_place() -> None:
    """Cancelled at any moment, the end of the job included, a job takes nobody with it."""
    with processes() as executor:
        executor.submit("echo").result(60)
        for i in range(12):
            one = executor.submit("dawdle", {}, {"seconds": 1e-3 * (i % 4)})
            other = executor.submit("dawdle", {"i": np.array(i)})
            time.sleep(5e-4 * i)
            cancelled = one.cancel()
            assert cancelled == one.cancelled() and int(other.result(60)["i"]) == i


def test_leaving_the_progress_half_way_ends_the_job(tmp_path: Path) -> None:
    with processes() as executor:
        future = executor.submit("dawdle", {}, {"seconds": 60.0, "file": str(tmp_path / "pid")})
        steps = future.follow()
        next(steps)
        pid = begun(tmp_path / "pid")
        steps.close()
        assert future.cancelled() and gone(pid)


def test_shutdown_waits_for_what_was_given() -> None:
    executor = processes()
    futures = [executor.submit("dawdle", {}, {"seconds": 0.1}) for _ in range(2)]
    executor.shutdown()
    executor.shutdown()
    assert all(f.done() and gone(int(f.result()["pid"]), 1.0) for f in futures)
    with pytest.raises(RuntimeError, match="after shutdown"):
        executor.submit("echo")


def test_shutdown_without_waiting_lets_the_process_end_with_its_job(tmp_path: Path) -> None:
    executor = processes()
    future = executor.submit("dawdle", {}, {"seconds": 1.0, "file": str(tmp_path / "pid")})
    executor.shutdown(wait=False)
    assert not future.done()
    assert gone(int(future.result(60)["pid"]))


def test_a_worker_that_began_ahead_does_its_jobs_and_no_other_starts(tmp_path: Path) -> None:
    file = tmp_path / "first"
    with processes(2) as executor:
        executor.begin(1, "dawdle", {"file": str(file), "seconds": 0.5})
        found = executor.submit("echo").result(60)  # asked for while the first job runs
        assert int(found["pid"]) == begun(file) and len(executor._threads) == 1
        executor.begin(1, "refuse", {})
        assert len(executor._threads) == 1, "it is there already"
        executor.begin(3, "refuse", {})
        assert len(executor._threads) == 2, "the second of two"
        both = [executor.submit("dawdle", {}, {"seconds": 1.0}) for _ in range(2)]
        assert len({int(job.result(60)["pid"]) for job in both}) == 2, "a first job that is refused changes nothing"


def test_nobody_waits_for_a_worker_that_began_for_nothing(tmp_path: Path) -> None:
    with processes() as executor:
        executor.begin(1, "dawdle", {"file": str(tmp_path / "first"), "seconds": 300.0})
        pid = begun(tmp_path / "first")
    assert gone(pid, 5.0)
    executor.begin(1, "echo", {})
    assert len(executor._threads) == 1, "it was shut down"


def test_an_exception_in_the_block_ends_running_and_waiting_jobs(tmp_path: Path) -> None:
    with pytest.raises(KeyError), processes() as executor:
        running = executor.submit("dawdle", {}, {"seconds": 60.0, "file": str(tmp_path / "pid")})
        waiting = executor.submit("echo")
        pid = begun(tmp_path / "pid")
        raise KeyError
    assert running.cancelled() and waiting.cancelled() and gone(pid)


def test_a_crash_is_told_with_the_last_words_and_the_next_job_goes_on() -> None:
    with processes() as executor:
        futures = [executor.submit("die"), executor.submit("echo")]
        error = futures[0].exception(60)
        assert isinstance(error, DermisError) and error.code == "job-crashed"
        assert error.value.startswith("status 3: ") and error.value.endswith("last words")
        assert futures[0].progress() == (1, 3)
        assert futures[1].result(60)


@posix
def test_kill_9_of_a_worker_is_told(tmp_path: Path) -> None:
    with processes() as executor:
        future = executor.submit("dawdle", {}, {"seconds": 60.0, "file": str(tmp_path / "pid")})
        os.kill(begun(tmp_path / "pid"), signal.SIGKILL)
        error = future.exception(60)
        assert isinstance(error, DermisError) and error.code == "job-crashed" and "status -9" in error.value
        assert not future.cancelled() and executor.submit("echo").result(60)
        idle = int(executor.submit("echo").result(60)["pid"])
        os.kill(idle, signal.SIGKILL)
        assert gone(idle)
        assert int(executor.submit("echo").result(60)["pid"]) != idle, "one that died while it had nothing to do"


def test_a_worker_that_cannot_be_started_is_told(tmp_path: Path) -> None:
    with ProcessExecutor(table=TABLE, line=[str(tmp_path / "no-such-python")]) as executor:
        with pytest.raises(DermisError, match="a worker cannot be started"):
            executor.submit("echo").result(60)


def test_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with processes() as executor:
        wait([executor.submit(name) for name in ("echo", "refuse", "die", "fail")])
        executor.submit("dawdle", {}, {"seconds": 60.0}).cancel()
        executor.submit("echo").result(60)
        executors = [processes(), executor]
        pids = [int(e.submit("echo").result(60)["pid"]) for e in executors]
        child.close_all()
        assert all(gone(pid) for pid in pids)
    assert not list(tmp_path.iterdir())


@posix
def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys, time\nfrom pathlib import Path\nfrom tests.unit.work.test_executor import processes\n"
        "processes().submit('dawdle', {}, {'seconds': 60.0, 'file': sys.argv[1]})\n"
        "while not (Path(sys.argv[1]).exists() and Path(sys.argv[1]).read_text()): time.sleep(0.01)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    line = [sys.executable, "-c", code, str(tmp_path / "pid")]
    done = subprocess.run(line, env=child.environment() | {"TMPDIR": str(tmp_path)}, timeout=60)
    assert done.returncode == -signal.SIGKILL and gone(int((tmp_path / "pid").read_text()))


@posix
def test_a_process_that_splits_off_ends_by_itself_and_ends_nobody() -> None:
    code = (
        "import os, sys, time\nfrom tests.unit.work.test_executor import processes\n"
        "future = processes().submit('dawdle', {}, {'seconds': 1.0})\n"
        "while future.progress() == (0, 0): time.sleep(0.01)\n"
        "if os.fork() == 0: sys.exit(3)\n"
        "print(os.waitstatus_to_exitcode(os.wait()[1]), 'span' in future.result(60))\n"
    )
    line = [sys.executable, "-W", "ignore", "-c", code]  # from 3.12 on Python warns of forks beside threads
    done = subprocess.run(line, env=child.environment(), timeout=60, capture_output=True, text=True)
    assert done.stdout == "3 True\n", done.stderr


def test_the_end_of_python_ends_what_runs(tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom tests.unit.work.test_executor import processes\n"
        "executor = processes()\nexecutor.submit('dawdle', {}, {'seconds': 60.0, 'file': sys.argv[1]})\n"
        "while not (Path(sys.argv[1]).exists() and Path(sys.argv[1]).read_text()): time.sleep(0.01)\n"
    )
    line = [sys.executable, "-c", code, str(tmp_path / "pid")]
    done = subprocess.run(line, env=child.environment(), timeout=60, capture_output=True)
    assert done.returncode == 0 and not done.stderr and gone(int((tmp_path / "pid").read_text()))


def test_the_installed_layout_works_the_same(tmp_path: Path) -> None:
    """In the extension core/ lies inside another package and is imported under a long name."""
    home = tmp_path / "bl_ext" / "user_default" / "dermis"
    shutil.copytree(CORE, home / "core", ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "from bl_ext.user_default.dermis.core.work.child import command, environment\n"
        "from bl_ext.user_default.dermis.core.work.processes import ProcessExecutor\n"
        "with ProcessExecutor() as executor:\n"
        "    skin = {'skin': {}, 'level': 'draft', 'folder': 'skins', 'limit': 10**9}\n"
        "    print(sorted(executor.submit('skin', {}, skin).result()))\n"
        "print(command('work')[1:]); print(environment()['PYTHONPATH'].split(__import__('os').pathsep)[0])\n"
    )
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    env["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if "packages" in p or "wheels" in p)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.stdout.splitlines() == ["['pad', 'tetrahedra']", "['-s', '-m', 'core', 'work']", str(home)], done.stderr


def test_children_have_one_blas_thread_and_our_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", ["/x/site-packages", "/lib/python3", "/y/dist-packages/", "/x/site-packages"])
    env = child.environment()
    assert env["OPENBLAS_NUM_THREADS"] == "1"
    assert env["PYTHONPATH"].split(os.pathsep) == [str(CORE.parent), "/x/site-packages", "/y/dist-packages/"]
