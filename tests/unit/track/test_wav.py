"""WAV files: read back by Python's wave and by scipy, compared with the formula, and refused where voltage is lost."""

from __future__ import annotations

import json
import struct
import wave
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import wavfile

from core.errors import DermisError
from core.presets import Library
from core.track import export, wav
from core.track.command_track import CommandTrack

SCREEN = Library().device("electrovibration")


def a_track(volts: Any = 200.0, carrier: Any = 60.0, n: int = 501) -> CommandTrack:
    values = np.column_stack([np.broadcast_to(volts, n), np.broadcast_to(carrier, n)]).astype(float)
    return CommandTrack(SCREEN, np.arange(n) / 1000.0, values, {"finger": "Zeigefinger ä"})


def put(track: CommandTrack, folder: Path, **settings: Any) -> Path:
    path = folder / "t.wav"
    export.write(track, path, "wav", settings=settings)
    return path


def chunks(data: bytes) -> dict[bytes, bytes]:
    """Walk a RIFF file by the format's own rules."""
    assert data[:4] == b"RIFF" and data[8:12] == b"WAVE" and struct.unpack("<I", data[4:8])[0] == len(data) - 8
    return walk(data[12:])


def walk(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 0
    while at < len(data):
        size = struct.unpack_from("<I", data, at + 4)[0]
        found[data[at : at + 4]] = data[at + 8 : at + 8 + size]
        at += 8 + size + size % 2
    assert at == len(data)
    return found


def info(path: Path) -> dict[bytes, str]:
    listed = chunks(path.read_bytes())[b"LIST"]
    assert listed[:4] == b"INFO"
    return {key: text.rstrip(b"\0").decode("ascii") for key, text in walk(listed[4:]).items()}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rate", [48_000, 96_000, 192_000])
def test_both_readers_find_the_voltage(rate: int, tmp_path: Path) -> None:
    path = put(a_track(200.0, 110.0), tmp_path, rate=rate)
    with wave.open(str(path)) as file:
        assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (1, 3, rate)
        assert file.getnframes() == rate // 2 + 1
        raw = file.readframes(file.getnframes())
    found_rate, counts = wavfile.read(path)  # 24 bits in the upper ones of 32
    assert found_rate == rate
    again = np.frombuffer(b"".join(b"\0" + raw[i : i + 3] for i in range(0, len(raw), 3)), "<i4")
    assert np.array_equal(again, counts)
    volts = counts / 256 / wav.COUNTS * 300.0
    wanted = 200.0 * np.sin(2 * np.pi * 110.0 * np.arange(len(volts)) / rate)
    np.testing.assert_allclose(volts, wanted, rtol=0, atol=300.0 / wav.COUNTS)


def test_gain_and_full_scale_are_in_the_file_and_give_the_voltage_back(tmp_path: Path) -> None:
    path = put(a_track(200.0), tmp_path, gain=150.0, full_scale=2.0)
    said = info(path)
    header = json.loads(said[b"ICMT"])
    told = header["wave"]
    assert header["schema"] == "dermis-track-wav 1" and header["meta"]["finger"] == "Zeigefinger ä"
    assert (told["gain"], told["full_scale"], told["open_loop"], told["clipped"]) == (150.0, 2.0, True, 0)
    assert "open loop" in said[b"ISBJ"] and said[b"ISFT"].startswith("Dermis ") and "Electro" in said[b"INAM"]
    peak = np.abs(wavfile.read(path)[1] / 256.0).max() / told["counts"] * told["gain"] * told["full_scale"]
    assert peak == pytest.approx(200.0, rel=1e-5)
    assert json.loads(info(put(a_track(), tmp_path, gain=150.0))[b"ICMT"])["wave"]["full_scale"] == 2.0  # 300 V / 150


def test_beyond_full_scale_is_refused_with_channel_time_value_limit_and_remedy(tmp_path: Path) -> None:
    volts = np.full(501, 100.0)
    volts[300:] = 250.0
    with pytest.raises(DermisError) as error:
        put(a_track(volts), tmp_path, full_scale=200.0)
    assert error.value.code == "beyond-full-scale" and not list(tmp_path.iterdir())
    assert "amplitude, first at 0.30" in error.value.where and "200 V" in error.value.limit and error.value.remedy
    assert abs(float(str(error.value.value).split()[0])) == pytest.approx(250.0, rel=1e-3)
    found = export.write(a_track(volts), tmp_path / "t.wav", "wav", settings={"full_scale": 200.0, "clip": True})
    clipped = next(f for f in found if f.code == "clipped")
    counts = wavfile.read(tmp_path / "t.wav")[1] / 256.0
    assert clipped.count == np.count_nonzero(np.abs(counts) == wav.COUNTS) > 0
    assert json.loads(info(tmp_path / "t.wav")[b"ICMT"])["wave"]["clipped"] == clipped.count


def test_the_phase_goes_on_while_the_carrier_changes(tmp_path: Path) -> None:
    sweep = np.linspace(60.0, 200.0, 501)
    counts = wavfile.read(put(a_track(300.0, sweep), tmp_path))[1] / 256.0 / wav.COUNTS
    t = np.arange(len(counts)) / 48_000.0
    np.testing.assert_allclose(counts, np.sin(2 * np.pi * (60.0 * t + 140.0 * t**2)), rtol=0, atol=1e-4)
    fixed = wavfile.read(put(a_track(300.0, sweep), tmp_path, carrier=80.0))[1] / 256.0 / wav.COUNTS
    np.testing.assert_allclose(fixed, np.sin(2 * np.pi * 80.0 * t), rtol=0, atol=1e-6)


def test_an_offset_is_added_told_and_kept_within_the_channel(tmp_path: Path) -> None:
    found = export.write(a_track(100.0), tmp_path / "t.wav", "wav", settings={"offset": 50.0})
    assert {"constant-voltage", "open-loop"} <= {f.code for f in found}
    counts = wavfile.read(tmp_path / "t.wav")[1] / 256.0 / wav.COUNTS * 300.0
    assert (counts.max(), counts.min()) == pytest.approx((150.0, -50.0), rel=1e-4)
    with pytest.raises(DermisError, match="beyond the channel's limit"):
        put(a_track(280.0), tmp_path, offset=50.0, full_scale=1000.0)


def test_a_voice_coils_voltage_is_the_wave(tmp_path: Path) -> None:
    coil = Library().device("voice_coil")
    t = np.arange(8001) / 8000.0
    volts = 2.0 * np.sin(2 * np.pi * 250.0 * t)
    track = CommandTrack(coil, t, np.column_stack([np.zeros(8001), volts]), {"finger": "Index"})
    for rate in (48_000, 96_000, 192_000):
        found = export.write(track, tmp_path / "t.wav", "wav", settings={"rate": rate, "gain": 4.0, "full_scale": 1.5})
        assert not found  # it is worn: no open loop
        said = json.loads(info(tmp_path / "t.wav")[b"ICMT"])["wave"]
        assert (said["gain"], said["full_scale"], said["carrier"], said["open_loop"]) == (4.0, 1.5, None, False)
        read = wavfile.read(tmp_path / "t.wav")[1] / 256.0 / wav.COUNTS * 6.0
        wanted = 2.0 * np.sin(2 * np.pi * 250.0 * np.arange(len(read)) / rate)
        np.testing.assert_allclose(read[rate // 100 : -rate // 100], wanted[rate // 100 : -rate // 100], atol=2e-3)
    with pytest.raises(DermisError, match="beyond full scale"):
        put(track, tmp_path, full_scale=1.9)
    with pytest.raises(DermisError, match="the wave itself, so it has no carrier"):
        put(track, tmp_path, carrier=100.0)
    with pytest.raises(DermisError, match="beyond the channel's limit"):
        put(track, tmp_path, offset=-1.5)
    full = json.loads(info(put(track, tmp_path))[b"ICMT"])["wave"]["full_scale"]
    assert full == 3.0, "the largest sample is the channel's limit"


def test_what_cannot_be_a_wave_is_refused(tmp_path: Path) -> None:
    tactor = Library().device("haptip")
    still = CommandTrack(tactor, np.arange(3) / 1000.0, np.zeros((3, len(tactor.channels))))
    with pytest.raises(DermisError, match="not driven by a waveform.*friction_screen"):
        put(still, tmp_path)
    for settings, words in (
        ({"rate": 44_100}, "'rate' is too small"),
        ({"gain": 0.0}, "'gain' must be above zero"),
        ({"carrier": 5000.0}, "carrier outside the channel's range"),
        ({"volume": 1.0}, "no such setting"),
    ):
        with pytest.raises(DermisError, match=words):
            put(a_track(), tmp_path, **settings)
    with pytest.raises(DermisError, match="no such setting"):
        export.write(a_track(), tmp_path / "t.json", "json", settings={"gain": 2.0})
    bent = a_track()
    times = bent.times.copy()
    times[7] += 4e-4
    with pytest.raises(DermisError, match="not evenly spaced"):
        put(replace(bent, times=times), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_forced_track_is_written_as_it_is(tmp_path: Path) -> None:
    loud = a_track(np.r_[np.full(400, 100.0), np.full(101, 350.0)])
    with pytest.raises(DermisError, match="not written"):
        put(loud, tmp_path)
    export.write(loud, tmp_path / "t.wav", "wav", force=True, settings={"full_scale": 400.0})
    counts = wavfile.read(tmp_path / "t.wav")[1] / 256.0 / wav.COUNTS * 400.0
    assert np.abs(counts).max() == pytest.approx(350.0, rel=1e-4)


def test_equal_tracks_give_equal_bytes(tmp_path: Path) -> None:
    first = put(a_track(), tmp_path).read_bytes()
    assert put(a_track(), tmp_path).read_bytes() == first and len(first) % 2 == 0
