"""Recorded poses become keys: columns, units, axes, rates, and what is refused."""

from __future__ import annotations

from math import radians
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Euler, Quaternion, Vector

from blender_addon import reporting

from .build import cube, finger, span


def ready() -> bpy.types.Object:
    """Make an active finger."""
    span(1, 10, fps=24)
    made = finger(location=(0.0, 0.0, 0.0))
    bpy.context.view_layer.objects.active = made
    bpy.context.view_layer.update()
    return made


def written(folder: Path, text: str) -> str:
    """Write a file and return its path."""
    path = folder / "poses.csv"
    path.write_text(text)
    return str(path)


def at(obj: bpy.types.Object, frame: float) -> np.ndarray:
    """Return an object's matrix at a frame."""
    bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
    return np.array(obj.matrix_world)


@pytest.mark.parametrize("mode", ["XYZ", "QUATERNION"])
def test_times_places_and_turns_come_to_their_frames(mode: str, tmp_path) -> None:
    obj = ready()
    obj.rotation_mode = mode
    half = 0.5**0.5
    text = f"t,x,y,z,w,x,y,z\n10.0,1,2,3,1,0,0,0\n10.5,3,2,1,{half},{half},0,0\n11.0,0,0,0,-1,0,0,0\n"
    bpy.ops.dermis.import_poses(filepath=written(tmp_path, text), first=5, unit="MM")
    assert bpy.context.scene.frame_end == 29
    assert at(obj, 5)[:3, 3] == pytest.approx([1e-3, 2e-3, 3e-3])
    assert at(obj, 17)[:3, 3] == pytest.approx([3e-3, 2e-3, 1e-3])
    assert at(obj, 17)[:3, 1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)  # a quarter about X
    assert at(obj, 29)[:3, :3] == pytest.approx(np.eye(3), abs=1e-6)
    assert at(obj, 11)[:3, 3] == pytest.approx([2e-3, 2e-3, 2e-3])
    assert np.linalg.det(at(obj, 23)[:3, :3]) == pytest.approx(1.0, abs=1e-5)


def test_a_header_decides_what_is_time_and_what_is_an_angle(tmp_path) -> None:
    """Its first column was taken for x, its angles for a quaternion."""
    obj = ready()
    text = "time [ms],x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n0,1,2,3,0,0,90\n500,3,2,1,10,20,30\n"
    bpy.ops.dermis.import_poses(filepath=written(tmp_path, text), first=1)
    assert bpy.context.scene.frame_end == 13
    assert at(obj, 1)[:3, 3] == pytest.approx([1e-3, 2e-3, 3e-3])
    assert at(obj, 1)[:3, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    wanted = Euler((radians(10), radians(20), radians(30)), "XYZ").to_matrix()
    assert at(obj, 13)[:3, :3] == pytest.approx(np.array(wanted), abs=1e-6)
    assert at(obj, 13)[:3, 3] == pytest.approx([3e-3, 2e-3, 1e-3])


def test_places_that_cannot_be_metres_are_asked_about_and_the_unit_answers(tmp_path) -> None:
    """A finger was keyed 100 m away, and moved by a metre."""
    obj = ready()
    path = written(tmp_path, "time,x,y,z\n0,100,200,300\n0.5,101,200,300\n")
    with pytest.raises(RuntimeError, match="too far away for metres.*columns='time, x_mm, y_mm, z_mm'"):
        bpy.ops.dermis.import_poses(filepath=path)
    assert obj.animation_data is None
    bpy.ops.dermis.import_poses(filepath=path, unit="MM")
    assert at(obj, 1)[:3, 3] == pytest.approx([0.1, 0.2, 0.3])
    bpy.ops.dermis.import_poses(filepath=path, columns="time_s, x_m, y_m, z_m")
    assert at(obj, 1)[:3, 3] == pytest.approx([100.0, 200.0, 300.0])


def test_rows_without_times_have_a_rate_and_places_alone_keep_the_turn(tmp_path) -> None:
    obj = ready()
    obj.rotation_euler = (0.1, 0.2, 0.3)
    bpy.context.view_layer.update()
    rows = "\n".join(f"{i},0,0" for i in range(49))
    bpy.ops.dermis.import_poses(filepath=written(tmp_path, rows), rate=48.0, columns="x_m, y_m, z_m")
    assert bpy.context.scene.frame_end == 25
    assert at(obj, 13.5)[0, 3] == pytest.approx(25.0)
    assert tuple(obj.rotation_euler) == pytest.approx((0.1, 0.2, 0.3), abs=1e-5)


def test_what_is_up_there_is_up_here(tmp_path) -> None:
    obj = ready()
    turn = Quaternion(Vector((0.3, 1.0, 0.2)).normalized(), 0.7)
    row = f"1,2,-3,{turn.x},{turn.y},{turn.z},{turn.w}\n"
    path = written(tmp_path, row * 3)
    bpy.ops.dermis.import_poses(filepath=path, rate=24.0, y_up=True, columns="x, y, z, qx, qy, qz, qw")
    found = at(obj, 1)
    assert found[:3, 3] == pytest.approx([1.0, 3.0, 2.0])
    there = np.array(turn.to_matrix())[:, 1]  # the thing's own Y, Y up
    assert found[:3, 1] == pytest.approx([there[0], -there[2], there[1]], abs=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2\n3,4\n", "does not name its columns"),
        ("0,1,2,3\n1,1,2,3\n", "columns='time_s, x_m, y_m, z_m'"),
        ("time,x,y,z,rx,ry,rz\n0,1,2,3,0,0,90\n1,1,2,3,0,0,90\n", "columns='time, x, y, z, rx_deg, ry_deg, rz_deg'"),
        ("t,x,y,z\n0,1,2,3\n0,1,2,3\n", "times do not rise"),
        ("t,x,y,z\n0,1,2,3\n", "at least two rows"),
        ("t,x,y,z\n0,1,2,3\n1,a,2,3\n", "line 3, column 2"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,0,0,0,0\n0,0,0,0,0,0,0\n", "not a rotation"),
        ("", "no rows"),
    ],
)
def test_what_is_no_recording_is_refused(text: str, words: str, tmp_path) -> None:
    obj = ready()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.dermis.import_poses(filepath=written(tmp_path, text))
    assert obj.animation_data is None


def test_what_hangs_on_something_is_not_keyed(tmp_path) -> None:
    obj = ready()
    obj.parent = cube()
    with pytest.raises(RuntimeError, match="without a parent"):
        bpy.ops.dermis.import_poses(filepath=written(tmp_path, "x,y,z\n0,0,0\n1,1,1\n"))


def test_what_was_refused_is_listed_no_more_once_it_goes(tmp_path) -> None:
    ready()
    with pytest.raises(RuntimeError):
        bpy.ops.dermis.import_poses(filepath=written(tmp_path, "1,2\n"))
    assert reporting.findings()
    bpy.ops.dermis.import_poses(filepath=written(tmp_path, "t,x,y,z\n0,0,0,0\n1,0,0,1\n"))
    assert not reporting.findings()
