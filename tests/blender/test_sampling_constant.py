"""What can be keyed is a channel that the engine reads; the rest cannot be keyed, and old keys of it are told."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon import baking, compat
from blender_addon.preview import device_preview
from blender_addon.properties import object_properties
from blender_addon.sampling import scene_sweep
from core.presets import Library
from core.steps import drain

from .build import cube, finger, keys, screen, span

DEVICE = "finger.devices[0]."
CONSTANT = {
    object_properties.DermisDevice: ("auto_range", "direction_window"),
    object_properties.DermisFinger: ("pattern_repeat",),
    object_properties.DermisMaterial: ("content_length_mm", "content_size_mm", "content_damping", "kink_time"),
    object_properties.DermisScreen: ("height_mm", "invert"),
}
KEYED = {
    object_properties.DermisDevice: {
        "use_transient",
        "use_texture",
        "use_weight",
        "use_content",
        "use_pattern",
        "scale",
        "carrier",
        "threshold",
    },
    object_properties.DermisFinger: {
        "touch_distance_mm",
        "pattern_play",
        "pattern_angle",
        "pattern_frequency",
        "pattern_amplitude",
    },
    object_properties.DermisMaterial: {
        "friction",
        "surface_stiffness_mpa_m",
        "transient_on",
        "transient_amplitude",
        "transient_decay",
        "transient_frequency",
        "texture_on",
        "texture_amplitude_x",
        "texture_amplitude_y",
        "texture_period_x_mm",
        "texture_period_y_mm",
        "texture_speed_threshold_mm_s",
        "weight_on",
        "weight_acceleration",
        "weight_gravity",
        "content_on",
        "mass",
        "content_amplitude",
        "held",
    },
    object_properties.DermisScreen: {"touch_distance_mm"},
}


@pytest.fixture(autouse=True)
def no_trail():
    """Start without a trail."""
    device_preview.reset()


def bake() -> tuple[list[np.ndarray], list]:
    made = drain(baking.bake(bpy.context.scene, Library(None)))
    return [o.track.values for o in made.outputs], list(made.all_findings)


def test_only_what_the_engine_reads_over_time_can_be_keyed() -> None:
    for group, names in KEYED.items():
        known = group.bl_rna.properties
        assert {n for n in group.__annotations__ if known[n].is_animatable and known[n].type != "POINTER"} - {
            "devices"
        } == names
        assert not any(known[n].is_animatable for n in CONSTANT[group])


def test_keys_that_an_older_file_has_for_a_constant_are_told_and_do_nothing() -> None:
    scene = span(1, 25)
    thing, pane, tip = cube(), screen(), finger()
    tip.dermis.finger.devices.add().preset = "haptip"
    compat.set_keys(thing, "dermis.material.content_length_mm", 0, [1, 25], [30.0, 200.0])
    compat.set_keys(thing, "dermis.material.kink_time", 0, [1, 25], [0.1, 0.2])
    compat.set_keys(thing, "dermis.material.friction", 0, [1, 25], [0.0, 1.0])
    compat.set_keys(thing, "dermis.material.mass", 0, [1, 25], [0.0, 0.4])
    compat.set_keys(pane, "dermis.screen.invert", 0, [1, 25], [0, 1])
    compat.set_keys(tip, f"dermis.{DEVICE}auto_range", 0, [1, 25], [0, 1])
    compat.set_keys(tip, "dermis.finger.devices[7].auto_range", 0, [1, 25], [0, 1])  # of a device that is no more
    tactile = scene_sweep.sample(scene)
    told = [(f.severity, f.where, f.value) for f in tactile.findings if f.code == "keyed-constant"]
    assert sorted(told) == [
        ("warning", "object 'Cube'", "Length"),
        ("warning", "object 'Cube'", "Rounding"),
        ("warning", "object 'Finger'", "Auto Range"),
        ("warning", "object 'Screen'", "Depth Map"),
    ]
    chunks = list(tactile.chunks)
    assert all(set(c.animated) == {"body/0/friction", "body/0/mass"} for c in chunks)
    assert chunks[0].animated["body/0/mass"][0] == 0.0
    assert chunks[-1].animated["body/0/mass"][-1] == pytest.approx(0.4)
    assert tactile.bodies[0].parameters["content_length"] == pytest.approx(0.03)


@pytest.mark.parametrize("on", [0, 1])
def test_a_keyed_pattern_switch_counts_in_the_bake_and_live_alike(on: int) -> None:
    """Orientation, [S3] eq. 7, along +Y: 2 mm sin(2 pi 2 t) from the first sample on, or nothing."""
    scene = span(1, 27, fps=25)  # 40 ms a frame: the device's milliseconds fall on frames
    scene.dermis.sample_rate = 25.0
    tip = finger()
    tip.dermis.finger.devices.add().preset = "haptip"
    settings = tip.dermis.finger
    settings.pattern, settings.pattern_play, settings.pattern_repeat = "orientation", True, True
    keys(tip, f"dermis.{DEVICE}use_pattern", [1, 25], [on, on], "CONSTANT")
    for frame in range(1, 8):
        scene.frame_set(frame)
        row = device_preview.step(bpy.context).rows[0]
    # the trail starts a frame before the first
    assert row.values["tactor_y"] == pytest.approx(on * 2e-3 * np.sin(4 * np.pi * 7 * 0.04), abs=1e-9)
    (values,), _ = bake()
    times = np.arange(len(values)) / 1000.0
    assert values[:, 1] == pytest.approx(on * 2e-3 * np.sin(4 * np.pi * times), abs=1e-9)


def test_the_pattern_switch_keyed_off_in_the_middle() -> None:
    span(1, 27, fps=25)
    tip = finger()
    tip.dermis.finger.devices.add().preset = "haptip"
    settings = tip.dermis.finger
    settings.pattern, settings.pattern_play, settings.pattern_repeat = "orientation", True, True
    keys(tip, f"dermis.{DEVICE}use_pattern", [1, 14], [1, 0], "CONSTANT")  # off from 0.52 s on
    (values,), _ = bake()
    times = np.arange(len(values)) / 1000.0
    on, off = times < 0.51, times > 0.56
    assert values[on, 1] == pytest.approx(2e-3 * np.sin(4 * np.pi * times[on]), abs=1e-9)
    assert not values[off].any()


def test_live_uses_the_value_now_of_what_is_no_channel() -> None:
    scene = span(1, 10)
    thing, tip = cube(), finger()
    tip.dermis.finger.devices.add().preset = "haptip"
    compat.set_keys(thing, "dermis.material.content_length_mm", 0, [1, 10], [30.0, 200.0])
    compat.set_keys(thing, "dermis.material.friction", 0, [1, 10], [0.125, 0.125])
    thing.dermis.material.content_length_mm = 70.0
    scene.frame_set(4)
    now = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get())
    assert now.bodies[0].parameters["content_length"] == pytest.approx(0.07)
    assert now.chunks[0].animated["body/0/friction"] == pytest.approx([0.125])


def test_a_touch_gap_keyed_to_grow_counts() -> None:
    span(1, 25)
    cube(size=0.2)
    tip = finger(location=(0.0, 0.0, 0.2))  # 100 mm above the cube's top
    tip.dermis.finger.devices.add().preset = "haptip"
    keys(tip, "dermis.finger.touch_distance_mm", [1, 13], [0.5, 150.0], "CONSTANT")
    (output,) = drain(baking.bake(bpy.context.scene, Library(None))).outputs
    contact = output.signals["contact"]
    assert contact[504:].all() and not contact[:495].any()  # from frame 13, at 0.5 s, within a sample
