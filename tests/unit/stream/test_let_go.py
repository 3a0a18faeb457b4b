"""Who has let go is where nobody knows: arming then starts like the first time, with the finger out."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from core.presets import Library
from tests.unit.stream.stream_lab import Lab

FAR = {f"motor_{k}": 1.5 for k in (1, 2, 3)}


def through(protocol: str, reach: str, silence: str = "") -> Lab:
    """Arm a cable platform with this way to its safe state, drive it, stop it, and wait until it is there."""
    preset: Any = copy.deepcopy(Library().load("devices", "cable_platform"))
    preset["safe"]["reach"] = reach
    url = f"lab?silence={silence}" if silence else "lab"
    lab = Lab(protocol, "cable_platform", mode="jog", jog=FAR, ramp=0.0, url=url)
    lab.set(device={"key": "cable_platform", "preset": preset})
    lab.run(0.1)
    if protocol == "native":
        lab.device.pose_known = False  # servos, which cannot be asked
        lab.streamer.connection.adapter.pose = None  # type: ignore[union-attr]
    lab.arm()
    lab.run(0.6)
    assert lab.streamer.armed and lab.streamer.status()["pose_known"]
    lab.stops += 1
    lab.run(0.6)
    return lab


@pytest.mark.parametrize(("protocol", "silence"), [("native", ""), ("maestro", "keeps"), ("osc", "retracts")])
@pytest.mark.parametrize("reach", ["ramp", "release"])
def test_the_pose_is_forgotten_with_the_pulses(protocol: str, silence: str, reach: str) -> None:
    lab = through(protocol, reach, silence)
    assert lab.streamer.status()["pose_known"] is (reach == "ramp")


@pytest.mark.parametrize("protocol", ["maestro", "servo-animation", "osc"])
@pytest.mark.parametrize(
    ("silence", "known"), [("", False), ("unknown", False), ("lets-go", False), ("keeps", True), ("stops", True)]
)
def test_a_board_holds_its_pose_in_silence_only_where_that_is_declared(
    protocol: str, silence: str, known: bool
) -> None:
    """The sketch, built for Servo Animation, ends its pulses half a second after the last command."""
    assert through(protocol, "ramp", silence).streamer.status()["pose_known"] is known


def test_a_device_with_a_relay_forgets_its_pose_when_it_is_there() -> None:
    """The sender is not told by its own configuration: it has to ask."""
    lab = through("native", "ramp")
    assert lab.streamer.status()["pose_known"] is True
    lab.device.pose_known = False  # the relay has opened
    lab.run(0.15)
    assert lab.streamer.status()["pose_known"] is False
