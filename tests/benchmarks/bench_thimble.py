"""Thimble: time per frame of the search with its friction update, beside a simulation that refactors each time.

Targets are a ball, an edge and a sliding plane; none of them was made by the device. The paper needs 12.5 ms a frame
on 154 tetrahedra (7.5 ms of search on a network, 5 ms of friction update) and 126 ms with simulation in the search.
"""

from __future__ import annotations

import functools
import math
import time
from typing import Any

import numpy as np

from tests.benchmarks import Result, benchmark, measure, one_blas_thread, timing

PAPER_MS, PAPER_SIMULATED_MS = 12.5, 126.0
COMPONENTS = 60
FRAMES = 240
SURROGATE_LIMIT_US = 300.0
RECORDED_RUNS = 5  # of each kind of touch


@functools.cache
def device() -> Any:
    """The built-in thimble."""
    from core.devices.thimble import mechanism
    from core.presets import Library

    return mechanism(Library().device("thimble_3rrs"))


@functools.cache
def skin(level: str) -> Any:
    """The middle index finger."""
    from core.skin.model import fingertip_skin

    level, _, tissue = level.partition(", ")
    found = fingertip_skin(level=level)
    return found.with_law() if tissue else found


@functools.cache
def observation_matrix(level: str) -> Any:
    """Sixty stress components, fitted to the device."""

    from core.matching.description import DESCRIPTOR_MOVEMENTS
    from core.steps import drain
    from core.surrogate.dataset import record
    from core.surrogate.learned import descriptors
    from core.surrogate.store import contact_of

    own = skin(level).linear
    data = drain(record(device(), contact_of(device(), own, 0.6), DESCRIPTOR_MOVEMENTS))
    return descriptors(data, own.stress_components(), size=COMPONENTS).observation_matrix


@functools.cache
def frames(level: str) -> dict[str, Any]:
    """Run the three touches once; times in ms of target and of search with friction update, and what was found."""
    from core.matching.stress import StressMatcher
    from core.skin.observation import Observer
    from core.surrogate.store import contact_of
    from tests import touches

    model = skin(level)
    observer = Observer(model, observation_matrix(level))
    out: dict[str, Any] = {"target": [], "thimble": [], "evaluations": [], "left": [], "size": []}
    with one_blas_thread():
        follower = StressMatcher(device(), contact_of(device(), model, 0.6), observer)
        for touch in (touches.ball_roll(FRAMES), touches.edge_press(FRAMES), touches.slide(FRAMES)):
            path = touches.solver_on(model)
            follower.reset()
            for i in range(FRAMES):
                bodies = touch.bodies(i)
                start = time.perf_counter()
                step = path.step(bodies)
                between = time.perf_counter()
                frame = follower.step(observer.seen(step.nodal, step.amounts))
                end = time.perf_counter()
                if frame.minimum is not None:
                    out["target"].append(1e3 * (between - start))
                    out["thimble"].append(1e3 * (end - between))
                    out["evaluations"].append(frame.minimum.evaluations)
                    out["left"].append(frame.minimum.mismatch)
                    out["size"].append(frame.minimum.mismatch / max(frame.mismatch, 1e-12))
    return out


def refactor(level: str) -> float:
    """Milliseconds of one assembly and factorisation of the skin, with one solve."""
    from scipy.sparse.linalg import splu

    from core.skin.assembly import degrees, stiffness

    model = skin(level)
    free = degrees(model.mesh.free)
    force = np.zeros(len(free))
    force[0] = 1.0

    def once() -> Any:
        matrix = stiffness(model.mesh, model.material, "anp")[free][:, free]
        return splu(matrix.tocsc()).solve(force)

    return measure(once, 5, warmup=1).median


def frame_result(name: str, level: str, *, with_target: bool, p95_limit: float) -> Result:
    """The line of one frame time."""
    found = frames(level)
    total = np.array(found["thimble"]) + (np.array(found["target"]) if with_target else 0.0)
    times = timing(total.tolist())
    peer = refactor(level) * float(np.mean(found["evaluations"]))
    peers = {"refactor": peer, "paper, its machine": PAPER_MS, "paper, simulating": PAPER_SIMULATED_MS}
    error = None
    if times.p95 > p95_limit:
        error = f"the 95th percentile is above {p95_limit:g} ms"
    elif peer < 40 * times.median:
        error = f"refactoring takes {peer / times.median:.0f} times as long, not 40"
    return Result(name, times.median, "ms", times.p95, peers, error)


@benchmark("thimble_frame_ms", limit=1.0, quick=True)
def thimble_frame() -> Result:
    """Search and friction update, 1.6k tetrahedra."""
    return frame_result("thimble_frame_ms", "draft", with_target=False, p95_limit=2.0)


@benchmark("thimble_frame_p95_ratio", limit=2.0, quick=True)
def thimble_frame_p95_ratio() -> Result:
    """The 95th percentile of the same over its median."""
    times = timing(list(frames("draft")["thimble"]))
    return Result("thimble_frame_p95_ratio", times.p95 / times.median, "1")


@benchmark("finger_frame_ms", limit=0.6, quick=True)
def finger_frame() -> Result:
    """The same with the contact of the virtual touch."""
    return frame_result("finger_frame_ms", "draft", with_target=True, p95_limit=1.2)


@benchmark("thimble_frame_6k_ms")
def thimble_frame_6k() -> Result:
    """Search and friction update, 6.4k tetrahedra."""
    return frame_result("thimble_frame_6k_ms", "standard", with_target=False, p95_limit=3.0)


@benchmark("finger_frame_6k_ms")
def finger_frame_6k() -> Result:
    """The same with the contact of the virtual touch."""
    return frame_result("finger_frame_6k_ms", "standard", with_target=True, p95_limit=4.0)


@benchmark("finger_frame_stiff_ms", limit=3.0)
def finger_frame_stiff() -> Result:
    """The same on skin that stiffens."""
    return frame_result("finger_frame_stiff_ms", "draft, stiff", with_target=True, p95_limit=4.0)


@functools.cache
def personal() -> dict[str, Any]:
    """A surrogate from nothing, as a person waits for it: seconds of both stages."""
    from core.surrogate.store import adapt

    out: dict[str, Any] = {}
    with one_blas_thread():
        started = time.perf_counter()
        steps = adapt(device(), skin("draft"), 0.6)
        while True:
            try:
                stage, _, _ = next(steps)
                if stage == "training" and "dataset" not in out:
                    out["dataset"] = time.perf_counter() - started
            except StopIteration as stop:
                out["surrogate"] = stop.value
                break
        out["whole"] = time.perf_counter() - started
    return out


@benchmark("dataset_2400_s")
def dataset_2400() -> Result:
    """2400 random movements, and the subspaces."""
    return Result("dataset_2400_s", personal()["dataset"], "s")


@benchmark("train_s")
def train_seconds() -> Result:
    """Training of ridge and network on half of the movements."""
    return Result("train_s", personal()["whole"] - personal()["dataset"], "s")


@benchmark("personal_surrogate_s", limit=180.0)
def personal_surrogate() -> Result:
    """All of it."""
    return Result("personal_surrogate_s", personal()["whole"], "s")


@benchmark("surrogate_test_error", limit=0.042)
def surrogate_test_error() -> Result:
    """The worse of both models on movements held out: half of 2400 straight presses, as in the paper."""
    held_out = personal()["surrogate"].meta["held_out"]
    for name, kinds in held_out.items():
        for kind, told in kinds.items():
            print(f"{name}, {kind}: {told['error']:.4f}, nine in ten movements below {told['most']:.4f}")
    worse = max(kinds["straight"]["error"] for kinds in held_out.values())
    in_use = max(kinds["in_use"]["error"] for kinds in held_out.values())
    return Result("surrogate_test_error", worse, "", None, {"paper": 0.042, "in use": in_use})


@benchmark("follow_heldout_error", limit=0.08)
def follow_heldout() -> Result:
    """A recording of virtual electrodes along the product's own movements, on runs that nothing was fitted to."""
    from dataclasses import replace

    from core.matching.recorded import held_out_error, learn
    from core.matching.thimble import Follower, matcher
    from core.skin.sensor import electrode_sensor
    from core.surrogate.store import contact_of
    from core.surrogate.table import SampleTable
    from tests import touches

    model, rng = skin("draft"), np.random.default_rng(5)
    sensor = electrode_sensor(model).matrix
    follower = Follower(matcher(device(), model, friction=0.6), model, "stress")
    x, channels = [], []
    kinds = (touches.ball_roll, touches.edge_press, touches.slide, touches.flat_press, touches.cup, touches.foam)
    for make in kinds * RECORDED_RUNS:
        touch = make(60)
        follower.matching.reset()
        scaled = replace(touch, position=touch.position * rng.uniform(0.7, 1.2, 3))
        found = follower.follow(scaled.forces(model))
        x.append(found.x)
        channels.append(found.force.reshape(60, -1).astype(np.float64) @ sensor.T)
    run = np.repeat(np.arange(len(x)), 60)
    table = SampleTable(np.concatenate(x), np.zeros((len(run), 0)), np.concatenate(channels), run)
    learned = learn(table, device(), contact_of(device(), model, 0.6))
    peers = {"the pose alone": held_out_error(table, table.trajectory * 4 // learned.runs)}
    return Result("follow_heldout_error", learned.error, "", None, peers)


@functools.cache
def searches(kind: str) -> dict[str, Any]:
    """Follow three touches with a kind of model, read from its files: microseconds of each search, and what is left.

    A search is all of `StressMatcher._search`: fixing the friction state, the look at the start table, and one or two
    descents. The friction update and the contact at the pose chosen, which every method pays, are not in it. Searches
    that step in where a learned model was wrong are listed apart, as 'rescues'.
    """
    import tempfile
    from pathlib import Path

    from core.matching.stress import StressMatcher
    from core.surrogate.store import contact_of, load, save
    from tests import touches

    model, made = skin("draft"), personal()["surrogate"]
    observation_matrix = made.descriptors.observation_matrix
    out: dict[str, Any] = {"us": [], "rescues": [], "evaluations": []}
    left = whole = 0.0
    with tempfile.TemporaryDirectory() as folder, one_blas_thread():
        save(Path(folder) / "s", made)
        files = load(Path(folder) / "s", model, device(), 0.6)
        forward = None if kind == "direct" else files.model(device(), model, contact_of(device(), model, 0.6), kind)
        follower = StressMatcher(device(), contact_of(device(), model, 0.6), observation_matrix, forward)
        search = follower._search

        def timed(*arguments: Any) -> Any:
            start = time.perf_counter()
            found = search(*arguments)
            taken = 1e6 * (time.perf_counter() - start)
            rescue = forward is not None and follower.model is follower.direct
            out["rescues" if rescue else "us"].append(taken)
            if not rescue:
                out["evaluations"].append(found.evaluations)
            return found

        follower._search = timed  # type: ignore[method-assign]
        for touch in (touches.ball_roll(120), touches.edge_press(120), touches.slide(120)):
            follower.reset()
            for force in touch.forces(model, points=True):
                target = observation_matrix @ force.ravel()
                frame = follower.step(target)
                left += float(((frame.stimulus - target) ** 2).sum())
                whole += float((target**2).sum())
    out["error"] = math.sqrt(left / whole)
    print(
        f"{kind}: {timing(out['us']).median:.0f} us a search, {np.mean(out['evaluations']):.1f} evaluations; "
        f"{len(out['rescues'])} direct rescues in {len(out['us'])} frames; "
        f"relative RMS of the rendered stress {out['error']:.3f}"
    )
    return out


@benchmark("surrogate_us", limit=SURROGATE_LIMIT_US)
def surrogate() -> Result:
    """One optimisation on the polynomial, the faster of both learned models; stress errors are printed."""
    found, network, direct = searches("ridge"), searches("network"), searches("direct")
    times, error = timing(found["us"]), None
    if found["error"] > direct["error"] + 0.01:
        error = f"rendered stress {found['error']:.3f} off, the direct search's {direct['error']:.3f}"
    elif times.median > 0.5 * timing(direct["us"]).median:
        error = "more than half of the direct search"
    peers = {
        "network (ONNX)": timing(network["us"]).median,
        "direct": timing(direct["us"]).median,
        "paper, its machine": 7500.0,
    }
    if found["rescues"]:
        peers["a rescue"] = timing(found["rescues"]).median
    return Result("surrogate_us", times.median, "us", times.p95, peers, error)


@benchmark("surrogate_network_us")
def surrogate_network() -> Result:
    """One optimisation on the network's ONNX file, run by onnxruntime."""
    times = timing(searches("network")["us"])
    return Result("surrogate_network_us", times.median, "us", times.p95, {"paper, its machine": 7500.0})
