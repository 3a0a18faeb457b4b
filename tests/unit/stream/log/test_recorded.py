"""What stands in a log: every sample of a stream, in its order, with what became of it, whatever ends the stream."""

from __future__ import annotations

import csv as plain_csv
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.errors import DermisError
from core.presets import Library
from core.stream.client import SenderClient
from core.stream.log import binary
from core.stream.log.row import BLOCKS, Fate, Phase
from core.stream.outbox import SendResult
from core.stream.protocols.bus import dynamixel as dynamixel_registers
from core.stream.protocols.bus import feetech as feetech_registers
from core.work.child import command, environment
from tests.unit.stream.stream_box import beating, posix, ready
from tests.unit.stream.stream_lab import Lab, sine_track

pytestmark = pytest.mark.shared_tests("the board is simulated; senders that end run on both lines")


def lab_log(lab: Lab, path: Path) -> binary.LogFile:
    """End a lab's stream, and read its log."""
    lab.streamer.shut(lab.now)
    lab.run(2.0)
    assert lab.streamer.finished
    status = lab.streamer.recorder.finish(20.0)
    assert not status.get("ended"), status
    return binary.read(path)


def jog_lab(path: Path, protocol: str = "native", **more: Any) -> Lab:
    return Lab(protocol, mode="jog", jog={"pulley_1": 0.2}, ramp=0.05, log=str(path), **more)


@pytest.mark.parametrize("protocol", ["native", "maestro", "servo-animation", "torque"])
def test_every_sample_is_there_in_its_order(protocol: str, tmp_path: Path) -> None:
    lab = jog_lab(tmp_path / "a.dlog", protocol)
    lab.begin(0.5)
    assert lab.streamer.armed, lab.streamer.message
    sent = lab.streamer.counters["sent"]
    file = lab_log(lab, tmp_path / "a.dlog")
    rows, live = file.rows, file.rows[file.rows["phase"] == Phase.LIVE]
    assert rows["number"].tolist() == list(range(len(rows))) and file.end is not None and file.end["lost"] == 0
    assert len(live) == sent > 100 and (live["fate"] != Fate.DROPPED).all()
    assert (np.diff(rows["time"]) >= 0).all() and rows["time"][0] >= 0
    assert (rows["phase"][len(live) :] != Phase.LIVE).all() and rows["phase"][-1] == Phase.SAFE
    assert np.allclose(live["commanded"], [0.2, 0.0]), "what the hand asks for"
    assert live["limited"][-1] == pytest.approx([0.2, 0.0], abs=1e-6)
    assert (np.diff(live["limited"][:, 0]) >= -1e-7).all() and live["limited"][0, 0] < 0.1, "the blend is the limiter's"


@pytest.mark.parametrize(("protocol", "step"), [("native", 1.1 / 65535), ("maestro", 1.1 / 4000), ("torque", 0.0)])
def test_sent_is_what_the_protocols_numbers_stand_for(protocol: str, step: float, tmp_path: Path) -> None:
    lab = jog_lab(tmp_path / "a.dlog", protocol)
    lab.begin(0.4)
    rows = lab_log(lab, tmp_path / "a.dlog").rows
    wire = lab.device.wire
    most = 0.5 * step * (wire.range_high - wire.range_low) + 1e-7
    off = np.abs(rows["sent"] - rows["limited"])
    assert (off <= most).all() and (step == 0 or off.max() > 0)


def test_a_calibration_stands_between_commanded_and_limited(tmp_path: Path) -> None:
    spec = Library().device("haptip")
    made = Calibration.of(spec).with_entry("pulley_1", gain=0.5)
    lab = jog_lab(tmp_path / "a.dlog", calibration=made.dumps())
    lab.begin(0.5)
    file = lab_log(lab, tmp_path / "a.dlog")
    live = file.rows[file.rows["phase"] == Phase.LIVE]
    assert file.header.gain == (0.5, 1.0) and live["limited"][-1, 0] == pytest.approx(0.1, abs=1e-6)
    assert live["commanded"][-1, 0] == pytest.approx(0.2, abs=1e-6)


def test_what_the_device_reports_has_its_own_time(tmp_path: Path) -> None:
    lab = jog_lab(tmp_path / "a.dlog", "torque")
    lab.begin(0.5)
    live = lab_log(lab, tmp_path / "a.dlog").rows
    live = live[live["phase"] == Phase.LIVE]
    assert np.isfinite(live["reported"]).all() and (live["heard"] <= live["time"]).all()
    assert (live["time"] - live["heard"])[10:].max() < 0.003, "this board answers every datagram"
    assert abs(live["reported"][-1, 0] - 0.2) < 0.05


@pytest.mark.parametrize("protocol", ["dynamixel", "feetech"])
def test_what_servos_measure_beside_their_pose_stands_in_columns_of_its_own(protocol: str, tmp_path: Path) -> None:
    lab = jog_lab(tmp_path / "a.dlog", protocol, rate=100.0)
    lab.begin(1.0)
    assert lab.streamer.armed, lab.streamer.message
    registers = dynamixel_registers if protocol == "dynamixel" else feetech_registers
    lab.device.servos[1].memory[registers.TEMPERATURE] = 44
    lab.run(0.5)
    file = lab_log(lab, tmp_path / "a.dlog")
    assert [(q.name, q.unit) for q in file.header.sensed] == [("temperature", "degC"), ("current", "A")]
    assert file.header.columns[-4:] == (
        "temperature.pulley_1[degC]",
        "temperature.pulley_2[degC]",
        "current.pulley_1[A]",
        "current.pulley_2[A]",
    )
    live = file.rows[file.rows["phase"] == Phase.LIVE]
    assert live["sensed"].shape[1:] == (2, 2) and np.isfinite(live["sensed"]).all()
    assert live["sensed"][0, 0].tolist() == [31.0, 31.0] and live["sensed"][-1, 0].tolist() == [31.0, 44.0]


def test_a_native_device_is_asked_for_its_pose_while_it_is_driven(tmp_path: Path) -> None:
    lab = jog_lab(tmp_path / "a.dlog")
    lab.begin(1.0)
    live = lab_log(lab, tmp_path / "a.dlog").rows
    live = live[live["phase"] == Phase.LIVE]
    assert len(np.unique(live["heard"])) >= 8 and live["time"][-1] - live["heard"][-1] < 0.15
    assert live["reported"][-1] == pytest.approx([0.2, 0.0], abs=1e-3)


def test_a_track_stands_with_its_own_time(tmp_path: Path) -> None:
    track = sine_track(tmp_path / "t.csv")
    lab = Lab(track=str(track), ramp=0.0, look_ahead=0.05, log=str(tmp_path / "a.dlog"), offset=0.25)
    lab.run(0.2)
    lab.playing = True
    lab.begin(1.0)
    live = lab_log(lab, tmp_path / "a.dlog").rows
    live = live[(live["phase"] == Phase.LIVE) & np.isfinite(live["play"])][100:]
    assert np.allclose(live["commanded"][:, 0], 0.1 * np.sin(2 * np.pi * live["track"]), atol=2e-6)
    assert np.allclose(live["play"] - live["time"], 0.05, atol=0.002), "look-ahead"
    assert np.allclose(np.diff(live["play"]), 1e-3, atol=1e-9), "one a period"


def test_what_found_no_room_is_dropped_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lab = jog_lab(tmp_path / "a.dlog", "maestro")
    lab.begin(0.3)
    outbox, real = lab.streamer.drive.connection.outbox, lab.streamer.drive.connection.link.send
    refused = Counter[str]()

    def no_room(message: bytes) -> bool:
        refused["messages"] += 1
        return False

    lab.streamer.drive.connection.link.send = no_room
    lab.set(jog={"pulley_1": 0.1})
    lab.run(0.05)
    dropped = lab.streamer.counters["dropped"]
    lab.streamer.drive.connection.link.send = real
    lab.run(0.2)
    assert outbox.unsent is None and dropped > 10 and SendResult.DROPPED
    rows = lab_log(lab, tmp_path / "a.dlog").rows
    gone = rows[rows["fate"] == Fate.DROPPED]
    assert len(gone) == dropped and np.isnan(gone["sent"]).all() and np.isfinite(gone["limited"]).all()


def test_samples_that_were_left_out_are_counted_beside_the_next(tmp_path: Path) -> None:
    lab = jog_lab(tmp_path / "a.dlog", "maestro")
    lab.begin(0.3)
    lab.now += 0.03  # this process was kept from working
    lab.run(0.1)
    skipped = lab.streamer.counters["skipped"]
    rows = lab_log(lab, tmp_path / "a.dlog").rows
    assert rows["skipped"].sum() == skipped > 20 and np.count_nonzero(rows["skipped"]) <= 2


def test_a_log_goes_on_over_a_reconnection_and_ends_when_it_is_switched_off(tmp_path: Path) -> None:
    path = tmp_path / "a.dlog"
    lab = jog_lab(path, reconnect=True)
    lab.begin(0.2)
    lab.cut = True
    lab.run(0.1)
    lab.cut = False
    lab.run(1.5)
    lab.begin(0.2)
    assert lab.streamer.armed
    before = lab.streamer.counters["sent"]
    lab.set(log="")
    lab.run(0.2)
    lab.streamer.recorder.finish(20.0)
    file = binary.read(path)
    live = file.rows[file.rows["phase"] == Phase.LIVE]
    assert file.end is not None and file.rows["number"].tolist() == list(range(len(file.rows)))
    assert np.diff(live["time"]).max() > 1.0 and abs(len(live) - before) <= 1 and lab.streamer.armed
    lab.streamer.shut(lab.now)
    lab.run(0.5)


def test_a_log_that_cannot_be_is_refused_in_words(tmp_path: Path) -> None:
    taken = tmp_path / "taken.csv"
    taken.write_text("three years")
    for log, words in (
        (str(taken), "would overwrite a file"),
        (str(tmp_path / "none" / "a.csv"), "no such folder"),
        (str(taken / "inside"), "cannot be made"),
    ):
        lab = Lab(mode="jog", log=log)
        lab.run(0.1)
        assert words in lab.streamer.message and lab.streamer.drive is None
        lab.streamer.shut(lab.now)
    for wrong, words in (
        ({"log": "a.txt"}, "a CSV or a binary file"),
        ({"log": "a.csv", "log_size": 50e6, "log_total": 20e6}, "may not be smaller"),
        ({"tee": "tcp://a:1"}, "not an address to tee to"),
        ({"tee": "udp://a"}, "HOST:PORT"),
        ({"tee": "udp://a:1?format=xml"}, "no such format"),
        ({"tee": "udp://a:1?rate=fast"}, "not a rate"),
        ({"tee": "udp://a:1?colour=red"}, "unknown option"),
        ({"tee": "lsl:"}, "needs a name"),
    ):
        lab.request = type(lab.request)(**wrong)
        with pytest.raises(DermisError, match=words):
            lab.request.check()
    assert taken.read_text() == "three years"


def test_a_log_that_cannot_be_begun_under_way_is_told_and_the_stream_goes_on(tmp_path: Path) -> None:
    lab = Lab(mode="jog", jog={"pulley_1": 0.1})
    lab.begin(0.2)
    lab.set(log=str(tmp_path / "none" / "a.csv"))
    lab.run(0.1)
    assert lab.streamer.armed and "no such folder" in lab.streamer.message
    lab.set(log=str(tmp_path / "a.dlog"))
    lab.run(0.1)
    assert len(lab_log(lab, tmp_path / "a.dlog").rows) > 50


def test_nothing_is_written_where_nobody_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lab = Lab(mode="jog", jog={"pulley_1": 0.1})
    lab.begin(0.2)
    assert lab.streamer.status()["log"] == {} and lab.streamer.recorder._child is None
    assert not list(tmp_path.iterdir())


def test_files_in_a_folder_are_named_by_device_and_time(tmp_path: Path) -> None:
    for _ in range(2):
        lab = Lab(mode="jog", log=str(tmp_path / "logs"), log_format="csv")
        lab.begin(0.05)
        lab.streamer.shut(lab.now)
        lab.run(0.3)
        lab.streamer.recorder.finish(20.0)
    names = [p.name for p in sorted((tmp_path / "logs").iterdir())]
    assert len(names) == 2 and all(n.startswith("haptip_20") and n.endswith(".csv") for n in names)


# -- real senders, over a real pty

real = pytest.mark.real_time


def csv_rows(path: Path) -> list[dict[str, str]]:
    text = path.read_bytes().decode()
    lines = [line for line in text[: text.rindex("\n")].splitlines() if not line.startswith("#")]
    return list(plain_csv.DictReader(lines))


def logged(client: SenderClient) -> dict[str, Any]:
    return dict(client.status().get("log") or {})


@real
@posix
def test_a_real_sender_logs_all_that_arrives(boxes: Any, track_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("serial")
    box, path = boxes("pty"), tmp_path / "a.dlog"
    with SenderClient() as client:
        ready(client, box.url, track=str(track_file), ramp=0.0, log=str(path))
        client.arm()
        beating(client, 1.0, playing=True)
        client.stop()
        beating(client, 0.3)
        status = client.status()
        assert status["log"]["file"] == str(path) and status["log"]["lost"] == 0 and status["log"]["rows"] > 50
    received = box.end()["received"]
    file = finished(path)
    live = file.rows[file.rows["phase"] == Phase.LIVE]
    assert (live["fate"] != Fate.DROPPED).sum() == status["counters"]["sent"] == received
    assert abs(file.header.started_unix - path.stat().st_ctime) < 30


def finished(path: Path, seconds: float = 10.0) -> binary.LogFile:
    """Wait for the end of a log whose writer ends by itself."""
    end = time.monotonic() + seconds
    while (file := binary.read(path)).end is None:
        assert time.monotonic() < end, "the log was not finished"
        time.sleep(0.02)
    return file


def rings_of(pid: int) -> set[Path]:
    """Return the rings that a process has mapped: those of others come and go beside a test."""
    lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    return {Path(line.split(None, 5)[5]) for line in lines if "/dermis-ring-" in line}


@real
@posix
@pytest.mark.parametrize("suffix", ["csv", "dlog"])
def test_kill_9_of_the_sender_leaves_a_readable_log(suffix: str, boxes: Any, track_file: Path, tmp_path: Path) -> None:
    """Its writer is a process of its own: all that was put into the ring is written, and it leaves nothing behind."""
    pytest.importorskip("serial")
    box, path = boxes("pty"), tmp_path / f"a.{suffix}"
    client = SenderClient()
    try:
        ready(client, box.url, track=str(track_file), ramp=0.0, log=str(path))
        client.arm()
        beating(client, 0.6, playing=True)
        rings = rings_of(client.pid)
        os.kill(client.pid, signal.SIGKILL)
    finally:
        client.close()
    received = box.end()["received"]
    end = time.monotonic() + 10
    while (b"end" if suffix == "csv" else b"lost") not in path.read_bytes()[-200:]:
        assert time.monotonic() < end
        time.sleep(0.02)
    rows = csv_rows(path) if suffix == "csv" else list(binary.read(path).rows)
    numbers = [int(row["number"]) for row in rows]
    assert numbers == list(range(len(rows))) and abs(len(rows) - received) <= 1, "to the last sample"
    assert rings
    while any(ring.exists() for ring in rings):  # the writer's last step, after the log
        assert time.monotonic() < end
        time.sleep(0.02)


@real
@posix
def test_kill_9_of_the_writer_leaves_a_readable_log_and_the_stream(
    boxes: Any, track_file: Path, tmp_path: Path
) -> None:
    pytest.importorskip("serial")
    box, path = boxes("pty"), tmp_path / "a.csv"
    with SenderClient() as client:
        ready(client, box.url, track=str(track_file), ramp=0.0, log=str(path))
        client.arm()
        end = time.monotonic() + 20.0  # its process starts late on a busy machine
        while client.status()["log"].get("written", 0) <= 200 and time.monotonic() < end:
            beating(client, 0.1, playing=True)
        os.kill(writer_of(client.pid), signal.SIGKILL)
        beating(client, 0.4, playing=True)
        status = client.status()
        assert status["state"] == "streaming" and "the log ended: its process did" in status["log"]["ended"]
        client.stop()
        beating(client, 0.2)
    rows = csv_rows(path)
    assert [int(r["number"]) for r in rows] == list(range(len(rows))) and 200 < len(rows) < box.end()["received"]


def writer_of(pid: int) -> int:
    """Return the process that writes a sender's log."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return next(int(c) for c in children if b"write" in Path(f"/proc/{c}/cmdline").read_bytes().split(b"\0"))


@real
@posix
def test_a_writer_that_hangs_loses_rows_that_are_counted_and_delays_nothing(
    boxes: Any, track_file: Path, tmp_path: Path
) -> None:
    """As behind a disk that answers no more. At 10 s of rows the ring is full, here at 1,024: a rate of 100 Hz."""
    pytest.importorskip("serial")
    box, path = boxes("pty"), tmp_path / "a.dlog"
    with SenderClient() as client:
        ready(client, box.url, mode="jog", jog={"pulley_1": 0.1}, ramp=0.0, log=str(path), rate=100.0)
        client.arm()
        beating(client, 0.5)
        writer = writer_of(client.pid)
        os.kill(writer, signal.SIGSTOP)
        try:
            beating(client, 11.0)
            status = client.status()
            assert status["state"] == "streaming" and status["log"]["lost"] > 5
            assert status["counters"].get("skipped", 0) < 20
        finally:
            os.kill(writer, signal.SIGCONT)
        beating(client, 0.5)
        assert client.status()["log"]["rows"] > 1024
    file = finished(path)
    lost = int(file.rows["number"][-1]) + 1 - len(file.rows)
    assert file.end is not None and file.end["lost"] == lost > 5, "the count stands in the file, and the gap shows"


def play(*options: str) -> subprocess.CompletedProcess[str]:
    line = command("stream", "play", *options, "--url", "virtual:", "--yes", "--ramp", "0.1")
    return subprocess.run(line, env=environment(), capture_output=True, text=True, timeout=60)


def short_track(path: Path, rows: int = 501) -> Path:
    """Return the first rows of the sine, a thousand a second."""
    import core.track.csv as csv_track
    from core.track.command_track import CommandTrack

    whole = csv_track.read(sine_track(path))
    csv_track.write(CommandTrack(whole.spec, whole.times[:rows], whole.values[:rows]), path)
    return path


@real
def test_play_says_what_it_has_logged(tmp_path: Path) -> None:
    track, path = short_track(tmp_path / "t.csv"), tmp_path / "a.csv"
    done = play(str(track), "--log", str(path))
    assert done.returncode == 0 and f"log {path}: " in done.stderr, done.stderr
    rows = csv_rows(path)
    sent = dict(part.split() for part in done.stdout.strip().split(", ") if len(part.split()) == 2)["sent"]
    assert sum(r["phase"] == "live" and r["fate"] != "dropped" for r in rows) == int(sent)
    again = play(str(track), "--log", str(path))
    assert again.returncode == 2 and "would overwrite a file" in again.stderr
    assert set(BLOCKS) == {name.partition(".")[0] for name in rows[0] if "." in name}


# The writer alone has no room: the sender's own memory is a file, too.
FULL = """
import sys
from core.stream import recorder
from core.__main__ import main
limit = f"import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, ({sys.argv[1]}, {sys.argv[1]})); "
runs = "from core.__main__ import main; sys.exit(main(sys.argv[1:]))"
recorder.command = lambda *words: [sys.executable, "-c", limit + runs, *words]
sys.exit(main(sys.argv[2:]))
"""


@real
@posix
@pytest.mark.parametrize("suffix", ["csv", "dlog"])
def test_a_full_disk_ends_the_log_said_once_and_never_the_stream(suffix: str, tmp_path: Path) -> None:
    track, path = short_track(tmp_path / "t.csv", 3001), tmp_path / f"a.{suffix}"
    room = 240_000 if suffix == "csv" else 160_000  # the first rows come in one heap, once the writer has started
    options = ["stream", "play", str(track), "--url", "virtual:", "--yes", "--ramp", "0.1", "--log", str(path)]
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(room), *options], env=environment(), capture_output=True, text=True
    )
    assert done.returncode == 1 and "sent" in done.stdout, done.stderr
    sent = dict(part.split() for part in done.stdout.strip().split(", ") if len(part.split()) == 2)["sent"]
    assert int(sent) > 500, "it played to its end"
    assert done.stderr.count("the stream goes on without it") == 1 and "File too large" in done.stderr
    numbers = [int(r["number"]) for r in (csv_rows(path) if suffix == "csv" else binary.read(path).rows)]
    assert numbers == list(range(len(numbers))) and 10 < len(numbers) < int(sent) and path.stat().st_size <= room
