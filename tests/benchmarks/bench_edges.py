"""Frictional contact on free points of the smooth pad: planes, balls, edges and ribs that slide.

Timed is a whole frame of a finger as a scene has it: `SubStepper` over `PathSolver`, forces brought to the mesh's
nodes, surfaces of triangles. Each is pressed 1 mm deep at 2 mm/s, then drawn to and fro by 1.5 mm at 240 frames a
second, with friction 0.6; the pressing is not timed. The node solver's frame on a block is timed in the same run: this
says more than a time does where other work shares the processor.
"""

from __future__ import annotations

import functools
import time
from typing import Any

import numpy as np

from core.shipped import BUILT_IN

from . import Result, benchmark, one_blas_thread, timing

MU, DEPTH, RATE, STROKE, PRESS = 0.6, 1e-3, 240.0, 1.5e-3, 2e-3
_ANGLES = {f"{angle:.0f} degrees": angle for angle in (90.0, 60.0, 120.0)}
RIB, PERIOD, RIBS, GROOVE = 0.75e-3, 1.5e-3, 21, 1.5e-3


@benchmark("contact_edge_ms", limit=1.0, quick=True)
def contact_edge() -> Result:
    """An edge of 90 degrees, rounded by 0.2 mm, that slides at 20 mm/s."""
    return _result("contact_edge_ms", "edge", 20e-3)


@benchmark("contact_edge_fast_ms", limit=3.0, quick=True)
def contact_edge_fast() -> Result:
    """The same edge at 100 mm/s: every frame is walked in parts."""
    return _result("contact_edge_fast_ms", "edge", 100e-3)


@benchmark("contact_ribs_ms", limit=2.2, quick=True)
def contact_ribs() -> Result:
    """Ribs 0.75 mm wide, 1.5 mm apart, at 20 mm/s."""
    return _result("contact_ribs_ms", "ribs", 20e-3, strokes=1)


@benchmark("contact_points_plane_ratio", limit=1.2, quick=True)
def contact_points_plane() -> Result:
    """A block at 20 mm/s, over what the node solver takes for it; a ball of 5 mm beside it."""
    nodes, ball = (timing(_times(*case)).median for case in (("block", 20e-3, 2, True), ("ball", 20e-3, 2, False)))
    plane = timing(_times("block", 20e-3, 2, False)).median
    return Result("contact_points_plane_ratio", plane / nodes, "1", None, {"ball": ball / nodes, "nodes, ms": nodes})


@benchmark("contact_edge_slid_error", quick=True)
def contact_edge_slid() -> Result:
    """A finger without friction slid over an edge of 90 degrees, against one pressed where it is: mean, worst beside.

    Nothing remembers how it came there, so both forces ought to be the same.
    """
    errors = {name: _slid_errors(angle) for name, angle in _ANGLES.items()}
    means = {name: float(np.mean(found)) for name, found in errors.items()}
    worst = {f"{name}, worst place": max(found) for name, found in errors.items()}
    return Result("contact_edge_slid_error", means.pop("90 degrees"), "1", None, {**means, **worst})


def _slid_errors(angle: float) -> list[float]:
    """Return how far the force is off at places along a stroke there and back in steps of 0.1 mm, over its size."""
    from core.contact.solver.bodies import ContactBody
    from core.contact.solver.pad_points import PadPoints
    from core.contact.solver.path_solver import PathSolver
    from core.contact.solver.sub_stepper import SubStepper
    from core.presets import Library
    from core.skin.surface_store import surface_compliance
    from core.surface.gap import Surface

    pad = surface_compliance(Library().skin("index_medium"), shipped=BUILT_IN / "skins")
    assert pad is not None
    surface = Surface.edge(np.radians(angle))

    def forces(ways: Any) -> Any:
        stepper = SubStepper(PathSolver(PadPoints(pad)), 8e-3)
        bodies = (ContactBody(surface, translation=np.array([x, 0.0, z]), friction=0.0) for x, z in ways)
        return np.array([stepper.step([body]).solution.force.sum(axis=0) for body in bodies])

    down, there = np.linspace(0.0, DEPTH, 11), 0.1e-3 * np.arange(1, 13)
    along = np.concatenate([there, there[-2::-1]])
    with one_blas_thread():
        slid = forces([*((0.0, z) for z in down), *((x, DEPTH) for x in along)])[len(down) :]
        pressed = np.array([forces([(x, z) for z in down])[-1] for x in there])[np.rint(along / 0.1e-3).astype(int) - 1]
    return [float(e) for e in np.linalg.norm(slid - pressed, axis=1) / np.linalg.norm(pressed, axis=1)]


def _result(name: str, shape: str, speed: float, strokes: int = 2) -> Result:
    found = timing(_times(shape, speed, strokes, False))
    plane = timing(_times("block", 20e-3, 2, True)).median
    return Result(name, found.median, "ms", found.p95, {"node solver on a block": plane})


@functools.cache
def _times(shape: str, speed: float, strokes: int, at_nodes: bool) -> tuple[float, ...]:
    """Return the times of the frames that slide [ms]."""
    from core.contact.compliant_bone import CompliantBone
    from core.contact.solver.bodies import ContactBody
    from core.presets import Library
    from core.skin.model import skin_from_parameters
    from core.skin.surface_store import surface_compliance

    parameters = Library().skin("index_medium")
    pad = None if at_nodes else surface_compliance(parameters, shipped=BUILT_IN / "skins")
    bone = CompliantBone.of(skin_from_parameters(parameters), {}, "finger", surface=pad)
    surface, pressing = _surface(shape), int(DEPTH / PRESS * RATE)
    step = speed / RATE
    there = np.arange(1, int(STROKE / step) + 1) * step
    stroke = np.concatenate([there, there[-2::-1], -there, -there[-2::-1]])
    along = np.concatenate([np.zeros(pressing + 1), np.tile(stroke, strokes)])
    depth = np.minimum(np.arange(len(along)) / pressing, 1.0) * DEPTH
    times = []
    with one_blas_thread():
        for frame in range(len(along)):
            body = ContactBody(surface, translation=np.array([along[frame], 0.0, depth[frame]]), friction=MU)
            started = time.perf_counter()
            bone.step([body], float(frame))
            times.append((time.perf_counter() - started) * 1e3)
    return tuple(times[pressing + 1 :])


def _surface(shape: str) -> Any:
    from core.surface.gap import Surface

    if shape == "ribs":
        return Surface.build(*_ribs())
    return {"block": Surface.block, "edge": Surface.edge, "ball": lambda: Surface.sphere(5e-3, 5000)}[shape]()


def _ribs() -> tuple[Any, Any]:
    """Return vertices [m] and triangles of ribs along Y on a block; the middle of one's top is the origin."""
    from core.surface import shapes

    rib, triangles = shapes.block(RIB, 0.05, 1.2 * GROOVE)
    below, _ = shapes.block(RIBS * PERIOD, 0.05, 0.02)
    middles = (np.arange(RIBS) - RIBS // 2) * PERIOD
    parts = [below - [0.0, 0.0, GROOVE], *(rib + [x, 0.0, 0.0] for x in middles)]
    count = len(rib)
    return np.concatenate(parts), np.concatenate([triangles + k * count for k in range(len(parts))])
