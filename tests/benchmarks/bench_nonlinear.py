"""Skin that stiffens against the exact neo-Hookean finger, on forty touches that no table has seen, and its price.

Each tissue solves its own contact at the nodes of the standard mesh, frame after frame; linear skin stands beside it.
Stress is compared in all elements by volume, force as the sum on the finger. Medians over paths; `p95` of these rows is
the 90th percentile.
"""

from __future__ import annotations

import functools
import tempfile
import time
from pathlib import Path

import numpy as np

from . import Result, benchmark, one_blas_thread, timing

FRAMES, RATE, SPEED, DEPTH, STROKE = 3, 240.0, 20e-3, 1e-3, 1.5e-3


@benchmark("nl_stress_error_2mm", limit=0.075)
def stress_error_2mm() -> Result:
    """Stress 2 mm deep, all kinds of path."""
    return _error("nl_stress_error_2mm", "stress", 2e-3)


@benchmark("nl_stress_p90_2mm", limit=0.13)
def stress_p90_2mm() -> Result:
    """The 90th percentile of the same."""
    from core.parameters.error_bands import LINEAR, NEO_HOOKEAN

    from .nonlinear_errors import at, spread

    ours, linear = (spread([e.stress for e in at(tissue, 2e-3)])[1] for tissue in (NEO_HOOKEAN, LINEAR))
    return Result("nl_stress_p90_2mm", ours, "1", None, {"linear": linear})


@benchmark("nl_force_error_2mm", limit=0.01)
def force_error_2mm() -> Result:
    """The sum of the forces 2 mm deep."""
    return _error("nl_force_error_2mm", "force", 2e-3)


@benchmark("nl_stress_error_1mm", limit=0.04)
def stress_error_1mm() -> Result:
    """Stress 1 mm deep."""
    return _error("nl_stress_error_1mm", "stress", 1e-3)


@benchmark("nl_stress_error_shear", limit=0.10)
def stress_error_shear() -> Result:
    """Stress where the object was then drawn 2 mm across the finger."""
    return _error("nl_stress_error_shear", "stress", 2e-3, 2e-3)


@benchmark("nl_stress_error_slide", limit=0.15)
def stress_error_slide() -> Result:
    """Stress where it was drawn 6 mm."""
    return _error("nl_stress_error_slide", "stress", 2e-3, 6e-3)


@benchmark("nl_stress_error_edge", limit=0.20)
def stress_error_edge() -> Result:
    """Stress under edges and ribs, 2 mm deep."""
    from .nonlinear_errors import EDGES

    return _error("nl_stress_error_edge", "stress", 2e-3, kinds=EDGES)


@benchmark("nl_worse_than_linear", limit=0.0)
def worse_than_linear() -> Result:
    """The share of all frames, to 4 mm deep and 6 mm slid, at which stress is farther off than linear skin's."""
    from core.parameters.error_bands import NEO_HOOKEAN

    return worse("nl_worse_than_linear", NEO_HOOKEAN)


def worse(name: str, tissue: str) -> Result:
    """Return the share of frames of a tissue that are farther off than linear skin's."""
    from core.parameters.error_bands import LINEAR

    from .nonlinear_errors import measured

    both = list(zip(measured(tissue).errors, measured(LINEAR).errors, strict=True))
    share = float(np.mean([ours.stress > linear.stress for ours, linear in both]))
    force = float(np.mean([ours.force > linear.force for ours, linear in both]))
    lost = float(np.mean([not ours.converged for ours, _ in both]))
    return Result(name, share, "1", None, {"of force": force, "not converged": lost})


def _error(name: str, what: str, depth: float, slide: float = 0.0, kinds: tuple[str, ...] = ()) -> Result:
    from core.parameters.error_bands import LINEAR, NEO_HOOKEAN

    return error(name, what, depth, slide, kinds, {"": NEO_HOOKEAN, "linear": LINEAR})


def error(name: str, what: str, depth: float, slide: float, kinds: tuple[str, ...], tissues: dict[str, str]) -> Result:
    """Return what a tissue is off by, named '', and others beside it, by their names."""
    from .nonlinear_errors import at, spread

    rows = {said: at(tissue, depth, slide, kinds) for said, tissue in tissues.items()}
    found = {said: spread([getattr(e, what) for e in errors]) for said, errors in rows.items()}
    ours, lost = found.pop(""), sum(not e.converged for e in rows[""])
    failed = f"{lost} of {len(rows[''])} frames are not converged" if lost else None
    peers = {
        f"{said}{more}": value for said, both in found.items() for more, value in zip(("", ", p90"), both, strict=True)
    }
    return Result(name, ours[0], "1", ours[1], peers, failed)


@benchmark("nl_frame_ratio", limit=2.0)
def frame_ratio() -> Result:
    """A frame on points, contact and what a frame shows, over that of linear skin; at nodes beside it.

    A block is pressed 1 mm deep and drawn to and fro at 20 mm/s; linear and stiffening fingers take each frame in
    turn, so that both share what else the processor does. p95 is the ratio of the 95th percentiles.
    """
    from core.parameters.error_bands import NEO_HOOKEAN

    (median, late), (at_nodes, late_nodes) = (ratio(points, NEO_HOOKEAN) for points in (True, False))
    return Result("nl_frame_ratio", median, "1", late, {"at nodes": at_nodes, "at nodes, p95": late_nodes})


@functools.cache
def ratio(points: bool, stiff: str) -> tuple[float, float]:
    """Return the ratio of the medians and of the 95th percentiles of the frames' times, of the processor."""
    from core.contact.compliant_bone import CompliantBone
    from core.contact.solver.bodies import ContactBody
    from core.parameters.error_bands import LINEAR
    from core.skin.surface_store import smooth_pad
    from core.surface.gap import Surface

    from .nonlinear_errors import skin_of

    bones, times = {}, {}
    for tissue in (LINEAR, stiff):
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
    ours, linear = (timing(times[tissue][pressing + 1 :]) for tissue in (stiff, LINEAR))
    return ours.median / linear.median, ours.p95 / linear.p95


def _shown(skin: object, taken: object) -> None:
    """Work out what a frame shows: displacement of the skin and the stress that colours it."""
    from core.skin.stimulus import Stimulus, von_mises

    step = taken.step  # type: ignore[attr-defined]
    felt = Stimulus(skin, step.nodal, given=step.amounts)  # type: ignore[arg-type]
    felt.surface_values(von_mises(felt.stress))
    assert felt.displacement.size


@benchmark("nl_build_s", limit=150.0)
def build() -> Result:
    """Making the table of the standard finger, its mesh and all."""
    from core.tissue.stiffening_store import make_stiffening

    from .nonlinear_reference import LEVEL, fingertip_skin

    skin = fingertip_skin(level=LEVEL)
    started, worked = time.perf_counter(), time.process_time()
    for _ in make_stiffening(skin.shape, skin.material.poisson):
        pass
    worked = time.process_time() - worked  # where other work shares the processor, this says more
    return Result("nl_build_s", time.perf_counter() - started, "s", None, {"of the processor": worked})


@benchmark("nl_table_mb", limit=10.0)
def table() -> Result:
    """The table of a finger, as a file."""
    from core.parameters.error_bands import NEO_HOOKEAN

    from .nonlinear_errors import skin_of

    stiffening = skin_of(NEO_HOOKEAN).stiffening
    assert stiffening is not None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "table.npz"
        stiffening.write(file)
        return Result("nl_table_mb", file.stat().st_size / 1e6, "MB")
