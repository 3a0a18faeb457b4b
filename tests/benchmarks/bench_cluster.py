"""Work on other machines' engine, here: what two workers of a dask scheduler cost, keep and lose over one process."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks import Result, benchmark, timing

SHOTS, RATE, COUNT = 24, 240, 240
JOBS = 200


@functools.cache
def folder() -> Path:
    """Return where everything goes."""
    return Path(tempfile.mkdtemp(prefix="dermis-bench-cluster-"))


@functools.cache
def shots() -> list[Path]:
    """Return scenes of a second: a finger with 128 pins presses a block and strokes it, deeper in each."""
    from core.scene import scene_file
    from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene
    from core.surface.gap import Surface

    times = np.arange(COUNT) / RATE
    block = Surface.block(60e-3, 60e-3, 20e-3).mesh
    block = replace(block, vertices=block.vertices - [0.0, 0.0, block.vertices[:, 2].max()])
    finger = Finger("Index", (DeviceUse("pin_array_128"),), {"skin_level": "draft"})
    made = []
    for number in range(SHOTS):
        pose = np.tile(np.eye(4), (1, COUNT, 1, 1))
        pose[0, :, 2, 3] = -(0.4e-3 + 0.04e-3 * number) * np.sin(np.pi * np.arange(COUNT) / (COUNT - 1))
        pose[0, :, 0, 3] = 5e-3 * np.sin(2 * np.pi * times)
        chunk = Chunk(times * RATE, times, pose, np.tile(np.eye(4), (1, COUNT, 1, 1)), pose[:0])
        body = Body("Block", block, {"friction": 0.3 + 0.01 * number})
        scene = TactileScene("shot", Fraction(RATE), (0, COUNT - 1), RATE, (finger,), (body,), (), [chunk])
        made.append(folder() / "shots" / f"shot_{number:02d}.npz")
        scene_file.save(scene, made[-1])
    return made


@contextmanager
def cluster() -> Iterator[Any]:
    """Give an executor over two workers."""
    from core.work.cluster import ClusterExecutor
    from tests.clusters import Cluster
    from tests.unit.work.jobs_lab import TABLE, on_worker

    with Cluster(2) as made, ClusterExecutor(made.address) as executor:
        with ClusterExecutor(made.address, table=TABLE, entry=on_worker) as lab:
            yield executor, lab


def rendered(name: str, scenes: list[Path], executor: Any, kills: tuple[int, ...] = ()) -> dict[str, bytes]:
    """Render shots into a folder of a name, killing a worker when so many are done; return the files by their path."""
    from core.pipeline.shot import Wanted
    from core.pipeline.shots import Rendered, render_shots
    from core.presets import Library

    out = folder() / name
    victims = iter(sorted(executor._client.run(os.getpid).values()) if kills else ())
    done = 0
    for step in render_shots(scenes, Library(), out, Wanted(), executor):
        if isinstance(step, Rendered):
            done += step.error is None
            if done in kills:
                os.kill(next(victims), signal.SIGKILL)
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*.csv")}


@dataclass(frozen=True)
class Found:
    """What was measured.

    Attributes:
        one, children, workers, client: processor's seconds of one process, of two child processes of ours, of two
            workers, and of the client beside them. alone, together, killed: files by path.
        trips: seconds of single jobs, there and back. each: of one among many. peak: memory of a worker [MB].
    """

    one: float
    children: float
    workers: float
    client: float
    alone: dict[str, bytes]
    together: dict[str, bytes]
    killed: dict[str, bytes]
    trips: list[float]
    each: float
    peak: float


@functools.cache
def found() -> Found:
    """Measure all of it once."""
    from core.work.executor import InlineExecutor
    from core.work.processes import ProcessExecutor

    with InlineExecutor() as inline:
        rendered("warm", shots()[:1], inline)
        before = time.process_time()
        alone = rendered("alone", shots(), inline)
        one = time.process_time() - before
    with ProcessExecutor(2) as processes:
        before = os.times()
        rendered("children", shots(), processes)
    children = os.times().children_user + os.times().children_system - before.children_user - before.children_system
    with cluster() as (executor, lab):
        executor._client.wait_for_workers(2)
        rendered("warm_workers", shots()[:6], executor)  # what is imported, once a process
        before, spent = time.process_time(), executor._client.run(time.process_time)
        together = rendered("together", shots(), executor)
        client = time.process_time() - before
        workers = sum(seconds - spent[key] for key, seconds in executor._client.run(time.process_time).items())
        peak = max(executor._client.run(_peak).values())
        lab.submit("echo").result(60)
        trips = []
        for _ in range(30):
            start = time.perf_counter()
            lab.submit("echo").result(60)
            trips.append(time.perf_counter() - start)
        start = time.perf_counter()
        futures = [lab.submit("echo") for _ in range(JOBS)]
        for future in futures:
            future.result(60)
        each = (time.perf_counter() - start) / JOBS
        killed = rendered("killed", shots(), executor, (6, 14))
    return Found(one, children, workers, client, alone, together, killed, trips, each, peak)


def _peak() -> float:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


@benchmark("dask_cpu_overhead", limit=1.10)
def overhead() -> Result:
    """Processor's seconds of two workers over one process: 24 shots of a second, 128 pins on draft skin."""
    one, workers, client = found().one, found().workers, found().client
    peers = {"two child processes": found().children / one, "one process, s": one, "client, s": client}
    peers["a worker's memory, MB"] = found().peak
    return Result("dask_cpu_overhead", workers / one, "", None, peers)


@benchmark("dask_overhead_ms", limit=20.0)
def trip() -> Result:
    """A job that does nothing, there and back; the peer is one of 200 that are handed out at once."""
    trips = timing([1e3 * seconds for seconds in found().trips])
    return Result("dask_overhead_ms", trips.median, "ms", trips.p95, {"one of 200": 1e3 * found().each})


@benchmark("dask_bytes_equal")
def equal() -> Result:
    """1 where 24 shots by two workers are the bytes of one process."""
    same = len(found().alone) == SHOTS and found().together == found().alone
    return Result("dask_bytes_equal", float(same), "", None, {}, None if same else "other bytes")


@benchmark("dask_kill_lost", limit=0.0)
def lost() -> Result:
    """Shots of 24 that are missing, or other bytes, after each of two workers was killed in the middle."""
    killed, alone = found().killed, found().alone
    return Result("dask_kill_lost", float(sum(killed.get(name) != data for name, data in alone.items())), "")


@benchmark("sweep_resume_redone", limit=0.0)
def redone() -> Result:
    """Rows that a sweep does once more after it was killed in the middle; the peer is how many were there then."""
    from core.presets import Library
    from core.steps import drain
    from core.sweep.run import run_sweep
    from core.sweep.spec import read
    from core.work.child import command, environment
    from core.work.processes import ProcessExecutor

    out, spec = folder() / "table", folder() / "sweep.toml"
    vary = '[vary]\ndevice = "pin_array_128"\n"use.pin_method" = ["DM2", "FM2"]\n"body.friction" = [0.2, 0.4]\n'
    scenes = ", ".join(f"'{path}'" for path in shots()[:3])
    spec.write_text(f'schema = "dermis-sweep 1"\nstudy = "devices"\nscenes = [{scenes}]\n{vary}')
    words = command("sweep", str(spec), "--out", str(out), "--workers", "1", "--quiet")
    running = subprocess.Popen(words, env=environment(), stderr=subprocess.DEVNULL)
    while len(list(out.glob("rows/*.json"))) < 4:
        if running.poll() is not None:
            return Result("sweep_resume_redone", None, "", None, {}, "it ended before it was killed")
        time.sleep(0.005)
    running.kill()
    running.wait()
    there = {path: path.stat().st_mtime_ns for path in out.glob("rows/*.json")}
    with ProcessExecutor(2) as executor:
        made = drain(run_sweep(read(spec), Library(), out, executor))
    again = sum(path.stat().st_mtime_ns != at for path, at in there.items())
    wrong = None if made.done + len(there) == made.rows == 12 else f"{made.done} of {made.rows} done"
    return Result("sweep_resume_redone", float(again), "", None, {"there": float(len(there))}, wrong)
