"""A window never waits for what is read or made: threads and child processes do it, and the cards say so meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import pytest

from blender_addon import loading, redraw
from blender_addon._core import DermisError, core
from blender_addon.demos import demo_motors, demo_thimble
from blender_addon.devices import skin_models, thimble_devices
from blender_addon.preview import device_preview, platform_preview, skin_preview
from blender_addon.viewport import device_cards, shown, slices

MOST = 120.0  # [s] that tests wait


@pytest.fixture
def window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let views be looked at, with an empty cache and nothing in memory."""
    monkeypatch.setattr(redraw, "watched", lambda: True)
    monkeypatch.setattr(slices, "budget", lambda: 0.0)
    monkeypatch.setattr(slices, "rest", lambda: 0.0)
    monkeypatch.setattr(skin_models, "cache", lambda: core.cache.Cache(tmp_path, 10**9))
    forget()
    yield
    forget()


def forget() -> None:
    """Forget everything that was read."""
    loading.finish()
    skin_models.forget()
    device_preview.reset()
    skin_preview.reset()
    for kept in device_preview.FOLLOWERS:
        kept.reset()
    thimble_devices.forget()
    shown.forget()


def work(until: Callable[[], bool]) -> None:
    """Do what timers do until something is the case."""
    end = time.monotonic() + MOST
    while not until():
        assert time.monotonic() < end, "it takes too long"
        skin_models._tick()
        loading._on_timer()
        if shown._slices.busy(bpy.context.scene):
            shown._slices._on_timer()
        else:
            shown.work()
        time.sleep(0.005)


def rows() -> tuple:
    """Return the devices that are shown."""
    now = shown.now(bpy.context.scene)
    return now.devices.rows if now is not None and now.devices is not None else ()


def test_work_goes_on_in_a_thread_and_what_it_raises_is_told_once(monkeypatch) -> None:
    monkeypatch.setattr(redraw, "watched", lambda: True)
    held, asked = threading.Event(), []
    try:
        assert loading.value("a", lambda: held.wait(MOST) and threading.current_thread()) is None
        assert loading.value("a", lambda: asked.append(1)) is None, "it is under way"
        held.set()
        while (found := loading.value("a", lambda: asked.append(1))) is None:
            time.sleep(0.001)
        assert found[0] is not threading.main_thread() and not asked

        def refused() -> None:
            raise DermisError("refused")

        with pytest.raises(DermisError, match="refused"):
            while loading.value("b", refused) is None:
                time.sleep(0.001)
        while (again := loading.value("b", lambda: 1)) is None:
            time.sleep(0.001)
        assert again == (1,), "it is tried anew"
    finally:
        held.set()
        loading.finish()


def test_without_a_window_it_is_done_at_once() -> None:
    assert loading.value("c", lambda: threading.current_thread()) == (threading.main_thread(),)
    assert loading.engine(skins=True)


def test_a_thimble_on_a_skin_that_nobody_has_made_says_what_it_waits_for(window, monkeypatch) -> None:
    """Everything that takes long is done by others than this thread: the skin, its tables, the thimble's."""
    main = threading.main_thread()
    for module, name in (
        (core.skin.model, "condensed_pad"),
        (core.matching.description, "describe"),
        (core.matching.warm_start, "warm_start_table"),
    ):
        before = getattr(module, name)

        def elsewhere(*given, before=before, name=name, **named):
            assert threading.current_thread() is not main, name
            return before(*given, **named)

        monkeypatch.setattr(module, name, elsewhere)
    scene = demo_thimble.build("BALL")
    bpy.context.window.scene = scene
    said: list[str] = []

    def ready() -> bool:
        found = rows()
        said.extend(row.note for row in found if row.note)
        said.extend(state.note for state in skin_preview.own(scene) if state.model is None)
        return any("mismatch" in row.signals for row in found)

    scene.frame_set(30)
    shown.on_frame(scene)
    work(ready)
    assert any(note.startswith("making the standard skin") for note in said), said
    assert any(note.startswith("preparing") for note in said), said
    assert not [row.note for row in rows() if row.note]
    known = {state.finger for state in shown.now(scene).skins.states}
    assert "Index" in known and len(known) == 2, "the skin, and as the thimble renders it"


def test_the_second_time_no_process_is_asked(window) -> None:
    scene = demo_thimble.build("BALL")
    bpy.context.window.scene = scene
    scene.frame_set(30)
    shown.on_frame(scene)
    work(lambda: any("mismatch" in row.signals for row in rows()))
    forget()
    shown.on_frame(scene)
    end = time.monotonic() + MOST
    while not any("mismatch" in row.signals for row in rows()):
        assert time.monotonic() < end and not skin_models._making
        loading._on_timer()
        shown._slices._on_timer() if shown._slices.busy(scene) else shown.work()
        time.sleep(0.005)


def test_a_thimble_that_cannot_be_prepared_says_why(window, monkeypatch) -> None:
    scene = demo_thimble.build("BALL")
    bpy.context.window.scene = scene
    finger = next(obj for obj in scene.objects if obj.dermis.role == "FINGER")
    device = finger.dermis.finger.devices[0]
    device.thimble_calibrated = True
    device.thimble_felt_1 = 1.5
    scene.frame_set(30)
    shown.on_frame(scene)
    work(lambda: any("felt" in row.note for row in rows()))
    assert [device_cards.in_words(row) for row in rows()] == [row.note for row in rows()]


def test_a_platform_without_a_table_says_how_it_comes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    forget()
    monkeypatch.setattr(skin_models, "cache", lambda: core.cache.Cache(tmp_path, 10**9))
    monkeypatch.setattr(core.matching.lookup, "_TABLES", core.recent.Recent(1))  # another test may have made it
    scene = demo_motors.build("flat")
    bpy.context.window.scene = scene
    for frame in (20, 21):
        scene.frame_set(frame)
        shown.on_frame(scene)
    (row,) = rows()
    assert not row.values and row.note == platform_preview.NO_TABLE and "Bake" in row.note
    assert device_cards.in_words(row) == row.note and device_cards.height(row) > 0
    forget()
