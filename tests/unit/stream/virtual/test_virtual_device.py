"""Real processes over real links: the sender as Blender starts it, virtual devices as programs, and either one killed.

Nothing here measures speed; limits of time are those that safety promises, with the machine's own delay on top.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.errors import DermisError
from core.presets import Library
from core.stream.client import SenderClient
from core.stream.links.open_link import open_link
from core.stream.links.url import Url
from core.stream.protocols.wire import Wire
from core.stream.virtual.device import make
from core.stream.virtual.faults import Faults
from core.stream.virtual.link import open_any_link
from tests import exits
from tests.unit.stream.stream_box import HAPTIP, beating, posix, ready

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.shared_tests("the board is simulated; senders that end run on both lines"),
]

serial = pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")


@posix
@pytest.mark.parametrize("at", ["pty", "tcp", "udp"])
def test_the_way_from_blender_to_the_device(at: str, boxes: Any, track_file: Path) -> None:
    box = boxes(at)
    with SenderClient() as client:
        ready(client, box.url, track=str(track_file), ramp=0.1, look_ahead=0.1)
        assert client.status()["values"] == [0.0, 0.0]
        beating(client, 0.2)
        client.arm()
        beating(client, 0.4)
        beating(client, 1.0, playing=True)
        status = client.status()
        assert status["state"] == "streaming" and status["counters"]["sent"] > 500
        client.stop()
        box.safe_at()
    report = box.end()
    assert report["received"] > 500 and report["damaged"] == 0 and report["lost"] == 0
    assert report["state"] == "safe" and max(abs(v) for v in report["values"].values()) < 1e-4


def test_what_is_not_there_says_so() -> None:
    for url, what in (
        ("/dev/ttyDoesNotExist", "no such port"),
        ("socket://127.0.0.1:1", "cannot be opened"),
        ("", "no port is"),
        ("udp://127.0.0.1", "HOST:PORT"),
        ("gopher://x", "unknown kind of link"),
        ("virtual:?loss=2", "impossible"),
        ("virtual:?stuck=9", "no such actuator"),
        ("/dev/null?baud=fast", "baud"),
        ("spy://", "needs the URL"),
    ):
        with pytest.raises(DermisError, match=what):
            open_any_link(Url(url), Wire.of(Library().device("haptip")))


@posix
def test_nobody_answers(boxes: Any) -> None:
    box = boxes("pty", "servo-animation")
    with SenderClient() as client:
        client.connect(box.url, "native", "haptip", HAPTIP)
        assert "no answer came" in client.wait("fault", 10)["message"]


def test_loop_and_spy(tmp_path: Path) -> None:
    record = tmp_path / "record.txt"
    none = lambda url: pytest.fail("no virtual device was asked for")  # noqa: E731
    link = open_link(Url(f"spy://loop://?file={record}"), none, 115_200)
    assert link.send(b"\x01\x02") and link.receive() == [b"\x01\x02"] and link.receive() == []
    link.close()
    assert [line[13:] for line in record.read_text().splitlines()] == ["TX 01 02", "RX 01 02"]


@pytest.mark.parametrize("protocol", ["native", "native-wifi", "maestro", "servo-animation", "torque", "osc"])
def test_the_device_in_the_box_speaks_every_protocol(protocol: str) -> None:
    with SenderClient() as client:
        client.connect("virtual:", protocol, "haptip", HAPTIP, mode="jog", jog={"pulley_1": 0.2}, ramp=0.0)
        client.heartbeat()
        client.wait("ready", 10)
        end = time.monotonic() + 8
        while time.monotonic() < end:
            if not client.status()["armed"]:  # at first, and where a busy machine kept this process from beating
                client.arm()
            beating(client, 0.05)
            told = client.status().get("received", {}).get("values", {})
            if abs(told.get("pulley_1", 0.0) - 0.2) < 0.005:
                break
        assert told["pulley_1"] == pytest.approx(0.2, abs=0.005) and abs(told["pulley_2"]) < 0.005
        status = client.status()
        assert (status["silence"]["does"] == "retracts") == protocol.startswith("native")
        assert bool(status["caution"]) != protocol.startswith("native"), "without a watchdog a person is told"


def test_a_stuck_actuator_shows_in_what_the_device_reports() -> None:
    with SenderClient() as client:
        client.connect("virtual:?stuck=1", "native", "haptip", HAPTIP, mode="follow", ramp=0.0)
        client.heartbeat()
        client.wait("ready", 10)
        client.arm()
        told: dict[str, float] = {}

        def beat() -> None:
            beating(client, 0.1, values=(0.2, 0.2))
            told.update(client.status()["received"]["values"])

        exits.until(lambda: told.get("pulley_1") == pytest.approx(0.2, abs=1e-3), beat, "the other one arrives")
        beat()
        assert abs(told["pulley_2"]) < 1e-3


def test_what_is_reported_is_as_commanded_whatever_the_calibration() -> None:
    """A pulley that counts the other way round, and from another zero, is driven elsewhere than its twin is shown."""
    made = (
        Calibration.of(Library().device("haptip"))
        .with_entry("pulley_1", zero=0.05, gain=-1.0)
        .with_entry("pulley_2", gain=2.0)
    )
    with SenderClient() as client:
        client.connect("virtual:", "native", "haptip", HAPTIP, mode="follow", ramp=0.0, calibration=made.dumps())
        client.heartbeat()
        client.wait("ready", 10)
        client.arm()
        wanted = pytest.approx({"pulley_1": 0.2, "pulley_2": 0.1}, abs=1e-4)
        beat = partial(beating, client, 0.1, values=(0.2, 0.1))
        exits.until(lambda: client.status().get("reported", {}) == wanted, beat, "as asked")
        status = client.status()
        assert status["received"]["values"] == pytest.approx({"pulley_1": -0.15, "pulley_2": 0.2}, abs=1e-4)


def test_loss_and_corruption_are_counted_and_survived(track_file: Path) -> None:
    with SenderClient() as client:
        url = "virtual:?loss=0.05&corrupt=0.001&seed=3"
        client.connect(url, "native", "haptip", HAPTIP, track=str(track_file), ramp=0.0)
        client.heartbeat()
        client.wait("ready", 10)
        client.arm()
        beating(client, 1.5, playing=True)
        status = client.status()
        assert status["state"] == "streaming", status["message"]
        told = status["received"]
        assert told["lost"] > 10 and told["damaged"] > 0
        assert 0.80 < told["received"] / status["counters"]["sent"] < 0.98


def test_faults_do_what_they_say() -> None:
    faults = Faults(loss=0.25, delay=0.01, seed=5)
    for k in range(4000):
        faults.put(bytes((k % 256,)), k * 1e-3)
    assert faults.get(0.0) == []
    assert len(faults.get(1e9)) / 4000 == pytest.approx(0.75, abs=4 * (0.25 * 0.75 / 4000) ** 0.5)


def test_a_finger_on_the_virtual_panel_is_answered_through_a_real_sender(tmp_path: Path) -> None:
    """A map from a file, a finger that circles: uphill there is a voltage, downhill none, and it started at 0 V."""
    from core.devices.friction_screen import FrictionScreen
    from core.matching.screen_map import ScreenMap

    x = (np.arange(64) + 0.5) / 64 * 0.1 - 0.05
    heights = np.broadcast_to((0.5 * x).astype(np.float32), (1, 64, 64)).copy()
    screen = FrictionScreen.of(Library().device("electrovibration"))
    made = ScreenMap(
        heights, (0.1, 0.1), 1.0, screen, scale=120.0, lowest=float(heights.min()), highest=float(heights.max())
    )
    made.save(tmp_path / "ramp.map.npz")
    steepest = 10 ** (1.05 / 1.24) * 60 ** (1 / 1.24)  # log10 f = 1.24 log10 V - 1.05 at f = 120 * 0.5
    preset = Library().load("devices", "electrovibration")
    with SenderClient() as client:
        client.connect(
            "virtual:?finger=1",
            "native",
            "electrovibration",
            preset,
            mode="panel",
            ramp=0.0,
            screen=str(tmp_path / "ramp.map.npz"),
        )
        client.heartbeat()
        client.wait("ready", 10)
        beating(client, 0.3)
        assert client.status()["received"]["values"]["amplitude"] == 0.0, "nothing before arming"
        client.arm()
        seen = []

        def beat() -> None:
            beating(client, 0.05)
            seen.append(client.status()["received"]["values"]["amplitude"])

        for _ in range(70):  # a turn takes 3.1 s
            beat()
        exits.until(lambda: max(seen) > 0.98 * steepest and min(seen) == 0.0, beat, "uphill and downhill")
        assert client.status()["armed"], client.status()["message"]
    assert max(seen) == pytest.approx(steepest, rel=0.02) and min(seen) == 0.0


@pytest.mark.parametrize("protocol", exits.PROTOCOLS)
def test_a_device_that_was_told_nothing_yet_is_at_rest(protocol: str) -> None:
    wire = Wire.of(Library().device("haptip"))
    assert np.any(wire.rest != wire.range_low), "a device where it matters"
    reported = make(protocol, wire, {}).report()["values"]
    assert list(reported.values()) == pytest.approx(wire.rest.tolist(), abs=1e-3)  # the coarsest position
