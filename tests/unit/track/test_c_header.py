"""The C header: compiled, played, and compared with the track that it was written from."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.track import c_header, check
from core.track.command_track import CommandTrack

pytestmark = pytest.mark.one_line("3.13", "the header is C, compiled by the system's compiler")

SPEC = DeviceSpec(
    "dev",
    "Two servos */ and a trap",
    "test",
    50.0,
    (
        Channel("only_tells", "m"),
        Channel("a", "rad", -1.0, 1.0, None, 0.0, "s1"),
        Channel("b", "rad", 0.0, 2.0, None, 2.0, "s2"),
    ),
)


def a_track(n: int = 40) -> CommandTrack:
    rng = np.random.default_rng(3)
    values = np.column_stack([np.zeros(n), rng.uniform(-1, 1, n), rng.uniform(0, 2, n)])
    values[:2, 1:] = [[-1, 0], [1, 2]]  # both ends
    return CommandTrack(SPEC, np.arange(n) / 50.0, values)


MAIN = r"""
#include <stdio.h>
#include "clip.h"
int main(void) {
  uint16_t counts[CLIP_CHANNELS]; unsigned long t;
  while (scanf("%lu", &t) == 1) {
    int on = clip_play((uint32_t)t, counts);
    printf("%d %u %u\n", on, counts[0], counts[1]);
  }
  return 0;
}
"""


def play(folder: Path, track: CommandTrack, times: list[int]) -> NDArray[np.int64]:
    """Compile a track's header; return what its player says at times [us]: running, and the counts of two channels."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("NO C COMPILER: the player of the C header was not run (install gcc)")
    c_header.write(track, folder / "clip.h")
    (folder / "main.c").write_text(MAIN)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1"]
    subprocess.run([compiler, *flags, "main.c", "-o", "main"], cwd=folder, check=True)
    done = subprocess.run(
        [folder / "main"], input="\n".join(map(str, times)), text=True, capture_output=True, check=True
    )
    return np.array([[int(n) for n in line.split()] for line in done.stdout.splitlines()])


def test_the_player_gives_the_track(tmp_path: Path) -> None:
    track = a_track()
    times = [*range(0, 780_000, 777), 20_000, 779_999, 780_000, 4_000_000_000]
    rows = play(tmp_path, track, times)
    inside = np.array(times) < 780_000
    assert rows[:, 0].tolist() == inside.astype(int).tolist()
    assert (rows[~inside, 1:] == [32768, 65535]).all(), "at its end the rest pose"
    t = np.array(times)[inside] * 1e-6
    for column, (channel, low) in enumerate(((1, -1.0), (2, 0.0))):
        wanted = (np.interp(t, track.times, track.values[:, channel]) - low) / 2.0 * 65535
        assert np.abs(rows[inside, 1 + column] - wanted).max() <= 1.5  # half a count of each end, one of the division


@pytest.mark.parametrize(
    ("rate", "period", "seconds"),
    [
        (240.0, Fraction(12_500, 3), 4290),  # pins; over 71 minutes, all but what micros() counts
        (1000.0, Fraction(1000), 300),
        (24000 / 1001, Fraction(125_125, 3), 4290),  # more than 16 bits of time
        (7.0, Fraction(1_000_000, 7), 4290),
        (999.0, Fraction(1_000_000, 999), 300),
    ],
)
def test_the_player_keeps_time_over_a_long_track(tmp_path: Path, rate: float, period: Fraction, seconds: float) -> None:
    """At a clock's whole microseconds the exact position between samples, in integers: not one count of drift."""
    n = int(seconds * rate)
    rng = np.random.default_rng(4)
    values = np.column_stack([np.zeros(n), rng.choice([-1.0, 1.0], n), rng.uniform(0, 2, n)])
    track = CommandTrack(replace(SPEC, rate=rate), np.arange(n) / rate, values)
    table, _ = c_header.counts(track)
    end = math.ceil((n - 1) * period)  # the first microsecond that is not before the last sample
    samples = [0, 1, 2, 3, n // 2, n // 2 + 1, n - 3, n - 2, *rng.integers(0, n - 1, 200).tolist()]
    times = [t for k in samples for t in (math.ceil(k * period), math.ceil((k + 1) * period) - 1)]
    times += [*rng.integers(0, end, 500).tolist(), end - 1, end, end + 1]
    rows = play(tmp_path, track, times)
    for t, (on, *got) in zip(times, rows.tolist(), strict=True):
        assert on == (t < end), t
        if not on:
            continue
        sample, part = divmod(t * period.denominator, period.numerator)
        for c, count in enumerate(got):
            before, after = int(table[sample, c]), int(table[sample + 1, c])
            step = abs(after - before) * part // period.numerator
            assert count == before + (step if after > before else -step), f"{t} us, sample {sample} of {n}"


def test_the_header_tells_its_version_and_period() -> None:
    text = c_header.dumps(a_track().resampled(240.0), "clip")
    for line in ("CLIP_FORMAT 2u", "CLIP_PERIOD_US 12500ul", "CLIP_PERIOD_SAMPLES 3ul"):
        assert f"#define {line}\n" in text
    assert "3 samples in 12500 us, exactly" in text
    whole = c_header.dumps(a_track(), "clip")
    assert "#define CLIP_PERIOD_US 20000ul\n#define CLIP_PERIOD_SAMPLES 1ul\n" in whole


def test_two_samples_are_enough_to_play(tmp_path: Path) -> None:
    """From one end of both ranges to the other in 20 ms; then it is over, and both are at rest."""
    got = play(tmp_path, a_track(2), [0, 10_000, 19_999, 20_000])
    assert got[0].tolist() == [1, 0, 0] and got[3].tolist() == [0, 32768, 65535]
    assert np.abs(got[1] - [1, 32768, 32768]).max() <= 1 and np.abs(got[2] - [1, 65532, 65532]).max() <= 1


@pytest.mark.parametrize("rate", [0.12, 1.1, 13.7, 29.97, 59.94, 123.456, 240.00001, 7777.0])
def test_a_rate_without_an_exact_period_gets_one_that_is_right_to_a_part_in_10_to_the_7(rate: float) -> None:
    track = replace(a_track(), spec=replace(SPEC, rate=rate), times=np.arange(40) / rate)
    text = c_header.dumps(track, "clip")
    number = {k: int(v) for k, v in re.findall(r"#define CLIP_PERIOD_(\w+) (\d+)ul", text)}
    period = Fraction(number["US"], number["SAMPLES"])
    assert abs(period * Fraction(rate) / 10**6 - 1) <= Fraction(1, 10**7)
    assert number["US"] * number["SAMPLES"] < 2**32 and number["US"] <= 2**23, "what 32 bits hold"


@pytest.mark.parametrize("rate", [50.0, 240.0, 24000 / 1001])
def test_avr_takes_it(tmp_path: Path, rate: float) -> None:
    compiler = shutil.which("avr-gcc")
    if compiler is None:
        pytest.skip("NO avr-gcc: the C header was not compiled for a microcontroller (install gcc-avr avr-libc)")
    c_header.write(a_track().resampled(rate), tmp_path / "clip.h")
    (tmp_path / "main.c").write_text('#include "clip.h"\nuint16_t c[2];\nint main(void) { return clip_play(5, c); }\n')
    flags = ["-mmcu=atmega328p", "-Os", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, "main.c", "-o", "main.elf"], cwd=tmp_path, check=True)


def test_counts_by_hand() -> None:
    table, columns = c_header.counts(a_track())
    assert columns == [1, 2]
    assert table[:2].tolist() == [[0, 0], [65535, 65535]]


def test_what_it_cannot_hold() -> None:
    uneven = a_track()
    with pytest.raises(DermisError, match="not evenly spaced"):
        c_header.dumps(replace(uneven, times=uneven.times + np.r_[np.zeros(39), 1e-3]), "clip")
    for rate in (0.1, 2e6):
        odd = replace(a_track(), spec=replace(SPEC, rate=rate), times=np.arange(40) / rate)
        with pytest.raises(DermisError, match="clock of microseconds cannot keep"):
            c_header.dumps(odd, "clip")
    hours = CommandTrack(replace(SPEC, rate=1.0), np.arange(4296.0), np.zeros((4296, 3)))
    with pytest.raises(DermisError, match="longer than a clock"):
        c_header.dumps(hours, "clip")  # micros() would be back at 0 before its end, and play it again
    c_header.dumps(replace(hours, times=hours.times[:-1], values=hours.values[:-1]), "clip")
    with pytest.raises(DermisError, match="two samples"):
        c_header.dumps(replace(a_track(), times=np.zeros(1), values=np.zeros((1, 3))), "clip")
    wild = a_track()
    wild.values[3, 1] = 1.5
    with pytest.raises(DermisError, match="outside the channel's range"):
        c_header.dumps(wild, "clip")
    with pytest.raises(DermisError, match="identifier"):
        c_header.dumps(a_track(), "Clip-1")
    assert c_header.identifier("1 Daumen.haptip") == "track_1_daumen_haptip"


def codes(track: CommandTrack, **more: int) -> set[str]:
    return {f.code for f in check.findings_of(track, **more)}


def test_checks_beyond_the_track_s_own() -> None:
    t = np.arange(0, 2.0, 1 / 50)
    wave = np.sin(2 * np.pi * 2.0 * t)  # largest acceleration (4 pi)^2 = 157.9
    track = CommandTrack(SPEC, t, np.column_stack([t * 0, wave, 0 * t + 1]))
    assert codes(track) == set()
    for limit, expected in ((170.0, set()), (150.0, {"acceleration"})):
        assert codes(replace(track, spec=replace(SPEC, parameters={"acceleration.a": limit}))) == expected
    for limit, expected in ((5.0, set()), (1.0, {"bandwidth"})):
        assert codes(replace(track, spec=replace(SPEC, parameters={"bandwidth.a": limit}))) == expected
    for resolution, expected in ((1e-4, set()), (1e-5, {"coarse"})):  # a count is 2 / 65535 = 3.05e-5
        fine = replace(SPEC, parameters={"resolution.a": resolution})
        assert codes(replace(track, spec=fine), levels=65536) == expected
    small = replace(track, values=track.values * [1, 1e-4, 1])
    assert codes(small, levels=65536) == {"quantisation"}
    unbounded = replace(SPEC, channels=(SPEC.channels[0], Channel("a", "rad", actuator="s1"), SPEC.channels[2]))
    assert "no-range" in codes(replace(track, spec=unbounded), levels=65536)
