"""The acceptance of a built device: what counts as accepted, and a walk over a real port with a person who answers."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.errors import DermisError
from core.presets import Library
from core.stream.acceptance.bench import Bench
from core.stream.acceptance.command import _go, _tried
from core.stream.acceptance.mover import fastest_over
from core.stream.acceptance.player import slow_track
from core.stream.acceptance.report import CHECKS, Check, Report, judged
from core.stream.acceptance.walk import Walk
from core.stream.protocols import native
from core.stream.protocols.wire import Wire
from core.stream.request import StreamRequest
from core.work.child import command, environment
from tests.unit.stream.stream_box import posix

pytestmark = pytest.mark.shared_tests("the board is simulated; senders that end run on both lines")

WHEN = datetime(2026, 1, 2, 3, 4, tzinfo=UTC)


@pytest.mark.parametrize(
    ("seen", "measured", "expected"),
    [
        (True, {"pose": True}, ("passed", "measured and seen")),
        (True, None, ("passed", "seen")),
        (None, {"pose": True}, ("passed", "measured")),
        (None, None, ("not tried", "")),
        (False, {"pose": True}, ("failed", "measured and seen")),
        (True, {"pose": True, "speed": False}, ("failed", "measured and seen")),
        (None, {"pose": False}, ("failed", "measured")),
    ],
)
def test_neither_person_nor_measurement_is_overruled(seen: Any, measured: Any, expected: Any) -> None:
    assert judged(seen, measured) == expected
    busy = judged(seen, measured, busy=True)
    assert busy == (expected if expected[0] == "failed" else ("not judged", "")), "what is seen to fail has failed"


def test_accepted_only_if_all_was_tried_and_nothing_failed(tmp_path: Path) -> None:
    good, bad, left = (Check(o, "w", o) for o in ("passed", "failed", "not tried"))  # type: ignore[arg-type]
    assert Report({}, [good, good]).verdict == "accepted"
    assert Report({}, [good, left]).verdict == "incomplete"
    assert Report({}, [good, Check("a", "w", "not judged")]).verdict == "incomplete"
    assert Report({}, [good], interrupted=True).verdict == "incomplete" == Report({}).verdict
    assert Report({}, [good, bad, left], interrupted=True).verdict == "not accepted"
    report = Report({"device": "A | B"}, [Check("x|y", "w", "passed", "seen")])
    report.write(tmp_path / "r.md", WHEN)
    text, plain = (tmp_path / "r.md").read_text("utf-8"), json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert "accepted" in text and "2026-01-02 03:04" in text and "| x/y |" in text
    assert plain["schema"] == "dermis-acceptance 2" and plain["verdict"] == "accepted"
    assert plain["date"] == "2026-01-02T03:04:00+00:00" and plain["checks"][0]["name"] == "x|y"


def test_the_fastest_of_a_known_movement() -> None:
    """2 rad/s for a second, asked for every 3 ms and answered up to 2 ms later: bounds that contain 2 rad/s."""
    rng = np.random.default_rng(1)
    poses = []
    for t in np.arange(0.0, 2.0, 0.003):
        asked, heard = t - rng.uniform(0.0, 0.001), t + rng.uniform(0.0, 0.001)
        poses.append((float(asked), float(heard), np.array([min(2.0 * t, 2.0), 0.0])))
    least, most = fastest_over(poses, 0.5)
    assert least[0] <= 2.0 <= most[0] <= 1.01 * least[0] and not least[1] and not most[1]
    assert not fastest_over(poses[:1], 0.5)[0].any() and not len(fastest_over([], 0.5)[0])


def test_the_slow_movement_stays_between_its_two_poses() -> None:
    wire = Wire.of(Library().device("haptip"))
    away = wire.safe + 0.1
    track = slow_track(wire, away)
    values = np.stack([track.column(n) for n in wire.names], axis=1)
    assert np.allclose(values.min(axis=0), wire.safe) and np.allclose(values.max(axis=0), away)
    speed = np.abs(np.diff(values, axis=0)).max() * wire.spec.rate
    assert speed <= 0.1 * np.pi / 4.0 * 1.001 < wire.slew.min()


def test_the_command_lists_the_walks_own_checks() -> None:
    class Bench:
        wire = Wire.of(Library().device("haptip"))

    assert tuple(Walk(Bench(), None, []).checks()) == CHECKS  # type: ignore[arg-type]


# -- over a real port


@pytest.fixture
def busy() -> Iterator[None]:
    """Let two programs beside take all the time of a processor each."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    yield
    for loop in loops:
        loop.kill()
        loop.wait()


def accept(url: str, out: Path, answers: str, *more: str, device: str = "haptip") -> subprocess.CompletedProcess[str]:
    """Run the verb; `answers` is what the person types."""
    return subprocess.run(
        command("stream", "accept", "--url", url, "--device", device, "--out", str(out), *more),
        env=environment(),
        input=answers,
        capture_output=True,
        text=True,
        timeout=240,
    )


def only(*names: str) -> list[str]:
    return [part for name in names for part in ("--only", name)]


def checks_of(out: Path) -> dict[str, dict[str, str]]:
    """Return the checks of a report that were tried, by name."""
    checks = json.loads(out.with_suffix(".json").read_text("utf-8"))["checks"]
    return {check["name"]: check for check in checks if check["what"] != "left out by --only"}


@posix
@pytest.mark.long
@pytest.mark.real_time
def test_a_good_device_passes_stop_silence_flood_and_a_killed_program(boxes: Any, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out = tmp_path / "a.md"
    box = boxes("pty")
    tried = only("link", "first-arm", "motors", "speed", "stop", "silence", "flood", "rate", "exits")
    done = accept(box.url, out, "y\n" * 60, *tried)
    by_name = checks_of(out)
    assert not [check for check in by_name.values() if check["outcome"] == "failed"], by_name
    report = json.loads(out.with_suffix(".json").read_text("utf-8"))
    assert report["verdict"] == "incomplete" and done.returncode == 1, "unplug and switch were left out"
    for name in ("first-arm", "motor pulley_1", "stop", "silence", "flood", "exit, killed", "exit, Ctrl-C"):
        assert by_name[name]["outcome"] == "not judged" or by_name[name]["judge"] == "measured and seen", by_name[name]
    if by_name["silence"]["outcome"] == "passed":
        low, high = (float(word) for word in by_name["silence"]["figure"].split() if word.isdigit())
        assert low - 8 <= native.WATCHDOG_MS <= high + 8, "found by halving"
    assert "FINGERS OUT" in done.stdout


@posix
@pytest.mark.long
@pytest.mark.real_time
def test_a_busy_computer_fails_no_good_device(boxes: Any, busy: None, tmp_path: Path) -> None:
    """Two programs that never wait stood beside it, and a good device failed its rate three times of three."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out, box = tmp_path / "a.md", boxes("pty")
    accept(box.url, out, "y\n" * 40, *only("link", "speed", "stop", "silence", "rate"))
    by_name = checks_of(out)
    assert set(by_name) == {"link", "speed", "stop", "silence", "rate"}
    for check in by_name.values():
        assert check["outcome"] in ("passed", "not judged"), check
        assert ("this computer was busy" in check["figure"]) == (check["outcome"] == "not judged"), check


@posix
@pytest.mark.long
@pytest.mark.real_time
def test_a_busy_computer_excuses_no_bad_device(boxes: Any, busy: None, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out, box = tmp_path / "a.md", boxes("pty", "native", "haptip", "loss=0.02", "delay=0.03")
    accept(box.url, out, "y\n" * 40, *only("link", "rate"))
    assert {name: check["outcome"] for name, check in checks_of(out).items()} == {"link": "failed", "rate": "failed"}


@posix
@pytest.mark.long
@pytest.mark.real_time
@pytest.mark.parametrize(
    ("protocol", "key", "at"),
    [
        ("maestro", "cable_platform", "pty"),
        ("dynamixel", "cable_platform", "pty"),
        ("feetech", "thimble_3rrs", "pty"),
        ("servo-animation", "thimble_3rrs", "pty"),
        ("torque", "haptip", "udp"),
        ("osc", "pin_array_128", "udp"),
    ],
)
def test_every_protocol_goes_through(protocol: str, key: str, at: str, boxes: Any, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out, box = tmp_path / "a.md", boxes(at, protocol, key)
    tried = ("link", "first-arm", "speed", "stop", "silence", "flood", "rate")
    done = accept(box.url, out, "y\n" * 60, "--protocol", protocol, *only(*tried), device=key)
    assert "Traceback" not in done.stderr
    by_name = checks_of(out)
    assert set(by_name) == set(tried)
    assert not [check for check in by_name.values() if check["outcome"] == "failed"], by_name
    measured = "measured and seen" if protocol in ("torque", "dynamixel", "feetech") else "seen"
    for name in ("first-arm", "stop"):
        assert by_name[name]["judge"] == measured or by_name[name]["outcome"] == "not judged", by_name[name]


@posix
@pytest.mark.real_time
def test_a_stuck_motor_fails_whatever_the_person_says_and_is_one_line(boxes: Any, tmp_path: Path) -> None:
    """It stands where the safe pose is not, and every check that looked at the pose failed because of it."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out = tmp_path / "a.md"
    box = boxes("pty", "native", "cable_platform", "stuck=1")
    done = accept(box.url, out, "y\n" * 10, *only("first-arm", "motors", "stop"), device="cable_platform")
    by_name = checks_of(out)
    assert [name for name, check in by_name.items() if check["outcome"] == "failed"] == ["motor motor_2"], by_name
    assert "stays at" in by_name["motor motor_2"]["figure"]
    assert {"first-arm", "motor motor_1", "motor motor_3", "stop"} <= set(by_name)
    assert done.returncode == 1 and "not accepted" in done.stdout


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("too_fast", "outcome"), [(1.0, "passed"), (1.2, "failed"), pytest.param(40.0, "failed", marks=pytest.mark.long)]
)
def test_a_board_that_moves_faster_than_it_was_told_fails(too_fast: float, outcome: str) -> None:
    bench = bench_for("haptip")
    bench.connect()
    device = bench.connection.link._server.device  # type: ignore[attr-defined]
    configure = device._configure

    def quicker(body: bytes) -> None:
        configure(body)
        device._slew = device._slew * too_fast

    device._configure = quicker
    (found,) = Walk(bench, Yes(), []).speed()
    assert found.outcome in (outcome, "not judged"), found
    assert found.outcome == outcome or "this computer was busy" in found.figure
    bench.end()


@pytest.mark.real_time
def test_a_silence_is_as_long_as_it_was_and_not_as_long_as_it_was_meant() -> None:
    """A computer that stands still for 40 ms in each silence of 25 ms made a watchdog of 50 ms seem one of 25."""
    held = []

    def sleep(seconds: float) -> None:
        time.sleep(seconds + (0.04 if held and held.pop() else 0.0))

    bench = bench_for("haptip", sleep=sleep)
    bench.connect()
    silence = bench.silence

    def disturbed(seconds: float, flood: bytes = b"") -> Any:
        held.append(True)
        return silence(seconds, flood)

    bench.silence = disturbed  # type: ignore[method-assign]
    (found,) = Walk(bench, Yes(), []).silence()
    assert found.outcome in ("passed", "not judged"), found
    low, high = (float(word) for word in found.figure.partition(" ms")[0].split() if word.isdigit())
    assert low - 8 <= native.WATCHDOG_MS <= high + 8, found
    bench.end()


def test_what_this_computer_did_beside_a_check_is_told() -> None:
    from core.stream.acceptance.host import Host

    now, used, over = [10.0], [0.0], [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds + over[0]

    host = Host(lambda: now[0], sleep, lambda: used[0])
    host.sleep(0.5)
    now[0], used[0] = now[0] + 0.3, used[0] + 0.3  # this program worked
    host.look()
    assert host.worst(10.0) == 0.0 and not host.disturbed(10.0)
    over[0] = 0.004
    host.sleep(0.1)
    now[0] += 0.03  # and stood still
    assert host.worst(10.0) == pytest.approx(0.03) and host.lost(10.0) == pytest.approx(0.034)
    assert host.disturbed(10.0) and not host.disturbed(now[0] + 1e-6)
    assert "for up to 30 ms at a time, 0.034 s of 0.93 s" in host.words(10.0)


@posix
@pytest.mark.real_time
def test_a_board_that_says_nothing_is_judged_by_the_person(boxes: Any, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out = tmp_path / "a.md"
    box = boxes("pty", "maestro")
    accept(box.url, out, "y\nn\nn\n", "--protocol", "maestro", *only("link", "silence"))
    checks = {c["name"]: c for c in json.loads(out.with_suffix(".json").read_text("utf-8"))["checks"]}
    assert checks["silence"]["outcome"] == "failed" and checks["silence"]["judge"] == "seen"
    assert checks["link"]["outcome"] == "not tried"


@posix
@pytest.mark.real_time
def test_nobody_at_the_bench_ends_it_safely_and_says_so(boxes: Any, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out, box = tmp_path / "a.md", boxes("pty")
    done = accept(box.url, out, "y\n", *only("first-arm"))
    report = json.loads(out.with_suffix(".json").read_text("utf-8"))
    assert report["interrupted"] and report["verdict"] == "incomplete"
    assert "nobody is at the bench" in done.stderr and "Traceback" not in done.stderr
    assert box.end()["state"] == "safe"
    again = accept(box.url, out, "y\n")
    assert again.returncode == 2 and "exists" in again.stderr, "a report is not written over"


def test_a_device_that_does_not_answer_leaves_no_report(tmp_path: Path) -> None:
    out = tmp_path / "a.md"
    for _ in range(2):  # the next attempt has the same name
        done = accept(str(tmp_path / "no port"), out, "y\n")
        assert done.returncode == 2 and "exists" not in done.stderr and "Traceback" not in done.stderr
        assert not list(tmp_path.iterdir())


def test_a_report_that_cannot_be_written_moves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = accept("virtual:", tmp_path / "file" / "a.md", "y\n")
    assert done.returncode == 2 and "cannot be written" in done.stderr and "PASSED" not in done.stdout


def test_a_person_is_kept_waiting_without_the_device_falling_asleep() -> None:
    """While an answer is waited for the device hears of its sender; an end of the input is nobody."""
    from core.stream.acceptance.person import NobodyThere, Terminal

    class Slow(Terminal):
        def _read(self) -> None:
            return None

    ticks = []

    def meanwhile() -> None:
        ticks.append(1)
        if len(ticks) == 5:
            terminal._lines.put("maybe\n")
        if len(ticks) == 9:
            terminal._lines.put("Yes\n")
        if len(ticks) == 12:
            terminal._lines.put("")

    terminal = Slow(meanwhile)
    assert terminal.ask("?") is True and len(ticks) == 9
    with pytest.raises(NobodyThere):
        terminal.wait("!")
    with pytest.raises(DermisError):
        terminal.ask("?")


# -- whatever happens at the bench


class Yes:
    """A person to whom everything looks right."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def ask(self, question: str) -> bool:
        self.asked.append(question)
        return True

    wait = ask

    def number(self, question: str) -> float:
        raise NotImplementedError

    def tell(self, text: str) -> None:
        pass


def bench_for(
    key: str,
    protocol: str = "native",
    url: str = "virtual:",
    *,
    sleep: Callable[[float], None] = time.sleep,
    **request: Any,
) -> Bench:
    device = {"key": key, "preset": Library().load("devices", key)}
    return Bench(StreamRequest(url=url, protocol=protocol, device=device, **request), sleep=sleep)


def at(bench: Bench) -> np.ndarray:
    assert bench.streamer.connection is not None
    return np.array(list(bench.streamer.connection.link.report()["values"].values()))


def values(box: Any) -> np.ndarray:
    return np.array(list(box.end()["values"].values()))


@pytest.mark.real_time
def test_a_calibrated_device_goes_where_it_is_meant_to() -> None:
    """Mounted the other way round, it went 144 degrees from its safe pose where it was to hold still."""
    made = Calibration.of(Library().device("cable_platform")).with_entry("motor_1", gain=-1.0, zero=math.radians(160))
    bench = bench_for("cable_platform", calibration=made.dumps())
    bench.connect()
    walk = Walk(bench, Yes(), [])
    found = [*walk.first_arm(), *walk.motors()]
    assert [check.outcome for check in found] == ["passed"] * 4, found
    assert np.allclose(at(bench), bench.wire.safe, atol=1e-3) and bench.wire.safe[0] > 2.6
    assert bench.end() == "" and bench.streamer.connection is None


@pytest.mark.long
@pytest.mark.real_time
def test_every_pin_is_tried_and_no_speed_is_asked_of_valves() -> None:
    bench = bench_for("pin_array_128")
    bench.connect()
    walk, move = Walk(bench, Yes(), []), bench.move
    bench.move = lambda values, seconds: move(values, 0.05)  # type: ignore[method-assign]
    found = {check.name: check for check in walk.motors()}
    assert [check.outcome for check in found.values()] == ["passed"] * 4
    assert found["all other motors"].what == "125 moved in their turn"
    assert [check.outcome for check in walk.speed()] == ["does not apply"]
    assert Report({}, [*found.values(), *walk.speed()]).verdict == "accepted"
    bench.end()


MAESTRO = "virtual:?crc=1&reads=1&silence=retracts&silence_ms=100&board_crc=1&board_timeout=0.1"


@pytest.mark.real_time
def test_a_pose_that_only_an_option_of_the_address_turns_on_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    """A Maestro reports its pulses with reads=1, while it is armed; the checks took it for a board without answers."""
    bench, report = bench_for("cable_platform", "maestro", MAESTRO), Report({})
    bench.connect()
    _go(Walk(bench, Yes(), []), ["link", "first-arm", "stop"], report)
    link, first, stop = (check for check in report.checks if check.what != "left out by --only")
    said = "this protocol asks nothing while the board is not armed"
    assert (link.outcome, link.limit) == ("not tried", said) and f"link: {said}\n" in capsys.readouterr().out
    assert (
        first.what == "armed; to the safe pose"
        and (first.outcome, first.judge) == ("passed", "measured and seen")
        and first.figure.startswith("motor_1 ")
    )
    assert (stop.outcome, stop.judge, stop.figure) == ("passed", "seen", ""), "no stop is confirmed"
    assert bench.end() == ""


@pytest.mark.real_time
def test_a_maestros_channel_that_does_not_move_is_found() -> None:
    bench = bench_for("cable_platform", "maestro", MAESTRO + "&stuck=1")
    bench.connect()
    found = {check.name: check.outcome for check in Walk(bench, Yes(), []).first_arm()}
    assert found == {"first-arm": "passed"}, "its pulses are those of the safe pose after the silence of Connect"
    motors = {check.name: check.outcome for check in Walk(bench, Yes(), []).motors()}
    assert motors == {"motor motor_1": "passed", "motor motor_2": "failed", "motor motor_3": "passed"}
    assert bench.end() == ""


@pytest.mark.real_time
@pytest.mark.parametrize(("pause", "outcome", "arms"), [(0.04, "failed", 1), (0.8, "not judged", 3)])
def test_a_board_that_never_arms_is_excused_by_no_short_pause(pause: float, outcome: str, arms: int) -> None:
    """A missing PCA9685: nothing is armed, however idle this computer is."""
    asked = []

    def sleep(seconds: float) -> None:
        asked.append(1)
        time.sleep(seconds + (pause if bench._arms and len(asked) % 20 == 0 else 0.0))

    bench = bench_for("haptip", sleep=sleep)
    connect = bench.connect

    def connected() -> None:
        connect()
        bench.connection.link._server.device._configure = lambda body: None  # type: ignore[attr-defined]

    bench.connect = connected  # type: ignore[method-assign]
    bench.connect()
    (found,) = _tried("first-arm", Walk(bench, Yes(), []).first_arm, bench)
    assert (found.outcome, bench._arms) == (outcome, arms), found
    assert "did not arm within 1 s" in found.figure and "PCA9685" in found.figure
    assert ("this computer was busy" in found.figure) == (outcome == "not judged")
    bench.end()


def test_rubbish_is_not_sent_to_a_board_that_takes_it_for_commands() -> None:
    """`84 00 00 2f` is a Maestro's own word for 1504 us, and noise now and then one for 4000."""
    bench = bench_for("cable_platform", "maestro")
    bench.connect()
    assert [check.outcome for check in Walk(bench, Yes(), []).flood()] == ["not tried"]
    assert not bench.streamer.armed and not bench.streamer.counters["bytes"]
    bench.end()


@pytest.mark.long
@pytest.mark.real_time
def test_rubbish_is_tried_also_where_a_watchdog_has_just_ended_the_link() -> None:
    bench = bench_for("haptip")
    bench.connect()
    walk = Walk(bench, Yes(), [])
    walk.mover.move_away()
    bench.silence(0.1)
    bench.until(lambda: bench.streamer.connection is None, 2.0)
    assert bench.native is None
    assert [check.outcome for check in walk.flood()] == ["passed"]
    assert bench.end() == ""


@posix
@pytest.mark.long
@pytest.mark.real_time
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_a_signal_in_the_middle_brings_the_device_home(boxes: Any, tmp_path: Path, name: str) -> None:
    """Moved away, on a board that keeps its pulses; a second signal does not cut the way home short."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    out, box = tmp_path / "a.md", boxes("pty", "maestro", "cable_platform")
    verb = ["stream", "accept", "--url", box.url, "--device", "cable_platform", "--protocol", "maestro"]
    with subprocess.Popen(
        command(*verb, "--out", str(out), *only("silence")),
        env=environment(),
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as run:
        assert run.stdin is not None and run.stdout is not None
        run.stdin.write("\n")
        run.stdin.flush()
        said = ""
        while "has it let go" not in said:
            letter = run.stdout.read(1)
            assert letter, f"it ended too soon: {said}"
            said += letter
        number = getattr(signal, name)
        for _ in range(2):
            run.send_signal(number)
            time.sleep(0.03)
        _, errors = run.communicate(timeout=30)
    assert run.returncode == 128 + number and "Stopping" in errors and "Traceback" not in errors
    assert np.allclose(values(box), Wire.of(Library().device("cable_platform")).safe, atol=3e-3)
    assert json.loads(out.with_suffix(".json").read_text("utf-8"))["interrupted"]


@posix
@pytest.mark.long
@pytest.mark.real_time
def test_what_another_program_has_left_anywhere_is_brought_home(boxes: Any) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box = boxes("pty", "maestro", "cable_platform")
    killed = bench_for("cable_platform", "maestro", box.url)
    killed.arm()
    killed.move(killed.wire.safe + 1.0, 0.5)
    assert killed.streamer.connection is not None
    killed.streamer.connection.link.close()
    bench = bench_for("cable_platform", "maestro", box.url)
    bench.connect()
    with bench.apart():
        pass
    assert bench.end() == ""
    assert np.allclose(values(box), bench.wire.safe, atol=3e-3)


@posix
@pytest.mark.long
@pytest.mark.real_time
def test_a_device_that_dies_in_the_middle_fails_and_is_not_called_safe(boxes: Any, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box, port = boxes("pty", "maestro", "cable_platform"), tmp_path / "port"
    port.symlink_to(box.url)  # the system gives the name of a pty that has gone to the next one of anybody
    bench = bench_for("cable_platform", "maestro", str(port))
    bench.connect()
    walk = Walk(bench, Yes(), [])
    bench.arm()
    port.unlink()
    box.process.kill()
    box.process.wait()
    tried = list(_tried("motors", walk.motors, bench)) + list(_tried("rate", walk.rate, bench))
    assert [check.outcome for check in tried] == ["failed", "failed"], tried
    words = bench.end()
    assert words
    report = Report({}, [Check("a", "w", "passed")], unsafe=words)
    assert report.verdict == "not accepted" and "may not have been left in its safe state" in report.markdown(WHEN)


def test_only_whole_words_are_answers() -> None:
    from core.stream.acceptance.person import Terminal

    class Typed(Terminal):
        def _read(self) -> None:
            for line in ("stop\n", "you tell me\n", "nothing\n", "no\n"):
                self._lines.put(line)

    typed = Typed(lambda: None)
    assert typed.ask("?") is False and typed._lines.empty()


@pytest.mark.parametrize("name", ["a.json", "a.md"])
def test_no_report_is_written_over_another(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.json").write_text("kept")
    done = accept("virtual:", tmp_path / name, "y\n")
    assert done.returncode == 2 and (tmp_path / "a.json").read_text() == "kept"
    assert not (tmp_path / "a.md").exists()
