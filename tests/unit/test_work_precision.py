"""Work-precision diagrams: where points stand, what is said of a machine's noise, and certificates of solvers."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from core.plot.canvas import SvgCanvas
from core.scene.tactile_scene import Mesh
from core.surface.gap import Surface
from tests.benchmarks import Benchmark, Result
from tests.benchmarks import __main__ as run
from tests.benchmarks.work_precision import diagram, on_meshes, on_shapes, sliding, slopes
from tests.benchmarks.work_precision.__main__ import PICTURES, save, table
from tests.benchmarks.work_precision.matched import LIMIT, _solved
from tests.benchmarks.work_precision.measured import Noise, Panel, Point, machine, panel_of
from tests.benchmarks.work_precision.on_shapes import Setting

pytestmark = pytest.mark.one_line("3.13", "a tool of developers: the product does not use it")

POINTS = [
    Point("nodes", "draft", 0.1, 0.2, 0.5, 1e-6, False, {"force": 0.1}),
    Point("nodes", "fine", 10.0, 20.0, 0.05, 1e-7),
    Point("points", "3e-04", 1.0, 2.0, 0.005, None, True, discretisation=0.004),
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
    assert lines[2] == "| ball | nodes: draft | 0.1 | 0.2 | 0.5 | 1e-06 |  | force 0.1 |"
    assert "(default)" in lines[4] and "| 0.004 |" in lines[4]
    assert "own error 0.02; neo_hookean 0.046" in lines[5] and "ms a frame" in lines[5]


def test_a_wrong_answer_has_no_certificate() -> None:
    gram, sides = np.diag([1.0, 2.0]), [np.array([0.1, 2.0]), np.array([-1.0, 0.2])]
    right = _solved("right", gram, sides, lambda c: np.clip(c / np.diag(gram), 0.0, LIMIT))
    assert right.error <= 1e-15
    wrong = _solved("wrong", gram, sides, lambda c: np.clip(c / np.diag(gram), 0.0, LIMIT) + [0.0, 0.1 * LIMIT])
    assert wrong.error == pytest.approx(0.1)


def test_every_diagram_of_a_picture_is_measured_somewhere() -> None:
    made = {*on_shapes.CASES, "card", "scan", "deforming", *(f"{shape}, sliding" for shape in sliding.SHAPES)}
    made |= {"tissues", "pin solvers", "pin methods", "thimble", "thimble components", "gradient", "sampling", "scenes"}
    drawn = {name for names, *_ in PICTURES.values() for name in names}
    assert drawn == made, "a picture that lacks a diagram is not drawn"
    for names, across, title, says in PICTURES.values():
        room = diagram.size(len(names), across)[0] - 40.0
        assert 6.1 * len(title) < room and 4.8 * len(says) < room, f"wider than its picture: {says}"


def test_a_scan_is_a_ball_but_for_its_noise_and_holes() -> None:
    vertices, triangles = on_meshes.ball(1280)
    whole = Surface.build(vertices, triangles)
    middle = np.array([0.0, 0.0, -on_meshes.RADIUS])
    assert np.linalg.norm(vertices - middle, axis=1) == pytest.approx(on_meshes.RADIUS)
    assert whole.volume == pytest.approx(4.0 / 3.0 * np.pi * on_meshes.RADIUS**3, rel=0.02), (
        "closed, and seen from outside"
    )
    noisy, left = on_meshes.scan_of_ball(20480)
    off = np.linalg.norm(noisy - middle, axis=1) - on_meshes.RADIUS
    assert np.std(off) == pytest.approx(on_meshes.NOISE, rel=0.05)
    a, b, c = (noisy[left[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / (4.0 * np.pi * on_meshes.RADIUS**2)
    share = on_meshes.HOLES * np.pi * on_meshes.HOLE**2 / (4.0 * np.pi * on_meshes.RADIUS**2)
    assert 0.5 * share < 1.0 - area < 1.5 * share
    at_contact = np.linalg.norm(
        (a + b + c) / 3.0 - middle - on_meshes.RADIUS * np.array([0.2, 0.0, np.sqrt(0.96)]), axis=1
    )
    assert at_contact.min() > 0.9 * on_meshes.HOLE, "one of the holes is where it touches"


def test_the_slopes_of_the_relief_are_those_of_its_height() -> None:
    x, y, step = np.array([0.1, -0.3]), np.array([0.2, 0.05]), 1e-6
    _, along_x, along_y = slopes.relief(x, y)
    rise = slopes.relief(x + step, y)[0] - slopes.relief(x - step, y)[0]
    assert along_x == pytest.approx(rise / (2.0 * step), rel=1e-7)
    rise = slopes.relief(x, y + step)[0] - slopes.relief(x, y - step)[0]
    assert along_y == pytest.approx(rise / (2.0 * step), rel=1e-7)


def test_what_slides_comes_back() -> None:
    there = sliding.PRESSING + sliding.STROKE / sliding.SPEED
    assert sliding._place(0.0) == pytest.approx([0.0, 0.0, 0.0])
    assert sliding._place(sliding.PRESSING) == pytest.approx([0.0, 0.0, 1e-3])
    assert sliding._place(there) == pytest.approx([sliding.STROKE, 0.0, 1e-3])
    assert sliding._place(there + sliding.STROKE / sliding.SPEED) == pytest.approx([0.0, 0.0, 1e-3])


def test_a_ball_that_swelled_is_the_ball_it_became() -> None:
    setting = Setting("points", "", "points", "draft", tolerance=1e-6)
    vertices, triangles = on_meshes.ball(1280)
    whole = Surface.build(vertices, triangles)
    shapes = [Mesh(vertices * size, whole.triangles) for size in np.linspace(0.9, 1.0, on_shapes.SAMPLES)]
    place = on_meshes.exact().place
    rigid, swelled = (on_shapes.pressed(whole, place, setting, each)[0] for each in ((), shapes))
    assert rigid.resultant[2] > 0.1
    off = np.linalg.norm(swelled.resultant - rigid.resultant) / rigid.resultant[2]
    assert off < 5e-3, "without friction the way is no matter, but for which cells it left divided"


def test_quick_runs_where_nothing_is_named_and_all_when_it_is_to_be_full(monkeypatch: pytest.MonkeyPatch) -> None:
    made = {
        name: Benchmark(name, None, lambda: Result("", 1.0, ""), quick)
        for name, quick in (("a_ms", True), ("b_ms", False))
    }
    monkeypatch.setattr(run, "REGISTRY", made)
    assert [b.name for b in run.chosen([], False)] == ["a_ms"]
    assert [b.name for b in run.chosen([], True)] == ["a_ms", "b_ms"]
    assert [b.name for b in run.chosen(["b_"], False)] == ["b_ms"], "one that is named runs, quick or not"
    assert run.chosen(["c"], True) == []


def test_results_say_what_they_were_measured_on() -> None:
    noise = Noise()
    noise.times, noise.waited = [1.0, 1.1], [1.0, 3.0, 3.0]
    about = {"machine": machine(), "noise": noise.as_json(), "seconds": 12.0}
    told = json.loads(run.as_json([Result("a_ms", 1.5, "ms", 2.0, {"numpy": 3.0})], about))
    assert told["results"] == [
        {"name": "a_ms", "value": 1.5, "unit": "ms", "p95": 2.0, "peers": {"numpy": 3.0}, "error": None}
    ]
    assert (
        told["machine"]["versions"]["numpy"] == np.__version__ and told["machine"]["blas"] and told["seconds"] == 12.0
    )
    assert not told["noise"]["quiet"], "who waits for the processor is not alone with it"
    assert "NOISY" in run.spoken(about) and told["machine"]["blas"] in run.spoken(about)
