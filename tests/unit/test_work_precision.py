"""Work-precision diagrams: where points stand, what is said of a machine's noise, and certificates of solvers."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from core.plot.canvas import SvgCanvas
from tests.benchmarks.work_precision import diagram
from tests.benchmarks.work_precision.__main__ import save, table
from tests.benchmarks.work_precision.matched import LIMIT, _solved
from tests.benchmarks.work_precision.measured import Noise, Panel, Point, panel_of

POINTS = [
    Point("nodes", "draft", 0.1, 0.2, 0.5, 1e-6, False, {"force": 0.1}),
    Point("nodes", "fine", 10.0, 20.0, 0.05, 1e-7),
    Point("points", "3e-04", 1.0, 2.0, 0.005, None, True),
]


def panel() -> Panel:
    return Panel("ball", "a ball", "stress", list(POINTS), 0.02, {"neo_hookean": 0.046})


def test_points_stand_on_logarithmic_axes() -> None:
    canvas = SvgCanvas(*diagram.size(1, 1))
    diagram.draw(canvas, [panel()], "title", "says", 1)
    text = canvas.to_bytes().decode()
    at = [tuple(map(float, found)) for found in re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="3"', text)]
    assert len(at) == 3
    (x0, y0), (x1, y1), (x2, y2) = at
    assert x0 - x1 == pytest.approx(x1 - x2, abs=2e-3) and x0 > x2, "a decade is as wide as any"
    assert y0 - y2 == pytest.approx(y2 - y1, abs=2e-3) and y0 > y1, "and as high"
    rings = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="5.4"', text)
    assert [tuple(map(float, ring)) for ring in rings] == [(x2, y2)], "the default is ringed, and it alone"
    for word in ("draft", "fine", "3e-04", "neo-hookean", "the reference", "a ball", "stress"):
        assert word in text


def test_what_is_saved_comes_back(tmp_path: Path) -> None:
    noise = Noise()
    noise.times = [1.0, 1.1, 2.0]
    files = save(tmp_path, [panel()], noise, 1.0)
    assert [f.name for f in files] == ["work_precision.md", "work_precision.json"], "no picture lacks a diagram"
    told = json.loads((tmp_path / "work_precision.json").read_text(encoding="utf-8"))
    assert told["noise"]["most_over_least"] == 2.0 and not told["noise"]["quiet"]
    assert told["machine"]["blas_threads"] == 1 and told["machine"]["versions"]["numpy"] == np.__version__
    assert panel_of(told["panels"][0]) == panel()
    lines = table([panel()]).splitlines()
    assert lines[2] == "| ball | nodes: draft | 0.1 | 0.2 | 0.5 | 1.0e-06 | force 0.1 |"
    assert "(default)" in lines[4] and "own error 0.02; neo_hookean 0.046" in lines[5]


def test_a_wrong_answer_has_no_certificate() -> None:
    gram, sides = np.diag([1.0, 2.0]), [np.array([0.1, 2.0]), np.array([-1.0, 0.2])]
    right = _solved("right", gram, sides, lambda c: np.clip(c / np.diag(gram), 0.0, LIMIT))
    assert right.error <= 1e-15
    wrong = _solved("wrong", gram, sides, lambda c: np.clip(c / np.diag(gram), 0.0, LIMIT) + [0.0, 0.1 * LIMIT])
    assert wrong.error == pytest.approx(0.1)
