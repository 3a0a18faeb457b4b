"""Floor: how near the search of a frame comes to the best pose found, and six legs matched by stress.

Touches are solved on points of the smooth skin, as the devices' contact is; errors are of the whole stress.
"""

from __future__ import annotations

import functools
import time
from typing import Any

import numpy as np

from tests.benchmarks import Result, benchmark, one_blas_thread, timing

POINTS = 3.0  # of rendered error [%] above the floor
FRAMES = 120
COMPONENTS = 60


@functools.cache
def parts(key: str) -> tuple[Any, Any, Any, Any]:
    """A device by its preset, the skin, sixty components of stress fitted to both, and the operator of all stress."""

    from core.matching.description import DESCRIPTOR_MOVEMENTS
    from core.matching.thimble_use import prepare
    from core.presets import Library
    from core.skin.model import fingertip_skin
    from core.steps import drain
    from core.surrogate.dataset import record
    from core.surrogate.learned import descriptors
    from core.surrogate.store import contact_of

    skin = fingertip_skin(level="draft")
    device = prepare(Library().device(key), skin, {"platform_method": "stress"}).device
    data, whole = drain(record(device, contact_of(device, skin, 0.6), DESCRIPTOR_MOVEMENTS)), skin.stress_components()
    return device, skin, descriptors(data, whole, size=COMPONENTS).observation_matrix, whole


def follower(key: str) -> Any:
    """What follows stimuli with a device."""
    from core.matching.stress import StressMatcher
    from core.surrogate.store import contact_of

    device, skin, matrix, _ = parts(key)
    return StressMatcher(device, contact_of(device, skin, 0.6), matrix)


def off(key: str, matching: Any, frames: list[Any], forces: Any) -> float:
    """Relative RMS of the whole stress between a touch and frames of a device [%]."""
    whole = parts(key)[3]
    wanted = forces.reshape(len(forces), -1) @ whole.T
    made = np.array([matching.contact.nodal(frame.solution).ravel() for frame in frames]) @ whole.T
    return 100.0 * float(np.linalg.norm(made - wanted) / np.linalg.norm(wanted))


@benchmark("edge_rendered_error")
def edge_rendered_error() -> Result:
    """The edge, searched frame by frame, beside the best pose found and the best of several ways, in per cent."""
    from core.matching.trajectory import trajectory
    from core.steps import drain
    from tests import touches

    key = "thimble_3rrs"
    _, skin, matrix, _ = parts(key)
    forces, matching = touches.edge_press(FRAMES).forces(skin, points=True), follower(key)
    targets = forces.reshape(FRAMES, -1) @ matrix.T
    with one_blas_thread():
        rendered = off(key, matching, [matching.step(target) for target in targets], forces)
        matching.reset()
        found = drain(trajectory(matching, targets))
    floor, ways = (off(key, matching, frames, forces) for frames in (found.best, found.frames))
    floor = min(floor, rendered)
    error = (
        None if rendered <= floor + POINTS else f"{rendered - floor:.1f} points above the best found, not {POINTS:g}"
    )
    return Result("edge_rendered_error", rendered, "%", None, {"best found": floor, "several ways": ways}, error)


@benchmark("hexapod_stress_frame_ms", limit=4.0)
def hexapod_stress_frame() -> Result:
    """Search in six freedoms and friction update, 1.6k tetrahedra, over a ball, an edge and a sliding plane."""
    from tests import touches

    key = "hexapod"
    _, skin, matrix, _ = parts(key)
    matching, times = follower(key), []
    errors = {}
    with one_blas_thread():
        for touch in (touches.ball_roll(FRAMES), touches.edge_press(FRAMES), touches.slide(FRAMES)):
            forces, frames = touch.forces(skin, points=True), []
            matching.reset()
            for force in forces:
                target = matrix @ force.ravel()
                start = time.perf_counter()
                frames.append(matching.step(target))
                if frames[-1].minimum is not None:
                    times.append(1e3 * (time.perf_counter() - start))
            errors[f"{touch.name} off %"] = off(key, matching, frames, forces)
    taken = timing(times)
    return Result("hexapod_stress_frame_ms", taken.median, "ms", taken.p95, errors)
