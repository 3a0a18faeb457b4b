"""The table of readers: every function that takes a file or bytes from outside, with whole examples to damage.

`test_readers_table.py` fails where code reads and is not in here, and says what to do.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from core import calibration, images, number_rows, presets, scene_file, sensor
from core.design import recordings
from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.files import write_npz
from core.formats import binary, c_header, check, csv, export, json_track
from core.matching.screen_map import ScreenMap
from core.matching.table import SkinTable
from core.scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene, sample_frames
from core.skin import file as skin_file
from core.skin import own_mesh
from core.skin import store as skin_store
from core.stream import packets
from core.stream.native import Native
from core.stream.osc import Osc, bundle, message_head, read_bundle, read_message
from core.stream.torque import Torque
from core.stream.wire import Wire
from core.stream.wish import wish_of
from core.surrogate import onnx, table
from core.surrogate import store as surrogate_store
from core.surrogate.network import Network
from core.surrogate.ridge import QuadraticRidge
from core.surrogate.subspace import Subspace
from core.track import CommandTrack


@dataclass(frozen=True)
class Reader:
    """One way in.

    Attributes:
        name: for people. covers: functions that it runs, 'module:function'; of them the table is proof.
        suffix: of its files. seeds: whole examples. read: reads a file, and uses what it read as far as that is cheap.
        named: files that the example needs beside it, by suffix.
    """

    name: str
    covers: tuple[str, ...]
    suffix: str
    seeds: Callable[[], list[bytes]]
    read: Callable[[Path], object]
    beside: Callable[[Path], None] = lambda path: None


# -- examples


def _written(write: Callable[[Path], object], suffix: str = "") -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"one{suffix}"
        write(path)
        return path.read_bytes()


@cache
def _track() -> CommandTrack:
    spec = DeviceSpec(
        "dev", "A device", "thimble", 100.0,
        (Channel("x", "m", -1.0, 1.0, 200.0, 0.0, "a"), Channel("y", "rad", None, None, None, 0.25)),
        {"bandwidth.x": 10.0, "t": "é"},
        {"bandwidth": 1e6, "bits_per_sample": 8.0}, stated_hash="0123456789abcdef",
    )  # fmt: skip
    times = np.arange(12) / 100
    values = np.column_stack([np.sin(times), np.linspace(0, 0.1, 12)])
    meta = {"finger": "Index", "fps": "24/1", "frame_range": "1 3", "x.note": "\\ \n"}
    return CommandTrack(spec, times, values, meta, {"x.slew": 2})


def _uneven() -> CommandTrack:
    track = _track()
    return CommandTrack(track.spec, track.times + 1e-3 * np.arange(12) ** 2, track.values, track.meta)


def _scene() -> TactileScene:
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
    rows = b"".join(bytes((k % 5,)) + bytes((i * 7 + k) % 251 if colour != 3 else 0 for i in range(width))
                    for k in range(6))  # fmt: skip
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 8, 6, depth, colour, 0, 0, 0))]
    if colour == 3:
        chunks += [(b"PLTE", bytes(range(48))), (b"tRNS", b"\0\x80")]
    chunks += [(b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks
    )


def _npy(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def _npz(**arrays: Any) -> bytes:
    return _written(lambda path: write_npz(path, arrays), ".npz")


def _images() -> list[bytes]:
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8)
    return [
        *(_png(colour, depth) for colour, depth in ((0, 1), (0, 8), (0, 16), (2, 8), (3, 4), (4, 8), (6, 16))),
        _npy(grey), _npy(grey / 48.0), _npy(np.zeros((6, 8, 4), np.float32)),
        b"P5\n# c\n8 6 255\n" + grey.tobytes(), b"P6 8 2 65535 " + bytes(96), b"P2\n8 6\n255\n" + b" 17" * 48,
        b"P3 2 2 9\n" + b"1 2 3\n" * 4, b"Pf\n8 6\n-1.0\n" + np.zeros(48, "<f4").tobytes(),
        b"PF\n2 2\n1.0\n" + np.ones(12, ">f4").tobytes(),
    ]  # fmt: skip


def _skin_table() -> bytes:
    rng = np.random.default_rng(1)
    made = SkinTable(rng.random((12, 3)), rng.integers(0, 4095, (12, 20)).astype(np.uint16), 0, np.ones(3), 0.0,
                     {"device": "dev"})  # fmt: skip
    return _written(made.save, ".npz")


def _screen_map() -> bytes:
    from core.devices.friction_screen import FrictionScreen

    heights = np.tile(np.linspace(0, 1, 6, dtype=np.float32), (2, 4, 1))
    made = ScreenMap(heights, (0.1, 0.08), 1e-3, FrictionScreen.of(presets.Library().device("electrovibration")),
                     scale=10.0, highest=1.0)  # fmt: skip
    return _written(made.save, ".npz")


def _preset(group: str, key: str) -> bytes:
    return (presets.BUILT_IN / group / f"{key}.json").read_bytes()


TETRAHEDRON = {
    "schema": skin_file.SCHEMA, "unit": "mm", "nodes": [[0, 0, 2], [2, 0, 2], [0, 2, 2], [0.5, 0.5, 0]],
    "tetrahedra": [[0, 2, 1, 3]], "fixed": [0, 1, 2], "pad": [3],
}  # fmt: skip


def _mesh_arrays() -> bytes:
    return _npz(**{k: np.array(v) for k, v in TETRAHEDRON.items()})


def _network() -> Network:
    rng = np.random.default_rng(2)
    return Network(*(rng.random(shape) for shape in ((5,),)), np.ones(5), rng.random((4, 5)), rng.random(4),
                   rng.random((2, 4)), rng.random(2))  # fmt: skip


SKIN = SimpleNamespace(key="skin", pad_count=4, material=SimpleNamespace(modulus=1e5))


@cache
def _thimble() -> Any:
    from core.devices.thimble import mechanism

    return mechanism(presets.Library().device("thimble_3rrs"))


def _surrogate() -> surrogate_store.Surrogate:
    rng = np.random.default_rng(3)
    spaces = surrogate_store.Descriptors(
        Subspace(rng.random(6), rng.random((2, 6)), rng.random(7)), rng.random((2, 12)),
        Subspace(rng.random(12), rng.random((2, 12)), rng.random(13)),
    )  # fmt: skip
    ridge = QuadraticRidge(rng.random(5), np.ones(5), rng.random(2), rng.random((2, 5)), rng.random((2, 5, 5)))
    meta = {"schema": surrogate_store.SCHEMA, "skin": "skin", "device": surrogate_store.device_key(_thimble()),
            "friction": 0.6, "modulus": 1e5}  # fmt: skip
    return surrogate_store.Surrogate(spaces, ridge, _network(), meta)


def _surrogate_files() -> tuple[bytes, bytes]:
    def write(path: Path) -> None:
        surrogate_store.save(path, _surrogate())

    def write_graph(path: Path) -> None:
        surrogate_store.save(path.with_name("x"), _surrogate())
        path.with_name("x.onnx").rename(path)

    return _written(write, ".npz"), _written(write_graph, ".onnx")


def _recording() -> bytes:
    rng = np.random.default_rng(4)
    names = ["time", *(f"e{i}" for i in range(19)), "pressure"]
    rows = np.column_stack([np.arange(20) / 100, rng.integers(800, 3000, (20, 20))])
    return "\n".join([",".join(names), *(",".join(f"{v:g}" for v in row) for row in rows), ""]).encode()


def _recorded_table() -> bytes:
    rng = np.random.default_rng(5)
    names = ["m1", "m2", "m3", *(f"e{i}" for i in range(19)), "pressure"]
    rows = np.column_stack([rng.random((20, 3)), rng.integers(800, 3000, (20, 20))])
    return "\n".join([",".join(names), *(",".join(f"{v:.4g}" for v in row) for row in rows), ""]).encode()


@cache
def _wire() -> Wire:
    return Wire.of(presets.Library().device("haptip"))


def _frames() -> list[bytes]:
    counts = np.array([1, 65535], np.uint16)
    welcome = packets.Welcome(2, 2, b"12345678", bytes(8), 77, 1, 16, counts, 50)
    bodies = [
        (packets.Kind.WELCOME, welcome.body()), (packets.Kind.STATE, packets.state(2, 3)),
        (packets.Kind.SYNCED, packets.Synced(1, 2, 3, 4, 5, 6, 7, 8, 9).body()), (packets.Kind.NACK, packets.nack(1, 2)),
        (packets.Kind.TOUCH, packets.touch(1, True, 0.1, 0.2)), (packets.Kind.HELLO, packets.hello(2, bytes(8))),
        (packets.Kind.COMMAND, packets.command(7, counts, timed=True)), (packets.Kind.SYNC, bytes(4)),
        (packets.Kind.CONFIGURE, packets.configure(50, 1, counts, counts)), (packets.Kind.ARM, b""),
    ]  # fmt: skip
    return [b"".join(packets.pack(kind, 1, i, body) for i, (kind, body) in enumerate(bodies))]


# -- what is done with them


def _use_track(read: Callable[[Path], CommandTrack]) -> Callable[[Path], object]:
    def use(path: Path) -> object:
        track = read(path)
        check.findings_of(track, levels=65536)
        for write in (csv.dumps, json_track.dumps, binary.dumps, lambda t: c_header.dumps(t, "t")):
            try:
                write(track)
            except DermisError:
                continue  # a format may refuse what another holds
        return track

    return use


def _use_scene(path: Path) -> object:
    scene = scene_file.load(path)
    scene.validate()
    for chunk in scene.chunks:
        sum(a.nbytes for a in (chunk.frames, chunk.fingers))
    return scene


def _use_library(group: str) -> Callable[[Path], object]:
    def use(path: Path) -> object:
        folder = path.parent / "library"
        (folder / group).mkdir(parents=True, exist_ok=True)
        target = folder / group / "mine.json"
        target.write_bytes(path.read_bytes())
        library = presets.Library(folder)
        entry = next(e for e in library.list(group) if e.key == "mine")
        str(entry.name).encode("utf-8")
        if entry.error is not None:
            presets.read(target)
        if group == "devices":
            return library.device("mine").hash
        return library.skin("mine") if group == "skins" else library.material("mine")

    return use


def _use_calibration(path: Path) -> object:
    made = calibration.Calibration.load(path)
    made.dumps().encode("utf-8")
    return made.applied(_wire().spec) if hasattr(made, "applied") else made


def _use_screen_map(path: Path) -> object:
    found = ScreenMap.load(path)
    return found.answer(0.01, 0.01, (1.0, 0.0), 0.1)


def _use_table(path: Path) -> object:
    found = SkinTable.load(path)
    return found.by_command.query(found.commands[:1] / found.scale, 1), found.by_reading


def _use_onnx(path: Path) -> object:
    fit = onnx.OnnxFit(path)
    return fit.inputs, fit.outputs


def _use_surrogate(path: Path) -> object:
    return surrogate_store.load(path, SKIN, _thimble(), 0.6)  # type: ignore[arg-type]


def _use_frames(path: Path) -> object:
    data = path.read_bytes()
    adapter = Native(_wire(), {})
    adapter._session = 1
    adapter.receive(data, 1.0)
    for packet in packets.Decoder().feed(data):
        for read in (packets.read_command, packets.read_hello, packets.Welcome.read, packets.read_configure,
                     packets.Synced.read, packets.read_touch, packets.read_state, packets.read_nack, packets.u32):
            try:
                read(packet.body)
            except DermisError:
                continue
    return adapter


def _use_osc(path: Path) -> object:
    data = path.read_bytes()
    Osc(_wire(), {}).receive(data, 1.0)
    return read_bundle(data) if data.startswith(b"#bundle") else read_message(data)


def _use_torque(path: Path) -> object:
    adapter = Torque(_wire(), {})
    adapter._asked[1] = 0.9
    adapter.receive(path.read_bytes(), 1.0)
    return adapter


def _use_wish(path: Path) -> object:
    try:
        plain = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return None  # of the sender's own board: whole or not there, by its check sum
    if not isinstance(plain, dict):
        return None
    wish = wish_of(plain)
    wish.check()
    wish.calibrated()
    return wish.spec()


def _wish() -> bytes:
    device = {"key": "haptip", "preset": json.loads(_preset("devices", "haptip"))}
    return json.dumps({"connect": True, "url": "virtual:", "device": device, "jog": {"pulley_1": 0.1}}).encode()


def _either(*readers: Callable[[Path], object]) -> Callable[[Path], object]:
    def use(path: Path) -> object:
        for read in readers:
            read(path)
        return None

    return use


READERS = (
    Reader("CSV track", ("core.formats.csv:read", "core.formats.export:read"), ".csv",
           lambda: [csv.dumps(t).encode() for t in (_track(), _uneven())], _use_track(export.read)),
    Reader("JSON track", ("core.formats.json_track:read",), ".json",
           lambda: [json_track.dumps(t).encode() for t in (_track(), _uneven())], _use_track(json_track.read)),
    Reader("binary track", ("core.formats.binary:read",), ".dtrack",
           lambda: [binary.dumps(t) for t in (_track(), _uneven())], _use_track(binary.read)),
    Reader("scene", ("core.scene_file:load",), ".npz",
           lambda: [_written(lambda path: scene_file.save(_scene(), path))], _use_scene),
    Reader("image", ("core.images:read",), ".png", _images, images.read),
    Reader("rows of numbers", ("core.number_rows:read_rows",), ".csv",
           lambda: [b"a,b\n1,2\n3,nan\n# c\n4,5\n"], number_rows.read_rows),
    Reader("look-up table", ("core.matching.table:SkinTable.load",), ".npz", lambda: [_skin_table()], _use_table),
    Reader("screen map", ("core.matching.screen_map:ScreenMap.load",), ".npz", lambda: [_screen_map()],
           _use_screen_map),
    Reader("calibration", ("core.calibration:Calibration.load",), ".json",
           lambda: [calibration.Calibration("haptip", _wire().spec.hash, {"pulley_1": calibration.Entry()})
                    .dumps().encode()], _use_calibration),
    Reader("device preset", ("core.presets:read",), ".json",
           lambda: [_preset("devices", k) for k in ("haptip", "thimble_3rrs", "hexapod", "electrovibration",
                                                    "cable_platform", "pin_array_128")], _use_library("devices")),
    Reader("material preset", ("core.presets:read",), ".json", lambda: [_preset("materials", "wood")],
           _use_library("materials")),
    Reader("skin preset", ("core.presets:read",), ".json", lambda: [_preset("skins", "index_medium")],
           _use_library("skins")),
    Reader("mesh, JSON", ("core.skin.file:load_mesh", "core.skin.own_mesh:digest"), ".json",
           lambda: [json.dumps(TETRAHEDRON).encode()], _either(own_mesh.digest, skin_file.load_mesh)),
    Reader("mesh, arrays", ("core.skin.file:load_mesh",), ".npz", lambda: [_mesh_arrays()], skin_file.load_mesh),
    Reader("cached skin", ("core.skin.store:read_model",), ".npz",
           lambda: [_npz(**{k: np.zeros((3, 3)) for k in skin_store.MESH_ARRAYS}, compliance=np.zeros((9, 9)))],
           skin_store.read_model),
    Reader("cached responses", ("core.skin.store:read_table",), ".npz",
           lambda: [_npz(table=np.zeros((3, 3), np.float32))], lambda path: skin_store.read_table(path, (3, 3))),
    Reader("ONNX", ("core.surrogate.onnx:OnnxFit.__init__", "core.surrogate.onnx:read_meta"), ".onnx",
           lambda: [_surrogate_files()[1]], _use_onnx),
    Reader("surrogate", ("core.surrogate.store:load",), ".npz", lambda: [_surrogate_files()[0]], _use_surrogate,
           beside=lambda path: path.with_suffix(".onnx").write_bytes(_surrogate_files()[1]) and None),
    Reader("sample table", ("core.surrogate.table:read_table",), ".npz",
           lambda: [_npz(x=np.ones((4, 3)), channels=np.ones((4, 2)), memory=np.ones((4, 1)), trajectory=np.arange(4))],
           table.read_table),
    Reader("sample table, CSV", ("core.surrogate.table:read_table",), ".csv", lambda: [b"1,2,3,4\n5,6,7,8\n"],
           table.read_table),
    Reader("stimuli", ("core.sensor:read_stimuli",), ".npz",
           lambda: [_npz(times=np.arange(4.0), stimuli=np.ones((4, 2)))], lambda path: sensor.read_stimuli(path, 2)),
    Reader("stimuli, CSV", ("core.sensor:read_stimuli",), ".csv", lambda: [b"t,a,b\n0,1,2\n1,2,3\n"],
           lambda path: sensor.read_stimuli(path, 2)),
    Reader("recording", ("core.design.recordings:read_recording",), ".csv", lambda: [_recording()],
           recordings.read_recording),
    Reader("recorded table", ("core.design.recordings:read_table",), ".csv", lambda: [_recorded_table()],
           lambda path: recordings.read_table(path, np.ones(3), np.array([[0.0] * 3, [1.0] * 3]))),
    Reader("packets", ("core.stream.packets:Decoder.feed",), ".bin", _frames, _use_frames),
    Reader("OSC", ("core.stream.osc:read_bundle",), ".bin",
           lambda: [bundle(1, [message_head("/dermis/touch") + bytes(4)]), b"/dermis/touch\0\0\0,iff\0\0\0\0" + bytes(12)],
           _use_osc),
    Reader("torque board", ("core.stream.torque:Torque.receive",), ".bin", lambda: [b"DA\1\0" + bytes(8)], _use_torque),
    Reader("wish", ("core.stream.wish:wish_of",), ".json", lambda: [_wish()], _use_wish),
)  # fmt: skip
