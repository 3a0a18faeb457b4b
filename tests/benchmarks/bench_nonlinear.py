"""Skin that stiffens against the exact neo-Hookean finger, on forty touches that no table has seen, and its price.

Each tissue solves its own contact at the nodes of the standard mesh, frame after frame; others stand beside it. `nl_*`
is the series, `nl_exact_*` the exact law in a few fields, whose table was made of touches with a seed and ranges of
their own (`core/tissue/sampled_table_fit.py`). Stress is compared in all elements by volume, force as the sum on the
finger. Medians over paths; `p95` of these rows is the 90th percentile.
"""

from __future__ import annotations

import functools
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.parameters.error_bands import LINEAR, NEO_HOOKEAN

from . import Result, benchmark, one_blas_thread, timing

FRAMES, RATE, SPEED, DEPTH, STROKE = 3, 240.0, 20e-3, 1e-3, 1.5e-3
EDGES = ("edge", "rib")
# of the names of rows: what they measure, and what stands beside it
PEERS = {"nl": {"": NEO_HOOKEAN, "linear": LINEAR}}


class Row(NamedTuple):
    """What is compared: of which frames, up to which limit."""

    name: str
    limit: float
    what: str
    depth: float
    slide: float = 0.0
    kinds: tuple[str, ...] = ()


ROWS = (
    Row("stress_error_2mm", 0.075, "stress", 2e-3),
    Row("force_error_2mm", 0.01, "force", 2e-3),
    Row("stress_error_1mm", 0.04, "stress", 1e-3),
    Row("stress_error_shear", 0.10, "stress", 2e-3, 2e-3),  # the object was then drawn 2 mm across the finger
    Row("stress_error_slide", 0.15, "stress", 2e-3, 6e-3),
    Row("stress_error_edge", 0.20, "stress", 2e-3, kinds=EDGES),
)


def error(name: str, row: Row, tissues: dict[str, str]) -> Result:
    """Return what a tissue is off by, named '', and others beside it, by their names."""
    from .nonlinear_errors import at, spread

    rows = {said: at(tissue, row.depth, row.slide, row.kinds) for said, tissue in tissues.items()}
    found = {said: spread([getattr(e, row.what) for e in errors]) for said, errors in rows.items()}
    ours, lost = found.pop(""), sum(not e.converged for e in rows[""])
    failed = f"{lost} of {len(rows[''])} frames are not converged" if lost else None
    peers = {
        f"{said}{more}": value for said, both in found.items() for more, value in zip(("", ", p90"), both, strict=True)
    }
    return Result(name, ours[0], "1", ours[1], peers, failed)


def late(name: str, tissues: dict[str, str]) -> Result:
    """Return the 90th percentile of the stress 2 mm deep."""
    found = error(name, ROWS[0], tissues)
    peers = {said.removesuffix(", p90"): value for said, value in found.peers.items() if said.endswith(", p90")}
    return Result(name, found.p95, "1", None, peers, found.error)


def worse(name: str, tissue: str) -> Result:
    """Return the share of all frames, to 4 mm deep and 6 mm slid, whose stress is farther off than linear skin's."""
    from .nonlinear_errors import measured

    both = list(zip(measured(tissue).errors, measured(LINEAR).errors, strict=True))
    share = float(np.mean([ours.stress > linear.stress for ours, linear in both]))
    force = float(np.mean([ours.force > linear.force for ours, linear in both]))
    lost = float(np.mean([not ours.converged for ours, _ in both]))
    return Result(name, share, "1", None, {"of force": force, "not converged": lost})


def frame_ratio(name: str, tissue: str) -> Result:
    """Return a frame on points, contact and what a frame shows, over that of linear skin; at nodes beside it.

    A block is pressed 1 mm deep and drawn to and fro at 20 mm/s; linear and stiffening fingers take each frame in
    turn, so that both share what else the processor does. p95 is the ratio of the 95th percentiles.
    """
    (median, last), (at_nodes, last_nodes) = (ratio(points, tissue) for points in (True, False))
    return Result(name, median, "1", last, {"at nodes": at_nodes, "at nodes, p95": last_nodes})


@functools.cache
def ratio(points: bool, stiff: str) -> tuple[float, float]:
    """Return the ratio of the medians and of the 95th percentiles of the frames' times, of the processor."""
    from core.contact.compliant_bone import CompliantBone
    from core.contact.solver.bodies import ContactBody
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


def table(name: str, tissue: str) -> Result:
    """Return the size of the table of a finger, as a file."""
    from core.tissue.stiffening_store import SHIPPED, find_stiffening

    from .nonlinear_errors import reference

    skin = reference().skin
    assert skin.shape is not None
    find = find_stiffening
    found = find(skin.shape, skin.material.poisson, shipped=SHIPPED)
    assert found is not None, f"no table of the standard finger's {tissue} tissue ships"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "table.npz"
        found.write(file)
        return Result(name, file.stat().st_size / 1e6, "MB")


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


for _prefix, _tissues in PEERS.items():
    for _row in ROWS:
        _name = f"{_prefix}_{_row.name}"
        benchmark(_name, _row.limit)(functools.partial(error, _name, _row, _tissues))
    for _name, _limit, _measure in (("worse_than_linear", 0.0, worse), ("table_mb", 10.0, table)):
        _name = f"{_prefix}_{_name}"
        benchmark(_name, _limit)(functools.partial(_measure, _name, _tissues[""]))
    benchmark(f"{_prefix}_stress_p90_2mm", 0.13)(functools.partial(late, f"{_prefix}_stress_p90_2mm", _tissues))
for _name, _limit, _tissue in (("nl_frame_ratio", 2.0, NEO_HOOKEAN),):
    benchmark(_name, _limit)(functools.partial(frame_ratio, _name, _tissue))
