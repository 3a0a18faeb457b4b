"""The strip in the timeline: what it says of a bake is what the bake says, and a view's pixels are its frames."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import changes
from blender_addon.preview import live_lanes
from blender_addon.preview.rows import Preview
from blender_addon.results import lanes, store
from blender_addon.results.lanes import Lane, Mark, Series
from blender_addon.timeline import columns, strip
from blender_addon.timeline.columns import View
from core.devices.spec import Channel, DeviceSpec
from core.errors import Finding
from core.track.command_track import CommandTrack

VIEW = View(200, 80, 0.0, 100.0, 1.0)  # two pixels a frame


def pixels(layout: columns.Layout, colour: Any) -> list[tuple[int, int]]:
    """Return left and right of the boxes of a colour, whatever their alpha."""
    corners = layout.positions.reshape(-1, 4, 2)
    tones = layout.colours.reshape(-1, 4, 4)[:, 0, :3]
    return [
        (round(float(c[0, 0])), round(float(c[1, 0])))
        for c, t in zip(corners, tones, strict=True)
        if np.allclose(t, colour[:3], atol=0.02)
    ]


def lane(**series: tuple[list[float], list[float]]) -> Lane:
    return Lane("Index", {k: (Series(np.array(f, float), np.array(v, float)),) for k, (f, v) in series.items()})


def test_a_column_has_the_largest_value_in_it() -> None:
    frames = np.arange(0.0, 50.0, 0.1)
    values = np.zeros(500)
    values[233] = 1.0  # one sample of ten a frame
    found = columns.columns(Series(frames, values), View(100, 80, 0.0, 100.0, 1.0))
    assert np.flatnonzero(found > 0).tolist() == [23]
    assert np.isfinite(found[:50]).all() and np.isnan(found[51:]).all()


def test_a_sample_holds_until_the_next_where_pixels_are_finer() -> None:
    found = columns.columns(
        Series(np.array([10.0, 11.0, 12.0]), np.array([0.0, 1.0, 0.0])), View(300, 9, 5.0, 15.0, 1.0)
    )
    assert np.flatnonzero(found == 1.0).tolist() == list(range(180, 210))
    assert np.flatnonzero(found == 0.0).tolist() == [*range(150, 180), *range(210, 240)]


def test_touch_lies_at_its_frames_and_is_as_high_as_the_force() -> None:
    made = lane(force=([0, 10, 20, 30], [0.0, 0.5, 1.0, 0.0]))
    layout = columns.laid_out([made], (), (), VIEW)
    assert pixels(layout, columns.BLUE) == [(20, 40), (40, 60)]
    boxes = layout.positions.reshape(-1, 4, 2)[np.isclose(layout.colours[::4, :3], columns.BLUE[:3]).all(axis=1)]
    heights = boxes[:, 2, 1] - boxes[:, 0, 1]
    assert heights[1] == pytest.approx(2.0 * heights[0], rel=0.1)


def test_boxes_are_drawn_whole_one_after_the_other() -> None:
    layout = columns.laid_out([lane(touch=([0, 10, 20], [0, 1, 0]))], (), (), VIEW)
    assert (layout.triangles // 4 == np.repeat(np.arange(len(layout.positions) // 4), 2)[:, None]).all()


def test_mismatch_colours_and_limits_are_red() -> None:
    made = lane(touch=([0, 10, 20], [0, 1, 0]), mismatch=([0, 10, 20], [0, 1, 0]), limited=([0, 12, 13], [0, 1, 0]))
    layout = columns.laid_out([made], (), (), VIEW)
    assert pixels(layout, columns.ORANGE) == [(20, 40)] and pixels(layout, columns.BLUE) == []
    assert pixels(layout, columns.RED) == [(24, 26)]
    assert "mismatch, up to 100 %" in made.says and "at a limit" in made.says
    begun = lane(touch=([0, 10, 20], [0, 1, 0]), mismatch=([0, 10, 20], [0, 505.96, 0]))  # in the first light touch
    assert begun.says == "Index: touch · mismatch, above 100 % at times"


def test_a_view_that_shows_part_shows_that_part() -> None:
    made = lane(touch=([0, 10, 20], [0, 1, 0]))
    assert pixels(columns.laid_out([made], (), (), View(200, 80, 12.0, 32.0, 1.0)), columns.BLUE) == [(0, 80)]
    assert pixels(columns.laid_out([made], (), (), View(200, 80, 50.0, 60.0, 1.0)), columns.BLUE) == []


def test_what_is_out_of_date_is_pale() -> None:
    made = lane(touch=([0, 10, 20], [0, 1, 0]))
    fresh, stale = (columns.laid_out([made], (), (), VIEW, pale=pale) for pale in (False, True))
    bars = np.isclose(fresh.colours[:, :3], columns.BLUE[:3]).all(axis=1)
    assert bars.any() and np.allclose(stale.colours[bars, 3], columns.PALE * fresh.colours[bars, 3])


@pytest.mark.parametrize("height", [30, 41, 120, 400])
def test_lanes_fit_the_region_and_have_labels_where_there_is_room(height: int) -> None:
    many = [Lane(name, lane(touch=([0, 1], [1, 0])).series) for name in ("Thumb", "Index", "Middle", "Ring", "Little")]
    layout = columns.laid_out(many, (), (), View(200, height, 0.0, 100.0, 1.0))
    assert layout.top <= max(min(height - columns.SCRUB, 0.5 * height), 15.0) + 1e-6
    assert len(layout.labels) == (5 if height >= 120 else 0)
    if layout.labels:
        assert [text.partition(":")[0] for text, _, _ in layout.labels] == [
            "Thumb",
            "Index",
            "Middle",
            "Ring",
            "Little",
        ]
        ys = [y for _, _, y in layout.labels]
        assert ys == sorted(ys, reverse=True)


def test_a_label_keeps_clear_of_keys() -> None:
    """It goes to the first gap that is wide enough, else the name alone does, else nothing is written."""
    made = Lane("Index", lane(force=([0, 10, 20], [0.0, 1.0, 0.0])).series)
    view = View(400, 80, 0.0, 100.0, 1.0)
    width = columns.LETTER * len(made.says) + 12.0

    def label(*keys: float) -> tuple[str, float] | None:
        layout = columns.laid_out([made], (), (), view, keys=keys)
        boxes = layout.positions.reshape(-1, 4, 2)[np.isclose(layout.colours[::4, 3], 0.75)]
        for key in keys:
            assert not ((boxes[:, 0, 0] < 4.0 * key) & (4.0 * key < boxes[:, 1, 0])).any(), "a key is covered"
        return layout.labels[0][:2] if layout.labels else None

    assert label() == (made.says, 6.0)
    words, x = label(1.0, 5.0)
    assert words == made.says and x > 4.0 * 5.0
    every = np.arange(0.0, 100.0, (columns.LETTER * 5 + 12.0 + 2.5 * columns.KEY) / 4.0)
    assert width > 2.0 * (columns.LETTER * 5 + 12.0)
    assert label(*every)[0] == "Index"
    assert label(*range(0, 100, 4)) is None


def test_a_mark_is_hit_at_its_place_and_nowhere_else() -> None:
    marks = (Mark(30.0, "Index", "warning", "slow"), Mark(33.0, "", "error", "bad"))
    layout = columns.laid_out([lane(touch=([0, 10], [1, 1]))], (), marks, VIEW)
    (x, y, _), (x2, y2, _) = layout.marks
    assert (x, x2) == (60.0, 66.0)
    assert layout.mark_at(x - 2, y + 1, 6.0) == marks[0] and layout.mark_at(x2 + 2, y2, 6.0) == marks[1]
    assert layout.mark_at(x + 50, y, 6.0) is None


def track(values: list[float], limited: dict[str, int], slew: float | None = None) -> CommandTrack:
    spec = DeviceSpec("d", "D", "shear_tactor", 10.0, (Channel("a", "m", -1.0, 1.0, slew),))
    return CommandTrack(spec, 0.1 * np.arange(len(values)), np.array(values)[:, None], limited=limited)


def test_limited_samples_are_those_on_a_limit_that_was_at_work() -> None:
    values = [0.0, 0.5, 1.0, 1.0, 0.2, 0.0]
    assert lanes.limited(track(values, {"a.range": 2}), {}).tolist() == [False, False, True, True, False, False]
    assert not lanes.limited(track(values, {"a.range": 0}), {}).any()
    fast = track([0.0, 0.2, 0.4, 0.5], {"a.slew": 2}, slew=2.0)
    assert lanes.limited(fast, {}).tolist() == [False, True, True, False]
    assert lanes.limited(track(values, {}), {"at_limit": np.array([0, 0, 3, 0, 0, 0])}).tolist()[2] is True


def test_marks_are_findings_with_a_frame_once_each_in_order() -> None:
    late = Finding("warning", "b", "late", "finger 'Index', haptip", frame=9.0)
    early = Finding("error", "a", "early", frame=2.5)
    marks = lanes.marks_of((late, early, late, Finding("info", "c", "nowhere")))
    assert [(m.frame, m.finger, m.severity) for m in marks] == [(2.5, "", "error"), (9.0, "Index", "warning")]


def test_a_bakes_strip_is_what_the_bake_says() -> None:
    bpy.ops.dermis.demo_scene()
    scene = bpy.context.scene
    assert strip.of(scene) is None
    bpy.ops.dermis.bake()
    shown = strip.of(scene)
    assert shown is not None and shown.state == "fresh"
    assert [made.finger for made in shown.lanes] == ["Thumb", "Index", "Reader"]
    result = store.current(scene)
    contact = result.bake.outputs[0].signals["contact"]
    (series,) = shown.lanes[1].series["touch"]
    assert series.frames[0] == 1.0 and series.frames[-1] == pytest.approx(97.0, abs=0.1)
    assert np.array_equal(series.values, contact)
    assert strip.of(scene).lanes is shown.lanes  # made once
    view = View(1300, 60, -9.0, 260.0, 1.0)
    assert strip.layout_of(shown, view) is strip.layout_of(strip.of(scene), view)
    scene.dermis.sample_rate = 100.0
    assert strip.of(scene).state == "stale"


def test_a_redraw_costs_next_to_nothing() -> None:
    bpy.ops.dermis.demo_scene()
    bpy.ops.dermis.bake()
    scene, view = bpy.context.scene, View(1600, 200, -9.0, 110.0, 1.0)
    strip.layout_of(strip.of(scene), view)
    start = time.process_time()
    for _ in range(200):
        strip.layout_of(strip.of(scene), view)
    assert (time.process_time() - start) / 200 < 1e-3
    start = time.process_time()
    for k in range(20):  # while somebody drags the view, every redraw is another one
        strip.layout_of(strip.of(scene), view._replace(left=-10.0 - k))
    assert (time.process_time() - start) / 20 < 20e-3


def test_what_was_seen_live_is_shown_until_an_edit_and_jumps_stay_empty() -> None:
    scene = bpy.context.scene
    row = SimpleNamespace(finger="Index", contact=1.0, signals={"mismatch": 0.25})
    for frame in (1.0, 2.0, 4.0, 30.0):
        shown = SimpleNamespace(
            frame=frame, devices=Preview(frame, "live", "", (row,)), skins=SimpleNamespace(states=())
        )
        live_lanes.note(scene, shown)
    (made,) = live_lanes.of(scene)
    found = columns.columns(made.series["touch"][0], View(40, 50, 0.0, 40.0, 1.0))
    assert found[3] == found[30] == 1.0 and np.isnan(found[5:30]).all() and np.isnan(found[:1]).all()
    assert made.most("mismatch") == 0.25
    strip_now = strip.of(scene)
    assert strip_now is not None and strip_now.state == "live" and not strip_now.lanes
    changes.mark_dirty()
    assert live_lanes.of(scene) == () and strip.of(scene) is None


def test_without_bake_and_touch_nothing_is_drawn() -> None:
    scene = bpy.context.scene
    row = SimpleNamespace(finger="Index", contact=0.0, signals={})
    live_lanes.note(
        scene, SimpleNamespace(frame=1.0, devices=Preview(1.0, "live", "", (row,)), skins=SimpleNamespace(states=()))
    )
    assert live_lanes.of(scene) and strip.of(scene) is None, "a line of 'up to 0 N' would look like a bake"


def test_the_jump_is_not_there_outside_the_editors() -> None:
    assert not bpy.ops.dermis.strip_jump.poll()
