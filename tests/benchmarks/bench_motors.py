"""How many motors: look-up beside a plain k-d tree and brute force, collection, and a whole answer.

The table is the paper's: the cable platform's 166,375 rows of 20 readings, collected once into a cache folder of the
benchmark (a minute on two cores; it says how long) and read from there afterwards. Queries are what the virtual sensor
reads along the six interactions, with noise and wobble. All of them are looked up, those in the air too: ours knows
that readings of untouched skin need no search. A peer counts only where its neighbours are ours.
"""

from __future__ import annotations

import functools
import gc
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from . import Result, benchmark, measure, one_blas_thread, timing

FOLDER = Path(os.environ.get("XDG_CACHE_HOME") or Path(tempfile.gettempdir())) / "dermis-bench-motors"
TIMES_FASTER = 3.0
COLLECT_PER_S, COLLECT_ROWS = 1500.0, 6144
SINGLES, BRUTE = 1500, 64
OTHER_SKIN = "index_large"
WHOLE, FEW = bool(os.environ.get("DERMIS_BENCH_WHOLE")), 2  # seeds of the short form
ENOUGH = 0.9  # of the verdicts


@functools.cache
def table() -> Any:
    """Return the cable platform's whole table, collected once."""
    from core.design.collect import collect
    from core.matching.table import SkinTable
    from core.presets import Library
    from core.skin.model import fingertip_skin
    from core.skin.shape import FingertipShape
    from core.version import ENGINE
    from core.work.processes import ProcessExecutor

    spec, shape = Library().device("cable_platform"), FingertipShape()
    key = f"{spec.hash[:12]}-{fingertip_skin(shape, level='draft').key[:12]}-points-engine{ENGINE}"
    path = FOLDER / f"{key}.npz"
    if path.exists():
        return SkinTable.load(path)
    started = time.perf_counter()
    with ProcessExecutor(os.cpu_count() or 1) as executor:
        steps = collect(spec, shape, FOLDER / "parts", level="draft", executor=executor)
        while True:
            try:
                next(steps)
            except StopIteration as stop:
                made = stop.value
                break
    made.save(path)
    print(f"collected {made.meta['asked']} rows in {time.perf_counter() - started:.0f} s, into {path}")
    return SkinTable.load(path)


@functools.cache
def queries(skin: str = "index_medium") -> Any:
    """Return what is sensed along the six interactions on a size of finger, shape (q, 20), whole counts."""
    from core.design.interactions import NAMES, NOISE
    from core.design.trial import felt, sense
    from core.presets import Library
    from core.skin.model import skin_from_parameters

    model = skin_from_parameters(Library().skin(skin), level="draft")
    with one_blas_thread():
        sensed = [sense(felt(model, name, 0), NOISE, i) for i, name in enumerate(NAMES)]
    return np.vstack(sensed).astype(np.float64)


@benchmark("lookup_us")
def lookup() -> Result:
    """One query at a time, as it comes from a sensor."""
    return _looked_up("lookup_us", queries(), single=True)


@benchmark("lookup_batch_us")
def lookup_batch() -> Result:
    """All queries of the six interactions at once, per query."""
    return _looked_up("lookup_batch_us", queries(), single=False)


@benchmark("lookup_far_us")
def lookup_far() -> Result:
    """One at a time, from a larger finger than the table's: off its sheet."""
    return _looked_up("lookup_far_us", queries(OTHER_SKIN), single=True)


@benchmark("lookup_far_batch_us")
def lookup_far_batch() -> Result:
    """All at once, from a larger finger than the table's."""
    return _looked_up("lookup_far_batch_us", queries(OTHER_SKIN), single=False)


@benchmark("collect_rows_per_s")
def collect_rows() -> Result:
    """Rows pressed a second by one process, the skin at hand; from below."""
    from core.matching.readings import readings_of
    from core.matching.sweep import sweep
    from core.matching.table import press_of, tabulate
    from core.presets import Library
    from core.skin.model import fingertip_skin

    spec, skin = Library().device("cable_platform"), fingertip_skin(level="draft")
    press, sensor = press_of(skin, spec), readings_of(skin)
    whole, _ = sweep(spec, press.points.positions)
    commands = whole[:: len(whole) // COLLECT_ROWS][:COLLECT_ROWS]
    rates = []
    with one_blas_thread():
        for _ in range(3):
            started = time.perf_counter()
            tabulate(sensor, commands, press.press(commands))
            rates.append(len(commands) / (time.perf_counter() - started))
    rate = float(np.median(rates))
    wrong = None if rate >= COLLECT_PER_S else f"below {COLLECT_PER_S:g} rows a second"
    print(f"{len(skin.mesh.tetrahedra)} tetrahedra")
    return Result("collect_rows_per_s", rate, "1/s", None, {}, wrong)


@benchmark("design_scene_s", limit=2.0)
def design_scene() -> Result:
    """From a baked scene of 10 s, the table given, to number, couplings, picture and preset."""
    from core.contact.skin_sampler import SkinSampler
    from core.design import task
    from core.design.interactions import NOISE, interaction
    from core.design.trial import sense
    from core.matching.table import SkinTable
    from core.presets import Library
    from core.skin.model import fingertip_skin

    spec, skin = Library().device("cable_platform"), fingertip_skin(level="draft")
    scene = interaction("tip", skin.positions, seed=0, repetitions=2)  # 9 s and a rest on both sides
    sampler = SkinSampler(scene, {0: skin})
    for chunk in scene.chunks:
        sampler.add(chunk)
    touch = sampler.finish()[0]
    given = table()
    with tempfile.TemporaryDirectory() as folder:
        given.save(Path(folder) / "table.npz")

        def once() -> None:
            fresh = SkinTable.load(Path(folder) / "table.npz")
            steps = task.answer(spec, fresh, {"tip": sense(touch, NOISE, 0)})
            while True:
                try:
                    next(steps)
                except StopIteration as stop:
                    task.write(stop.value, Path(folder) / "out")
                    return

        taken = measure(once, 5, warmup=1)
    seconds = float(touch.times[-1] - touch.times[0])
    wrong = None if seconds >= 9.0 else f"the scene lasts {seconds:.1f} s"
    return Result("design_scene_s", 1e-3 * taken.median, "s", 1e-3 * taken.p95, {}, wrong)


@benchmark("motors_verdicts")
def motors_verdicts() -> Result:
    """How often the numbers of motors are those that the paper expects, on seeds that nothing was fitted to.

    Two seeds of twenty, 24 verdicts of 240; all with `DERMIS_BENCH_WHOLE` in the environment, which takes ten times as
    long. Both tables are whole.
    """
    from . import figures_s2

    seeds = range(figures_s2.FIRST, figures_s2.FIRST + (figures_s2.SEEDS if WHOLE else FEW))
    with one_blas_thread():
        found = figures_s2.verdicts_of(seeds)
    right = {key: sum(v.found[0] == v.expected for v in verdicts) for key, verdicts in found.items()}
    every = [v for verdicts in found.values() for v in verdicts]
    paper = sum(v.found[1] == v.expected for v in every)
    total = sum(right.values())
    wrong = None if total >= ENOUGH * len(every) else f"fewer than {100 * ENOUGH:g} % are as the paper expects"
    peers = {"out of": len(every), "by the paper's rule": paper, **right}
    return Result("motors_verdicts", total, "", None, peers, wrong)


def _looked_up(name: str, sensed: Any, *, single: bool) -> Result:
    from scipy.spatial import cKDTree

    from core.design.interactions import NOISE
    from core.matching.lookup import commands_of

    given = table().heard_with(NOISE)
    points = given.exact_readings[given.heard]
    tree = cKDTree(points)
    loud = given.from_rest(sensed) > given.noise_floor
    k = given.neighbours
    ours = given.by_reading.query(sensed[loud], k)
    distance, index = tree.query(sensed[loud], k + 1)
    wrong = [] if np.allclose(distance[:, :k], ours.distance, atol=1e-6) else ["ckdtree has other neighbours"]
    weights = 1.0 / np.maximum(distance[:, :k], 1e-150) ** 2 - 1.0 / distance[:, k:] ** 2
    index = index[:, :k]
    peers_answer = np.einsum("qk,qkm->qm", weights, given.heard_commands[index]) / weights.sum(axis=1, keepdims=True)
    off = np.abs(peers_answer - commands_of(given, sensed)[loud]).max(axis=1)
    if (off[ours.distance[:, 0] > 0] > 1e-9).any():
        wrong.append("ckdtree gives other commands")
    if single:
        own = _one_by_one(lambda q: commands_of(given, q), [q[None] for q in sensed[:: max(len(sensed) // SINGLES, 1)]])
        other = _one_by_one(lambda q: tree.query(q, k + 1), list(sensed[:: max(len(sensed) // SINGLES, 1)]))
    else:
        own = [1e3 / len(sensed) * measure(lambda: commands_of(given, sensed), 1, warmup=w).median for w in (1, 0, 0)]
        other = [1e3 / len(sensed) * measure(lambda: tree.query(sensed, k + 1), 1, warmup=0).median for _ in range(3)]

    def brute(query: Any) -> Any:
        return np.argpartition(((points - query) ** 2).sum(axis=1), k)[:k]

    forced = _one_by_one(brute, list(sensed[:: len(sensed) // BRUTE]))
    mine, peer = timing(own), timing(other)
    wanted = 1.0 if single else TIMES_FASTER  # a call costs as much as a search: one query shall cost no more
    if peer.median < wanted * mine.median:
        wrong.append(f"ckdtree takes {peer.median / mine.median:.1f} times as long, not {wanted:g}")
    peers = {"ckdtree": peer.median, "brute force": timing(forced).median}
    if single:
        print(f"{name}: mean {np.mean(own):.1f} us, ckdtree's {np.mean(other):.1f} us")
    return Result(name, mine.median, "us", mine.p95, peers, "; ".join(wrong) or None)


def _one_by_one(call: Callable[[Any], Any], inputs: list[Any]) -> list[float]:
    """Return the time of each call [us]."""
    taken = []
    with one_blas_thread():
        for given in inputs[:8]:
            call(given)
        gc.collect()
        gc.disable()
        try:
            for given in inputs:
                start = time.perf_counter()
                call(given)
                taken.append(1e6 * (time.perf_counter() - start))
        finally:
            gc.enable()
    return taken
