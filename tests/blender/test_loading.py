"""A window never waits for what is read or made: threads and child processes do it, and the cards say so meanwhile."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import changes, loading, panels, redraw, views
from blender_addon._core import DermisError, core
from blender_addon.demos import demo_motors, demo_thimble
from blender_addon.devices import skin_models, thimble_devices
from blender_addon.panels import main
from blender_addon.preview import device_preview, platform_preview, skin_preview
from blender_addon.viewport import device_cards, shown, skin_field, slices

from . import build
from .stand_in import Anything, Panel

pytestmark = pytest.mark.shared_tests("threads and children of the engine")

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
    loading.forget()
    skin_models.forget()
    device_preview.reset()
    skin_preview.reset()
    for kept in device_preview.FOLLOWERS:
        kept.reset()
    thimble_devices.forget()
    skin_field._kits.clear()
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


def test_no_collection_of_garbage_looks_at_what_was_loaded(window) -> None:
    full = []
    gc.callbacks.append(seen := lambda phase, info: full.append(phase) if info["generation"] == 2 else None)
    try:
        before = len(gc.get_objects())
        work(lambda: loading.engine(skins=True))
        assert not full
        assert gc.isenabled()
        assert gc.get_freeze_count() > 0.9 * before, "some have ended meanwhile"
        assert len(gc.get_objects()) < 0.2 * before
    finally:
        gc.callbacks.remove(seen)
        loading.forget()
    assert gc.get_freeze_count() == 0, "all is as it was"


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
        loading.forget()


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
        (core.contact.skin_stepper.SkinStepper, "__init__"),
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


def test_tables_that_come_while_a_frame_is_worked_out_are_used_by_the_next(window, monkeypatch) -> None:
    """Rows and rendered skins are worked out one after the other: what one finds waiting, the other does too."""
    scene = demo_thimble.build("BALL")
    bpy.context.window.scene = scene
    scene.frame_set(30)
    shown.on_frame(scene)
    work(lambda: any("mismatch" in row.signals for row in rows()))
    for kept in device_preview.FOLLOWERS:
        kept.reset()
    changes.mark_dirty()
    answers = iter(["not yet"])  # to the first who asks; whoever asks after that is told that all is there
    monkeypatch.setattr(thimble_devices, "waits", lambda *_: next(answers, ""))
    seen = []
    for _ in range(2):
        shown._frames.clear()
        work(lambda: scene.session_uid in shown._frames)
        seen.append(([row.note for row in rows()], len(shown.now(scene).skins.states)))
    assert seen[0] == (["not yet"], 1), "neither the row nor the skin"
    assert seen[1][1] == 2 and not any(seen[1][0]), "both"


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


def test_a_jump_is_solved_aside_and_who_leaves_it_finds_everything_as_it_was(window) -> None:
    """The first contact after a jump runs in a thread; a jump elsewhere meanwhile neither waits for it nor sees it."""
    scene = demo_thimble.build("EDGE")
    bpy.context.window.scene = scene
    scene.frame_set(29)
    work(lambda: rows() and shown.now(scene).frame == 29.0)
    held, begun, solving = threading.Event(), threading.Event(), core.contact.skin_stepper.SkinStepper.step
    learning, learnt = core.skin.stress_table.StressTable._learn, []

    def learn(table, roots) -> None:
        learnt.extend((root, threading.current_thread()) for root in roots)
        learning(table, roots)

    def slow(*given, **named):
        begun.set()
        assert held.wait(MOST) and threading.current_thread() is not threading.main_thread()
        return solving(*given, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(core.contact.skin_stepper.SkinStepper, "step", slow)
        patch.setattr(core.skin.stress_table.StressTable, "_learn", learn)
        scene.frame_set(50)
        shown.on_frame(scene)
        end = time.monotonic() + MOST
        while not begun.is_set():
            assert time.monotonic() < end, "nothing begins"
            shown._slices._on_timer()
        for _ in range(5):
            started = time.perf_counter()
            shown._slices._on_timer()
            assert time.perf_counter() - started < MOST / 10 and not held.is_set(), "the window goes on"
        scene.frame_set(40)  # and somebody jumps elsewhere
        shown.on_frame(scene)
        held.set()
        work(lambda: rows() and shown.now(scene).frame == 40.0)
    assert learnt and not any(thread is threading.main_thread() for _, thread in learnt)
    found = [state.force for state in skin_preview.own(scene)], rows()[0].values
    forget()
    work(lambda: rows() and shown.now(scene).frame == 40.0)
    again = [state.force for state in skin_preview.own(scene)], rows()[0].values

    def refused(_work) -> None:
        raise AssertionError("nothing is new: no thread is begun")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loading, "aside", refused)
        for state in shown.now(scene).skins.states:
            assert not list(skin_field.learn(state, scene.dermis.skin_view.quantity))
    assert all(np.array_equal(a, b) for a, b in zip(found[0], again[0], strict=True)) and found[1] == again[1]


def test_panels_wait_until_a_thread_has_loaded_the_modules_that_they_query(window: None) -> None:
    """A draw that loads them itself would hold the window. Blender hides a panel whose parent is hidden."""
    classes = [c for c in panels.CLASSES if issubclass(c, bpy.types.Panel) and not getattr(c, "bl_parent_id", "")]
    others = [cls for cls in classes if cls is not main.DERMIS_PT_main]
    build.finger()

    def head() -> list[str]:
        layout = Anything()
        Panel(main.DERMIS_PT_main, layout).draw(bpy.context)
        return list(layout.words)

    assert len(others) > 8 and not any(cls.poll(bpy.context) for cls in others) and head() == ["Loading..."]
    end = time.monotonic() + MOST
    while not views.there():
        assert time.monotonic() < end
        time.sleep(0.01)
    assert sum(cls.poll(bpy.context) for cls in others) > 4 and "Loading..." not in head()
