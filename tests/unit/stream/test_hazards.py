"""What can move a device although nobody wants it to: commands already under way, sleep, touches that never end."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.devices.spec import Channel, DeviceSpec
from core.matching.screen_map import ScreenMap
from core.presets import Library
from core.stream.output_limiter import OutputLimiter
from core.stream.protocols import osc
from core.stream.protocols.adapter import Touch
from core.stream.protocols.wire import Wire
from core.stream.touch_panel_source import PanelSource
from core.stream.virtual.osc import OscDevice
from core.track import csv
from core.track.command_track import CommandTrack
from tests.unit.stream.stream_lab import TICK, Lab, panel_lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

# -- commands under way when somebody stops


def test_the_virtual_osc_receiver_honours_time_tags() -> None:
    """As the specification asks; what a stop has to hold against."""
    wire = Wire.of(Library().device("haptip"))
    device = OscDevice(wire)
    message = osc.message_head("/dermis/haptip/pulley_1") + struct.pack(">f", 0.25)
    device.feed(osc.bundle(round((time.time() + 0.5 + osc.NTP) * 2**32), [message]), 100.0)
    device.tick(100.4)
    assert device.latest[0] == 0.0 and len(device.waiting) == 1
    device.feed(osc.bundle(osc.IMMEDIATELY, [message[:-4] + struct.pack(">f", -0.125)]), 100.45)
    assert device.latest[0] == -0.125 and len(device.waiting) == 1, "nothing takes a bundle back"
    device.tick(100.6)
    assert device.latest[0] == 0.25 and not device.waiting


@pytest.mark.parametrize("protocol", ["osc", "native"])
def test_nothing_plays_on_after_a_stop(protocol: str, track_file: Path) -> None:
    """With the longest look-ahead: what was sent for later must not be played after the safe state."""
    lab = Lab(protocol, track=str(track_file), ramp=0.0, look_ahead=1.0)
    lab.begin(0.2)
    lab.playing = True
    lab.run(1.5)
    lab.stops += 1
    lab.run(0.03)
    assert np.abs(lab.at).max() < 1e-4
    moved: list[float] = []
    lab.run(1.5, lambda: moved.append(float(np.abs(lab.at).max())))
    assert max(moved) < 1e-4


def test_osc_makes_up_for_a_delay_by_what_it_sends(track_file: Path) -> None:
    lab = Lab("osc", track=str(track_file), ramp=0.0, look_ahead=0.1)
    lab.begin(0.2)
    lab.playing = True
    lab.run(0.5)
    errors: list[float] = []
    lab.run(1.0, lambda: errors.append(float(lab.at[0] - 0.1 * np.sin(2 * np.pi * (lab.time + 0.1)))))
    assert np.abs(errors).max() <= 2 * np.pi * 0.1 * 2e-3, "0.1 s of the track ahead, to two milliseconds"


# -- a sender that was kept from working


def smooth(part: float) -> float:
    """The blend: 3 p^2 - 2 p^3."""
    return part * part * (3 - 2 * part)


def test_a_sleep_gives_no_credit_to_blend_or_speed() -> None:
    """0.9 s of sleep in a blend of 1 s: the device goes on where it was, two milliseconds further at most."""
    wire = Wire.of(Library().device("haptip"))
    limiter = OutputLimiter(wire)
    limiter.begin(np.zeros(2), 0.0, 1.0)
    limiter.step(wire.upper_limit, 0.001)
    assert np.allclose(limiter.step(wire.upper_limit, 0.901), wire.upper_limit * smooth(0.003), rtol=1e-9)
    for k in range(997):
        out = limiter.step(wire.upper_limit, 0.902 + 0.001 * k)
    assert np.allclose(out, wire.upper_limit), "the rest of the blend takes the rest of its time"
    limiter.begin(np.zeros(2), 10.0, 0.0)
    limiter.step(np.zeros(2), 10.001)
    path = [limiter.step(wire.upper_limit, t) for t in (10.9, 10.901, 10.902)]
    assert np.allclose(path, np.outer((2, 3, 4), wire.slew) * 0.001), "two periods, then one each"


def test_late_commands_take_longer_and_go_no_farther() -> None:
    """Commands at 20 Hz where 100 Hz were planned, then at 2 Hz: each step counts as two planned periods."""
    spec = DeviceSpec("slow", "Slow", "t", 100.0, (Channel("a", "rad", -10.0, 10.0, 1.0, 0.0, "m"),))
    limiter = OutputLimiter(Wire.of(spec))
    limiter.begin(np.zeros(1), 0.0, 0.0)
    path = [float(limiter.step(np.array([10.0]), 0.05 * k)[0]) for k in range(1, 6)]
    assert np.allclose(np.diff([0.0, *path]), 0.02)
    late = [float(limiter.step(np.array([10.0]), 0.25 + 0.5 * k)[0]) for k in range(1, 4)]
    assert np.allclose(np.diff([path[-1], *late]), 0.02)


def test_commands_that_did_not_leave_do_not_count() -> None:
    """Nearly as long without room in the link as the board may hear nothing: the blend waits for it."""
    lab = Lab("servo-animation", mode="jog", jog={"pulley_1": 0.4}, ramp=1.0)
    lab.begin()
    path: list[float] = []
    lab.run(0.25, lambda: path.append(float(lab.at[0])))
    assert lab.streamer.connection is not None
    link, send = lab.streamer.connection.link, lab.streamer.connection.link.send
    link.send = lambda message: False  # type: ignore[method-assign]
    lab.run(0.095)
    assert lab.streamer.counters["dropped"] > 80
    link.send = send  # type: ignore[method-assign]
    lab.run(0.25, lambda: path.append(float(lab.at[0])))
    step = 2 * np.radians(24) / 1000
    assert np.abs(np.diff(path[1:])).max() <= 1.5 * 0.4 * 2 * TICK + step
    assert path[-1] == pytest.approx(0.2, abs=0.01), "half of the commands, half of the way"


# -- touches that never end


def uphill(panel: PanelSource, end: float) -> None:
    for k in range(11):
        panel.touched(Touch(True, -0.01 + 0.001 * k, 0.0), end - 0.1 + 0.01 * k)


def test_a_touch_that_is_not_repeated_grows_old(screen: ScreenMap) -> None:
    panel = PanelSource(Wire.of(Library().device("electrovibration")), screen)
    uphill(panel, 10.0)
    assert panel.values_at(10.199, 10.199)[0] > 100
    assert panel.values_at(10.201, 10.201)[0] == 0.0 and panel.aged == 1
    assert panel.values_at(70.0, 70.0)[0] == 0.0 and panel.aged == 1, "counted once"
    uphill(panel, 80.0)
    last = Touch(True, 0.001, 0.0)
    panel.touched(last, 80.01)
    panel.touched(last, 140.0)
    assert panel.values_at(140.0, 140.0)[0] == 0.0 and panel.aged == 2
    panel.touched(Touch(True, 0.002, 0.0, at=200.0), 200.3)
    assert panel.values_at(200.3, 200.3)[0] == 0.0, "heard long before the sender looked"


def test_a_lost_word_of_the_end_leaves_no_voltage(screen: ScreenMap) -> None:
    """The finger slides and leaves; the packet that says so is lost, and the panel says no more."""
    lab = panel_lab(screen)
    lab.begin(0.5)
    for x in np.linspace(-0.03, 0.03, 50):
        lab._answers.append(lab.device.touched(True, float(x), 0.0, lab.now))
        lab.run(0.01)
    assert lab.at[0] > 100
    lab.device.touch = None
    lab.run(0.19)
    assert lab.at[0] > 100
    lab.run(0.02)
    assert lab.at[0] == 0.0 and lab.streamer.status()["counters"]["touches grown old"] == 1
    lab.stops += 1
    lab.run(0.5)
    lab.arm()
    lab.run(0.2)
    assert lab.at[0] == 0.0, "arming does not bring it back"


def test_the_virtual_panel_repeats_its_touch(screen: ScreenMap) -> None:
    lab = panel_lab(screen)
    lab.begin()
    lab._answers.append(lab.device.touched(True, 0.0, 0.0, lab.now))
    heard: set[float | None] = set()
    adapter = lab.streamer.connection.adapter  # type: ignore[union-attr]
    lab.run(1.0, lambda: heard.add(adapter.touch.at if adapter.touch else None))
    assert len(heard - {None}) == pytest.approx(50, abs=2), "every 20 ms while the finger is down"
    assert lab.streamer.status()["counters"]["touches grown old"] == 0
    lab._answers.append(lab.device.touched(False, 0.0, 0.0, lab.now))
    lab.run(0.1, heard.clear)
    assert adapter.touch.down is False  # type: ignore[union-attr]


# -- something else to play


def volts(path: Path, *levels: float) -> str:
    """Write ten seconds of levels, each as long."""
    spec = Library().device("electrovibration")
    t = np.arange(2001) / 200
    values = np.tile([c.rest for c in spec.channels], (len(t), 1))
    values[:, [c.name for c in spec.channels].index("amplitude")] = np.repeat(levels, 2001 // len(levels) + 1)[:2001]
    csv.write(CommandTrack(spec, t, values), path)
    return str(path)


@pytest.mark.parametrize("change", ["track", "offset"])
def test_something_else_to_play_is_blended_in(change: str, tmp_path: Path) -> None:
    """A voltage has no speed limit, so nothing but the blend keeps it from a jump."""
    first, other = volts(tmp_path / "a.csv", 100.0, 20.0), volts(tmp_path / "b.csv", 20.0)
    lab = Lab("native", "electrovibration", track=first, ramp=0.1)
    lab.begin(0.5)
    lab.playing = True
    lab.run(0.5)
    count = 300 / 65535
    assert lab.at[0] == pytest.approx(100.0, abs=count)
    lab.set(**({"track": other} if change == "track" else {"offset": 5.0}))
    path = [float(lab.at[0])]
    lab.run(0.4, lambda: path.append(float(lab.at[0])))
    assert np.abs(np.diff(path)).max() <= 1.5 * 80 / 0.3 * lab.streamer.output.sample_clock.period * 1.05 + count
    assert path[-1] == pytest.approx(20.0, abs=count)


def test_a_setting_that_changes_nothing_played_blends_nothing(track_file: Path) -> None:
    lab = Lab(track=str(track_file), ramp=0.0)
    lab.begin(0.5)
    lab.playing = True
    lab.run(0.5)
    lab.set(play_on=True, jog={"pulley_1": 0.1})
    errors: list[float] = []
    lab.run(0.4, lambda: errors.append(float(lab.at[0] - 0.1 * np.sin(2 * np.pi * lab.time))))
    assert np.abs(errors).max() <= 2 * np.pi * 0.1 * 2e-3


def test_a_change_in_the_first_ramp_does_not_shorten_it(tmp_path: Path) -> None:
    lab = Lab("native", "electrovibration", track=volts(tmp_path / "a.csv", 100.0), ramp=2.0)
    lab.begin(0.1)
    lab.set(track=volts(tmp_path / "b.csv", 90.0))
    lab.run(0.9)
    assert lab.at[0] == pytest.approx(90.0 * smooth(0.9 / 1.91), abs=1.0), "0.9 s of the 1.91 s that were left"
    lab.run(1.2)
    assert lab.at[0] == pytest.approx(90.0, abs=300 / 65535)


def test_a_calibration_puts_no_voltage_under_a_finger_that_is_lifted(screen: ScreenMap) -> None:
    lab = panel_lab(screen)
    lab.begin(0.3)
    assert lab.at[0] == 0.0
    made = Calibration.of(Library().device("electrovibration")).with_entry("amplitude", zero=50.0)
    lab.set(calibration=made.dumps())
    most: list[float] = []
    lab.run(1.0, lambda: most.append(float(lab.at[0])))
    assert max(most) <= 300 / 65535 and lab.streamer.armed
    lab._answers.append(lab.device.touched(True, 0.0, 0.0, lab.now))
    lab.run(0.1)
    lab._answers.append(lab.device.touched(False, 0.0, 0.0, lab.now))
    lab.run(0.1)
    assert lab.at[0] <= 300 / 65535


@pytest.mark.parametrize("mode", ["play", "jog"])
def test_a_calibration_under_way_puts_no_voltage_where_there_is_none(mode: str, tmp_path: Path) -> None:
    """Before and after a track, and for a channel that nobody moves, 0 V stays 0 V, whatever zero and gain become."""
    lab = Lab("native", "electrovibration", mode=mode, track=volts(tmp_path / "a.csv", 100.0), ramp=0.0)
    lab.time = -5.0
    lab.begin(0.5)
    assert lab.at[0] == 0.0
    made = Calibration.of(Library().device("electrovibration")).with_entry("amplitude", zero=50.0)
    lab.set(calibration=made.dumps())
    most: list[float] = []
    lab.run(1.0, lambda: most.append(float(lab.at[0])))
    assert max(most) <= 300 / 65535 and lab.streamer.armed
