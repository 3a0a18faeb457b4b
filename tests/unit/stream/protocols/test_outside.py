"""Adapters from outside this package: found by name, refused in words, and safe by the same declaration."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.presets import Library
from core.stream.links.transport import Transport
from core.stream.protocols import adapters
from core.stream.protocols.silence import Does, Silence
from core.stream.protocols.wire import Wire
from tests.unit.stream.stream_lab import TICK, Lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

OUTSIDE = Path(__file__).parents[3] / "adapters"
FAR = {f"motor_{k}": 2.79 for k in (1, 2, 3)}
COUNT = 2 * np.pi / 4096


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(adapters.FOLDERS, str(OUTSIDE))


class Bus:
    """Three servos that answer position reads, and stop by themselves after 100 ms: their bus watchdog."""

    datagrams = False

    def __init__(self, wire: Wire) -> None:
        self.counts = np.full(wire.count, 2048)
        self.wire, self.torque, self.heard = wire, np.zeros(wire.count, bool), 0.0

    def feed(self, data: bytes, now: float) -> list[bytes]:
        from tests.adapters import dynamixel

        assert data[:4] == dynamixel.HEADER and struct.unpack("<H", data[-2:])[0] == dynamixel.crc(data[:-2])
        body, out = data[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd"), []
        if body[0] == dynamixel.SYNC_WRITE:
            self.heard = now
            for at in range(5, len(body), 5):
                servo, count = struct.unpack_from("<Bi", body, at)
                self.counts[servo - 1] = count
        elif body[0] == dynamixel.SYNC_READ:
            for servo in body[5:]:
                answer = b"\0" + struct.pack("<i", int(self.counts[servo - 1]))
                out.append(dynamixel.packet(servo, dynamixel.STATUS, answer))
        elif body[1] == dynamixel.TORQUE:
            self.torque[data[4] - 1] = bool(body[3])
        return out

    def tick(self, now: float) -> list[bytes]:
        return []

    def report(self) -> dict[str, Any]:
        return {"values": self.wire.named((self.counts - 2048) * COUNT)}


def lab(**more: Any) -> Lab:
    """Give a cable platform of three Dynamixels."""

    class Bench(Lab):
        def _open(self, url: Any, wire: Wire, protocol: str) -> Transport:
            assert protocol == "other"
            self.device = Bus(wire)
            bench, link = self, Transport()
            bench._answers = []

            def send(message: bytes) -> bool:
                bench.sent.append((bench.now, message))
                bench._answers += bench.device.feed(message, bench.now)
                return True

            def receive() -> list[bytes]:
                out, bench._answers = bench._answers, []
                return out

            link.send, link.receive = send, receive  # type: ignore[method-assign]
            return link

    return Bench("other", "cable_platform", mode="jog", jog=FAR, url="lab?adapter=dynamixel", ramp=0.0, **more)


def test_a_servo_bus_from_outside_is_driven_and_led_home() -> None:
    bench = lab()
    bench.begin(0.6)
    assert np.allclose(bench.at, 2.79, atol=COUNT) and bench.device.torque.all()
    assert bench.streamer.status()["silence"]["does"] == "stops"
    bench.stops += 1
    path = [bench.at]
    bench.run(0.5, lambda: path.append(bench.at))
    assert np.abs(np.diff(np.array(path), axis=0)).max() <= np.radians(600) * 0.02 + COUNT
    assert np.allclose(path[-1], bench.device.wire.safe, atol=COUNT)


def test_its_declaration_decides_after_a_suspension() -> None:
    bench = lab()
    bench.begin(0.6)
    bench.now += 3.0
    path = [bench.at]
    bench.run(0.6, lambda: path.append(bench.at))
    assert np.abs(np.diff(np.array(path), axis=0)).max() <= np.radians(600) * 0.02 + COUNT, "from where it stopped"
    assert np.allclose(path[-1], bench.device.wire.safe, atol=COUNT) and not bench.streamer.armed
    del bench.sent[:]
    bench.run(100 * TICK)
    assert not any(message[7] == 0x83 for _, message in bench.sent), "it is asked for its pose, and moved no more"


def test_adapters_are_found_by_name() -> None:
    assert adapters.names() == ["dynamixel"]
    made = adapters.make("other", Wire.of(Library().device("cable_platform")), {"adapter": "dynamixel", "first": "7"})
    assert made.silence == Silence(Does.STOPS, 0.1, "board") and made.ids[0] == 7  # type: ignore[attr-defined]
    assert adapters.make("other", made.wire, made.options).ids[0] == 7, "as the log's process makes it"  # type: ignore[attr-defined]
    assert type(made) is adapters.adapter_of("other", {"adapter": "dynamixel"}), "a file is run once"


@pytest.mark.parametrize("name", ["", "nobody", "../dynamixel", "/tmp/x", "dynamixel.py", "Dynamixel"])
def test_a_name_that_is_none_is_refused_and_says_which_there_are(name: str) -> None:
    with pytest.raises(DermisError) as refused:
        adapters.adapter_of("other", {"adapter": name})
    assert "dynamixel" in str(refused.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def adapter(api): return 3", "not an adapter"),
        ("def adapter(api): return api.Adapter", "not an adapter"),
        ("def adapter(api): raise ValueError('no bus')", "ValueError: no bus"),
        ("def adapter(api: ", "SyntaxError"),
        ("x = 1", "defines no function adapter(api)"),
    ],
)
def test_a_broken_adapter_is_one_sentence(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken.py").write_text(text)
    monkeypatch.setenv(adapters.FOLDERS, str(tmp_path))
    with pytest.raises(DermisError) as refused:
        adapters.adapter_of("other", {"adapter": "broken"})
    assert words in str(refused.value) and ("broken.py" in str(refused.value))


RAISER = """
import struct

def adapter(api):
    class Raiser(api.adapter_of("maestro")):
        OPTIONS = (*api.adapter_of("maestro").OPTIONS, "fails")
        name = "raiser"

        def __init__(self, wire, options):
            super().__init__(wire, options)
            self.bad = False
            method = getattr(self, options["fails"])

            def failing(*arguments, **named):
                if self.bad:
                    struct.unpack("<I", b"")
                return method(*arguments, **named)

            setattr(self, options["fails"], failing)

    return Raiser
"""


@pytest.mark.parametrize("method", [*adapters.FALLBACKS])
def test_an_adapter_that_raises_does_not_take_the_way_to_safety_along(
    method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A parser's struct.error ends the stream with a reason; the ramp goes on, or the supply is to be switched off."""
    from core.stream.virtual.maestro import MaestroDevice

    (tmp_path / "raiser.py").write_text(RAISER)
    monkeypatch.setenv(adapters.FOLDERS, str(tmp_path))
    monkeypatch.setattr(adapters.API, "adapter_of", adapters.adapter_of, raising=False)

    class Bench(Lab):
        def _open(self, url: Any, wire: Wire, protocol: str) -> Transport:
            link = super()._open(url, wire, "maestro")
            assert isinstance(self.device, MaestroDevice)
            receive = link.receive
            link.receive = lambda: receive() or [b"an answer"]  # type: ignore[method-assign]
            return link

    url = f"lab?adapter=raiser&silence=keeps&fails={method}"
    bench = Bench("other", "cable_platform", mode="jog", jog=FAR, url=url, ramp=0.0)
    bench.begin(0.6)
    assert np.allclose(bench.at, 2.79, atol=0.01), bench.streamer.message
    bench.streamer.connection.adapter.bad = True  # type: ignore[union-attr]
    device, path = bench.device, [bench.at]

    def note() -> None:
        path.append(np.array(list(device.report()["values"].values())))

    bench.run(0.05, note)
    bench.stops += 1
    bench.run(2.5, note)
    assert not bench.streamer.armed
    if method == "command":
        assert "Switch its supply off" in bench.streamer.message
        assert "'command': error: unpack" in bench.streamer.message
    else:
        assert np.allclose(path[-1], device.wire.safe, atol=0.01), bench.streamer.message
        assert np.abs(np.diff(np.array(path), axis=0)).max() <= np.radians(600) * 0.02 + 0.003


@pytest.mark.parametrize("value", ["None", "0", "'abc'", "b'abc'", "[3]", "['abc']"])
@pytest.mark.parametrize("method", ["poll", "command", "retract", "safe"])
def test_values_that_are_no_messages_are_faults(
    method: str, value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = f"    class A(api.Adapter):\n        def {method}(self, *a, **k): return {value}"
    (tmp_path / "values.py").write_text(f"def adapter(api):\n{body}\n    return A")
    monkeypatch.setenv(adapters.FOLDERS, str(tmp_path))
    made = adapters.make("other", Wire.of(Library().device("cable_platform")), {"adapter": "values"})
    given = (np.zeros(3), 0.0, None) if method == "command" else (0.0,) if method == "poll" else ()
    answer = getattr(made, method)(*given)
    if method == "retract" and value == "None":
        assert answer is None and not made.fault
        return
    assert answer == ([] if method != "retract" else None)
    assert f"failed in '{method}': TypeError" in made.fault and made.broken == (method == "command")
