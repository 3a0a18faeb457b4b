"""The C header: compiled, played, and compared with the track that it was written from."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.formats import c_header, check
from core.track import CommandTrack

SPEC = DeviceSpec(
    "dev", "Two servos */ and a trap", "test", 50.0,
    (Channel("only_tells", "m"), Channel("a", "rad", -1.0, 1.0, None, 0.0, "s1"),
     Channel("b", "rad", 0.0, 2.0, None, 2.0, "s2")),
)  # fmt: skip


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


def test_the_player_gives_the_track(tmp_path: Path) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("NO C COMPILER: the player of the C header was not run (install gcc)")
    track = a_track()
    c_header.write(track, tmp_path / "clip.h")
    (tmp_path / "main.c").write_text(MAIN)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1"]
    subprocess.run([compiler, *flags, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    times = [*range(0, 780_000, 777), 20_000, 779_999, 780_000, 4_000_000_000]
    done = subprocess.run([tmp_path / "main"], input="\n".join(map(str, times)), text=True, capture_output=True,
                          check=True)  # fmt: skip
    rows = np.array([[int(n) for n in line.split()] for line in done.stdout.splitlines()])
    inside = np.array(times) < 780_000
    assert rows[:, 0].tolist() == inside.astype(int).tolist()
    assert (rows[~inside, 1:] == [32768, 65535]).all(), "at its end the rest pose"
    t = np.array(times)[inside] * 1e-6
    for column, (channel, low) in enumerate(((1, -1.0), (2, 0.0))):
        wanted = (np.interp(t, track.times, track.values[:, channel]) - low) / 2.0 * 65535
        assert np.abs(rows[inside, 1 + column] - wanted).max() <= 1.5  # half a count of each end, one of the division


def test_avr_takes_it(tmp_path: Path) -> None:
    compiler = shutil.which("avr-gcc")
    if compiler is None:
        pytest.skip("NO avr-gcc: the C header was not compiled for a microcontroller (install gcc-avr avr-libc)")
    c_header.write(a_track(), tmp_path / "clip.h")
    (tmp_path / "main.c").write_text('#include "clip.h"\nuint16_t c[2];\nint main(void) { return clip_play(5, c); }\n')
    flags = ["-mmcu=atmega328p", "-Os", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, "main.c", "-o", "main.elf"], cwd=tmp_path, check=True)


def test_counts_by_hand() -> None:
    table, columns = c_header.counts(a_track())
    assert columns == [1, 2]
    assert table[:2].tolist() == [[0, 0], [65535, 65535]]


def test_what_it_cannot_hold() -> None:
    with pytest.raises(DermisError, match="microseconds apart"):
        c_header.dumps(a_track().resampled(30.0), "clip")
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
