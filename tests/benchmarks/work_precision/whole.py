"""Whole scenes: a thimble on a rolling ball, from poses to angles, by accuracy, contact and tissue of the skin.

The time is of the processor, a sample and finger of one process. The error is of the stress that the skin is asked to
feel: discretisation, measured on a ball of 12 mm pressed 1 mm deep, and the tissue's own at that depth, as the root of
the sum of their squares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from core.parameters.error_bands import LINEAR, NEO_HOOKEAN, error_band

from .. import one_blas_thread
from ..bench_shares import cache, library
from ..bench_shares import scene as six
from . import on_shapes
from .measured import Panel, Point, clocked

RUNS, SAMPLES = 2, 180
WAYS = (
    ("nodes, linear", {"contact": "nodes", "tissue": LINEAR}, ("draft", "standard")),
    ("points, linear", {"contact": "points", "tissue": LINEAR}, ("draft", "standard")),
    ("points, neo-Hookean", {"contact": "points", "tissue": NEO_HOOKEAN}, ("draft", "standard")),
)


def scenes() -> Panel:
    """Return the diagram of scenes."""
    ball = next(on_shapes.panels(("ball 12 mm",)))
    panel = Panel("scenes", "a thimble on a ball, poses to angles", "error of the stress asked for, tissue included")
    meshes = {point.knob: point.error for point in ball.points if point.curve == "nodes, by mesh"}
    points = next(point.error for point in ball.points if point.default)
    for curve, given, levels in WAYS:
        tissue = error_band(str(given["tissue"]), 1e-3).stress.median
        for level in levels:
            shape = meshes[level] if given["contact"] == "nodes" else points
            _baked({**given, "skin_level": level})  # makes the tables
            taken = [_baked({**given, "skin_level": level}) for _ in range(RUNS)]
            least, most = float(np.median(taken)), max(taken)
            default = curve == "points, linear" and level == "standard"
            parts = {"discretisation": shape, "modelling": tissue}
            off = float(np.hypot(shape, tissue))
            panel.points.append(Point(curve, level, least, most, off, None, default, parts))
    panel.bands = {name: error_band(name, 1e-3).stress.median for name in (LINEAR, NEO_HOOKEAN)}
    return panel


def _baked(given: Mapping[str, Any]) -> float:
    """Return the processor's time of a bake of one finger [ms a sample]."""
    from core.pipeline.render import render
    from core.steps import drain

    scene = six("standard")
    finger = replace(scene.fingers[0], parameters={**scene.fingers[0].parameters, **given})
    chunks = [replace(c, fingers=c.fingers[:1], bodies=c.bodies[:1]) for c in scene.chunks][: SAMPLES // 60]
    last = SAMPLES - 1
    one = replace(scene, frame_range=(0, last), fingers=(finger,), bodies=scene.bodies[:1], chunks=chunks)
    with one_blas_thread():
        made, taken = clocked(lambda: drain(render(one, library(), cache=cache())))
    assert len(made.outputs) == 1, [str(f) for f in made.all_findings]
    return taken / SAMPLES
