"""Sliding with friction: shapes pressed 1 mm deep and drawn to and fro, by way of solving and by rate of samples.

The error is of the force on the finger along the path, RMS over RMS, at the times that all rates share. No formula
knows it: the reference is contact on points, twice as close, solved to `TIGHT`, at `FINEST` samples a second; its own
error is taken to be what halving the distance of points, or doubling the rate, changed. What all contact on points
shares, the compliance of the smooth pad, is not judged here but where shapes are pressed. The algebraic part is the
distance from the same way solved to `TIGHT`. The time is all of the processor's for the path, for each 1/240 s of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any
from unittest import mock

import numpy as np

from core.arrays import Array
from core.parameters.error_bands import LINEAR, NEO_HOOKEAN, error_band

from .. import one_blas_thread, timing
from .measured import Panel, Point, clocked
from .on_shapes import DEPTH, RATE, TIGHT, Setting, settings, skin_of

MU, PRESSING, SPEED, STROKE = 0.6, 0.1, 20e-3, 1.5e-3  # friction, [s], [m/s], [m]
RATES, FINEST, SHARED = (60.0, 120.0, RATE, 480.0), 960.0, 60.0  # samples a second; `SHARED` divides all of them
RUNS = 2
SHAPES = ("plane", "ball 5 mm", "edge 90 degrees")


def panels() -> Iterator[Panel]:
    """Yield a diagram for each shape."""
    default = next(s for s in settings() if s.default)
    band = {tissue: error_band(tissue, DEPTH).force.median for tissue in (LINEAR, NEO_HOOKEAN)}
    for shape in SHAPES:
        surface = _surface(shape)
        with one_blas_thread():
            tight = default._replace(tolerance=TIGHT)
            truth = _drawn(surface, tight._replace(coarser=0.5), FINEST)[0]
            wider, slower = _drawn(surface, tight, FINEST), _drawn(surface, tight._replace(coarser=0.5), FINEST / 2.0)
            own = max(_off(force, truth) for force, _ in (wider, slower))
            panel = Panel(f"{shape}, sliding", f"{shape}, drawn to and fro, friction {MU}", "error of force", own=own)
            panel.bands, panel.each = band, "ms for each 1/240 s"
            for setting, rate in _ways():
                panel.points.append(_point(surface, setting, rate, truth))
        yield panel


def _ways() -> Iterator[tuple[Setting, float]]:
    """Yield all ways to solve at the scene's rate, and the default's at other rates."""
    for setting in settings():
        if setting.element == "anp" and setting.level != "fine":
            yield setting, RATE
        if setting.default:
            for rate in RATES:
                named = setting._replace(curve="points, by samples a second", knob=f"{rate:g}", default=False)
                yield named, rate


def _point(surface: Any, setting: Setting, rate: float, truth: Array) -> Point:
    tight = _drawn(surface, setting._replace(tolerance=TIGHT), rate)[0]
    runs = [_drawn(surface, setting, rate) for _ in range(RUNS)]
    force = runs[-1][0]
    times = [ms * rate / RATE for _, each in runs for ms in each]  # for 1/240 s at each sample's pace
    parts = {"median": timing(times).median}
    told = setting.curve, setting.knob, float(np.mean(times)), timing(times).p95
    return Point(*told, _off(force, truth), _off(force, tight), setting.default, parts, _off(tight, truth))


def _off(force: Array, truth: Array) -> float:
    return float(np.sqrt(((force - truth) ** 2).sum() / (truth**2).sum()))


def _drawn(surface: Any, setting: Setting, rate: float) -> tuple[Array, list[float]]:
    """Return the force at shared times while it is drawn [N], shape (n, 3), and all samples' times in contact [ms]."""
    from core.contact.skin_sampler import SkinSampler
    from core.contact.solver import point_tree
    from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

    body = Body("shape", Mesh(surface.vertices, surface.triangles), {"friction": MU})
    finger = Finger("finger", (), {"contact": setting.contact, "solved_at": "samples"})
    scene = TactileScene("sliding", Fraction(24), (1, 100), rate, (finger,), (body,), (), ())
    limits = {name: setting.coarser * getattr(point_tree, name) for name in ("TURNED", "BENT")}
    times = []
    count = round((PRESSING + 2.0 * STROKE / SPEED) * rate) + 1
    with mock.patch.multiple(point_tree, **limits):
        sampler = SkinSampler(scene, {0: skin_of(setting.level)}, tolerance=setting.tolerance)
        for sample in range(-1, count):
            t = sample / rate
            pose = np.eye(4)[None, None].copy()
            pose[0, 0, :3, 3] = _place(t)
            at = np.array([t])
            chunk = Chunk(1.0 + 24.0 * at, at, np.eye(4)[None, None].copy(), pose, pose[:0])
            taken = clocked(lambda chunk=chunk: sampler.add(chunk))[1]  # type: ignore[misc]
            times += [taken] if sample > 0 else []
        touch = sampler.finish()[0]
    first, step = round(PRESSING * rate) + 1, round(rate / SHARED)
    force = [touch.stimulus_at(i).resultant for i in range(first, len(touch.times), step)]
    return np.array(force), times


def _place(t: float) -> Array:
    """Return where a shape is [m]: at first contact, pressed, drawn along X and back."""
    drawn = STROKE - abs(STROKE - SPEED * max(t - PRESSING, 0.0))
    return np.array([drawn, 0.0, DEPTH * min(t / PRESSING, 1.0)])


def _surface(shape: str) -> Any:
    """Return a shape whose top is the origin."""
    from core.surface.gap import Surface

    if shape == "plane":
        return Surface.block()
    return Surface.sphere(5e-3, 5000) if shape == "ball 5 mm" else Surface.edge()
