"""Commands as F-curves: they are what was baked, nobody's animation changes, and they go away again."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import compat
from blender_addon.results import command_curves, store


@pytest.fixture
def demo() -> bpy.types.Scene:
    """Return the demo scene, baked."""
    bpy.ops.dermis.demo_scene()
    bpy.ops.dermis.bake()
    return bpy.context.scene


def curves_of(place: Any) -> dict[str, Any]:
    """Return the curves of a datablock's action, by the name of their property."""
    bag = next(iter(compat.channelbags(place.animation_data.action)))
    return {c.data_path[2:-2]: c for c in bag.fcurves}


def keys_of(curve: Any) -> np.ndarray:
    """Return frame and value of each key, or of each sample of a curve without keys."""
    kept = curve.keyframe_points if len(curve.keyframe_points) else curve.sampled_points
    points = np.empty(2 * len(kept), np.float32)
    kept.foreach_get("co", points)
    return points.reshape(-1, 2)


def test_curves_are_what_was_baked_at_frames_in_millimetres(demo: bpy.types.Scene) -> None:
    assert bpy.ops.dermis.commands_as_curves() == {"FINISHED"}
    index = demo.objects["Index"]
    assert index.select_get()  # the Graph Editor shows no other
    curves = curves_of(index.data)
    track = store.current(demo).bake.outputs[0].track
    keys = keys_of(curves["haptip tactor_x (mm)"])
    assert keys[:, 0].tolist() == [float(f) for f in range(1, 98)]
    wanted = 1e3 * np.interp((keys[:, 0] - 1.0) / 24.0, track.times, track.column("tactor_x"))
    assert np.abs(keys[:, 1] - wanted).max() < 1e-5 and np.ptp(wanted) > 0.5
    assert "haptip pulley_1 (deg)" in curves
    limits = {name: keys_of(c)[:, 1].tolist() for name, c in curves.items() if " limit " in name}
    assert limits["haptip limit 2 (mm)"] == 97 * [2.0] and limits["haptip limit -2 (mm)"] == 97 * [-2.0]
    assert all(c.lock and not len(c.keyframe_points) for c in curves.values())  # no keys in anybody's timeline
    assert {c.group.name for c in curves.values()} == {"HapTip shear tactor, at frames, of 1000 Hz"}
    assert set(curves_of(demo.objects["Reader"].data)) >= {"electrovibration amplitude (V)"}


def test_the_properties_follow_their_curves(demo: bpy.types.Scene) -> None:
    bpy.ops.dermis.commands_as_curves()
    mesh = demo.objects["Index"].data
    keys = dict(keys_of(curves_of(mesh)["haptip tactor_x (mm)"]).tolist())
    for frame in (20, 80):
        demo.frame_set(frame)
        assert mesh["haptip tactor_x (mm)"] == pytest.approx(keys[float(frame)], abs=1e-6)
        assert abs(keys[float(frame)]) > 1e-3


def test_between_frames_at_a_stated_rate(demo: bpy.types.Scene) -> None:
    bpy.ops.dermis.commands_as_curves(keys="RATE", rate=240.0)
    curves = curves_of(demo.objects["Index"].data)
    keys = keys_of(curves["haptip tactor_y (mm)"])
    assert len(keys) == 961 and np.allclose(np.diff(keys[:, 0]), 0.1, atol=1e-4)
    assert {c.group.name for c in curves.values()} == {"HapTip shear tactor, 240 Hz of 1000"}


def test_the_animation_and_the_bake_stay_as_they_were(demo: bpy.types.Scene) -> None:
    index = demo.objects["Index"]
    action, slot = index.animation_data.action, index.animation_data.action_slot
    before = {(c.data_path, c.array_index): keys_of(c).tobytes() for b in compat.channelbags(action) for c in b.fcurves}
    hash_before = store.current(demo).bake.content_hash
    bpy.ops.dermis.commands_as_curves()
    assert (index.animation_data.action, index.animation_data.action_slot) == (action, slot)
    after = {(c.data_path, c.array_index): keys_of(c).tobytes() for b in compat.channelbags(action) for c in b.fcurves}
    assert after == before
    demo.frame_set(30)
    bpy.context.view_layer.update()
    assert store.state(demo) == "fresh"
    bpy.ops.dermis.bake()
    assert store.current(demo).bake.content_hash == hash_before


def test_they_are_replaced_and_removed_whole(demo: bpy.types.Scene) -> None:
    actions, plain = set(bpy.data.actions.keys()), dict(demo.objects["Index"].data.items())
    bpy.ops.dermis.commands_as_curves()
    once = set(bpy.data.actions.keys())
    bpy.ops.dermis.commands_as_curves(keys="RATE", rate=100.0)
    assert set(bpy.data.actions.keys()) == once and len(once - actions) == 3
    assert bpy.ops.dermis.remove_curves() == {"FINISHED"}
    assert set(bpy.data.actions.keys()) == actions
    mesh = demo.objects["Index"].data
    assert dict(mesh.items()) == plain and mesh.animation_data is None
    assert store.state(demo) == "fresh"
    assert not bpy.ops.dermis.remove_curves.poll()


def test_without_a_mesh_of_its_own_the_finger_itself_holds_them_where_it_is_free(demo: bpy.types.Scene) -> None:
    index, thumb = demo.objects["Index"], demo.objects["Thumb"]
    thumb.data = index.data  # shared, and both are animated
    made = command_curves.write(demo, store.current(demo))
    assert {f.where for f in made.findings} == {"finger 'Index'", "finger 'Thumb'"} and made.curves > 0
    thumb.animation_data_clear()
    made = command_curves.write(demo, store.current(demo))
    assert {f.where for f in made.findings} == {"finger 'Index'"}
    assert "haptip tactor_x (mm)" in curves_of(thumb)
    assert command_curves.remove(demo) == 2 and thumb.animation_data is None


def test_where_nobody_can_hold_curves_it_is_refused(demo: bpy.types.Scene) -> None:
    reader, index = demo.objects["Reader"], demo.objects["Index"]
    reader.data = demo.objects["Thumb"].data = index.data
    with pytest.raises(RuntimeError, match="it cannot hold the curves"):
        bpy.ops.dermis.commands_as_curves()


@pytest.mark.undo
def test_undo_is_one_step(demo: bpy.types.Scene) -> None:
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.dermis.commands_as_curves()
    bpy.ops.ed.undo_push(message="after")
    assert command_curves.present(bpy.context.scene)
    bpy.ops.ed.undo()
    assert not command_curves.present(bpy.context.scene)
    assert not [a for a in bpy.data.actions if a.name.endswith("Commands")]
