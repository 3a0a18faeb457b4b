"""The sketch on its emulated board: how soon it is safe whatever is on its line, and how well it plays a fast track.

simavr counts clock cycles, so these figures do not depend on the machine; they are emulated, no board was measured.
"""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

from . import Result, benchmark
from .bench_haptip import sampled, scene

COMMANDS = 5000


def needed() -> None:
    """Say what is missing for an emulated board."""
    from tests.unit.stream.firmware_avr import MISSING

    if MISSING:
        raise RuntimeError(f"no emulated board, for want of {', '.join(MISSING)}")


@benchmark("flood_safe_ms", limit=100.0)
def floods() -> Result:
    """Time from the last valid packet to a pulse that has moved towards safe: slowest channel, flood, build.

    Over Wi-Fi, on the host build, a board's silence is 60 to 400 ms, and 200 of a new link. The shortest counts here;
    that of a new link may last as much longer as it is longer.
    """
    needed()
    from tests.unit.stream.firmware_avr import AvrBoard
    from tests.unit.stream.firmware_board import BAUD
    from tests.unit.stream.firmware_floods import ARRIVES, FLOODS, FRAME_US, ROUNDING_US, flood
    from tests.unit.stream.firmware_host import CHIPS, CROSS_MISSING, WifiBoard, chip_of
    from tests.unit.stream.firmware_wifi import SILENCES, WIFI_FLOODS, wifi_flood

    others = {"PCA9685": lambda: AvrBoard("-DDERMIS_PCA9685=1")}  # its rounds last 22 ms, its steps are 4.9 us
    others |= {} if CROSS_MISSING else {name: functools.partial(chip_of, name) for name in CHIPS}
    others["Wi-Fi, sealed as its sender did"] = WifiBoard
    worst_of, above = {}, []
    for build, made in others.items():
        found = []
        for name in FLOODS:
            with made() as board:
                found.append(flood(board, name, BAUD))
        worst_of[build] = 1e3 * max(f.begins for f in found)
        allowed = 1.1 * FRAME_US + 4.9 if build == "PCA9685" else FRAME_US + ROUNDING_US
        if (steep := max(f.steepest for f in found)) > allowed:
            above.append(f"{build}: {steep:.1f} us from one pulse to the next, above {allowed:g}")
    default = f"Wi-Fi, {SILENCES[1]} ms of silence"
    for silence in SILENCES:
        found = []
        for name in WIFI_FLOODS:
            with WifiBoard() as board:
                found.append(wifi_flood(board, name, silence))
        worst_of[f"Wi-Fi, {silence} ms of silence"] = 1e3 * max(f.begins for f in found)
        if (steep := max(f.steepest for f in found)) > FRAME_US + ROUNDING_US:
            above.append(f"Wi-Fi: {steep:.1f} us from one pulse to the next, above {FRAME_US:g}")
    if (late := worst_of[default] - SILENCES[1] + 50.0) > 100.0:
        above.append(f"{default}: {worst_of[default]:.0f} ms, {late - 100:.0f} later than that allows")
    done = {}
    for name in FLOODS:
        with AvrBoard() as board:
            done[name] = flood(board, name, BAUD)
    begins = {name: 1e3 * f.begins for name, f in done.items()}
    worst = max(begins, key=lambda name: begins[name])
    steepest = max(f.steepest for f in done.values())
    peers = {
        f"{len(done)} floods, worst: {worst}": begins[worst],
        "silence": begins["silence"],
        "at the safe pose": 1e3 * max(f.arrives for f in done.values()),
        **worst_of,
    }
    stopped = [name for name, f in done.items() if f.arrives > ARRIVES]
    error = None
    if steepest > FRAME_US + ROUNDING_US:
        error = f"{steepest:.1f} us from one pulse to the next, above {FRAME_US:g}"
    elif stopped:
        error = f"not at the safe pose within {1e3 * ARRIVES:.0f} ms: {', '.join(stopped)}"
    elif above:
        error = "; ".join(above)
    counted = [value for build, value in worst_of.items() if build != default]
    return Result("flood_safe_ms", max(begins[worst], *counted), "ms", None, peers, error)


@benchmark("haptip_on_sketch_pulse_error_us", limit=4.0)
def haptip_on_sketch() -> Result:
    """Error of each pulse against the played track at its own time, over 5,000 commands at 1 kHz; a bake beside it."""
    needed()
    import numpy as np

    from core.matching.shear_tactor import render
    from core.presets import Library
    from core.track import binary
    from tests.unit.stream.firmware_lab import play, slow_track

    folder = Path(tempfile.mkdtemp(prefix="dermis-bench-"))
    slow = play(slow_track(folder / "slow.dtrack", COMMANDS / 1000), COMMANDS / 1000)
    header, chunks = scene()
    spec = Library().device("haptip")
    binary.write(
        render(sampled(header, chunks), header, 0, header.fingers[0].devices[0], spec).track.within_limits(),
        folder / "baked.dtrack",
    )
    baked = play(folder / "baked.dtrack", COMMANDS / 1000)
    errors = np.abs(slow.errors)
    error = None
    for run in (slow, baked):
        if run.received != run.sent or any(run.counted.values()) or run.overruns:
            error = f"of {run.sent} commands {run.received} were taken; {run.counted}, {run.overruns} overruns"
    return Result(
        "haptip_on_sketch_pulse_error_us",
        float(errors.max()),
        "us",
        float(np.percentile(errors, 95)),
        {
            "baked taps and strokes, p95": float(np.percentile(np.abs(baked.errors), 95)),
            "baked, worst": float(np.abs(baked.errors).max()),
        },
        error,
    )
