"""While something steps through the frames, a device on a finger holds: nobody plays then, and nobody scrubs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon import baking
from blender_addon._core import core
from blender_addon.preferences import library
from blender_addon.results import store
from blender_addon.sampling import scene_sweep
from blender_addon.streaming import frame_hold, session
from core.steps import drain

from . import build
from .test_stream import HAPTIP, a_bake, a_track, state, wait

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]


@pytest.fixture
def scene() -> Any:
    """A finger with a HapTip over a cube, and a bake for it, at the frame 13 of 49."""
    build.cube(size=0.2)
    build.finger(location=(0.0, 0.0, 0.1)).dermis.finger.devices.add().preset = HAPTIP
    bpy.context.view_layer.update()
    bpy.context.scene.dermis.sample_rate = 50.0
    made = a_bake(a_track())
    made.frame_set(13)
    return made


def published() -> tuple[float | None, bool, tuple[float, ...]]:
    """Return time, playing and values as the sender reads them."""
    heartbeat = session._client._shared.read_heartbeat()
    return heartbeat.time, heartbeat.playing, heartbeat.values


@contextmanager
def beating() -> Iterator[list[tuple[float, Any]]]:
    """Give a heartbeat at every frame that anything goes to, as the timer may; note it, and what was published."""
    noted: list[tuple[float, Any]] = []

    def note(scene: bpy.types.Scene, _depsgraph: Any = None) -> None:
        session.heartbeat()
        noted.append((scene.frame_current_final, published()))

    bpy.app.handlers.frame_change_post.append(note)
    try:
        yield noted
    finally:
        bpy.app.handlers.frame_change_post.remove(note)


@contextmanager
def playback() -> Iterator[None]:
    """Let Blender play meanwhile.

    It is stopped as it was started, as the space bar does: Blender 4.5 once died in `screen.animation_cancel`.
    """
    play()
    try:
        yield
    finally:
        play()


def play() -> None:
    """Start or stop Blender's playback."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.screen.animation_play()


def a_bake_job(scene: Any, _folder: Path) -> None:
    """Bake as the operator's timer does, a step at a time."""
    drain(baking.bake(scene, library()))


def a_sampling(scene: Any, _folder: Path) -> None:
    """Sample the scene."""
    list(scene_sweep.sample(scene).chunks)


def a_scene_export(_scene: Any, folder: Path) -> None:
    """Save the sampled scene."""
    assert bpy.ops.dermis.export_scene(filepath=str(folder / "scene.npz")) == {"FINISHED"}


def a_render(scene: Any, folder: Path) -> None:
    """Render an animation of tiny pictures."""
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    render, scene.frame_end = scene.render, 4
    render.engine, render.resolution_x, render.resolution_y, render.filepath = "CYCLES", 8, 8, str(folder / "picture")
    scene.cycles.samples = 1
    assert bpy.ops.render.render(animation=True) == {"FINISHED"}


@pytest.mark.parametrize("mode", ["play", "follow"])
@pytest.mark.parametrize("sweep", [a_bake_job, a_sampling, a_scene_export, a_render])
def test_what_was_published_last_holds(
    scene: Any, tmp_path: Path, sweep: Callable[[Any, Path], None], mode: str
) -> None:
    scene.dermis_stream.mode = mode
    session.connect(scene)
    wait(state("ready"))
    session.heartbeat()
    before = published()
    wanted = a_track().values[500, 2:] if mode == "follow" else ()
    assert before[0] == pytest.approx(0.5) and before[2] == pytest.approx(wanted, abs=1e-12)
    with beating() as noted, playback():
        session.heartbeat()
        assert published() == (before[0], True, before[2]), "Blender plays, and nothing sweeps yet"
        sweep(scene, tmp_path)
    frames = [frame for frame, _ in noted]
    assert min(frames) == 1 and len(set(frames)) >= 4, "it did go through the frames"
    assert {(time, values) for _, (time, _, values) in noted} == {(before[0], before[2])}
    assert not any(playing for frame, (_, playing, _) in noted if frame != 13), "13 is where all of them end"
    scene.frame_set(25)
    session.heartbeat()
    assert published()[0] == pytest.approx(1.0), "a person's frame counts again afterwards"


def test_a_bake_that_is_cancelled_ends_the_hold(scene: Any) -> None:
    session.connect(scene)
    session.heartbeat()
    steps = baking.bake(scene, library())
    while scene.frame_current != 3:
        next(steps)
    assert frame_hold.held()
    session.heartbeat()
    assert published()[0] == pytest.approx(0.5)
    steps.close()
    assert not frame_hold.held() and scene.frame_current == 13
    scene.frame_set(1)
    session.heartbeat()
    assert published()[0] == pytest.approx(0.0)


def test_nothing_is_armed_during_a_sweep(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    chunks = scene_sweep.sample(scene).chunks
    chunks.advance()
    with pytest.raises(RuntimeError, match="steps through the frames"):
        bpy.ops.dermis.stream_arm()
    chunks.close()
    assert bpy.ops.dermis.stream_arm() == {"FINISHED"}
    wait(lambda s: s["armed"])


def test_connecting_during_a_sweep_publishes_no_time(scene: Any) -> None:
    chunks = scene_sweep.sample(scene).chunks
    chunks.advance()
    session.connect(scene)
    assert published() == (None, False, ())
    chunks.close()
    session.heartbeat()
    assert published()[0] == pytest.approx(0.5)


def test_blenders_own_operators_have_the_names_that_are_looked_for() -> None:
    for identifier in frame_hold.STEPPING:
        family, name = identifier.split("_OT_")
        operator = getattr(getattr(bpy.ops, family.lower()), name)
        assert operator.get_rna_type().identifier == identifier
    assert "modal_operators" in bpy.types.Window.bl_rna.properties


def test_a_bake_that_is_kept_is_sent_only_after_its_sweep(scene: Any) -> None:
    """The bake's frames pass with the old track held; the new one and its own times come together."""
    pipeline = core.pipeline.bake
    session.connect(scene)
    old = session._client._request["track"]
    scene.frame_start = 7
    with beating() as noted:
        drain(baking.bake(scene, library()))
    assert {shown[0] for _, shown in noted} == {0.5} and session._client._request["track"] == old
    store.keep(scene, pipeline.Bake((pipeline.Output("Finger", HAPTIP, a_track(), {}, ()),), (), {}, "new"))
    session.heartbeat()
    assert published()[0] == pytest.approx(0.25) and session._client._request["track"] != old
