"""One scene with all that once went wrong in silence: its tracks are those of a script that asks Blender alone.

Instances on points joined with their host, stretched time, a renamed finger, recorded poses whose header says what the
columns are, a height map with 'no data', and a script that lifts a mesh from a late frame on.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector
from mathutils.bvhtree import BVHTree

from blender_addon import baking
from blender_addon.preview import device_preview
from core.presets import Library
from core.steps import drain

from . import build
from .test_sampling_instances import info_geometry, on_points

FPS, LAST, LATE = 24, 97, 40
SECONDS = (LAST - 1) / FPS
REACH = 0.5e-3  # [m] a finger's touch distance where nobody says another
NEAR = 2e-5  # [m] of the reach: there it is left open who is right, as poses are in single precision
SCREEN = (0.9, 0.0, 0.0)
LIFT = 0.01


def place(t: np.ndarray) -> np.ndarray:
    """Return where the finger is at times [s]: along the row of things, going up and down a millimetre."""
    x = -0.2 + 1.2 * t / SECONDS
    return np.stack([x, 0.005 * np.sin(3.0 * t), 0.5e-3 + 0.5e-3 * np.sin(2 * np.pi * 5.0 * t)], axis=1)


def turn(t: np.ndarray) -> np.ndarray:
    """Return its angles [degrees] at times [s]."""
    return np.stack([0.0 * t, 10.0 * np.sin(t), 40.0 * t / SECONDS], axis=1)


def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the height of the screen's relief [m], from 0 to 1 along its sides."""
    return 1e-3 * np.rint(20 + 12 * x + 8 * y)


@pytest.fixture
def lifting() -> Iterator[None]:
    """Run a script that puts the table 10 mm higher, where the finger passes, from frame LATE on."""
    device_preview.reset()

    def run(scene: bpy.types.Scene, _depsgraph: Any = None) -> None:
        mesh = bpy.data.meshes["Table"]
        top = 0.0 if scene.frame_current >= LATE else -LIFT
        for vertex in mesh.vertices:
            if vertex.co.z > -0.02:
                vertex.co.z = top
        mesh.update()

    run.__module__ = "somebody.elses"
    bpy.app.handlers.frame_change_post.append(run)
    yield
    bpy.app.handlers.frame_change_post.remove(run)


def scene_of_all(folder: Path) -> bpy.types.Object:
    """Make the scene and return its finger."""
    scene = build.span(1, LAST, fps=FPS)
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 200
    device_preview.reset()

    finger = build.finger("Index", (0.0, 0.0, 0.0))
    for preset in ("haptip", "electrovibration"):
        finger.dermis.finger.devices.add().preset = preset
    bpy.context.view_layer.objects.active = finger
    t = np.arange(0, LAST) / FPS
    rows = np.column_stack([1e3 * t, 1e3 * place(t), turn(t)])
    lines = ["time [ms],x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg", *(",".join(f"{v:.9f}" for v in row) for row in rows)]
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    assert bpy.ops.dermis.import_poses(filepath=str(folder / "poses.csv"), first=1) == {"FINISHED"}

    points = [(-0.15, 0.0, -0.02), (0.0, 0.0, -0.02), (0.15, 0.0, -0.02)]
    host = build.mesh_object("Host", [*points, (0.0, 0.0, -0.05)], [(0, 1, 3), (1, 2, 3)])
    host.dermis.role = "TOUCHABLE"
    cube = build.mesh_object("Cube", np.array(build.CUBE) * 0.04, build.CUBE_FACES, (0.0, 0.0, -9.0))
    on_points(host, info_geometry(cube), join=True)
    build.keys(host, "location", [1, 10, 20], [(0, 0, 0), (0, 0, 0), (0, 0, -0.002)])  # evaluated frames

    table = [(0.1 * x + 0.45, 0.1 * y, 0.04 * z - 0.04) for x, y, z in build.CUBE]
    made = build.mesh_object("Table", np.array(table) + (0, 0, 0.02 - LIFT), build.CUBE_FACES)
    made.dermis.role = "TOUCHABLE"

    screen = build.screen("Pane", 0.3, 0.2)
    screen.location = SCREEN
    x, y = np.meshgrid((np.arange(60) + 0.5) / 60, (np.arange(40) + 0.5) / 40)
    stored = np.rint(1e3 * heights(x, y)).astype(np.int16)
    stored[15:25, 20:30] = -9999
    np.save(folder / "heights.npy", stored[::-1])
    settings = screen.dermis.screen
    settings.source, settings.filepath, settings.map_unit, settings.no_data = (
        "FILE",
        str(folder / "heights.npy"),
        "mm",
        "-9999",
    )
    return finger


def shown(finger: bpy.types.Object, frame: float) -> tuple[Matrix, float]:
    """Return the finger's matrix and its distance to all that can be touched, negative inside, as Blender has them."""
    scene = bpy.context.scene
    scene.frame_set(int(frame), subframe=frame % 1)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    matrix = finger.evaluated_get(depsgraph).matrix_world.copy()
    best = np.inf
    for item in depsgraph.object_instances:
        made_by = item.parent if item.is_instance else item.object
        if made_by.original.dermis.role != "TOUCHABLE":
            continue
        mesh = item.object.data
        places = [item.matrix_world @ v.co for v in mesh.vertices]
        if mesh.polygons:
            tree = BVHTree.FromPolygons(places, [tuple(p.vertices) for p in mesh.polygons])
            point, normal, _, distance = tree.find_nearest(matrix.translation)
            inside = (matrix.translation - point).dot(normal) < 0 and len(mesh.vertices) == 8  # the triangles are open
            best = min(best, -distance if inside else distance)
    return matrix, best


def test_tracks_are_those_of_a_script_that_asks_blender_alone(tmp_path: Path, lifting: None) -> None:
    finger = scene_of_all(tmp_path)
    before = drain(baking.bake(bpy.context.scene, Library(None)))
    finger.name = "Zeigefinger"
    bake = drain(baking.bake(bpy.context.scene, Library(None)))
    tactor, voltage = bake.outputs
    for one, other in zip(before.outputs, bake.outputs, strict=True):
        np.testing.assert_array_equal(one.track.values, other.track.values)
    assert {f.where for f in bake.all_findings if "Index" in f.where} == set()
    assert "holes-filled" in {f.code for f in bake.all_findings}

    frames = np.arange(1.0, LAST + 1e-9, 0.25)
    seen = [shown(finger, frame) for frame in frames]
    seconds = (frames - 1.0) / FPS

    # the recording: whole frames have its rows
    for frame, (matrix, _) in zip(frames, seen, strict=True):
        t = np.array([(frame - 1.0) / FPS])
        if frame == round(frame):
            assert np.array(matrix.translation) == pytest.approx(place(t)[0], abs=1e-6)
            turned = Euler(np.radians(turn(t)[0]), "XYZ").to_matrix()
            assert np.array(matrix.to_3x3()) == pytest.approx(np.array(turned), abs=1e-5)

    # contact with things: instances, their host, and what the script lifts
    gap = np.array([distance for _, distance in seen])
    clear = np.abs(gap - REACH) > NEAR
    index = np.rint(1000.0 * seconds).astype(int)
    felt = tactor.signals["contact"][np.minimum(index, len(tactor.signals["contact"]) - 1)]
    edges = np.flatnonzero(np.diff((gap < REACH).astype(int)))
    clear[edges], clear[edges + 1] = False, False  # a command may fall on the other side of the moment itself
    np.testing.assert_array_equal(felt[clear] > 0.5, gap[clear] < REACH)
    x = place(seconds)[:, 0]
    for low, high in ((-0.17, -0.13), (-0.02, 0.02), (0.4, 0.5)):
        part = clear & (x > low) & (x < high)
        assert (gap[part] < REACH).any() and (gap[part] > REACH).any(), "each of them is touched and left"
    low_by_then = (x > 0.13) & (x < 0.17)
    assert (gap[low_by_then] > REACH).all(), "at its own, stretched time the host is 2 mm lower"
    assert clear.sum() > 0.6 * len(clear)

    # the screen: where the pad is on it, and the relief beneath
    local = Matrix.Translation(Vector(SCREEN)).inverted()
    on = np.array([local @ matrix.translation for matrix, _ in seen])
    sure = (np.abs(on[:, 0]) < 0.14) & (np.abs(on[:, 2] - REACH) > NEAR)
    touching = sure & (on[:, 2] < REACH)
    assert touching.sum() > 5
    signals = {name: np.interp(seconds, voltage.track.times, values) for name, values in voltage.signals.items()}
    settled = np.concatenate([[False], touching[1:-1] & touching[:-2] & touching[2:], [False]])
    assert (signals["contact"][settled] == 1.0).all()
    assert signals["x"][settled] == pytest.approx(on[settled, 0], abs=1e-6)
    assert signals["y"][settled] == pytest.approx(on[settled, 1], abs=1e-6)
    u, v = on[:, 0] / 0.3 + 0.5, on[:, 1] / 0.2 + 0.5
    hole = (u > 18 / 60) & (u < 32 / 60) & (v > 13 / 40) & (v < 27 / 40)
    read = signals["height"] + 0.02  # it counts from the lowest
    assert read[settled & ~hole] == pytest.approx(heights(u, v)[settled & ~hole], abs=1.1e-3)
    assert (settled & hole).any() and (np.abs(read[settled & hole] - heights(u, v)[settled & hole]) < 5e-3).all()
