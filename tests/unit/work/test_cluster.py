"""Jobs by name on the workers of a dask scheduler: results, refusals, deaths, cancelling, other engines, TLS."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.work import engine as engines
from core.work.cluster import LARGE, ClusterExecutor, Keys, is_open, serve
from core.work.engine import ALIKE, SAME, check_same, engine, unlike
from core.work.executor import InlineExecutor
from core.work.jobs import JOBS
from core.work.parcel import packed, unpacked
from core.work.spread import Asked, spread
from tests.clusters import MISSING, Cluster, ended, has_dask
from tests.unit.work.jobs_lab import TABLE, on_worker

pytestmark = pytest.mark.shared_tests("dask has the processes; those of Dermis run on both lines")

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
SOON = 60.0


@pytest.fixture(scope="module")
def executor(cluster: Cluster) -> Iterator[ClusterExecutor]:
    with ClusterExecutor(cluster.address, table=TABLE, entry=on_worker) as made:
        yield made


# -- what travels


def test_a_parcel_holds_values_and_arrays_to_the_bit_and_equal_ones_are_equal_bytes() -> None:
    arrays = {"a/b": np.random.default_rng(0).normal(size=(3, 4)), "c": np.array("é"), "d": np.zeros((0, 3), np.int8)}
    head, found = unpacked(packed({"x": [1, None, float("inf")], "é": {"y": 0.1}}, arrays), "here")
    assert head == {"x": [1, None, float("inf")], "é": {"y": 0.1}}
    assert {k: (v.dtype, v.shape, v.tolist()) for k, v in found.items()} == {
        k: (v.dtype, v.shape, v.tolist()) for k, v in arrays.items()
    }
    assert packed({"x": 1}, arrays) == packed({"x": 1}, {k: v.copy() for k, v in arrays.items()})
    with pytest.raises(DermisError, match="Python objects"):
        packed({}, {"a": np.array([{}], dtype=object)})


def test_what_is_no_parcel_is_refused() -> None:
    whole = packed({"x": 1}, {"a": np.arange(9)})
    for data in (b"", b"PK", whole[: len(whole) // 2], whole.replace(b"{", b"["), b"x" + whole[1:]):
        with pytest.raises(DermisError, match="^a job"):
            unpacked(data, "a job")


def test_a_worker_answers_refusals_and_nonsense_in_words() -> None:
    head = {"job": "refuse", "parameters": {}, "engine": dict(engine()), "large": []}
    for request, code in (
        (packed(head, {}), "too-thick"),
        (packed({**head, "job": "brew"}, {}), "no-such-job"),
        (b"nonsense", "refused"),
        (packed({**head, "engine": {**engine(), "dermis": "0.0.1"}}, {}), "other-version"),
    ):
        reply, arrays = unpacked(serve(request, (), TABLE), "a reply")
        assert reply["error"]["code"] == code and not arrays and reply["engine"] == dict(engine())


# -- engines


def test_another_version_or_preset_is_refused_and_both_are_named() -> None:
    assert set(engine()) == {*SAME, *ALIKE} and all(engine().values())
    check_same(engine(), "worker a")
    check_same({**engine(), "numpy": "0.1"}, "worker a")
    assert unlike(engine()) == "" and unlike({**engine(), "numpy": "0.1"}) == f"numpy 0.1 (here {np.__version__})"
    for name in SAME:
        with pytest.raises(DermisError) as caught:
            check_same({**engine(), name: "other"}, "worker a")
        error = caught.value
        assert (error.code, error.where) == ("other-version", "worker a")
        assert (error.value, error.limit) == (f"{name} other", f"{name} {engine()[name]}")


def test_the_digest_is_of_names_and_words_and_blind_to_line_ends(tmp_path: Path) -> None:
    def digest(**files: bytes) -> str:
        folder = tmp_path / os.urandom(4).hex()
        for name, data in files.items():
            path = folder / name.replace("__", "/").replace("_py", ".py")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return engines._digest(folder, "**/*.py")

    one = digest(a_py=b"x\ny\n", b__c_py=b"z\n")
    assert (
        one == digest(a_py=b"x\r\ny\r\n", b__c_py=b"z\n") == digest(a_py=b"x\ny\n", b__c_py=b"z\n", built_in__d_py=b"")
    )
    assert one not in (digest(a_py=b"x\ny\n", b__d_py=b"z\n"), digest(a_py=b"x\ny", b__c_py=b"z\n"), digest(a_py=b""))


# -- the door


def test_without_dask_the_error_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setitem(sys.modules, "dask", None)
    with pytest.raises(DermisError, match=r'pip install "dermis\[dask\]"') as caught:
        ClusterExecutor("tcp://127.0.0.1:1")
    assert caught.value.code == "no-dask"


@pytest.mark.parametrize("address", ["tls://127.0.0.1:1", "tcp://127.0.0.1:1"])
def test_keys_and_a_tls_address_belong_together(address: str) -> None:
    keys = None if address.startswith("tls") else Keys("a", "b", "c")
    with pytest.raises(DermisError, match="TLS needs both"):
        ClusterExecutor(address, keys)


def test_an_address_that_others_can_listen_to_is_known() -> None:
    assert [is_open(a) for a in ("tcp://127.0.0.1:1", "tcp://localhost:1", "tcp://[::1]:1", "tls://10.0.0.1:1")] == [
        False
    ] * 4
    assert all(is_open(a) for a in ("tcp://10.0.0.1:1", "tcp://node7:8786", "10.0.0.1:1"))


def test_nobody_at_the_address_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    if not has_dask():
        pytest.skip(MISSING)
    monkeypatch.setattr("core.work.cluster.CONNECT_SECONDS", 0.5)
    with pytest.raises(DermisError) as caught:
        ClusterExecutor("tcp://127.0.0.1:9")
    assert (caught.value.code, caught.value.where) == ("no-scheduler", "tcp://127.0.0.1:9")


# -- jobs on workers


def test_arrays_go_there_and_back_to_the_bit(executor: ClusterExecutor) -> None:
    large = np.random.default_rng(0).normal(size=(LARGE // 8 + 1,))
    arrays = {"a": np.arange(6.0).reshape(2, 3)[:, ::-1], "large": large, "c": np.array("é")}
    found = executor.submit("echo", arrays, {"k": [1, "x"]}).result(SOON)
    assert {k: (found[k].dtype, found[k].tolist()) for k in arrays} == {
        k: (v.dtype, v.tolist()) for k, v in arrays.items()
    }
    assert json.loads(str(found["found"]))["parameters"] == {"k": [1, "x"]}
    assert int(found["pid"]) != os.getpid()
    assert executor.unlike == set(), "the same machine, the same wheels"


def test_what_many_jobs_need_is_sent_once_and_forgotten_with_the_last(executor: ClusterExecutor) -> None:
    large = np.arange(LARGE, dtype=np.int64)
    futures = [executor.submit("echo", {"x": large, "i": np.array(i)}) for i in range(8)]
    assert len(executor._large) == 1
    assert [(int(f.result(SOON)["i"]), int(f.result()["x"].sum())) for f in futures] == [
        (i, int(large.sum())) for i in range(8)
    ]
    end = time.monotonic() + SOON
    while executor._large and time.monotonic() < end:
        time.sleep(0.01)
    assert not executor._large and not executor._open


def test_refusals_and_defects_come_back_whole(executor: ClusterExecutor) -> None:
    with pytest.raises(DermisError) as caught:
        executor.submit("refuse").result(SOON)
    error = caught.value
    assert (error.code, error.what, error.where) == ("too-thick", "the disc is too thick", "disc")
    failed = executor.submit("fail").exception(SOON)
    assert isinstance(failed, DermisError) and failed.code == "job-failed" and failed.what.endswith("KeyError")
    with pytest.raises(DermisError, match="no such job"):
        executor.submit("brew")
    with pytest.raises(DermisError, match="plain values"):
        executor.submit("echo", {}, {"k": Path("/x")})


@posix
def test_a_dead_workers_job_is_done_by_another(executor: ClusterExecutor, tmp_path: Path) -> None:
    files = [tmp_path / str(i) for i in range(6)]
    futures = [
        executor.submit("dawdle", {"i": np.array(i)}, {"file": str(file), "seconds": 0.5})
        for i, file in enumerate(files)
    ]
    end = time.monotonic() + SOON
    while not any(file.exists() and file.read_text() for file in files):
        assert time.monotonic() < end, "none began"
        time.sleep(0.01)
    victim = next(int(file.read_text()) for file in files if file.exists() and file.read_text())
    os.kill(victim, signal.SIGKILL)
    found = [future.result(SOON) for future in futures]
    assert [int(made["i"]) for made in found] == list(range(6))
    assert ended(victim) and victim not in {int(made["pid"]) for made in found[1:]}


@posix
def test_a_job_that_kills_its_workers_is_given_up_in_words(cluster: Cluster) -> None:
    with ClusterExecutor(cluster.address, table=TABLE, entry=on_worker) as executor:
        error = executor.submit("die").exception(2 * SOON)
        assert isinstance(error, DermisError) and error.code == "job-crashed" and "died of the job" in error.what
        assert int(executor.submit("echo", {"i": np.array(3)}).result(SOON)["i"]) == 3


def test_cancelled_jobs_that_wait_never_run_and_what_runs_is_dropped(executor: ClusterExecutor, tmp_path: Path) -> None:
    files = [tmp_path / str(i) for i in range(8)]
    futures = [executor.submit("dawdle", {}, {"file": str(file), "seconds": 1.0}) for file in files]
    end = time.monotonic() + SOON
    while not any(file.exists() for file in files):
        assert time.monotonic() < end, "none began"
        time.sleep(0.01)
    assert all(future.cancel() for future in futures) and all(future.cancelled() for future in futures)
    with pytest.raises(CancelledError):
        futures[0].result(SOON)
    executor.submit("echo").result(SOON)
    time.sleep(0.2)
    assert not all(file.exists() for file in files), "jobs began after they were cancelled"


@pytest.mark.real_time
def test_leaving_by_an_exception_drops_what_runs(cluster: Cluster) -> None:
    with pytest.raises(ZeroDivisionError):
        with ClusterExecutor(cluster.address, table=TABLE, entry=on_worker) as executor:
            future = executor.submit("dawdle", {}, {"seconds": 3.0})
            started = time.monotonic()
            raise ZeroDivisionError
    assert future.cancelled() and time.monotonic() - started < 3.0
    with pytest.raises(RuntimeError, match="shutdown"):
        executor.submit("echo")


def test_a_worker_of_another_engine_is_refused_at_the_door_and_by_each_job(tmp_path: Path) -> None:
    """Its sources differ by one comment."""
    if not has_dask():
        pytest.skip(MISSING)
    shutil.copytree(engines.CORE, tmp_path / "core", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("presets", "tests", "blender_addon"):
        (tmp_path / name).symlink_to(engines.CORE.parent / name)
    (tmp_path / "core" / "units.py").open("a").write("# another\n")
    with Cluster(0) as other:
        with ClusterExecutor(other.address) as early:
            elsewhere = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", ""), *sys.path])
            other.add(1, PYTHONPATH=elsewhere)
            late = early.submit("skin", {}, {"skin": {}, "level": "draft", "folder": str(tmp_path), "limit": 1})
            error = late.exception(SOON)
        assert isinstance(error, DermisError) and error.code == "other-version"
        with pytest.raises(DermisError) as caught:
            ClusterExecutor(other.address)
        assert caught.value.code == "other-version" and caught.value.where.startswith("worker tcp://127.0.0.1")
        assert engine()["sources"] in caught.value.limit and engine()["sources"] not in str(caught.value.value)


@posix
def test_when_the_scheduler_dies_nobody_waits_for_ever(tmp_path: Path) -> None:
    if not has_dask():
        pytest.skip(MISSING)
    with Cluster(0) as other:
        executor = ClusterExecutor(other.address, table=TABLE, entry=on_worker)
        future = executor.submit("echo")
        other.kill_scheduler()
        error = future.exception(SOON)
        assert isinstance(error, DermisError) and error.code == "job-crashed" and "lost the job" in error.what
        with pytest.raises(DermisError, match="the scheduler has gone"):
            executor.submit("echo")
        executor.close()


def test_a_tls_scheduler_serves_who_has_keys_and_nobody_else(tmp_path: Path) -> None:
    if not has_dask():
        pytest.skip(MISSING)
    if not shutil.which("openssl"):
        pytest.skip("TLS IS NOT TESTED: there is no openssl to make keys with")
    key, certificate = tmp_path / "key.pem", tmp_path / "cert.pem"
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1"]
    made += ["-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(certificate)]
    subprocess.run(made, check=True, capture_output=True)
    files = ("--tls-ca-file", str(certificate), "--tls-cert", str(certificate), "--tls-key", str(key))
    with Cluster(1, files, "tls") as secure:
        assert secure.address.startswith("tls://")
        with ClusterExecutor(secure.address, Keys(str(certificate), str(certificate), str(key))) as executor:
            assert "tetrahedra" in executor.submit(
                "skin", {}, {"skin": {}, "level": "draft", "folder": str(tmp_path / "skins"), "limit": 10**9}
            ).result(SOON)
        with pytest.raises(DermisError, match="no scheduler answers"):
            ClusterExecutor(secure.address.replace("tls://", "tcp://"))


# -- a few at a time


def test_no_more_are_under_way_than_there_is_room_for_and_all_are_done() -> None:
    drawn: list[int] = []

    def asked() -> Iterator[tuple[int, Asked]]:
        for i in range(7):
            drawn.append(i)
            yield i, Asked("echo", {"i": np.array(i)}, {})

    found, most = {}, 0
    for item in spread(InlineExecutor(2, table=TABLE), asked()):
        if item is not None:
            key, future = item
            found[key] = int(future.result()["i"])
            most = max(most, len(drawn) - len(found))
    assert found == {i: i for i in range(7)} and most <= 2


def test_leaving_drops_what_is_under_way(executor: ClusterExecutor) -> None:
    steps = spread(executor, ((i, Asked("dawdle", {}, {"seconds": 1.0})) for i in range(100)))
    next(steps)
    assert 0 < len(executor._open) <= executor.room()
    steps.close()
    assert not executor._open


def test_the_table_of_jobs_is_whole() -> None:
    from importlib import import_module

    for name, place in JOBS.items():
        module, _, function = place.partition(":")
        assert callable(getattr(import_module(f"core{module}"), function)), name
