"""Child processes: jobs by name, errors in words, and nothing left behind, in both layouts of the engine."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import core
from core.errors import DermisError
from core.work import child
from core.work.child import Worker

CORE = Path(core.__file__).parent


def result(steps: Generator[tuple[int, int], None, dict[str, Any]]) -> tuple[list[tuple[int, int]], dict[str, Any]]:
    seen = []
    while True:
        try:
            seen.append(next(steps))
        except StopIteration as stop:
            return seen, stop.value


def gone(pid: int, seconds: float = 10.0) -> bool:
    """Wait until a process has ended."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.02)
    return False


def test_arrays_go_there_and_back_to_the_bit() -> None:
    arrays = {"a": np.random.default_rng(0).normal(size=(3, 4)), "b": np.arange(5, dtype=np.int16), "c": np.array("é")}
    with Worker() as worker:
        seen, found = result(worker.run("probe", arrays, {"k": [1, "x"]}))
        assert {k: (v.dtype, v.tolist()) for k, v in found.items() if k != "found"} == {
            k: (v.dtype, v.tolist()) for k, v in arrays.items()
        }
        assert seen[-1] == (1, 1)
        report = json.loads(str(found["found"]))
        assert report["parameters"] == {"k": [1, "x"]}
        assert report["python"] == sys.version.split()[0] and report["numpy"] == np.__version__
        assert result(worker.run("probe"))[1].keys() == {"found"}, "one worker does many jobs"


def test_errors_come_back_as_errors_and_the_worker_lives() -> None:
    with Worker() as worker:
        with pytest.raises(DermisError) as caught:
            result(worker.run("brew"))
        assert (caught.value.what, caught.value.value) == ("no such job", "brew")
        assert "probe" in caught.value.limit.split(", ")
        with pytest.raises(DermisError, match="an array of Python objects cannot be written"):
            result(worker.run("probe", {"x": np.array([{}], dtype=object)}))
        assert "found" in result(worker.run("probe"))[1]


def test_a_job_that_breaks_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The child's side, in this process: what is not a DermisError is named, not swallowed."""
    np.savez(tmp_path / "in.npz")
    request = {"job": "odd", "parameters": {}, "in": str(tmp_path / "in.npz"), "out": str(tmp_path / "out.npz")}
    with (tmp_path / "replies").open("wb") as replies:
        answer = child._do(request, {"odd": (".errors", "worst")}, replies)
    assert answer["error"]["what"] == "the job failed: TypeError" and "worst" in answer["error"]["value"]


def test_closing_ends_the_process_and_removes_its_files() -> None:
    worker = Worker()
    result(worker.run("probe"))
    folder, pid = worker._folder, worker.pid
    assert folder.is_dir()
    worker.close()
    worker.close()
    assert gone(pid) and not folder.exists()
    with pytest.raises(DermisError, match="the worker has ended"):
        next(worker.run("probe"))


def test_close_all_ends_every_worker() -> None:
    workers = [Worker(), Worker()]
    child.close_all()
    assert all(gone(w.pid) for w in workers)


def test_abandoning_a_job_ends_the_worker() -> None:
    worker = Worker()
    steps = worker.run("probe", {"x": np.zeros(10)})
    next(steps)
    steps.close()
    assert gone(worker.pid)


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_a_killed_worker_is_reported() -> None:
    with Worker() as worker:
        steps = worker.run("probe", {"x": np.zeros(10)})
        os.kill(worker.pid, signal.SIGSTOP)
        os.kill(worker.pid, signal.SIGKILL)
        with pytest.raises(DermisError, match=r"the worker (ended before its job did|has ended) .*status -9"):
            result(steps)


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_workers_end_when_their_parent_is_killed() -> None:
    code = (
        "import os, signal\nfrom core.work.child import Worker\nw = Worker()\nfor _ in w.run('probe'): pass\n"
        "print(w.pid, w._folder, flush=True)\nos.kill(os.getpid(), signal.SIGKILL)\n"
    )
    env = {**os.environ, "PYTHONPATH": str(CORE.parent)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    pid, folder = done.stdout.split()
    try:
        assert done.returncode == -signal.SIGKILL and gone(int(pid))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def test_the_installed_layout_works_the_same(tmp_path: Path) -> None:
    """In the extension core/ lies inside another package and is imported under a long name."""
    home = tmp_path / "bl_ext" / "user_default" / "dermis"
    shutil.copytree(CORE, home / "core", ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "from bl_ext.user_default.dermis.core.work.child import Worker, command, environment\n"
        "import numpy\n"
        "with Worker() as w:\n"
        "    steps = w.run('probe', {'x': numpy.arange(3)})\n"
        "    try:\n"
        "        while True: next(steps)\n"
        "    except StopIteration as stop: print(stop.value['x'].tolist())\n"
        "print(command('work')[1:]); print(environment()['PYTHONPATH'].split(__import__('os').pathsep)[0])\n"
    )
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.stdout.splitlines() == ["[0, 1, 2]", "['-s', '-m', 'core', 'work']", str(home)], done.stderr


def test_children_have_one_blas_thread_and_our_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", ["/x/site-packages", "/lib/python3", "/y/dist-packages/", "/x/site-packages"])
    env = child.environment()
    assert env["OPENBLAS_NUM_THREADS"] == "1"
    assert env["PYTHONPATH"].split(os.pathsep) == [str(CORE.parent), "/x/site-packages", "/y/dist-packages/"]
