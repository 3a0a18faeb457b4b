"""What the native sender asks of a device, and what it says of an old one."""

from __future__ import annotations

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.errors import DermisError
from core.presets import Library
from core.stream.protocols import adapters, packets
from core.stream.protocols.adapter import Adapter
from core.stream.protocols.native import Native
from core.stream.protocols.packets import Kind, Reach
from core.stream.protocols.wire import Wire
from core.stream.virtual.native import NativeDevice
from tests.unit.stream.stream_lab import Lab

HAPTIP = Wire.of(Library().device("haptip"))


def configured(made: Adapter, device: NativeDevice) -> Reach:
    """Let an adapter and a device talk until it is armed; return how the device gets to its safe state."""
    made.opened(0.0)
    now = 0.0
    for k in range(400):
        now = k * 1e-3
        if k == 100:
            made.arm()
        for message in made.poll(now):
            for answer in device.feed(message, now):
                made.receive(answer, now)
        device.tick(now)
    assert made.armed
    return device._reach


@pytest.mark.parametrize(("given", "reach"), [("", Reach.RAMP), ("ramp", Reach.RAMP), ("release", Reach.RELEASE)])
def test_the_url_may_ask_for_servos_that_let_go(given: str, reach: Reach) -> None:
    made = adapters.make("native", HAPTIP, {"reach": given} if given else {})
    assert configured(made, NativeDevice(HAPTIP)) == reach


def test_a_screen_stays_at_once() -> None:
    screen = Wire.of(Library().device("electrovibration"))
    assert configured(adapters.make("native", screen, {}), NativeDevice(screen)) == Reach.AT_ONCE
    for given in ("release", "ramp"):
        with pytest.raises(DermisError, match="at once, and no option delays that"):
            adapters.make("native", screen, {"reach": given})


@pytest.mark.parametrize("version", packets.READS)
def test_an_old_firmware_is_named_and_goes_on(version: int, monkeypatch: pytest.MonkeyPatch) -> None:
    welcome = packets.Welcome

    def of_version(_: int, *given: object) -> packets.Welcome:
        return welcome(version, *given)  # type: ignore[arg-type]

    monkeypatch.setattr("core.stream.virtual.native.Welcome", of_version)
    lab = Lab(mode="jog", jog={"pulley_1": 0.2}, ramp=0.0)
    lab.run(0.2)
    notice = lab.streamer.status()["notice"]
    assert ("uses version 1 of the protocol. Update it" in notice) is (version == 1)
    assert (notice == "") is (version == 2)
    lab.arm()
    lab.run(0.3)
    assert lab.at[0] == pytest.approx(0.2, abs=1e-4)


def test_questions_are_asked_more_often_while_answers_stay_away() -> None:
    made = adapters.make("native", HAPTIP, {})
    device = NativeDevice(HAPTIP)
    configured(made, device)
    assert isinstance(made, Native)
    asked = []
    for k in range(400, 460):
        now = k * 1e-3
        asked += [now for m in made.poll(now) for p in packets.Decoder().feed(m) if p.kind == Kind.SYNC]
    late = [at for at in asked if at > 0.42]
    assert np.diff(late).max() <= 0.0061, "every 5 ms from the first answer that is missing"


FAR = {f"motor_{k}": 2.7 for k in (1, 2, 3)}


def moved_away() -> Lab:
    """Give a cable platform that was armed at rest and has moved far since."""
    lab = Lab("native", "cable_platform", mode="jog", ramp=1.0)
    lab.run(0.5)
    lab.arm()
    lab.run(1.5)
    lab.set(jog=FAR)
    lab.run(1.0)
    assert lab.at[0] == pytest.approx(2.7, abs=1e-3)
    return lab


def test_to_arm_what_is_armed_moves_nothing() -> None:
    """It went back at full speed to where it had been armed, and came again."""
    lab, path = moved_away(), []
    lab.arm()
    lab.run(0.3, lambda: path.append(lab.at))
    assert np.ptp(np.array(path), axis=0).max() < 1e-3 and lab.streamer.armed


def test_a_calibration_under_way_says_that_the_device_knows_the_safe_pose_of_before() -> None:
    """What is safe is configured before arming, and nobody changes it under way."""
    lab = moved_away()
    made = Calibration.of(Library().device("cable_platform")).with_entry("motor_1", zero=0.3)
    lab.set(calibration=made.dumps())
    lab.run(0.5)
    assert lab.streamer.armed and "safe pose is that of the calibration before" in lab.streamer.message
    lab.stops += 1
    lab.run(0.5)
    lab.arm()
    lab.run(0.5)
    assert lab.streamer.armed and not lab.streamer.message
    lab.stops += 1
    lab.run(0.5)
    assert lab.streamer.output.wire is not None and np.allclose(lab.at, lab.streamer.output.wire.safe, atol=1e-3)


@pytest.mark.parametrize("lost", [0, 3])
def test_what_is_armed_on_its_way_to_safety_goes_on_from_where_it_is(lost: int) -> None:
    """Not from where it was when it was asked first, nor, where that answer is lost, from an earlier arming's pose."""
    lab, path = moved_away(), []
    feed, answers = lab.device.feed, []

    def deaf(data: bytes, now: float) -> list[bytes]:
        out = []
        for message in feed(data, now):
            welcome = any(p.kind == Kind.WELCOME for p in packets.Decoder().feed(message))
            if welcome:
                answers.append(now)
            if not welcome or len(answers) > lost:
                out.append(message)
        return out

    lab.device.feed = deaf
    lab.stops += 1
    lab.run(0.1)
    lab.arm()
    lab.run(0.25, lambda: path.append(lab.at[0]))
    turn = int(np.argmin(path))
    assert lab.streamer.armed and len(answers) > lost
    assert path[turn] > 0.9, "the ramp home was taken over"
    assert np.diff(path[turn : turn + 40]).max() < 5e-3, "gently, as every first pose is left"
