"""Pin geometry against closed forms on a flat skin and a cylinder; conservation of force."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.devices import pin_array
from core.devices.spec import from_preset
from core.errors import DermisError


def mm(value):
    return {"value": value, "unit": "mm"}


def preset(channels=None, **changes):
    parameters = {
        "rows": 4,
        "columns": 3,
        "pitch": mm(1.5),
        "pin_radius": mm(0.5),
        "cylinder_radius": mm(10),
        "standoff": mm(2),
        "mount_pitch": {"value": 0, "unit": "deg"},
        "stroke": mm(5),
        "force_limit": {"value": 0.4, "unit": "N"},
        "spread": mm(0.8),
        "delay": {"value": 75, "unit": "ms"},
    }
    parameters.update(changes)
    count = parameters["rows"] * parameters["columns"]
    channels = channels or [{"name": f"pin_{i:03}", "unit": "N"} for i in range(max(math.ceil(count), 1))]
    return from_preset(
        "pins",
        {
            "schema": "dermis-device 1",
            "name": "Pins",
            "kind": "pin_array",
            "rate": {"value": 240, "unit": "Hz"},
            "channels": channels,
            "parameters": parameters,
        },
    )


def plate(z=0.0, half=0.02):
    """A square seen from below: outward normal -Z, like the pad."""
    vertices = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])
    return vertices, np.array([[0, 2, 1], [0, 3, 2]])


def test_a_pin_presses_no_harder_than_its_channel_and_the_parameter_allow():
    newtons = [None, 0.1, 0.4, 0.9]
    channels = [
        {"name": f"pin_{i}", "unit": "N"} | ({} if n is None else {"high": {"value": n, "unit": "N"}})
        for i, n in enumerate(newtons)
    ]
    assert pin_array.layout(preset(channels, rows=4, columns=1)).force_limit.tolist() == [0.4, 0.1, 0.4, 0.4]
    with pytest.raises(DermisError, match="differ in number"):
        pin_array.layout(preset(channels, rows=3, columns=1))
    channels[1]["high"]["value"] = 0
    with pytest.raises(DermisError, match="the force limit of a pin"):
        pin_array.layout(preset(channels, rows=4, columns=1))


def test_pins_point_at_the_axis_and_stand_a_pitch_apart():
    pins = pin_array.layout(preset())
    axis_height = 0.010 - 0.002
    to_axis = np.column_stack([-pins.tips[:, 0], np.zeros(pins.count), axis_height - pins.tips[:, 2]])
    np.testing.assert_allclose(pins.directions, to_axis / 0.010, atol=1e-15)
    along = pins.tips.reshape(4, 3, 3)
    np.testing.assert_allclose(np.diff(along[:, 0, 1]), 1.5e-3)
    chord = 2 * 0.010 * np.sin(1.5e-3 / 0.010 / 2)
    np.testing.assert_allclose(np.linalg.norm(np.diff(along[0], axis=0), axis=1), chord)


def test_points_of_action_on_a_plate_are_line_plane_intersections():
    pins = pin_array.layout(preset())
    met = pin_array.contacts(pins, *plate(z=-0.001))
    expected = (-0.001 - pins.tips[:, 2]) / pins.directions[:, 2]
    np.testing.assert_allclose(met.travel, expected, atol=1e-15)
    np.testing.assert_allclose(met.points, pins.tips + expected[:, None] * pins.directions, atol=1e-15)
    assert met.hits.all() and not met.findings


def test_a_pitched_mount_turns_everything_about_x():
    level, turned = pin_array.layout(preset()), pin_array.layout(preset(mount_pitch={"value": 15, "unit": "deg"}))
    c, s = np.cos(np.radians(15)), np.sin(np.radians(15))
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    np.testing.assert_allclose(turned.tips, level.tips @ turn.T, atol=1e-16)
    # tilted pins push along one side of Y only: they cannot pull towards the other
    assert (turned.directions[:, 1] < 0).all()


def test_every_pins_force_is_conserved():
    rng = np.random.default_rng(2)
    nodes = np.column_stack([rng.uniform(-0.004, 0.004, (300, 2)), np.zeros(300)])
    pins = pin_array.layout(preset())
    a = pin_array.distribution(pins, pin_array.contacts(pins, *plate()), nodes)
    np.testing.assert_allclose(a.reshape(300, 3, pins.count).sum(axis=0).T, pins.directions, atol=1e-14)


def test_weights_follow_the_gaussian():
    pins = pin_array.layout(preset(rows=1, columns=1))
    nodes = np.array([[0.0, 0.0, 0.0], [0.8e-3, 0.0, 0.0]])
    a = pin_array.distribution(pins, pin_array.contacts(pins, *plate()), nodes)
    share = a.reshape(2, 3, 1)[:, 2, 0]
    assert share[1] / share[0] == pytest.approx(np.exp(-0.5), rel=1e-12)


def test_a_far_node_still_gets_all_the_force():
    pins = pin_array.layout(preset(rows=1, columns=1))
    a = pin_array.distribution(pins, pin_array.contacts(pins, *plate()), np.array([[0.005, 0.0, 0.0]]))
    np.testing.assert_allclose(a[:, 0], [0, 0, 1])


def test_pins_off_the_skin_are_reported_and_carry_nothing():
    pins = pin_array.layout(preset())
    met = pin_array.contacts(pins, *plate(half=0.0016))
    assert (~met.hits).sum() == met.findings[0].count > 0
    a = pin_array.distribution(pins, met, np.zeros((1, 3)))
    assert not a[:, ~met.hits].any() and a[:, met.hits].any()


def test_a_stroke_too_short_is_a_finding():
    met = pin_array.contacts(pin_array.layout(preset(stroke=mm(1))), *plate(z=0.001))
    assert [f.code for f in met.findings] == ["pin-stroke"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rows": 0}, "rows"),
        ({"columns": 2.5}, "columns"),
        ({"pitch": mm(0)}, "pitch"),
        ({"pitch": mm(0.9)}, "overlap"),
        ({"force_limit": {"value": 0, "unit": "N"}}, "force_limit"),
        ({"spread": mm(-0.8)}, "spread"),
        ({"columns": 40}, "wrap"),
        ({"delay": {"value": -1, "unit": "ms"}}, "delay"),
    ],
)
def test_bad_layouts_are_refused(changes, words):
    with pytest.raises(DermisError, match=words):
        pin_array.layout(preset(**changes))


def test_a_layout_off_the_finger_is_refused():
    vertices, triangles = plate()
    with pytest.raises(DermisError, match="no pin"):
        pin_array.contacts(pin_array.layout(preset()), vertices + [0.1, 0, 0], triangles)
