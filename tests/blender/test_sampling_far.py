"""Far from the origin poses come in steps of single precision, and that is told with distance, step and remedy."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon.sampling import scene_sweep, single_precision

from . import build

KILOMETRE_STEP = 2.0**-14  # [m] between 512 m and 1024 m, in single precision


def swept(scene: bpy.types.Scene) -> tuple[dict[str, Any], list[Any]]:
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    return got, [f for f in (*tactile.findings, *tactile.chunks.findings) if f.code == "far-from-origin"]


def sliding(x: float, unit: float = 1.0) -> bpy.types.Object:
    """Add a finger that slides by 1 mm from `x` [m], and a cube that stands still at it."""
    scene = build.span(1, 25)
    scene.unit_settings.scale_length = unit
    build.cube(location=(x / unit, 0.0, 0.0))
    finger = build.finger()
    build.keys(finger, "location", [1, 25], [(x / unit, 0, 0), ((x + 1e-3) / unit, 0, 0)])
    return finger


@pytest.mark.parametrize("unit", [1.0, 0.001, 0.3048])
def test_a_finger_at_a_kilometre_moves_in_steps_and_that_is_told(unit: float) -> None:
    sliding(1000.0, unit)
    got, (told,) = swept(bpy.context.scene)
    x = got["fingers"][0, :, 0, 3]
    jumps = np.unique(np.abs(np.diff(x)).round(9))
    assert len(x) == 241 and 3 <= len(np.unique(x)) < 40, "of 241 places most are the same"
    step = np.spacing(np.float32(1000.0 / unit)) * unit
    assert jumps[jumps > 0].min() == pytest.approx(step, rel=1e-3)
    assert (told.severity, told.where, told.count) == ("warning", "finger 'Finger'", 1)
    assert told.value == f"steps of {1e3 * step:.2g} mm at 1000 m"
    assert told.limit == "0.0021 mm" and "within 10 m" in told.remedy


def test_moved_near_the_origin_with_its_keys_nothing_comes_in_steps() -> None:
    sliding(0.5)
    got, told = swept(bpy.context.scene)
    assert not told and len(np.unique(got["fingers"][0, :, 0, 3])) > 200


def test_a_parent_that_brings_it_back_does_not_help_and_is_no_way_out_of_the_finding() -> None:
    finger = sliding(1000.0)
    finger.parent = build.empty("Back", (-1000.0, 0.0, 0.0))
    got, (told,) = swept(bpy.context.scene)
    assert np.abs(got["fingers"][0, :, 0, 3]).max() < 0.01 and len(np.unique(got["fingers"][0, :, 0, 3])) < 40
    assert told.value == "steps of 0.061 mm at 1000 m"


def test_what_stands_still_is_where_blender_shows_it() -> None:
    finger = sliding(1000.0)
    finger.animation_data_clear()
    assert not swept(bpy.context.scene)[1]


def test_a_body_that_turns_about_a_far_origin_moves_in_steps_where_the_finger_is() -> None:
    scene = build.span(1, 25)
    finger = build.finger(location=(1000.5, 0.0, 0.0))
    vertices = np.array(build.CUBE) + (1000.0, 0.0, 0.0)
    body = build.mesh_object("Far", vertices, build.CUBE_FACES)
    body.dermis.role = "TOUCHABLE"
    build.keys(body, "rotation_euler", [1, 25], [(0, 0, 0), (0, 0, 1e-6)])
    _, (told,) = swept(scene)
    assert told.where == "object 'Far'" and told.value == "steps of 0.061 mm at 1000 m"
    finger.location = (0.25, 0.0, 0.0)  # near the axis the same turn goes in small steps
    assert not swept(scene)[1]


def test_how_far_is_too_far_depends_on_the_rate() -> None:
    """Places that are off by half a step each change the velocity by up to 2 steps times the rate."""
    sliding(20.0)
    scene = bpy.context.scene
    assert not swept(scene)[1]
    scene.dermis.sample_rate = 1000.0
    (told,) = swept(scene)[1]
    assert told.value == "steps of 0.0019 mm at 20 m" and told.limit == "0.0005 mm"
    assert single_precision.limit(1.0) == pytest.approx(1e-5), "at a low rate, what surfaces are followed to"


def test_several_count_in_one_finding_of_the_farthest() -> None:
    sliding(1000.0)
    ball = build.cube("Ball", location=(0.0, 4000.0, 0.0))
    build.keys(ball, "location", [1, 25], [(0.0, 4000.0, 0.0), (0.0, 4001.0, 0.0)])
    (told,) = swept(bpy.context.scene)[1]
    assert (told.where, told.count) == ("object 'Ball'", 2)
