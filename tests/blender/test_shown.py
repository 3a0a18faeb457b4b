"""Drawing reads: what views and panels show was worked out before, and is asked for where something has happened since.

Without a window Blender draws nothing, so a graphics card that takes everything stands in for the real one.
"""

from __future__ import annotations

import builtins
import io
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import choices, doubts, panels, preferences, redraw, reporting
from blender_addon._core import core
from blender_addon.demos import demo_motors, demo_pins, demo_scene, demo_thimble
from blender_addon.devices import platform_devices, skin_models, thimble_adaptation
from blender_addon.preview import device_preview, pin_preview, rows, skin_preview, skin_state, thimble_preview
from blender_addon.results import store
from blender_addon.sampling import scene_sweep
from blender_addon.streaming import built_devices, device_calibration, streamed_track
from blender_addon.viewport import (
    cards,
    device_cards,
    packing,
    paint,
    parts,
    platform_twin,
    shown,
    skin_cards,
    skin_field,
    skin_shown,
    slices,
    tactor_twin,
    thimble_twin,
)

from .stand_in import Anything, Panel, draw, draw_callbacks, graphics_card

pytestmark = pytest.mark.shared_cases("presets of devices, for the engine")

# Whatever solves, searches, looks up, reads a file or works out what is drawn: none of it runs while something draws.
WORK = (
    (core.devices.workspace, "workspace"),
    (core.matching.deformation.PinSolver, "solve"),
    (core.matching.lookup, "commands_now"),
    (core.matching.lookup, "table_at_hand"),
    (core.matching.pins, "setup"),
    (core.matching.replay, "Replay"),
    (core.matching.table, "press_of"),
    (core.matching.thimble, "follower"),
    (core.matching.thimble_use, "calibrated_mechanism"),
    (core.pipeline.render, "render"),
    (core.presets.Library, "device"),
    (core.skin.model, "skin_from_parameters"),
    (core.skin.stimulus, "Stimulus"),
    (core.track.check, "preset_findings"),
    (device_preview, "baked_row"),
    (doubts, "look"),
    (pin_preview, "pins_of"),
    (platform_devices, "table"),
    (platform_twin, "state"),
    (scene_sweep, "sample_now"),
    (skin_field, "draw_of"),
    (skin_models, "get"),
    (thimble_adaptation, "status"),
    (thimble_preview, "follow"),
    (tactor_twin, "screen"),
    (tactor_twin, "tactor"),
    (thimble_twin, "joints"),
    (thimble_twin, "loops"),
    *((module, "open") for module in (builtins, io)),
    *((Path, name) for name in ("exists", "glob", "is_file", "open", "read_bytes", "read_text", "stat")),
    (parts.Part, "__new__"),  # what is drawn is finished
    (np, "cross"),
    (np, "einsum"),
    (np.linalg, "norm"),
)
FRAME = {"thimble": 30, "pins": 15, "platform": 38, "tactor": 20, "baked": 15}


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Anything:
    """Return the graphics card: it takes everything."""
    made, modules = graphics_card()
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    return made


@pytest.fixture
def callbacks() -> list[Callable[[], None]]:
    """Return the draw callbacks of all views."""
    return draw_callbacks()


def build(which: str) -> bpy.types.Scene:
    """Return a demo, shown at a frame in which it touches, everything worked out."""
    choices.refresh()
    if which == "thimble":
        scene = demo_thimble.build("BALL")
    elif which == "pins":
        scene = demo_pins.build(1.5e-3, 0.5, 0.0)
        scene.objects["Index"].dermis.finger.skin.level = "draft"
    elif which == "platform":
        scene = demo_motors.build("flat", "cable_platform")
        scene.objects["Index"].dermis.finger.devices[0].table_rows = 216
    else:
        scene = demo_scene.build(choices.first_of_kind("shear_tactor"), choices.first_of_kind("friction_screen"))
    bpy.context.window.scene = scene
    bpy.context.view_layer.objects.active = scene.objects["Index"]
    scene.dermis.thimble_view.workspace = True
    if which == "platform":
        assert bpy.ops.dermis.make_table() == {"FINISHED"}
    if which == "baked":
        scene.frame_start, scene.frame_end = 1, 24
        assert bpy.ops.dermis.bake() == {"FINISHED"}
    scene.frame_set(FRAME[which])
    device_preview.step(bpy.context)
    skin_preview.step(bpy.context)
    shown.work()
    return scene


def draw_only(callbacks: list[Callable[[], None]], layout: Anything) -> None:
    """Draw everything, while all that only handlers, timers and operators may do fails."""
    with pytest.MonkeyPatch.context() as patch:
        for owner, name in WORK:

            def never(*_: Any, _name: str = name, **__: Any) -> None:
                raise AssertionError(f"{_name} was called while something drew")

            patch.setattr(owner, name, never)
        draw(callbacks, layout)


@pytest.mark.parametrize("which", list(FRAME))
def test_drawing_reads(which: str, card: Anything, callbacks: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = build(which)
    layout, asked = Anything(), []
    monkeypatch.setattr(redraw, "request", lambda: asked.append(scene.frame_current))
    draw_only(callbacks, layout)
    assert not card.bare  # every line stands on a card or on a ground of its own
    assert card.drawn > 10 and layout.drawn > 50 and not asked
    assert any("Index" in words for words in card.words)  # its card in the corner
    # something happens, and nobody has worked it out yet: the old is drawn, and the work asked for
    scene.dermis.skin_view.quantity = "pressure"
    bpy.data.objects["Index"].dermis.finger.touch_distance_mm = 0.7
    draw_only(callbacks, layout)
    assert asked
    # at another frame nothing is known, and nothing of the old one may be shown
    before = card.drawn
    scene.frame_set(FRAME[which] + 1)
    draw_only(callbacks, layout)
    assert card.drawn == before


@pytest.mark.parametrize("fold", [False, True])
@pytest.mark.parametrize("which", ["thimble", "tactor"])
def test_a_card_of_another_frame_is_dimmed_and_says_so(
    which: str, fold: bool, card: Anything, callbacks: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = build(which)
    scene.dermis.fold_cards = fold
    shown.work()
    veiled: list[str] = []
    monkeypatch.setattr(paint, "veil", lambda *box_words_scale: veiled.append(box_words_scale[4]))
    draw_only(callbacks, Anything())
    now = shown.now(scene)
    assert not veiled and now.devices.rows
    monkeypatch.setattr(slices, "budget", lambda: 0.0)
    scene.frame_set(FRAME[which] + 9)
    shown.on_frame(scene)  # which has begun, and not ended
    draw_only(callbacks, Anything())
    assert veiled == [f"of frame {FRAME[which]}"] * (len(now.devices.rows) + len(now.skins.states))
    veiled.clear()
    while shown._slices._on_timer() is not None:
        pass
    draw_only(callbacks, Anything())
    assert not veiled and shown.now(scene).frame == FRAME[which] + 9


@pytest.mark.parametrize("view", [0.0, 0.25, 0.58, 1.0])
@pytest.mark.parametrize("colour", [paint.INK, paint.FAINT, paint.ORANGE, paint.BLUE, paint.GREEN])
def test_text_on_its_ground_is_readable_over_any_view(colour: paint.Colour, view: float) -> None:
    """WCAG 2.1, criterion 1.4.3: 4.5 to 1. Views show a ground of an alpha as one of its square (seen in pictures)."""

    def luminance(rgb: np.ndarray) -> float:
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    ground = view + paint.PANEL[3] ** 2 * (np.array(paint.PANEL[:3]) - view)
    text = ground + colour[3] * (np.array(colour[:3]) - ground)
    light, dark = sorted((luminance(ground), luminance(text)), reverse=True)
    assert (light + 0.05) / (dark + 0.05) >= 4.5


def test_a_veil_dims_its_card_and_writes_on_it(card: Anything) -> None:
    paint.veil(10.0, 20.0, 200.0, 80.0, "of frame 29", 1.0)
    (low, high), _ = card.boxes
    assert (*low, *high) == (10.0, 20.0, 210.0, 100.0)
    assert card.words == ["of frame 29"] and not card.bare


@pytest.mark.parametrize("gone", [False, True])
def test_panels_show_built_devices_once_a_timer_has_read_their_folder(
    gone: bool, card: Anything, callbacks: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = build("tactor")
    scene.dermis_stream.output = "Index: haptip"
    device_calibration.fill_channels(scene)
    saved = device_calibration.keep(scene, "left, red tape", "7573")
    if gone:
        (built_devices.user_folder(built_devices.FOLDER) / saved.file).unlink()
    built_devices.refresh()
    asked: list[int] = []
    monkeypatch.setattr(redraw, "request", lambda: asked.append(1))
    for read in (False, True):
        if read:
            shown.work()
        layout = Anything()
        draw_only(callbacks, layout)
        words = " ".join(layout.words)
        assert ("cannot be read" if gone else "left, red tape") in words if read else asked and "red tape" not in words


def test_panels_call_presets_by_their_names_once_a_finger_is_shown(card: Anything, callbacks: Any) -> None:
    build("tactor")
    choices.forget()
    for name in ("Index Medium", "Index Finger, Medium"):
        layout = Anything()
        draw_only(callbacks, layout)
        assert name in layout.words
        shown.work()


def test_the_stream_panel_calls_devices_by_their_names(card: Anything, callbacks: Any) -> None:
    scene = build("tactor")
    scene.dermis_stream.output = "Index: haptip"
    device_calibration.fill_channels(scene)
    device_calibration.keep(scene, "left, red tape", "7573")
    shown.work()
    layout = Anything()
    draw_only(callbacks, layout)
    Panel(panels.stream.DERMIS_MT_stream_devices, layout).draw(bpy.context)
    said = [words for words in layout.words if "Index: " in words or words.startswith("First")]
    assert "Index: HapTip shear tactor" in said and "First Device of the Bake" in said
    assert not [words for words in layout.words if "haptip" in words]


@pytest.mark.parametrize("which", list(FRAME))
def test_nothing_that_is_drawn_calls_a_device_by_the_key_of_its_preset(
    which: str, card: Anything, callbacks: Any
) -> None:
    scene = build(which)
    first = streamed_track.choices(scene)[0]
    scene.dermis_stream.output = first.label
    device_calibration.fill_channels(scene)
    shown.work()
    layout = Anything()
    draw_only(callbacks, layout)
    keys = {entry.key for entry in choices.entries("devices")}
    words = [text for text in (*layout.words, *card.words) if isinstance(text, str)]
    assert choices.worn(first.label) in words
    assert not [text for text in words if keys & set(re.split(r"[^\w-]+", text))]


def test_the_bake_panel_says_which_frames_are_baked(card: Anything, callbacks: Any) -> None:
    scene = build("tactor")
    for how, start, end in (("SCENE", 3, 77), ("OWN", 5, 9)):
        scene.dermis.bake_range = how
        scene.frame_start, scene.frame_end = 3, 77
        scene.dermis.frame_start, scene.dermis.frame_end = 5, 9
        bpy.context.view_layer.update()
        shown.work()
        layout = Anything()
        draw_only(callbacks, layout)
        assert f"Frames {start} to {end}" in layout.words


def test_findings_do_not_repeat_result_rows(card: Anything, callbacks: Any) -> None:
    result = store.current(build("baked"))
    track = result.bake.outputs[0].track
    for output in result.bake.outputs:
        output.track.limited.clear()
    track.limited["tactor_x.slew"] = 1717
    row = "1,717 limited: tactor x, slew"
    for told in (False, True):
        reporting.show(found for found in track.check() if found.code.startswith("limited") and told)
        layout = Anything()
        draw_only(callbacks, layout)
        counts = [words for words in layout.words if "1717" in words.replace(",", "")]
        assert (row in layout.words) is not told
        assert len(counts) == 1, counts


def test_a_click_folds_one_card_and_unfolds_it(card: Anything, callbacks: Any) -> None:
    build("tactor")
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")

    def words() -> list[str]:
        card.words.clear()
        draw(callbacks, Anything())
        return list(card.words)

    with bpy.context.temp_override(window=window, area=area, region=region):
        opened = words()
        (place, _), *_ = cards._places[region.as_pointer()]
        assert bpy.ops.dermis.fold_card.poll()
        assert not cards.fold_at(bpy.context, place.right + 5.0, place.bottom)
        assert cards.fold_at(bpy.context, place.left + 5.0, place.top - 5.0)
        folded = words()
        (line, _), *_ = cards._places[region.as_pointer()]
        assert line.height < place.height and len(folded) < len(opened)
        assert cards.fold_at(bpy.context, line.left + 5.0, line.top - 5.0) and words() == opened


def test_a_head_that_does_not_fit_says_less_and_is_not_cut(monkeypatch) -> None:
    made, modules = graphics_card()
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = preferences.library().device("haptip")
    row = rows.row_of("Middle", "haptip", spec, {"tactor_x": 0.0, "tactor_y": 0.0}, 1.0)
    letter, said = 6.0, device_cards.in_words(row)  # [px] of the stand-in's text
    for letters, head in ((40, "Middle   HapTip shear tactor"), (24, "Middle   HapTip shear"), (16, "Middle   HapTip")):
        width = (letters + len(said)) * letter + 3 * device_cards.MARGIN
        device_cards.line(row, packing.Box(0.0, 0.0, width, 22.0), 1.0)
        assert made.words[-1] == head
    for finger, work, head in (("Index: thimble", "rendered", "thimble"), ("A finger: its name", "idle", "A finge…")):
        state = skin_state.SkinState(finger, None, np.zeros((0, 3)), work=work)
        room = (len("no skin") + 8) * letter
        skin_cards.line(state, packing.Box(0.0, 0.0, room + 3 * 9.0, 22.0), 1.0)
        assert made.words[-2:] == ["no skin", head]  # beside what is said of it, not below
    waiting = skin_state.SkinState("Index", None, np.zeros((0, 3)), note="reading the draft skin")
    skin_cards.line(waiting, packing.Box(0.0, 0.0, skin_cards.LEGEND_WIDTH, 22.0), 1.0)
    assert made.words[-2:] == ["reading the draft skin", "Index"]


def test_both_errors_of_a_rendered_skin_are_told_in_full(monkeypatch) -> None:
    made, modules = graphics_card()
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    note = "100 % off, whole stress 100 %"
    state = skin_state.SkinState(
        "Index: thimble",
        SimpleNamespace(tissue="linear"),
        np.ones((1, 3)),
        normal_force=0.6,
        note=note,
        work="rendered",
    )
    (_, (width, height), _) = skin_cards.sizes(150.0, skin_cards.lines_of((state,)))
    now = skin_shown.Shown((state,), (None,), 0.0, 1.0)
    skin_cards.card(now, 0, None, packing.Box(0.0, 0.0, width, height), 1.0)
    assert made.words[-2:] == ["100 % off", "whole stress 100 %"] and not made.bare
