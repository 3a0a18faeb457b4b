"""Frames and seconds are converted in `blender_addon/scene_time.py` and nowhere else in the add-on."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.one_line("3.11", "the text of the sources is read")

ADDON = Path(__file__).resolve().parents[2] / "blender_addon"
CLOCK = ADDON / "scene_time.py"
OTHERS = sorted(path for path in ADDON.rglob("*.py") if path != CLOCK and "core" not in path.relative_to(ADDON).parts)

PLACES = {"frame_current", "frame_current_final", "frame_float", "frame_subframe"}
"""Properties of scenes that `scene_time` alone reads or sets."""
RATE = {"fps_base", "frame_map_old", "frame_map_new"}
"""Properties that others may only set, as a scene's `fps`."""
RATES = {"fps", "frames_per_second"}
"""Names of frame rates, with which nobody else calculates."""
OPERATORS = (ast.Mult, ast.Div, ast.FloorDiv, ast.Mod)


def conversions(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and reason of each place that converts frames or seconds by itself."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            stored = isinstance(node.ctx, ast.Store)
            of_scene = isinstance(node.value, ast.Attribute) and node.value.attr == "render"
            if (
                node.attr in PLACES
                or (node.attr in RATE and not stored)
                or (node.attr == "fps" and of_scene and not stored)
            ):
                yield node.lineno, f"reads {node.attr}"
        elif isinstance(node, ast.BinOp) and isinstance(node.op, OPERATORS):
            for part in (*ast.walk(node.left), *ast.walk(node.right)):
                name = part.attr if isinstance(part, ast.Attribute) else part.id if isinstance(part, ast.Name) else ""
                if name in RATES:
                    yield node.lineno, f"calculates with {name}"
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "frame_set":
            if len(node.args) + len(node.keywords) > 1:
                yield node.lineno, "sets a sub-frame"


def told(text: str) -> list[str]:
    """Return the reasons found in a text."""
    return [reason for _, reason in conversions(ast.parse(text))]


@pytest.mark.parametrize("path", OTHERS, ids=lambda path: path.relative_to(ADDON).as_posix())
def test_nobody_else_converts_frames_or_seconds(path: Path) -> None:
    found = [f"{path.name}:{line}: {why}" for line, why in conversions(ast.parse(path.read_text(encoding="utf-8")))]
    assert not found, "use blender_addon/scene_time.py:\n" + "\n".join(found)


@pytest.mark.parametrize(
    "text",
    [
        "moment = (float(scene.frame_current_final) - first) / 24",
        "step = count * scene.render.fps_base",
        "rate = scene.render.fps",
        "times = (frames - result.first) / result.fps",
        "frames = first + times * (fps)",
        "t = frames * sample.fps.denominator / sample.fps.numerator",
        "again.frame_set(whole, subframe=part)",
        "again.frame_set(whole, part)",
        "scene.frame_float = frame",
        "scene.frame_current = 7",
        "speed = scene.render.frame_map_new",
        "now = (frame - trail.first) / trail.frames_per_second",
    ],
)
def test_a_conversion_is_noticed(text: str) -> None:
    assert told(text)


def test_what_converts_nothing_is_left_alone() -> None:
    assert not told("scene.render.fps, scene.render.fps_base = fps, 1.0")
    assert not told("signature = (names, sample.fps)\nscene.frame_set(first)\nscene.frame_start = 1")
    assert CLOCK.is_file() and len(OTHERS) > 100 and told(CLOCK.read_text(encoding="utf-8"))
