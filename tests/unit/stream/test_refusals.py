"""Settings and calibrations that cannot be: refused in words that name what, value and limit, and never armed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.command_line.verbs import parser as command_line
from core.devices.calibration import Calibration
from core.errors import DermisError
from core.presets import Library
from core.stream.client import SenderClient
from core.stream.links.url import Url
from core.stream.protocols import adapters
from core.stream.protocols.wire import Wire
from core.stream.request import StreamRequest, request_of
from core.stream.virtual.device import options_of
from tests.unit.stream.stream_lab import Lab

HAPTIP = Library().device("haptip")

# -- a calibration and the safe state


@pytest.mark.parametrize(("limits", "told"), [({"low": 0.1}, "0.1 to"), ({"high": -0.05}, "to -0.05")])
def test_limits_that_leave_the_safe_state_outside_are_refused(limits: dict[str, float], told: str) -> None:
    made = Calibration.of(HAPTIP).with_entry("pulley_2", **limits)
    with pytest.raises(DermisError, match="safe state lies outside the calibrated limits") as error:
        Wire.of(HAPTIP, made)
    assert "pulley_2" in str(error.value) and told in str(error.value) and error.value.value == "0"
    lab = Lab(mode="jog", calibration=made.dumps())
    lab.streamer.tick(lab.now)
    assert lab.streamer.state == "fault" and "pulley_2" in lab.streamer.message and lab.streamer.connection is None


def test_limits_that_end_at_the_safe_state_are_taken() -> None:
    wire = Wire.of(HAPTIP, Calibration.of(HAPTIP).with_entry("pulley_1", low=0.0))
    assert wire.safe.tolist() == [0.0, 0.0] and wire.lower_limit[0] == 0.0


@pytest.mark.parametrize("protocol", ["native", "maestro"])
def test_zero_and_gain_move_the_safe_pose_of_a_worn_device(protocol: str) -> None:
    made = Calibration.of(HAPTIP).with_entry("pulley_1", zero=0.2, gain=-1.0)
    lab = Lab(protocol, mode="jog", jog={"pulley_1": -0.1}, ramp=0.0, calibration=made.dumps())
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    assert lab.at[0] == pytest.approx(0.3, abs=1e-3)
    lab.stops += 1
    lab.run(0.1)
    assert np.abs(lab.at - [0.2, 0.0]).max() < 1e-3, "where the preset's 0 is on this device"


@pytest.mark.parametrize(("protocol", "there"), [("maestro", 0.2), ("native", 0.0)])
def test_a_calibration_under_way_moves_it_where_the_sender_drives_and_elsewhere_from_the_next_arming(
    protocol: str, there: float
) -> None:
    """Nobody changes under way what a board takes for safe."""
    lab = Lab(protocol, mode="jog", jog={"pulley_1": 0.1}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    lab.set(calibration=Calibration.of(HAPTIP).with_entry("pulley_1", zero=0.2).dumps())
    lab.run(0.4)
    assert lab.at[0] == pytest.approx(0.3, abs=1e-3)
    for where in (there, 0.2):
        lab.stops += 1
        lab.run(0.1)
        assert lab.at[0] == pytest.approx(where, abs=1e-3)
        lab.arm()
        lab.run(0.4)


@pytest.mark.parametrize("protocol", ["native", "maestro"])
def test_such_limits_under_way_end_in_the_safe_state(protocol: str) -> None:
    lab = Lab(protocol, mode="jog", jog={"pulley_1": 0.3}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    assert lab.at[0] == pytest.approx(0.3, abs=1e-3)
    device = lab.device
    lab.set(calibration=Calibration.of(HAPTIP).with_entry("pulley_1", low=0.2).dumps())
    lab.run(0.1)
    assert np.abs(list(device.report()["values"].values())).max() < 1e-3
    assert lab.streamer.state == "fault" and "calibrated limits" in lab.streamer.message and not lab.streamer.armed


# -- numbers


BAD = [
    ("ramp", math.nan),
    ("ramp", math.inf),
    ("ramp", -1.0),
    ("ramp", "1"),
    ("ramp", True),
    ("look_ahead", math.nan),
    ("look_ahead", -0.5),
    ("stall", 0.0),
    ("stall", math.inf),
    ("stall", math.nan),
    ("rate", -1.0),
    ("rate", math.nan),
    ("offset", math.nan),
    ("offset", -math.inf),
]


@pytest.mark.parametrize(("name", "value"), BAD)
def test_a_request_names_what_cannot_be(name: str, value: Any) -> None:
    with pytest.raises(DermisError) as error:
        StreamRequest(**{name: value}).check()
    said = error.value
    assert said.where.startswith("stream") and name in said.what + said.where
    assert " to " in said.limit or said.limit.startswith("one number in ")
    assert said.value is value or said.value.startswith(f"{value:g} ")


def test_a_request_as_it_comes_is_allowed_and_so_are_the_limits() -> None:
    StreamRequest().check()
    StreamRequest(ramp=0.0, look_ahead=1.0, stall=0.1, rate=1000, offset=-2.5, jog={"a": 0.1}).check()
    with pytest.raises(DermisError, match="jog, a"):
        StreamRequest(jog={"a": math.nan}).check()


@pytest.mark.parametrize(
    ("name", "value"), [("arm_id", "1"), ("arm_id", 1.5), ("connect", 1), ("jog", []), ("ramp", None)]
)
def test_a_field_of_another_kind_is_refused(name: str, value: Any) -> None:
    with pytest.raises(DermisError, match="has the wrong type") as error:
        request_of({name: value})
    assert error.value.where == name
    assert request_of({"ramp": 2, "arm_id": 3}) == StreamRequest(ramp=2, arm_id=3)


def test_a_setting_that_cannot_be_ends_a_stream_safely() -> None:
    lab = Lab(mode="jog", jog={"pulley_1": 0.3}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    device = lab.device
    lab.set(stall=math.nan, arm_id=lab.request.arm_id + 1)
    lab.run(0.1)
    assert np.abs(list(device.report()["values"].values())).max() < 1e-3
    assert lab.streamer.state == "fault" and "stall" in lab.streamer.message
    lab.set(stall=0.5, reconnect=True, connect=False)
    lab.set(connect=True)
    lab.run(0.5)
    assert lab.streamer.state == "ready" and not lab.streamer.armed, "an arming that was refused arms nothing later"


def test_the_client_refuses_before_the_sender_sees_it() -> None:
    with SenderClient() as client:
        with pytest.raises(DermisError, match="ramp"):
            client.set(ramp=math.nan)
        with pytest.raises(DermisError, match="unknown fields"):
            client.set(rump=1.0)
        client.set(ramp=1.0)
        assert client.alive


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--ramp", "nan"),
        ("--ramp", "inf"),
        ("--ramp", "-1"),
        ("--look-ahead", "nan"),
        ("--look-ahead", "-0.5"),
        ("--ramp", "soon"),
    ],
)
def test_the_command_line_names_what_cannot_be(option: str, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = command_line("core")
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["stream", "play", "t.csv", "--url", "virtual:", f"{option}={value}"])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and option in said and value in said
    assert "is no number" in said or "0 to " in said
    fine = parser.parse_args(["stream", "play", "t.csv", "--url", "virtual:", f"{option}=0.25"])
    assert getattr(fine, option[2:].replace("-", "_")) == 0.25 and fine.track == Path("t.csv")


def test_options_and_faults_are_finite_numbers() -> None:
    for value in ("nan", "inf", "x"):
        with pytest.raises(DermisError, match="not a whole number"):
            adapters.make("native", Wire.of(HAPTIP), {"watchdog_ms": value})
        with pytest.raises(DermisError, match="no number"):
            options_of(Url(f"virtual:?stuck={value}"))
