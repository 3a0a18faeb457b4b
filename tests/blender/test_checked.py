"""A bake of a scene that is another by now is neither exported nor played, whoever changed it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon import changes, preferences
from blender_addon.preview import device_preview
from blender_addon.results import store
from blender_addon.streaming import session

from .build import cube, finger, keys, span
from .test_stream import state, wait

pytestmark = pytest.mark.shared_cases("what is compared is sampled, and sampling runs on both lines")

_moves = {"by": 0.0}


def mover(scene: Any, _depsgraph: Any = None) -> None:
    """A frame handler of somebody's, which Blender reports as no change of anything."""
    bpy.data.objects["Moved"].delta_location.z = _moves["by"]


@pytest.fixture
def scene() -> Iterator[Any]:
    """A finger that touches a cube, and one that a handler moves, baked."""
    made = span(1, 7)
    cube(size=0.06)
    cube("Moved", 0.02, (1.0, 0.0, 0.0))
    keys(finger("Index"), "location", (1, 7), [(0.0, 0.0, 0.034), (0.0, 0.0, 0.0302)])
    bpy.data.objects["Index"].dermis.finger.devices.add().preset = "haptip"
    _moves["by"] = 0.0
    bpy.app.handlers.frame_change_pre.append(mover)
    bpy.context.view_layer.update()
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    yield made
    session.close()
    if mover in bpy.app.handlers.frame_change_pre:
        bpy.app.handlers.frame_change_pre.remove(mover)


def exported(folder: Path) -> bool:
    return bpy.ops.dermis.export_tracks(directory=str(folder), form="json") == {"FINISHED"} and any(folder.iterdir())


def in_silence(change: Callable[[], Any]) -> Callable[[], None]:
    """Return a change that nobody is told of: as of a value in a table that a handler or a driver reads."""

    def quiet() -> None:
        with changes.muted():
            change()
            bpy.context.view_layer.update()

    return quiet


def preset_edited() -> None:
    folder = preferences.presets_folder() / "devices"
    folder.mkdir(parents=True, exist_ok=True)
    text = Path(preferences.library().path("devices", "haptip")).read_text()
    (folder / "haptip.json").write_text(text.replace('"name"', '"name" '))


CHANGES: dict[str, tuple[Callable[[], Any], str]] = {
    "a handler": (lambda: _moves.update(by=0.1), "object 'Moved': motion"),
    "a key": (
        in_silence(lambda: keys(bpy.data.objects["Index"], "location", (7,), [(0.0, 0.0, 0.0301)])),
        "finger 'Index': motion",
    ),
    "a vertex": (
        in_silence(lambda: setattr(bpy.data.objects["Cube"].data.vertices[0], "co", (0.0, 0.0, -0.05))),
        "object 'Cube': shape",
    ),
    "friction": (
        in_silence(lambda: setattr(bpy.data.objects["Cube"].dermis.material, "friction", 0.123)),
        "object 'Cube': settings",
    ),
    "a device": (in_silence(lambda: bpy.data.objects["Index"].dermis.finger.devices.add()), "finger 'Index': devices"),
    "the frame rate": (lambda: setattr(bpy.context.scene.render, "fps", 30), "scene: frames"),
    "gravity": (in_silence(lambda: setattr(bpy.context.scene, "gravity", (0.0, 0.0, -1.0))), "scene: gravity"),
    "another thing": (in_silence(lambda: cube("New", 0.01)), "object 'New' is new"),
    "one less": (
        in_silence(lambda: bpy.data.objects.remove(bpy.data.objects["Cube"])),
        "object 'Cube' is not there any more",
    ),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_changed_is_said_and_nothing_is_written(scene: Any, tmp_path: Path, what: str) -> None:
    change, words = CHANGES[what]
    change()
    for call in (
        lambda: bpy.ops.dermis.export_tracks(directory=str(tmp_path)),
        lambda: bpy.ops.dermis.export_as(form="json", directory=str(tmp_path)),
    ):
        with pytest.raises(RuntimeError, match="has changed since the bake") as refused:
            call()
        assert words in str(refused.value) and "Bake again" in str(refused.value)
    assert not list(tmp_path.iterdir()) and store.state(scene) == "stale", "the panel says so too from now on"
    scene.dermis_stream.mode = "play"
    session.connect(scene)
    wait(state("ready"))
    with pytest.raises(RuntimeError, match="has changed since the bake"):
        bpy.ops.dermis.stream_arm()
    assert not session.status()["armed"]
    bpy.ops.dermis.bake()
    assert exported(tmp_path)


def another(_scene: Any, _depsgraph: Any = None) -> None:
    """A frame handler that comes while a track is played."""


WHILE_ARMED: dict[str, Callable[[], Any]] = {
    "a vertex": lambda: setattr(bpy.data.objects["Cube"].data.vertices[0], "co", (0.0, 0.0, -0.05)),
    "a key": lambda: keys(bpy.data.objects["Index"], "location", (7,), [(0.0, 0.0, 0.0301)]),
    "friction": lambda: setattr(bpy.data.objects["Cube"].dermis.material, "friction", 0.123),
    "the frame rate": lambda: setattr(bpy.context.scene.render, "fps", 30),
    "time stretching": lambda: setattr(bpy.context.scene.render, "frame_map_new", 200),
    "a handler more": lambda: bpy.app.handlers.frame_change_post.append(another),
    "a handler less": lambda: bpy.app.handlers.frame_change_pre.remove(mover),
}


@pytest.mark.real_time
@pytest.mark.parametrize("what", WHILE_ARMED)
def test_an_edit_while_the_track_is_played_is_said_and_arming_again_is_refused(scene: Any, what: str) -> None:
    words = "plays the bake of before your edit"
    scene.dermis_stream.mode, scene.dermis_stream.ramp = "play", 0.1
    session.connect(scene)
    wait(state("ready"))
    assert bpy.ops.dermis.stream_arm() == {"FINISHED"}
    assert words not in wait(lambda status: status["armed"])["message"]
    try:
        WHILE_ARMED[what]()
        bpy.context.view_layer.update()
        session.heartbeat()
        status = session.status()
        assert words in status["message"] and status["armed"], "it says so, and goes on"
        bpy.ops.dermis.stream_stop()
        assert words not in wait(state("ready"))["message"], "nothing is played"
        if not what.startswith("a handler"):  # those change nothing of this scene: sampling it again tells
            with pytest.raises(RuntimeError, match="has changed since the bake"):
                bpy.ops.dermis.stream_arm()
            assert bpy.ops.dermis.bake() == {"FINISHED"}
        assert bpy.ops.dermis.stream_arm() == {"FINISHED"}
        assert words not in wait(lambda status: status["armed"])["message"]
    finally:
        if another in bpy.app.handlers.frame_change_post:
            bpy.app.handlers.frame_change_post.remove(another)


@pytest.mark.real_time
def test_following_an_old_bake_is_said_as_well(scene: Any) -> None:
    words = "follows the bake of before your edit"
    scene.dermis_stream.mode, scene.dermis_stream.ramp, scene.dermis.live_preview = "follow", 0.1, False
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    assert words not in wait(lambda status: status["armed"])["message"]
    WHILE_ARMED["a vertex"]()
    bpy.context.view_layer.update()
    session.heartbeat()
    assert words in session.status()["message"]
    scene.dermis.live_preview = True
    device_preview.step(bpy.context)
    session.heartbeat()
    assert words not in session.status()["message"], "it follows the scene as it is"


def test_what_does_not_matter_is_exported_and_played(scene: Any, tmp_path: Path) -> None:
    bpy.data.objects["Index"].name = "Zeigefinger"
    bpy.data.objects["Cube"].name = "Moved.001"
    bpy.data.objects["Moved"].name = "Cube"
    bpy.data.objects["Moved.001"].name = "Moved"
    bpy.app.handlers.frame_change_pre.remove(mover)
    assert store.state(scene) == "stale" and exported(tmp_path)
    assert store.state(scene) == "fresh", "it is shown that nothing has changed"
    scene.dermis_stream.mode = "play"
    session.connect(scene)
    wait(state("ready"))
    assert bpy.ops.dermis.stream_arm() == {"FINISHED"}
    wait(lambda s: s["armed"])


def test_moving_by_hand_asks_for_no_bake(scene: Any) -> None:
    _moves["by"] = 0.1
    scene.dermis_stream.mode = "jog"
    session.connect(scene)
    wait(state("ready"))
    assert bpy.ops.dermis.stream_arm() == {"FINISHED"}


def test_a_bake_of_an_earlier_session_is_checked_too(scene: Any, tmp_path: Path) -> None:
    bpy.app.handlers.frame_change_pre.remove(mover)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    scene = bpy.context.scene
    store.load(scene)
    assert store.state(scene) == "earlier" and exported(tmp_path / "tracks") and store.state(scene) == "fresh"
    store.load(scene)
    bpy.data.objects["Cube"].scale.z = 2.0
    with pytest.raises(RuntimeError, match="object 'Cube': motion"):
        bpy.ops.dermis.export_tracks(directory=str(tmp_path / "more"))


def test_a_bake_that_does_not_say_what_it_is_of_is_refused(scene: Any, tmp_path: Path) -> None:
    from dataclasses import replace

    store.keep(scene, replace(store.current(scene).bake, inputs={}))
    with pytest.raises(RuntimeError, match="earlier version of Dermis"):
        bpy.ops.dermis.export_tracks(directory=str(tmp_path))


def test_a_change_while_it_bakes_makes_the_bake_out_of_date(scene: Any) -> None:
    from blender_addon import baking

    taken: list[store.Taken] = []
    steps = baking.bake(scene, preferences.library(), noted=taken.append)
    while not taken or changes.sweeping():
        next(steps)
    bpy.data.objects["Cube"].dermis.material.friction = 0.3
    with pytest.raises(StopIteration) as made:
        while True:
            next(steps)
    store.keep(scene, made.value.value, taken[0])
    assert store.state(scene) == "stale"


def test_a_bake_of_another_scene_makes_none_fresh(scene: Any) -> None:
    bpy.data.objects["Cube"].dermis.material.friction = 0.3
    assert store.state(scene) == "stale"
    other = bpy.data.scenes.new("Other")
    other.frame_start, other.frame_end = 1, 3
    for obj in scene.objects:
        other.collection.objects.link(obj)
    with bpy.context.temp_override(scene=other, view_layer=other.view_layers[0]):
        bpy.ops.dermis.bake()
    assert store.state(other) == "fresh" and store.state(scene) == "stale"


def test_another_range_is_said(scene: Any, tmp_path: Path) -> None:
    scene.frame_end = 5
    assert exported(tmp_path) and store.state(scene) == "stale", "what was baked is written, and that it was another"
