"""Skin that follows the neo-Hookean law against the exact neo-Hookean finger, on forty touches, and its price.

Each tissue solves its own contact at the nodes of the standard mesh, frame after frame; linear skin stands beside it.
The exact finger (`tests/exact/exact_finger.py`) is the same law, by Newton's method in double precision. Stress is
compared in all elements by volume, force as the sum on the finger. Medians over paths; `p95` of these rows is the 90th
percentile.
"""

from __future__ import annotations

import functools
import time
from typing import NamedTuple

import numpy as np

from core.parameters.error_bands import LINEAR, NEO_HOOKEAN

from . import Result, benchmark, measure, one_blas_thread, timing

FRAMES, RATE, SPEED, DEPTH, STROKE = 3, 240.0, 20e-3, 1e-3, 1.5e-3
EDGES = ("edge", "rib")


class Row(NamedTuple):
    """What is compared: of which frames, up to which limit."""

    name: str
    limit: float
    what: str
    depth: float
    slide: float = 0.0
    kinds: tuple[str, ...] = ()


ROWS = (
    Row("nl_stress_error_2mm", 0.075, "stress", 2e-3),
    Row("nl_force_error_2mm", 0.01, "force", 2e-3),
    Row("nl_stress_error_1mm", 0.04, "stress", 1e-3),
    Row("nl_stress_error_shear", 0.10, "stress", 2e-3, 2e-3),  # the object was then drawn 2 mm across the finger
    Row("nl_stress_error_slide", 0.15, "stress", 2e-3, 6e-3),
    Row("nl_stress_error_edge", 0.20, "stress", 2e-3, kinds=EDGES),
)


def error(row: Row) -> Result:
    """Return what skin with the law is off by, and linear skin beside it."""
    from .nonlinear_errors import at, spread

    ours, linear = (at(tissue, row.depth, row.slide, row.kinds) for tissue in (NEO_HOOKEAN, LINEAR))
    (middle, late), (other, others) = (spread([getattr(e, row.what) for e in errors]) for errors in (ours, linear))
    lost = sum(not e.converged for e in ours)
    failed = f"{lost} of {len(ours)} frames are not converged" if lost else None
    return Result(row.name, middle, "1", late, {"linear": other, "linear, p90": others}, failed)


@benchmark("nl_stress_p90_2mm", limit=0.13)
def late() -> Result:
    """The 90th percentile of the stress 2 mm deep."""
    found = error(ROWS[0])
    return Result("nl_stress_p90_2mm", found.p95, "1", None, {"linear": found.peers["linear, p90"]}, found.error)


@benchmark("nl_worse_than_linear", limit=0.0)
def worse() -> Result:
    """The share of all frames, to 4 mm deep and 6 mm slid, whose stress is farther off than linear skin's."""
    from .nonlinear_errors import measured

    both = list(zip(measured(NEO_HOOKEAN).errors, measured(LINEAR).errors, strict=True))
    share = float(np.mean([ours.stress > linear.stress for ours, linear in both]))
    force = float(np.mean([ours.force > linear.force for ours, linear in both]))
    lost = float(np.mean([not ours.converged for ours, _ in both]))
    return Result("nl_worse_than_linear", share, "1", None, {"of force": force, "not converged": lost})


@benchmark("nl_frame_ratio", limit=2.0)
def frame_ratio() -> Result:
    """A frame on points, contact and what a frame shows, over that of linear skin; at nodes beside it.

    A block is pressed 1 mm deep and drawn to and fro at 20 mm/s; linear and stiffening fingers take each frame in
    turn, so that both share what else the processor does. p95 is the ratio of the 95th percentiles.
    """
    (median, last), (at_nodes, last_nodes) = (ratio(points) for points in (True, False))
    return Result("nl_frame_ratio", median, "1", last, {"at nodes": at_nodes, "at nodes, p95": last_nodes})


@functools.cache
def ratio(points: bool) -> tuple[float, float]:
    """Return the ratio of the medians and of the 95th percentiles of the frames' times, of the processor."""
    from core.contact.compliant_bone import CompliantBone
    from core.contact.solver.bodies import ContactBody
    from core.skin.surface_store import smooth_pad
    from core.surface.gap import Surface

    from .nonlinear_errors import skin_of

    bones, times = {}, {}
    for tissue in (LINEAR, NEO_HOOKEAN):
        skin = skin_of(tissue)
        surface = smooth_pad(skin) if points else None
        bones[tissue] = skin, CompliantBone.of(skin, {}, tissue, surface=surface)
        times[tissue] = list[float]()
    block, step, pressing = Surface.block(), SPEED / RATE, 120
    there = np.arange(1, int(STROKE / step) + 1) * step
    stroke = np.concatenate([there, there[-2::-1], -there, -there[-2::-1]])
    along = np.concatenate([np.zeros(pressing + 1), np.tile(stroke, FRAMES)])
    depth = np.minimum(np.arange(len(along)) / pressing, 1.0) * DEPTH
    with one_blas_thread():
        for frame in range(len(along)):
            body = ContactBody(block, translation=np.array([along[frame], 0.0, depth[frame]]), friction=0.6)
            for tissue, (skin, bone) in bones.items():
                started = time.process_time()
                _shown(skin, bone.step([body], float(frame)))
                times[tissue].append((time.process_time() - started) * 1e3)
    ours, linear = (timing(times[tissue][pressing + 1 :]) for tissue in (NEO_HOOKEAN, LINEAR))
    return ours.median / linear.median, ours.p95 / linear.p95


def _shown(skin: object, taken: object) -> None:
    """Work out what a frame shows: displacement of the skin and the stress that colours it."""
    from core.skin.stimulus import Stimulus, von_mises

    step = taken.step  # type: ignore[attr-defined]
    felt = Stimulus(skin, step.nodal, given=step.amounts)  # type: ignore[arg-type]
    felt.surface_values(von_mises(felt.stress))
    assert felt.displacement.size


@benchmark("nl_ready_ms", limit=1000.0)
def ready() -> Result:
    """From linear skin to the first frame of skin with the law: what a person waits for who chooses it."""
    from core.contact.compliant_bone import CompliantBone
    from core.contact.solver.bodies import ContactBody
    from core.skin import model
    from core.surface.gap import Surface

    from .nonlinear_errors import reference

    linear = reference().skin
    body = ContactBody(Surface.block(), translation=linear.positions[linear.positions[:, 2].argmin()] + [0, 0, 1e-4])

    def first() -> None:
        model._laws.clear()
        skin = linear.with_law()
        _shown(skin, CompliantBone.of(skin, {}, "finger").step([body], 0.0))

    with one_blas_thread():
        return Result("nl_ready_ms", *measure(first, 5, warmup=1)[:1], "ms")


for _row in ROWS:
    benchmark(_row.name, _row.limit)(functools.partial(error, _row))
