"""Devices on skin that follows the neo-Hookean law: what the lagged correction leaves, its looks and their price.

A ball rolls, a block is pressed and tilted, an edge turns and a plane is dragged, each in 240 frames at 240 Hz on the
draft finger. `nl_device_stress_error` compares, by the law and in what the method compares, what is left of a frame
with what a search on the law itself leaves from the same friction state.
"""

from __future__ import annotations

import functools
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import Result, benchmark, one_blas_thread, timing

FRAMES = 240
AT = (70, 130)  # frames of each touch that are searched again on the law
FRICTION, PIN_LIMIT = 0.6, 0.4
DRAGGED = "slide"
SEARCHED = 150  # evaluations of the law by the search that judges a thimble
Array = NDArray[np.float64]


@functools.cache
def skin() -> Any:
    """The draft finger, of tissue that follows the law."""
    from core.skin.model import fingertip_skin

    return fingertip_skin(level="draft").with_law()


@functools.cache
def touched(name: str) -> tuple[list[Array], list[Array | None]]:
    """Return forces on the nodes and what they keep, of a touch on the skin's points."""
    from tests import touches

    made = {"ball": touches.ball_roll, "block": touches.flat_press, "edge": touches.edge_press, "slide": touches.slide}
    touch = made[name](FRAMES)
    path = touches.solver_on(skin())
    steps = [path.step(touch.bodies(i)) for i in range(FRAMES)]
    return [s.nodal for s in steps], [s.amounts for s in steps]


TOUCHES = ("ball", "block", "edge", "slide")


@functools.cache
def thimble(name: str) -> dict[str, Any]:
    """Follow a touch with the thimble: evaluations of the law, their time [ms], and error over the best by the law."""
    from core.devices.thimble import mechanism
    from core.matching.thimble import Follower, matcher
    from core.presets import Library

    device = mechanism(Library().device("thimble_3rrs"))
    following = Follower(matcher(device, skin(), friction=FRICTION), skin(), "stress")
    matching = following.matching
    looked, spent = matching.direct.looked, list[float]()

    def timed(x: Array) -> Any:
        start = time.process_time()
        found = looked(x)
        matching.direct.stimulus(found)
        spent.append(1e3 * (time.process_time() - start))
        return found

    out: dict[str, Any] = {"looks": [], "ratio": [], "whole": [], "ms": spent, "unsettled": 0}
    forces, amounts = touched(name)
    for i, (force, kept) in enumerate(zip(forces, amounts, strict=True)):
        state = matching.state
        matching.direct.looked = timed  # type: ignore[method-assign]
        frame = following.step(force, kept)
        matching.direct.looked = looked  # type: ignore[method-assign]
        if frame.minimum is None:
            continue
        out["looks"].append(frame.looks)
        out["unsettled"] += frame.unsettled > 0.0
        out["whole"].append(frame.stress_error)
        if i in AT:
            saved = matching.save()
            out["ratio"].append(_over_best(matching, state, frame, force, kept))
            matching.restore(saved)
    return out


def _over_best(matching: Any, state: Any, frame: Any, force: Array, kept: Array | None) -> float:
    """Return what a frame leaves over the least that a search on the law finds, from where the frame is."""
    from scipy.optimize import minimize

    target, scale = matching.direct.observer.seen(force, kept), np.array([1.0, 1.0, matching.device.platform_radius])

    def left(y: Array) -> float:
        x = frame.x + 0.02 * scale * y
        if not matching.device.feasible(x):
            return 1e6
        matching.direct.hold(state)
        found = matching.direct.looked(x)
        if not found.settled:
            return 1e6
        return float(np.linalg.norm(matching.direct.stimulus(found) - target))

    start = np.vstack([np.zeros(3), np.eye(3)])
    options = {"initial_simplex": start, "maxfev": SEARCHED, "xatol": 1e-3, "fatol": 1e-6}
    best = minimize(left, np.zeros(3), method="Nelder-Mead", options=options).fun
    own = float(np.linalg.norm(frame.stimulus - target))
    return own / max(min(best, own), 1e-300)


@functools.cache
def pins(name: str) -> dict[str, Any]:
    """Follow a touch with the pins, by DM2: looks, milliseconds of one, what is left over the best by the law."""
    from core.matching import pins as pin_matching
    from core.matching.deformation import PinSolver
    from core.presets import Library
    from core.skin.observation import stress_error, touch_of

    ready = pin_matching.setup(skin(), Library().device("pin_array_128"))
    solver = PinSolver(ready.matcher, "DM2", force_limit=PIN_LIMIT)
    out: dict[str, Any] = {"looks": [], "ratio": [], "whole": [], "ms": [], "unsettled": 0}
    forces, amounts = touched(name)
    for i, (force, kept) in enumerate(zip(forces, amounts, strict=True)):
        if not force.any():
            solver.reset()
            continue
        start = time.process_time()
        step = solver.step(force.ravel(), kept)
        out["ms"].append(1e3 * (time.process_time() - start) / step.look.looks)
        out["looks"].append(step.look.looks)
        out["unsettled"] += not step.look.settled
        made = step.look.felt(skin(), ready.matcher.pressed(step.x))
        out["whole"].append(stress_error(touch_of(skin(), force, kept), made))
        if i in AT:
            out["ratio"].append(_over_best_pins(ready.matcher, force, kept, step))
    return out


def _over_best_pins(matcher: Any, force: Array, kept: Array | None, step: Any) -> float:
    """Return the displacement error of pin forces over the least that Gauss-Newton on the law itself finds.

    Within the pins' bounds, in double precision and with the law's own tangent: nothing is frozen.
    """
    from scipy.optimize import lsq_linear
    from scipy.sparse.linalg import splu

    from core.skin.assembly import degrees
    from tests.exact.neo_hookean import NeoHookean

    mesh, law = skin().mesh, NeoHookean(skin().mesh, skin().material.poisson)
    free, pad = degrees(mesh.free), matcher.law.tables.pad
    wanted = matcher.law.moved_by(force.ravel(), kept).astype(np.float64)
    load, u, x = matcher.law.pins / skin().material.modulus, step.look.moved.astype(np.float64), step.x.copy()

    def whole(moved: Array) -> Array:
        nodes = np.zeros(mesh.nodes.size)
        nodes[free] = moved
        return nodes.reshape(-1, 3)

    def balanced(x: Array, u: Array) -> Array:
        for _ in range(12):
            missing = np.zeros(len(free))
            missing[pad] = load @ x
            missing -= law.forces(law.response(whole(u)[None, None]).piola)[0, 0].ravel()[free]
            step = splu(law.tangent(whole(u))[free][:, free].tocsc()).solve(missing)
            u = u + step
            if np.linalg.norm(step) < 1e-8 * np.linalg.norm(u):
                break
        return u

    u, errors = balanced(x, u), list[float]()
    for _ in range(6):
        errors.append(float(np.linalg.norm(u - wanted)))
        columns = np.zeros((len(free), load.shape[1]))
        columns[pad] = load
        slope = splu(law.tangent(whole(u))[free][:, free].tocsc()).solve(columns)
        found = lsq_linear(slope, wanted - u + slope @ x, (0.0, PIN_LIMIT), method="bvls").x
        tried = balanced(found, u + slope @ (found - x))
        if np.linalg.norm(tried - wanted) >= np.linalg.norm(u - wanted):
            break
        x, u = found, tried
    return errors[0] / min(errors)


def both() -> list[tuple[str, dict[str, Any]]]:
    """Return what each device did with each touch."""
    with one_blas_thread():
        return [(f"{kind.__name__}, {name}", kind(name)) for kind in (thimble, pins) for name in TOUCHES]


@benchmark("nl_device_stress_error", limit=1.02)
def stress_left() -> Result:
    """What is left over what a search on the law leaves: the worst of all; in the peers that of each device and touch.

    A thimble compares its components of stress, pins the displacement; how much of the whole stress is left stands
    beside.
    """
    found = both()
    worst = {name: max(each["ratio"]) for name, each in found}
    whole = {f"{name}, whole stress": float(np.sqrt(np.mean(np.square(each["whole"])))) for name, each in found}
    return Result("nl_device_stress_error", max(worst.values()), "1", None, {**worst, **whole})


@benchmark("nl_device_looks", limit=1.0)
def looks() -> Result:
    """Evaluations of the law in a frame; p95 is that of pressing touches, and the dragged one has its own."""
    found = both()
    every = np.concatenate([each["looks"] for _, each in found])
    pressed = np.concatenate([each["looks"] for name, each in found if DRAGGED not in name])
    dragged = np.concatenate([each["looks"] for name, each in found if DRAGGED in name])
    late, far = float(np.percentile(pressed, 95)), float(np.percentile(dragged, 95))
    lost = sum(each["unsettled"] for _, each in found)
    error = f"the 95th percentiles are {late:g} and {far:g}, not 3 and 6" if late > 3 or far > 6 else None
    peers = {"dragged, p95": far, "frames that did not settle": float(lost), "of frames": float(len(every))}
    return Result("nl_device_looks", float(np.median(every)), "1", late, peers, error)


@benchmark("nl_look_ms", limit=2.0)
def look() -> Result:
    """Evaluation of the law at a thimble's pose, with contact and stress, in milliseconds of processor time."""
    times = {
        kind: [t for name, each in both() if name.startswith(kind) for t in each["ms"]] for kind in ("thimble", "pins")
    }
    own = timing(times["thimble"])
    return Result("nl_look_ms", own.median, "ms", own.p95, {"pins, with their forces": timing(times["pins"]).median})
