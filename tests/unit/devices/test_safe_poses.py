"""The safe poses of the presets that ship: clear of every finger, and reached without pressing it deeper."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from core.devices import cable_platform, hexapod
from core.devices.calibration import Calibration
from core.devices.inverse_kinematics import inverse_kinematics
from core.devices.kinds import KINDS
from core.devices.poses import Poses
from core.devices.retraction import CLEAR, FITTED, THICKEST, clearance
from core.devices.spec import DeviceSpec, from_preset
from core.devices.thimble import MIN_MARGIN, mechanism
from core.errors import DermisError
from core.presets import Library
from core.shipped import BUILT_IN
from core.stream.protocols.packets import FULL, Reach
from core.stream.protocols.wire import Wire
from tests.unit.devices.safe_ways import Platforms, Thimbles, deepened, depth, each, follow, pad, shapes, together
from tests.unit.stream.stream_lab import Lab

LIBRARY = Library()
KEYS = [e.key for e in LIBRARY.list("devices") if not e.user]
WORN_KEYS = [key for key in KEYS if LIBRARY.device(key).worn]
PLATFORMS = {"thimble_3rrs": 2.07e-3, "cable_platform": 6.03e-3, "hexapod": 9.99e-3}  # [m] clear of the thickest
STARTS = {"thimble_3rrs": 394, "cable_platform": 838, "hexapod": 1499}  # poses that ways begin at, as the page says
DEEPENING = 0.05e-3  # [m] deeper than where it started: as far as a platform may press on the way
SPARED = float(np.radians(8.0))  # [rad] of a servo's range, left to calibration
DROP = 15.0e-3  # [m] below the pad: how far six legs let the platform down
PAGE = (BUILT_IN / "streaming_safety.md").read_text("utf-8")


def devices(key: str) -> Thimbles | Platforms:
    spec = LIBRARY.device(key)
    return Thimbles(spec) if spec.kind == "thimble" else Platforms(spec, 1500)


def without(key: str, *names: str) -> Any:
    """Return a preset without these fields, and without speeds where 'slew' is one of them."""
    preset = LIBRARY.load("devices", key)
    for name in names:
        preset.pop(name, None)
        for channel in preset["channels"]:
            channel.pop(name, None)
    return from_preset(key, preset)


def retracted(spec: DeviceSpec) -> Any:
    """Return the safe pose of a device that ships: a value for every channel with an actuator [SI].

    A thimble's servos turn away from the finger, all alike; cables are let out; six legs stand level, DROP below the
    pad. A tactor returns to its middle, which stretches the skin least, and pins give no force.
    """
    if spec.kind == "thimble":
        return mechanism(spec).servo_limits[1] - SPARED
    if spec.kind == "cable_platform":
        return cable_platform.mechanism(spec).rest + SPARED
    if spec.kind == "hexapod":
        return hexapod.mechanism(spec).commands(Poses(np.eye(3)[None], np.array([[0.0, 0.0, -DROP]])))[0]
    return np.zeros(sum(bool(c.actuator) for c in spec.channels))


# -- the poses


def test_every_worn_preset_states_a_safe_value_for_every_actuator() -> None:
    assert len(WORN_KEYS) == 6 and {LIBRARY.device(k).kind for k in WORN_KEYS} == {
        name for name, kind in KINDS.items() if kind.worn
    }
    for key in WORN_KEYS:
        spec = LIBRARY.device(key)
        np.testing.assert_allclose(Wire.of(spec).safe, retracted(spec), atol=1e-9, err_msg=key)


def test_the_thickest_finger_is_the_thickest_that_ships() -> None:
    found = shapes()
    assert max(s.thickness for s in found.values()) == pytest.approx(THICKEST)
    assert found["index_medium"].thickness == pytest.approx(FITTED)


@pytest.mark.parametrize("key", PLATFORMS)
def test_the_safe_pose_is_clear_of_every_finger(key: str) -> None:
    spec = LIBRARY.device(key)
    safe = Wire.of(spec).safe
    assert clearance(spec, safe) >= max(CLEAR, PLATFORMS[key])
    low, high = (np.array([getattr(c, k) for c in spec.channels if c.actuator]) for k in ("low", "high"))
    spare = np.minimum(safe - low, high - safe)
    assert (spare >= (SPARED - 1e-9 if spec.channels[0].unit == "rad" else 5e-3)).all(), "room for a calibration"


def test_the_thimbles_safe_pose_is_firm_and_on_its_own_side() -> None:
    spec = LIBRARY.device("thimble_3rrs")
    device = mechanism(spec)
    x = device.forward(Wire.of(spec).safe, (0.0, 0.0, 18e-3))
    assert device.feasible(x) and inverse_kinematics(device, *x.tolist())[1] > 10 * MIN_MARGIN


# -- the way there


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("key", PLATFORMS)
def test_the_way_never_presses_deeper_and_never_gives_way(key: str) -> None:
    wire, moving = Wire.of(LIBRARY.device(key)), devices(key)
    poses = follow(moving, together, wire.safe, wire.slew)
    assert len(moving.starts) == STARTS[key] and not moving.lost.any()
    for name, shape in shapes().items():
        points = pad(shape)
        more, first = deepened(poses, points, moving.radius)
        assert more.max() <= DEEPENING, f"{name}: {1e3 * more.max():.3f} mm"
        assert first.max() > 0.3e-3, "starts that press"
        assert depth(points, poses[-1], moving.radius).max() == 0.0


def test_cables_let_out_one_by_one_do_not_press_either() -> None:
    wire, moving = Wire.of(LIBRARY.device("cable_platform")), devices("cable_platform")
    poses = follow(moving, each, wire.safe, wire.slew)
    assert not moving.lost.any()
    assert max(deepened(poses, pad(s), moving.radius)[0].max() for s in shapes().values()) <= DEEPENING


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("key", ["thimble_3rrs", "hexapod"])
def test_why_channels_must_arrive_together(key: str) -> None:
    """One by one, some platforms pass a singular pose on the way: the servos no longer say where they are."""
    wire, moving = Wire.of(LIBRARY.device(key)), devices(key)
    follow(moving, each, wire.safe, wire.slew)
    assert 0 < moving.lost.mean() < 0.1


def test_a_device_goes_to_its_safe_pose_with_all_channels_together() -> None:
    lab = Lab("native", "thimble_3rrs", mode="jog", jog={"servo_1": -0.6, "servo_2": 0.1, "servo_3": -0.2}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.5)
    start, safe, way = lab.at, Wire.of(lab.streamer.output.wire.spec).safe, []
    assert start == pytest.approx([-0.6, 0.1, -0.2], abs=1e-3)
    lab.stops += 1
    lab.run(0.15, each=lambda: way.append((lab.at - start) / (safe - start)))
    parts = np.array(way)
    assert parts[-1] == pytest.approx(1.0, abs=1e-3) and np.ptp(parts, axis=1).max() < 1e-2
    took = 1e-3 * (parts.min(axis=1) < 1 - 1e-3).sum()
    assert took == pytest.approx((safe - start).max() / np.radians(600.0), abs=4e-3)


# -- what goes over the wire


@pytest.mark.parametrize("key", [*WORN_KEYS, "pins at once"])
def test_a_worn_preset_without_a_safe_pose_is_refused_on_a_finger(key: str) -> None:
    spec = without("pin_array_128" if key == "pins at once" else key, "safe")
    with pytest.raises(DermisError, match="states no safe pose") as error:
        Wire.of(spec)
    assert spec.key in str(error.value) and "Add 'safe' to the preset: a retracted pose" in str(error.value)


def test_a_safe_pose_that_leaves_an_actuator_out_is_none() -> None:
    preset = LIBRARY.load("devices", "thimble_3rrs")
    del preset["safe"]["values"]["servo_2"]
    with pytest.raises(DermisError, match="none for servo_2"):
        Wire.of(from_preset("mine", preset))


def test_a_ramp_needs_a_speed() -> None:
    with pytest.raises(DermisError, match="states no speed for it.*servo_1, servo_2, servo_3"):
        Wire.of(without("thimble_3rrs", "slew"))


def test_a_screen_needs_none_of_it() -> None:
    wire = Wire.of(without("electrovibration", "safe"))
    assert wire.safe.tolist() == [0.0, 60.0] and wire.reach == Reach.RAMP
    assert wire.safe_slew.tolist() == [300.0, 990.0], "the whole range within a second"


def test_a_calibration_moves_a_safe_pose() -> None:
    spec = LIBRARY.device("thimble_3rrs")
    made = Calibration.of(spec).with_entry("servo_1", zero=0.1).with_entry("servo_2", zero=-0.05, gain=-1.0)
    assert Wire.of(spec, made).safe == pytest.approx(np.radians(32.0) * np.array([1, -1, 1]) + [0.1, -0.05, 0.0])
    with pytest.raises(DermisError, match="servo_3: the safe state lies outside the calibrated limits"):
        Wire.of(spec, Calibration.of(spec).with_entry("servo_3", zero=0.2))
    with pytest.raises(DermisError, match="servo_1"):
        Wire.of(spec, Calibration.of(spec).with_entry("servo_1", high=0.5))


def test_no_calibration_moves_no_voltage_and_no_force() -> None:
    for key, channel in (("electrovibration", "amplitude"), ("pin_array_128", "pin_001")):
        spec = LIBRARY.device(key)
        assert Wire.of(spec, Calibration.of(spec).with_entry(channel, zero=0.1, gain=2.0)).safe[0] == 0.0


def test_a_value_for_channels_that_are_one_entry_counts_for_each() -> None:
    preset = LIBRARY.load("devices", "pin_array_128")
    preset["safe"]["values"] = {"pin_{}": {"value": 0.1, "unit": "N"}}
    assert set(Wire.of(from_preset("pins", preset)).safe) == {0.1}


def test_how_long_the_way_takes() -> None:
    seconds = {key: Wire.of(LIBRARY.device(key)).safe_seconds for key in KEYS}
    told = {
        "thimble_3rrs": 72 / 600,
        "cable_platform": 152 / 600,
        "hexapod": 26.081089 / 50,
        "haptip": 24 / 2300,
        "pin_array_128": 0.0,
        "electrovibration": 0.0,
        "voice_coil": 0.0,
    }
    assert seconds == pytest.approx(told)
    preset = LIBRARY.load("devices", "haptip")
    preset["safe"]["reach"] = "release"
    assert Wire.of(from_preset("mine", preset)).safe_seconds == seconds["haptip"], "it may ramp before it lets go"
    del preset["channels"][2]["low"]
    assert Wire.of(from_preset("mine", preset)).safe_seconds == np.inf


def test_the_page_says_how_long_the_way_takes_and_how_clear_it_ends() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", PAGE.partition("### Safe poses")[2].partition("###")[0], re.M))
    assert set(rows) == set(KEYS)
    for key, row in rows.items():
        wire = Wire.of(LIBRARY.device(key))
        cells = [cell.strip() for cell in row.split("|")]
        told = re.fullmatch(r"([\d.]+) s", cells[-1])
        assert (told is None) == (wire.reach == Reach.AT_ONCE), key
        if told is not None:
            far = (
                np.maximum(wire.range_high - wire.safe, wire.safe - wire.range_low)
                / (wire.range_high - wire.range_low)
                * FULL
            )
            seconds = float((far / wire.slew_counts()).max()) / 1000.0  # whole counts: never faster than declared
            assert wire.safe_seconds <= seconds <= float(told[1]) < seconds + 0.01
        if key in PLATFORMS:
            assert cells[1] == f"{1e3 * clearance(wire.spec, wire.safe):.1f} mm"
    for count in STARTS.values():
        assert f"{count:,}" in PAGE


def test_counts_are_rounded_and_speeds_are_not_rounded_up() -> None:
    wire = Wire.of(LIBRARY.device("cable_platform"))
    span = wire.range_high - wire.range_low
    for part, count in ((0.0, 0), (0.4, 0), (0.6, 1), (1.4, 1), (1.6, 2), (FULL - 0.6, FULL - 1), (FULL - 0.4, FULL)):
        assert wire.counts(wire.range_low + span * part / FULL).tolist() == [count] * 3
    assert wire.slew_counts().tolist() == [245] * 3, "600 deg/s over 160 degrees are 245.8 counts a millisecond"
