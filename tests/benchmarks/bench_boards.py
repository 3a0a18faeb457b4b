"""Boards that labs own: packets against the makers' SDKs, and whether every value reaches a simulated board."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import Result, benchmark

VALUES = 10_000
PACKETS = 1500
# protocol, options of the address, settings of the simulated board
BOARDS: tuple[tuple[str, dict[str, str], dict[str, float]], ...] = (
    ("maestro", {"crc": "1", "device": "5"}, {"board_crc": 1.0, "board_number": 5.0}),
    ("dynamixel", {}, {}),
    ("feetech", {}, {}),
    ("feetech", {"series": "scs"}, {"board_scs": 1.0}),
    ("servo-animation", {}, {}),
    ("osc", {}, {}),
)


@benchmark("sdk_packets_equal", limit=None)
def sdk_packets_equal() -> Result:
    """Share of random packets of smart servos that are those of the makers' SDKs, byte for byte."""
    from tests import servo_sdks

    if not servo_sdks.there():
        return Result("sdk_packets_equal", None, "", None, {}, servo_sdks.MISSING)
    made = list(servo_sdks.pairs(PACKETS))
    equal = sum(theirs == ours for theirs, ours in made) / len(made)
    wrong = None if equal == 1.0 else "packets differ"
    return Result("sdk_packets_equal", equal, "1", None, {"packets": float(len(made))}, wrong)


@benchmark("board_values_lost", limit=0.0)
def board_values_lost() -> Result:
    """Random values that do not arrive at a simulated board as its protocol carries them, of 10,000 on each."""
    lost = {}
    for protocol, options, settings in BOARDS:
        name = " ".join((protocol, *options.values()))
        lost[name] = float(_lost(protocol, options, settings))
    lost["native-wifi"] = float(_lost_over_wifi())
    return Result("board_values_lost", sum(lost.values()), "", None, lost)


def _lost_over_wifi() -> int:
    """Return how many values of 10,000 do not arrive at the sketch, whole, as real datagrams of 127.0.0.1."""
    from tests.unit.stream.firmware_board import Sender, servos, wanted_us
    from tests.unit.stream.firmware_host import MISSING, WifiBoard

    if MISSING:
        raise RuntimeError(f"the sketch cannot be compiled, for want of {', '.join(MISSING)}")
    lost, rng = 0, np.random.default_rng(6)
    with WifiBoard("-DDERMIS_CHANNELS=8") as board:
        sender = Sender(board, servos(8))
        sender.arm()
        for values in rng.uniform(-1, 1, (VALUES // 8, 8)):
            sender.command(values)
            sender.run(0.025, 0.0125)
            board.pulses.clear()
            sender.run(0.02, 0.01)
            widths = board.widths()
            lost += sum(abs(widths.get(i, 0.0) - w) > 1.0 for i, w in enumerate(wanted_us(values)))
    return lost


def _lost(protocol: str, options: dict[str, str], settings: dict[str, float]) -> int:
    from core.presets import Library
    from core.stream.protocols import adapters
    from core.stream.protocols.wire import Wire
    from core.stream.virtual.device import make

    wire = Wire.of(Library().device("haptip"))
    adapter, device = adapters.make(protocol, wire, options), make(protocol, wire, settings)
    board: Any = device
    for servo in getattr(board, "servos", ()):
        servo.memory[board.TORQUE] = 1
    lost, rng = 0, np.random.default_rng(6)
    for k, values in enumerate(rng.uniform(wire.range_low, wire.range_high, (VALUES, wire.count))):
        for message in adapter.command(values, 0.02 * k, None):
            device.feed(message, 0.02 * k)
        told = np.array(list(board.report()["values"].values()))
        reach = 2e-3 * (wire.range_high - wire.range_low)  # Servo Animation has 1,000 positions
        lost += not bool((np.abs(told - adapter.carried(values)) <= reach).all())
    return lost
