"""Scenes: exact times for any fps, a hash of everything that matters, refusals a person can act on."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError, Finding, worst
from core.pipeline.render import run
from core.scene.content_hash import ContentHash
from core.scene.tactile_scene import (
    Body,
    Chunk,
    DeviceUse,
    Finger,
    Mesh,
    Screen,
    TactileScene,
    sample_count,
    sample_frames,
    unknown_settings,
)

TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]], dtype=np.int32))
CHUNK = Chunk(
    *(np.zeros(s) for s in ((2,), (2,), (1, 2, 4, 4), (1, 2, 4, 4), (0, 2, 4, 4))), animated={"a": np.ones(2)}
)


def scene(**change: Any) -> TactileScene:
    base = TactileScene("S", Fraction(24), (1, 25), 240.0, (Finger("F"),), (Body("B", TRIANGLE),), (), (CHUNK,))
    return replace(base, **change)


@pytest.mark.parametrize(
    ("fps", "frames", "rate", "count"),
    [
        (Fraction(24), (1, 25), 240.0, 241),
        (Fraction(24), (1, 2), 1000.0, 42),  # 1/24 s: 41.67 steps
        (Fraction(30000, 1001), (0, 30), 1000.0, 1002),  # 1.001 s
        (Fraction(30000, 1001), (0, 30000), 240.0, 240241),  # 1001 s exactly
        (Fraction(25), (-10, 10), 240.0, 193),
    ],
)
def test_sample_count_is_exact(fps: Fraction, frames: tuple[int, int], rate: float, count: int) -> None:
    assert sample_count(fps, frames, rate) == count
    found, times = sample_frames(fps, frames, rate)
    assert len(found) == len(times) == count
    assert (found[0], times[0]) == (frames[0], 0.0) and found[-1] <= frames[1] + 1e-9


def test_2997_fps_gives_the_right_times() -> None:
    frames, times = sample_frames(Fraction(30000, 1001), (1, 31), 1000.0)
    # 1 s is frame 1 + 29.97002997..., not 31
    assert frames[1000] == pytest.approx(float(1 + Fraction(30000, 1001)), abs=1e-12) and times[1000] == 1.0
    assert frames[1001] == 31.0, "1.001 s are thirty frames, exactly"


def test_times_do_not_depend_on_fps() -> None:
    _, slow = sample_frames(Fraction(24), (1, 25), 240.0)
    _, fast = sample_frames(Fraction(60), (1, 61), 240.0)
    np.testing.assert_array_equal(slow, fast)
    assert scene(fps=Fraction(60), frame_range=(1, 61)).duration == scene().duration == 1.0


BROKEN = Mesh(np.eye(3), np.array([[0, 1, 3]], dtype=np.int32))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fingers": ()}, "scene 'S': no finger. Add one with Add > Dermis > Finger"),
        ({"bodies": ()}, "nothing to touch. .*Make Touchable"),
        ({"frame_range": (5, 5)}, r"the frame range has no duration \(found '5 to 5'; allowed: an end frame after"),
        ({"frame_range": (9, 1)}, r"found '9 to 1'"),
        ({"rate": 0.0}, r"sampling rate must be positive \(found 0.0; allowed: > 0 Hz\)"),
        ({"rate": float("nan")}, "found nan"),
        ({"gravity": (0.0, 0.0, float("nan"))}, r"gravity must be an acceleration .*3 finite numbers"),
        ({"gravity": (0.0, -9.81)}, "gravity must be an acceleration"),
        ({"fingers": (Finger("F"), Finger("F"))}, r"two fingers have the same name \(found 'F'\). Rename one"),
        ({"bodies": (Body("B", TRIANGLE),) * 2}, "two objects have the same name"),
        (
            {"bodies": (Body("B", Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))),)},
            "object 'B': the mesh has no faces",
        ),
        (
            {"bodies": (Body("B", Mesh(np.eye(3) * [1.0, np.nan, 1.0], TRIANGLE.triangles)),)},
            r"object 'B': the mesh has vertices that are not finite .*3 of 3; vertex 0 is at \[1.0, nan, 0.0\].*Remove",
        ),
        ({"bodies": (Body("B", BROKEN),)}, r"a face uses a vertex that does not exist \(found 3; allowed: 0 to 2\)"),
    ],
)
def test_refusals(change: dict[str, Any], message: str) -> None:
    with pytest.raises(DermisError, match=message):
        scene(**change).validate()


def test_a_good_scene_passes() -> None:
    scene().validate()
    scene(bodies=(), screens=(Screen("P", (0.1, 0.1), np.zeros((2, 2), np.float32)),)).validate()


def test_a_finger_that_only_plays_a_pattern_needs_nothing_to_touch() -> None:
    use = DeviceUse("haptip")
    playing = Finger("F", (use,), {"pattern": "orientation", "pattern_play": True, "pattern_repeat": True})
    frames, times = sample_frames(Fraction(24), (1, 25), 240.0)
    none = np.zeros((0, len(times), 4, 4))
    chunk = Chunk(frames, times, np.tile(np.eye(4), (1, len(times), 1, 1)), none, none)
    (output,) = run(scene(fingers=(playing,), bodies=(), chunks=(chunk,))).outputs
    wave = 2e-3 * np.sin(4 * np.pi * output.track.times)
    assert output.track.column("tactor_y") == pytest.approx(wave, abs=1e-12)
    with pytest.raises(DermisError, match="nothing to touch"):
        scene(fingers=(Finger("F", (use,), {"pattern": "none"}),), bodies=()).validate()


def digest(of: TactileScene) -> str:
    content = ContentHash(of)
    assert list(content.through(of.chunks)) == list(of.chunks)
    return content.hexdigest()


CHANGES: list[dict[str, Any]] = [
    {"name": "T"},
    {"fps": Fraction(25)},
    {"frame_range": (1, 26)},
    {"rate": 120.0},
    {"gravity": (0.0, 0.0, 0.0)},
    {"fingers": (Finger("G"),)},
    {"fingers": (Finger("F", parameters={"a": 1}),)},
    {"bodies": (Body("B", None),)},
    {"bodies": (Body("B", Mesh(np.eye(3) * 2, TRIANGLE.triangles)),)},
    {"screens": (Screen("P", (1.0, 1.0), np.zeros((1, 1), np.float32)),)},
    {"screens": (Screen("P", (1.0, 1.0), np.ones((1, 1), np.float32)),)},
    {"chunks": ()},
    {"chunks": (replace(CHUNK, times=np.array([0.0, 1e-300])),)},
    {"chunks": (replace(CHUNK, animated={"b": np.ones(2)}),)},
    {"chunks": (replace(CHUNK, surfaces={0: (TRIANGLE,)}),)},
]


def test_the_hash_changes_with_everything_and_with_nothing_else() -> None:
    digests = [digest(scene())] + [digest(scene(**change)) for change in CHANGES]
    assert len(set(digests)) == len(digests)
    copy = Chunk(
        *(np.asfortranarray(getattr(CHUNK, n)) for n in ("frames", "times", "fingers", "bodies", "screens")),
        animated=dict(CHUNK.animated),
    )
    assert digest(scene(chunks=(copy,))) == digest(scene())


def test_a_name_that_no_setting_has_is_a_warning_with_names_like_it() -> None:
    given = {"friction": 0.4, "fricton": 0.3}
    finger = Finger(
        "F", (DeviceUse("haptip", {"use_textures": True}),), {"skin_levl": "draft", "skin": {"widht": 0.01}}
    )
    still = np.eye(4)
    two = replace(
        CHUNK, times=np.arange(2.0), fingers=np.tile(still, (1, 2, 1, 1)), bodies=np.tile(still, (2, 2, 1, 1))
    )
    wrong = scene(fingers=(finger,), bodies=(Body("B", TRIANGLE, given), Body("C", TRIANGLE, given)), chunks=(two,))
    told = {f.where: f for f in unknown_settings(wrong)}
    assert {where: (f.value, f.limit.split(" or ")[0]) for where, f in told.items()} == {
        "finger 'F'": ("skin_levl", "skin_level"),
        "skin of finger 'F'": ("widht", "width"),
        "device 'haptip' of finger 'F'": ("use_textures", "use_texture"),
        "object 'B'": ("fricton", "friction"),
    }, "bodies that share their settings are told once"
    assert list(told.values()) == [f for f in run(wrong).findings if f.code == "unknown-setting"]
    assert not list(unknown_settings(scene()))


def test_worst_finding() -> None:
    kinds = [Finding(s, "c", "w") for s in ("info", "warning", "error")]
    assert worst([]) is None and worst(kinds[:1]) == "info" and worst(kinds) == worst(kinds[::-1]) == "error"


def test_sentences_have_what_where_value_limit_and_remedy() -> None:
    error = DermisError("too big", where="box", value=3, limit="<= 2", remedy="Shrink it")
    assert str(error) == "box: too big (found 3; allowed: <= 2). Shrink it."
    finding = str(Finding("warning", "c", "too big", where="box", value="x", frame=2.5))
    assert finding == "warning: box: too big (found 'x') (first at frame 2.5)."
