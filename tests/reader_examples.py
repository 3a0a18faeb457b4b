"""Whole files of every kind that is read, as bytes; what the table of readers damages."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from core import presets, shipped
from core.devices import calibration
from core.devices.frequency_response import FrequencyResponse
from core.devices.response import Response
from core.devices.spec import Channel, DeviceSpec
from core.files import write_npz
from core.matching.screen_map import ScreenMap
from core.matching.table import SkinTable
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene, sample_frames
from core.skin import file as skin_file
from core.stream.log.binary import BinaryForm
from core.stream.log.row import Channel as LogColumn
from core.stream.log.row import LogHeader, file_rows
from core.stream.protocols import packets
from core.stream.protocols.wire import Wire
from core.surrogate import store as surrogate_store
from core.surrogate.network import Network
from core.surrogate.ridge import QuadraticRidge
from core.surrogate.subspace import Subspace
from core.track.command_track import CommandTrack


def written(write: Callable[[Path], object], suffix: str = "") -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"one{suffix}"
        write(path)
        return path.read_bytes()


@cache
def track() -> CommandTrack:
    spec = DeviceSpec(
        "haptip",
        "A device",
        "thimble",
        100.0,
        (Channel("x", "m", -1.0, 1.0, 200.0, 0.0, "a"), Channel("y", "rad", None, None, None, 0.25)),
        {"bandwidth.x": 10.0, "t": "é"},
        {"bandwidth": 1e6, "bits_per_sample": 8.0},
        stated_hash="0123456789abcdef",
    )
    times = np.arange(12) / 100
    values = np.column_stack([np.sin(times), np.linspace(0, 0.1, 12)])
    meta = {"finger": "Index", "fps": "24/1", "frame_range": "1 3", "x.note": "\\ \n"}
    return CommandTrack(spec, times, values, meta, {"x.slew": 2})


def uneven_track() -> CommandTrack:
    even = track()
    return CommandTrack(even.spec, even.times + 1e-3 * np.arange(12) ** 2, even.values, even.meta)


def scene() -> TactileScene:
    frames, times = sample_frames(Fraction(24), (1, 2), 240.0)
    n = len(times)
    poses = np.tile(np.eye(4), (1, n, 1, 1))
    two = np.tile(np.eye(4), (2, n, 1, 1))
    plane = Mesh(np.array([[-1, -1, -1], [1, -1, -1], [0, 1, -1]], dtype=float), np.array([[0, 1, 2]], dtype=np.int32))
    screen = Screen("Panel", (0.1, 0.075), np.tile(np.linspace(0, 1, 6, dtype=np.float32), (4, 1)), 0.001)
    chunk = Chunk(frames, times, poses, two, poses, {1: (plane,) * n}, {"finger/0/pattern": np.zeros(n)})
    fingers = (Finger("Index", (DeviceUse("haptip", {"relief": "map"}, "Panel"),), {"friction": 0.5}),)
    bodies = (Body("Plane", plane, {"friction": 0.3}), Body("Soft", None, {}, ("Plane",), True))
    return TactileScene("Tap", Fraction(24), (1, 2), 240.0, fingers, bodies, (screen,), (chunk,))


def _png(colour: int, depth: int) -> bytes:
    import struct
    import zlib

    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colour]
    width = (8 * channels * depth + 7) // 8
    rows = b"".join(
        bytes((k % 5,)) + bytes((i * 7 + k) % 251 if colour != 3 else 0 for i in range(width)) for k in range(6)
    )
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 8, 6, depth, colour, 0, 0, 0))]
    if colour == 3:
        chunks += [(b"PLTE", bytes(range(48))), (b"tRNS", b"\0\x80")]
    chunks += [(b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks
    )


def _tiffs(grey: np.ndarray) -> list[bytes]:
    from PIL import Image

    kinds = ((grey, "raw"), (grey.astype("<u2") * 99, "tiff_lzw"), (grey / np.float32(48), "tiff_adobe_deflate"))
    out = [io.BytesIO() for _ in kinds]
    for file, (pixels, compression) in zip(out, kinds, strict=True):
        Image.fromarray(pixels).save(file, "TIFF", compression=compression)
    return [file.getvalue() for file in out]


def _npy(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def npz(**arrays: Any) -> bytes:
    return written(lambda path: write_npz(path, arrays), ".npz")


def _written_by_others() -> list[bytes]:
    names = ("f8 Deflate predictor tiles", "i2 LZW predictor big-endian strips", "u4 Deflate BigTIFF tiles")
    with np.load(Path(__file__).parent / "unit/images/written_by_tifffile.npz") as archive:
        return [archive[name].tobytes() for name in (*names, "no data: f4 -9999")]


def all_images() -> list[bytes]:
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8)
    return [
        *(_png(colour, depth) for colour, depth in ((0, 1), (0, 8), (0, 16), (2, 8), (3, 4), (4, 8), (6, 8))),
        *_tiffs(grey),
        *_written_by_others(),
        _npy(grey),
        _npy(grey / 48.0),
        _npy(np.zeros((6, 8, 4), np.float32)),
        b"P5\n# c\n8 6 255\n" + grey.tobytes(),
        b"P6 8 2 65535 " + bytes(96),
        b"P2\n8 6\n255\n" + b" 17" * 48,
        b"P3 2 2 9\n" + b"1 2 3\n" * 4,
        b"Pf\n8 6\n-1.0\n" + np.zeros(48, "<f4").tobytes(),
        b"PF\n2 2\n1.0\n" + np.ones(12, ">f4").tobytes(),
    ]


def skin_table() -> bytes:
    rng = np.random.default_rng(1)
    made = SkinTable(
        rng.random((12, 3)), rng.integers(0, 4095, (12, 20)).astype(np.uint16), 0, np.ones(3), 0.0, {"device": "dev"}
    )
    return written(made.save, ".npz")


def screen_map() -> bytes:
    from core.devices.friction_screen import FrictionScreen

    heights = np.tile(np.linspace(0, 1, 6, dtype=np.float32), (2, 4, 1))
    made = ScreenMap(
        heights,
        (0.1, 0.08),
        1e-3,
        FrictionScreen.of(presets.Library().device("electrovibration")),
        scale=10.0,
        highest=1.0,
    )
    return written(made.save, ".npz")


def preset(group: str, key: str) -> bytes:
    return (shipped.BUILT_IN / group / f"{key}.json").read_bytes()


TETRAHEDRON = {
    "schema": skin_file.SCHEMA, "unit": "mm", "nodes": [[0, 0, 2], [2, 0, 2], [0, 2, 2], [0.5, 0.5, 0]],
    "tetrahedra": [[0, 2, 1, 3]], "fixed": [0, 1, 2], "pad": [3],
}  # fmt: skip


def mesh_arrays() -> bytes:
    return npz(**{k: np.array(v) for k, v in TETRAHEDRON.items()})


def _network() -> Network:
    rng = np.random.default_rng(2)
    return Network(rng.random(7), np.ones(7), rng.random((4, 7)), rng.random(4), rng.random((2, 4)), rng.random(2))


SKIN = SimpleNamespace(
    key="skin", pad_count=4, shape=None, follows_law=False, tissue="linear", material=SimpleNamespace(modulus=1e5)
)


@cache
def thimble() -> Any:
    from core.devices.thimble import mechanism

    return mechanism(presets.Library().device("thimble_3rrs"))


def _surrogate() -> surrogate_store.Surrogate:
    rng = np.random.default_rng(3)
    spaces = surrogate_store.Descriptors(
        Subspace(rng.random(6), rng.random((2, 6)), rng.random(7)),
        rng.random((2, 12)),
        *(Subspace(rng.random(12), rng.random((size, 12)), rng.random(13)) for size in (2, 2)),
    )
    ridge = QuadraticRidge(rng.random(7), np.ones(7), rng.random(2), rng.random((2, 7)), rng.random((2, 7, 7)))
    meta = {
        "schema": surrogate_store.SCHEMA,
        "skin": "skin",
        "pressed_on": "nodes",
        "device": surrogate_store.device_key(thimble()),
        "friction": 0.6,
        "modulus": 1e5,
    }
    return surrogate_store.Surrogate(spaces, ridge, _network(), meta)


def surrogate_files() -> tuple[bytes, bytes]:
    def write(path: Path) -> None:
        surrogate_store.save(path, _surrogate())

    def write_graph(path: Path) -> None:
        surrogate_store.save(path.with_name("x"), _surrogate())
        path.with_name("x.onnx").rename(path)

    return written(write, ".npz"), written(write_graph, ".onnx")


def recording() -> bytes:
    rng = np.random.default_rng(4)
    names = ["time", *(f"e{i}" for i in range(19)), "pressure"]
    rows = np.column_stack([np.arange(20) / 100, rng.integers(800, 3000, (20, 20))])
    return "\n".join([",".join(names), *(",".join(f"{v:g}" for v in row) for row in rows), ""]).encode()


def recorded_table() -> bytes:
    rng = np.random.default_rng(5)
    names = ["m1", "m2", "m3", *(f"e{i}" for i in range(19)), "pressure"]
    rows = np.column_stack([rng.random((20, 3)), rng.integers(800, 3000, (20, 20))])
    return "\n".join([",".join(names), *(",".join(f"{v:.4g}" for v in row) for row in rows), ""]).encode()


@cache
def wire() -> Wire:
    return Wire.of(presets.Library().device("haptip"))


def frames() -> list[bytes]:
    counts = np.array([1, 65535], np.uint16)
    welcome = packets.Welcome(2, 2, b"12345678", bytes(8), 77, 1, 16, counts, 50)
    bodies = [
        (packets.Kind.WELCOME, welcome.body()),
        (packets.Kind.STATE, packets.state(2, 3)),
        (packets.Kind.SYNCED, packets.Synced(1, 2, 3, 4, 5, 6, 7, 8, 9).body()),
        (packets.Kind.NACK, packets.nack(1, 2)),
        (packets.Kind.TOUCH, packets.touch(1, True, 0.1, 0.2)),
        (packets.Kind.HELLO, packets.hello(2, bytes(8))),
        (packets.Kind.COMMAND, packets.command(7, counts, timed=True)),
        (packets.Kind.SYNC, bytes(4)),
        (packets.Kind.CONFIGURE, packets.configure(50, 1, counts, counts)),
        (packets.Kind.ARM, b""),
    ]
    return [b"".join(packets.pack(kind, 1, i, body) for i, (kind, body) in enumerate(bodies))]


def calibration_text() -> bytes:
    points = ((-0.5, -0.45), (0.0, 0.02), (0.5, 0.52))
    curve = Response(points, points, latency=0.01, measured_on="2026-11-27", valid_days=30)
    vibration = FrequencyResponse(((20.0, 1.0, -0.1), (80.0, 1.2, -0.5)), measured_on="2026-11-27", valid_days=30)
    entries = {"pulley_1": calibration.Entry(response=curve), "pulley_2": calibration.Entry(frequency=vibration)}
    made = calibration.Calibration("haptip", wire().spec.hash, entries)
    return made.dumps().encode()


def request() -> bytes:
    device = {"key": "haptip", "preset": json.loads(preset("devices", "haptip"))}
    return json.dumps({"connect": True, "url": "virtual:", "device": device, "jog": {"pulley_1": 0.1}}).encode()


def stream_log(sensed: int = 1) -> bytes:
    header = LogHeader(
        log="0123456789abcdef",
        started="2026-01-02T03:04:05.000006+00:00",
        started_unix=1767323045.0,
        clock=12.5,
        device="haptip",
        name="HapTip",
        preset="ab",
        protocol="native",
        url="virtual:",
        rate=1000.0,
        channels=(LogColumn("pulley_1", "rad"),),
        zero=(0.0,),
        gain=(1.0,),
        program="dermis 0",
        sensed=(LogColumn("current", "A"),) * sensed,
    )
    rows, form = np.zeros(4, file_rows(1, sensed)), BinaryForm()
    rows["number"], rows["play"] = np.arange(4), np.nan
    return form.head(header) + form.rows(rows[:2]) + form.rows(rows[2:]) + form.end({"rows": 4, "lost": 0})


SWEEP = """schema = "dermis-sweep 1"
study = "motors"
rows = 500

[vary]
device = ["cable_platform", "hexapod"]
"device.disc_radius" = [10, 12.5]
seed = [1, 2, 3]
wobble = 0.5
"""
