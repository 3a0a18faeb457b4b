"""JSON and binary tracks: round trips, refusals, and files that something mangled on the way."""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.track import binary, csv, export, json_track
from core.track.command_track import CommandTrack

SPEC = DeviceSpec(
    "dev",
    "A dévice",
    "pin_array",
    1000.0,
    (Channel("x", "m", -2e-3, 2e-3, 0.15, 0.0), Channel("motor", "rad", -0.5, 0.5, None, 0.1, "m1")),
    {"range": 2e-3, "names": ["a", "b"], "on": True},
    {"bandwidth": 1e6, "bits_per_sample": 8.0},
)
META = {"finger": "Thumb, left", "scene": "Szene\n2", "frame_range": "1 25", "fps": "24/1"}


def a_track(n: int = 500, seed: int = 1) -> CommandTrack:
    rng = np.random.default_rng(seed)
    values = np.column_stack([np.cumsum(rng.normal(size=n)) * 1e-5, rng.uniform(-0.5, 0.5, n)])
    return CommandTrack(SPEC, np.arange(n) / 1000.0, values, META, {"x.slew": 3})


def same_but_values(a: CommandTrack, b: CommandTrack) -> None:
    assert a.times.tolist() == b.times.tolist()
    assert (dict(a.meta), dict(a.limited), a.channels) == (dict(b.meta), dict(b.limited), b.channels)
    assert (a.spec.key, a.spec.name, a.spec.kind, a.spec.rate) == (b.spec.key, b.spec.name, b.spec.kind, b.spec.rate)
    assert a.spec.hash == b.spec.hash
    assert (dict(a.spec.parameters), dict(a.spec.link_budget)) == (dict(b.spec.parameters), dict(b.spec.link_budget))


def test_json_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    track = a_track()
    json_track.write(track, tmp_path / "a.json")
    back = export.read(tmp_path / "a.json")
    same_but_values(track, back)
    assert np.array_equal(track.values, back.values)
    assert json_track.dumps(back) == json_track.dumps(track)


def test_json_is_json_of_plain_columns() -> None:
    track = a_track(3)
    plain = json.loads(json_track.dumps(track))
    assert plain["values"]["motor"] == track.values[:, 1].tolist()
    assert plain["times"] == {"count": 3, "first": 0, "rate": 1000.0}


def test_binary_comes_back_within_its_stated_error(tmp_path: Path) -> None:
    track = a_track(2000)
    binary.write(track, tmp_path / "a.dtrack")
    back = export.read(tmp_path / "a.dtrack")
    same_but_values(track, back)
    bound = np.ptp(track.values, axis=0) / 2**33 * (1 + 1e-3)
    assert (np.abs(back.values - track.values) <= bound).all()
    assert binary.dumps(back) == binary.dumps(back)
    assert (tmp_path / "a.dtrack").stat().st_size < 2000 * 2 * 4 + 1500


def test_near_zero_binary_keeps_a_part_of_the_range_and_not_of_the_value() -> None:
    """As its page says: the error is that of the range everywhere, so the least numbers lose their digits."""
    small = np.array([0.0, 1.25e-11, -3e-10, 1e-9, 1.23456789e-6])
    track = CommandTrack(SPEC, np.arange(7) / 1000.0, np.column_stack([[-1.0, *small, 1.0], [0.0] * 7]))
    back = binary.loads(binary.dumps(track)).values[:, 0]
    off = np.abs(back - track.values[:, 0])
    assert off.max() <= 2.0 / 2**33 * (1 + 1e-6)
    assert off[2] > 1e-11 and abs(back[1]) > 0  # 1.25e-11 and 0 themselves are gone
    exact = csv.loads(csv.dumps(track)).values[:, 0]
    np.testing.assert_allclose(exact, track.values[:, 0], rtol=5.001e-9, atol=0)  # which CSV keeps


def test_binary_refuses_what_its_steps_cannot_span() -> None:
    track = a_track(3)
    wide = replace(track, values=track.values + np.array([[1e308, 0], [-1e308, 0], [0, 0]]))
    with pytest.raises(DermisError, match="too large for this format"):
        binary.dumps(wide)


def test_binary_bytes_of_a_track_by_hand() -> None:
    """Three samples of one channel from 0 to 1: counts 0, 2^31 (half, rounded to even) and 2^32 - 1."""
    one = CommandTrack(
        DeviceSpec("d", "D", "pin_array", 10.0, (Channel("a", "1"),)),
        np.arange(3) / 10.0,
        np.array([[0.0], [0.5], [1.0]]),
    )
    data = binary.dumps(one)
    assert data[:8] == bytes.fromhex("8944524d540d0a01")
    size = struct.unpack_from("<I", data, 8)[0]
    assert data[12 + size : -4] == struct.pack("<3I", 0, 2**31, 2**32 - 1)
    assert struct.unpack("<I", data[-4:])[0] == zlib.crc32(data[:-4])
    assert json.loads(data[12 : 12 + size])["high"] == [1.0]


@pytest.mark.parametrize("module", [json_track, binary], ids=["json", "binary"])
def test_uneven_times_and_empty_tracks(module: object) -> None:
    uneven = replace(a_track(4), times=np.array([0.0, 0.1, 0.15, 7.0]))
    assert module.loads(module.dumps(uneven)).times.tolist() == [0.0, 0.1, 0.15, 7.0]  # type: ignore[attr-defined]
    empty = replace(a_track(1), times=np.empty(0), values=np.empty((0, 2)))
    assert module.loads(module.dumps(empty)).values.shape == (0, 2)  # type: ignore[attr-defined]


@pytest.mark.parametrize("module", [json_track, binary], ids=["json", "binary"])
def test_not_finite_is_refused(module: object) -> None:
    bad = a_track(4)
    bad.values[2, 1] = np.nan
    with pytest.raises(DermisError, match="not a finite number"):
        module.dumps(bad)  # type: ignore[attr-defined]


def test_every_single_flipped_bit_of_a_binary_is_noticed() -> None:
    data = bytearray(binary.dumps(a_track(5)))
    for bit in range(8 * len(data)):
        data[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DermisError):
            binary.loads(bytes(data))
        data[bit // 8] ^= 1 << bit % 8
    binary.loads(bytes(data))


def test_json_refusals_say_where() -> None:
    text = json_track.dumps(a_track(3))
    for old, new, what in (
        ('"dermis-track-json 1"', '"dermis-track-json 2"', "newer version"),
        ('"count": 3', '"count": 4', "number of samples"),
        ('"x": [', '"y": [', "columns are not the channels"),
        ("[0.0", "[NaN", "finite"),
        ('"rate": 1000.0', '"rate": -1.0', "grid|rate"),
        ('"unit": "rad"', '"unit": "degree"', "column name"),
        ('"x.slew": 3', '"x.slew": -3', "count"),
    ):
        broken = text.replace(old, new, 1) if old != "[0.0" else text.replace('"x": [', '"x": [NaN, ', 1)
        assert broken != text
        with pytest.raises(DermisError, match=what):
            json_track.loads(broken)


def test_errors_block_an_export_unless_forced(tmp_path: Path) -> None:
    wild = a_track(10)
    wild.values[5, 1] = 0.75
    path = tmp_path / "a.json"
    with pytest.raises(DermisError, match="not written: outside the channel's range"):
        export.write(wild, path, "json")
    assert not path.exists()
    found = export.write(wild, path, "json", force=True)
    assert "out-of-range" in {f.code for f in found}
    back = json_track.read(path)
    assert back.values[5, 1] == 0.75 and back.meta["forced"] == "out-of-range (1)"


def test_cut_keeps_both_ends_and_tells_the_frames() -> None:
    track = a_track(1001)
    part = export.cut(track, 0.25, 0.5, name="marker A")
    assert len(part.times) == 251 and part.times[0] == 0.0
    assert np.array_equal(part.values, track.values[250:501])
    assert part.meta["frame_range"] == "7 13" and part.meta["range"] == "marker A"
    with pytest.raises(DermisError, match="beyond the track"):
        export.cut(track, 0.5, 1.1)
    with pytest.raises(DermisError, match="empty"):
        export.cut(track, 0.5, 0.5)


def test_a_range_may_end_where_the_sampled_frames_end() -> None:
    """14 frames at 24 fps last 541.67 ms; at 1 kHz the last sample is at 541 ms, at 60 Hz at 533.3 ms."""
    for rate in (1000.0, 60.0, 240.0, 7.0):
        for frames in range(2, 60):
            last = frames / 24
            n = frames * int(rate) // 24 + 1
            whole = a_track(n)
            track = replace(whole, spec=replace(whole.spec, rate=rate), times=np.arange(n) / rate)
            assert np.array_equal(export.cut(track, 0.0, last).values, track.values)
            with pytest.raises(DermisError, match="beyond the track"):
                export.cut(track, 0.0, track.times[-1] + 1 / rate)


def test_a_range_between_two_samples_is_empty() -> None:
    with pytest.raises(export.EmptyRange, match="no sample"):
        export.cut(a_track(1001), 0.2501, 0.2509)
    with pytest.raises(export.EmptyRange, match="is empty"):
        export.cut(a_track(1001), 0.25, 0.25)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('"finger":', '"foo": "bar", "finger":', "unknown key"),
        ('"24/1"', '"abc"', "not a frame rate"),
        ('"1 25"', '"x"', "not a range of frames"),
        ('"pin_array"', '"banana"', "unknown kind of device"),
        ('"wire": {', '"wire": {"foo": 3, ', "unknown field of the wire"),
        ('"x.slew": 3', '"bogus.range": 4', "a limited channel without a column"),
        ('"x.slew": 3', '"x.bogus": 4', "unknown kind of limiting"),
        ('"count": 3, "first": 0', '"count": 2000000000, "first": 0', "more samples than a track can hold"),
    ],
)
def test_json_and_binary_refuse_what_they_do_not_know(old: str, new: str, what: str) -> None:
    track = a_track(3)
    text = json_track.dumps(track)
    assert text.count(old) == 1
    with pytest.raises(DermisError, match=what):
        json_track.loads(text.replace(old, new))
    data = binary.dumps(track)
    size = struct.unpack_from("<I", data, 8)[0]
    header = data[12 : 12 + size].decode()
    assert header.count(old) == 1
    worse = header.replace(old, new).encode()
    body = data[:8] + struct.pack("<I", len(worse)) + worse + data[12 + size : -4]
    with pytest.raises(DermisError, match=what):
        binary.loads(body + struct.pack("<I", zlib.crc32(body)))


@pytest.mark.parametrize("module", [json_track, binary])
def test_json_and_binary_do_not_write_what_they_would_refuse(module: ModuleType) -> None:
    for change, what in (
        ({"meta": {"foo": "bar"}}, "unknown key"),
        ({"limited": {"gone.range": 1}}, "without a column"),
        ({"spec": replace(SPEC, kind="banana")}, "unknown kind of device"),
    ):
        with pytest.raises(DermisError, match=what):
            module.dumps(replace(a_track(3), **change))
