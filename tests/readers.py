"""The table of readers: every function that takes a file or bytes from outside, with whole examples to damage.

`test_readers.py` fails where code reads and is not in here, and says what to do.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from core import images, number_rows, presets
from core.design import recorded_table, recordings
from core.design.collect import _whole
from core.devices import calibration, frequency_response, response_readings
from core.errors import DermisError
from core.files import read_bytes
from core.matching import description
from core.matching.screen_map import ScreenMap
from core.matching.table import SkinTable
from core.motion import recorded_poses
from core.scene import scene_file
from core.skin import file as skin_file
from core.skin import own_mesh, sensor
from core.skin import store as skin_store
from core.skin.remainder import Remainder
from core.stream.daq.force_sensor import ForceSensor
from core.stream.log import binary as stream_log
from core.stream.log.csv_form import CsvForm
from core.stream.output_limiter import OutputLimiter
from core.stream.protocols import adapters, packets, pairs
from core.stream.protocols.bus import dynamixel, feetech
from core.stream.protocols.maestro import Maestro
from core.stream.protocols.native import Native
from core.stream.protocols.osc import Osc, bundle, message_head, read_bundle, read_message
from core.stream.protocols.pairs import VIRTUAL_KEY
from core.stream.protocols.sealed import KEY, BoardSeals, HostSeals
from core.stream.protocols.torque import Torque
from core.stream.protocols.wire import Wire
from core.stream.request import request_of
from core.stream.sound.measured_card import MeasuredCard
from core.stream.virtual.device import make
from core.surrogate import onnx, table
from core.surrogate import store as surrogate_store
from core.sweep import readings as sweep_readings
from core.sweep import row as sweep_row
from core.sweep import spec as sweep_spec
from core.sweep import table as sweep_table
from core.track import binary, c_header, check, csv, export, json_track
from core.track.command_track import CommandTrack
from core.work import parcel
from tests import reader_examples as ex


@dataclass(frozen=True)
class Reader:
    """One way in.

    Attributes:
        name: for people. covers: functions that it runs, 'module:function'; of them the table is proof.
        suffix: of its files. seeds: whole ex. read: reads a file, and uses what it read as far as that is cheap.
        beside: writes what a file needs beside it. file: it opens the path itself; others are given bytes.
    """

    name: str
    covers: tuple[str, ...]
    suffix: str
    seeds: Callable[[], list[bytes]]
    read: Callable[[Path], object]
    beside: Callable[[Path], None] = lambda path: None
    file: bool = True


# -- what is done with them


def _use_track(read: Callable[[Path], CommandTrack]) -> Callable[[Path], object]:
    def use(path: Path) -> object:
        track = read(path)
        finite = np.isfinite(track.values).all() and np.isfinite(track.times).all()
        if not finite or not (np.diff(track.times) > 0).all():
            raise AssertionError("a track that no reader may let pass")
        check.preset_findings(track, presets.Library())
        check.findings_of(check.by_preset(track, presets.Library()), levels=65536)
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
        target.write_bytes(read_bytes(path))
        library = presets.Library(folder)
        entry = next(e for e in library.list(group) if e.key == "mine")
        str(entry.name).encode("utf-8")
        if entry.error is not None:
            presets.read(target)
        if group == "devices":
            return library.device("mine").hash, Wire.of(library.device("mine"))
        return library.skin("mine") if group == "skins" else library.material("mine")

    return use


def _use_calibration(path: Path) -> object:
    made = calibration.Calibration.load(path)
    made.dumps().encode("utf-8")
    wire = Wire.of(ex.wire().spec, made)
    return OutputLimiter(wire).step(wire.safe_command, 0.0)


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
    return surrogate_store.load(path, ex.SKIN, ex.thimble(), 0.6)  # type: ignore[arg-type]


def _use_frames(path: Path) -> object:
    data = path.read_bytes()
    adapter = Native(ex.wire(), {})
    adapter._session = 1
    adapter.receive(data, 1.0)
    for packet in packets.Decoder().feed(data):
        for read in (
            packets.read_command,
            packets.read_hello,
            packets.Welcome.read,
            packets.read_configure,
            packets.Synced.read,
            packets.read_touch,
            packets.read_state,
            packets.read_nack,
            packets.read_sync,
        ):
            try:
                read(packet.body)
            except DermisError:
                continue
    return adapter


def _use_osc(path: Path) -> object:
    data = path.read_bytes()
    Osc(ex.wire(), {}).receive(data, 1.0)
    return read_bundle(data) if data.startswith(b"#bundle") else read_message(data)


def _use_torque(path: Path) -> object:
    adapter = Torque(ex.wire(), {})
    adapter._asked[1] = 0.9
    adapter.receive(path.read_bytes(), 1.0)
    return adapter


def _use_force_sensor(path: Path) -> None:
    sensor = ForceSensor.load(path)
    volts = np.zeros((3, sensor.inputs))
    assert sensor.forces(volts, volts[0]).shape == (3, len(sensor.channels)) and not sensor.beyond(volts)


def _use_seals(path: Path) -> None:
    host, board = HostSeals(VIRTUAL_KEY), BoardSeals(VIRTUAL_KEY, lambda: 0)
    _, (offer,) = board.take(host.ask(), held=False)
    host.unseal(offer)
    _, (opened,) = board.take(host.ask(), held=False)
    host.unseal(opened)
    data = path.read_bytes()
    for one in (data, host.seal(data), board.seal(data)):
        host.unseal(one)
        board.take(one, held=False)


def _use_maestro(path: Path) -> object:
    adapter = Maestro(ex.wire(), {"reads": "1"})
    adapter.opened(0.0)
    adapter.poll(0.0)
    adapter.receive(path.read_bytes(), 0.1)
    if adapter.fault:
        raise DermisError(adapter.fault)
    return adapter


def _use_servos(path: Path, adapter: Any) -> object:
    adapter.opened(0.0)
    adapter.poll(0.0)
    adapter.receive(path.read_bytes(), 0.01)
    if 1 not in adapter.questions.found:
        raise DermisError("no answer from servo 1")
    made = adapter._describe(adapter.questions.found[1].data)
    if made.fault:
        raise DermisError(made.fault)
    return made


def _identity(protocol: str) -> list[bytes]:
    """Return the answer of a simulated servo that is asked for its identity."""
    adapter = adapters.make(protocol, ex.wire(), {})
    adapter.opened(0.0)
    return make(protocol, ex.wire(), {}).feed(adapter.poll(0.0)[0], 0.0)


def _use_row(path: Path) -> object:
    row = sweep_row.Row(path.stem, {}, {})
    target = sweep_table.path_of(path.parent, row)
    target.parent.mkdir(exist_ok=True)
    target.write_bytes(read_bytes(path))
    found = sweep_table.kept(path.parent, row)
    if found is None:
        raise DermisError("it is done once more")
    return found


def _use_stream_log(path: Path) -> object:
    file = stream_log.read(path)
    form = CsvForm(len(file.header.channels), len(file.header.sensed))
    return form.head(file.header) + form.rows(file.rows) + form.end(file.end or {})


def _use_request(path: Path) -> object:
    try:
        plain = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return None  # of the shared state: whole or not there, by its check sum
    if not isinstance(plain, dict):
        return None
    request = request_of(plain)
    request.check()
    request.calibrated()
    return request.spec()


def _either(*readers: Callable[[Path], object]) -> Callable[[Path], object]:
    def use(path: Path) -> object:
        for read in readers:
            read(path)
        return None

    return use


def _reader(
    name: str, covers: str, suffix: str, seeds: Callable[[], list[bytes]], read: Callable[[Path], object], **more: Any
) -> Reader:
    return Reader(name, tuple(covers.split()), suffix, seeds, read, **more)


def _write_graph(path: Path) -> None:
    path.with_suffix(".onnx").write_bytes(ex.surrogate_files()[1])


def _tracks(dumps: Callable[[CommandTrack], str | bytes]) -> Callable[[], list[bytes]]:
    def seeds() -> list[bytes]:
        written = [dumps(track) for track in (ex.track(), ex.uneven_track())]
        return [text.encode() if isinstance(text, str) else text for text in written]

    return seeds


def _presets(group: str, *keys: str) -> Callable[[], list[bytes]]:
    return lambda: [ex.preset(group, key) for key in keys]


DEVICES = ("haptip", "thimble_3rrs", "hexapod", "electrovibration", "cable_platform", "pin_array_128")
MODEL = {name: np.zeros((3, 3)) for name in skin_store.MESH_ARRAYS} | {"compliance": np.zeros((27, 27))}
REMAINDER = {"centres": np.zeros((4, 3)), "mixing": np.ones((4, 2)), "surface": np.ones((2, 3, 2, 3), "<f4")}
REMAINDER["beneath"] = np.ones((3, 1, 9, 1, 3), "<f4")
DESCRIPTION = {"schema": description.SCHEMA, "key": "key", "sources": [], "digest": description.digest_of(())}
SAMPLES = {"x": np.ones((4, 3)), "channels": np.ones((4, 2)), "memory": np.ones((4, 1)), "trajectory": np.arange(4)}
STIMULI = {"times": np.arange(4.0), "stimuli": np.ones((4, 2))}
ENDS = np.array([[0.0] * 3, [1.0] * 3])
TOUCH = b"/dermis/touch\0\0\0,iff\0\0\0\0" + bytes(12)
PACKETS = (
    "Decoder._packet",
    "Welcome.read",
    "Synced.read",
    "read_command",
    "read_configure",
    "read_hello",
    "read_nack",
    "read_touch",
    "read_sync",
)

READERS = (
    _reader(
        "CSV track",
        "core.track.csv:read core.track.export:read core.track.csv_header:_from_json",
        ".csv",
        _tracks(csv.dumps),
        _use_track(export.read),
    ),
    _reader(
        "JSON track",
        "core.track.json_track:read core.track.json_track:loads",
        ".json",
        _tracks(json_track.dumps),
        _use_track(json_track.read),
    ),
    _reader(
        "binary track",
        "core.track.binary:read core.track.binary:loads",
        ".dtrack",
        _tracks(binary.dumps),
        _use_track(binary.read),
    ),
    _reader(
        "scene",
        "core.scene.scene_file:load core.scene.scene_file:SceneChunks.__iter__ core.scene.scene_file:_header",
        ".npz",
        lambda: [ex.written(lambda path: scene_file.save(ex.scene(), path))],
        _use_scene,
    ),
    _reader(
        "image",
        "core.images:read core.images.npy:decode core.images.png_tiff:_opened core.images.netpbm:_raw "
        "core.images.png_tiff:_check_rows core.images.png_tiff:_packed core.images.png_tiff:_unpacked "
        "core.images.netpbm:_floats core.images.tiff:_samples core.images.tiff:_mask "
        "core.images.tiff_header:TiffHeader.of core.images.tiff_header:TiffHeader.numbers",
        ".png",
        ex.all_images,
        images.read,
    ),
    _reader(
        "rows of numbers",
        "core.number_rows:lines_of core.number_rows:numbers_of",
        ".csv",
        lambda: [b"a,b\n1,2\n3,nan\n# c\n4,5\n"],
        number_rows.read_rows,
    ),
    _reader(
        "recorded poses",
        "core.number_rows:lines_of core.number_rows:numbers_of",
        ".csv",
        lambda: [
            b"time [ms],x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n0,1,2,3,0,0,90\n10,1,2,4,0,0,91\n",
            b"t;x;y;z;qw;qx;qy;qz\n0;1,5;2;3;1;0;0;0\n0,5;1,5;2;4;0;1;0;0\n",
            b"# timestamp tx ty tz qx qy qz qw\n0 1 2 3 0 0 0 1\n1 1 2 4 0 0 0 1\n",
        ],
        recorded_poses.read,
    ),
    _reader("look-up table", "core.matching.table:SkinTable.load", ".npz", lambda: [ex.skin_table()], _use_table),
    _reader(
        "screen map", "core.matching.screen_map:ScreenMap.load", ".npz", lambda: [ex.screen_map()], _use_screen_map
    ),
    _reader(
        "measured sound card",
        "core.stream.sound.measured_card:MeasuredCard.load",
        ".json",
        lambda: [MeasuredCard("USB Audio: #1 (hw:1,0), ALSA", 48_000, 0.8, 0.012, 1e-5, 2.0, 1.0).dumps().encode()],
        lambda path: MeasuredCard.load(path).dumps(),
    ),
    _reader(
        "calibration",
        "core.devices.calibration:Calibration.load core.devices.calibration:Calibration.loads "
        "core.devices.response:Response.loads core.devices.frequency_response:FrequencyResponse.loads",
        ".json",
        lambda: [ex.calibration_text()],
        _use_calibration,
    ),
    _reader(
        "readings of an actuator",
        "core.number_rows:lines_of core.number_rows:numbers_of",
        ".csv",
        lambda: [b"driven [deg],reached [deg]\n0,0\n10,9\n20,19\n30,30\n20,20\n10,10\n0,0.5\n"],
        response_readings.read_csv,
    ),
    _reader(
        "frequency response of an actuator",
        "core.number_rows:lines_of core.number_rows:numbers_of",
        ".csv",
        lambda: [b"frequency [Hz],gain [dB],phase [deg]\n20,0,-5\n50,1.5,-20\n80,-1,-45\n"],
        frequency_response.read_csv,
    ),
    _reader("device preset", "core.presets:read", ".json", _presets("devices", *DEVICES), _use_library("devices")),
    _reader("material preset", "core.presets:read", ".json", _presets("materials", "wood"), _use_library("materials")),
    _reader("skin preset", "core.presets:read", ".json", _presets("skins", "index_medium"), _use_library("skins")),
    _reader(
        "mesh, JSON",
        "core.skin.file:_read_json core.skin.own_mesh:digest",
        ".json",
        lambda: [json.dumps(ex.TETRAHEDRON).encode()],
        _either(own_mesh.digest, skin_file.load_mesh),
    ),
    _reader("mesh, arrays", "core.skin.file:_read_npz", ".npz", lambda: [ex.mesh_arrays()], skin_file.load_mesh),
    _reader("cached skin", "core.skin.store:read_model", ".npz", lambda: [ex.npz(**MODEL)], skin_store.read_model),
    _reader(
        "cached tables",
        "core.skin.store:read_arrays",
        ".npz",
        lambda: [ex.npz(table=np.zeros((3, 3), "<f4"))],
        lambda path: skin_store.read_arrays(path, {"table": (3, 3)}),
    ),
    _reader(
        "cached description",
        "core.matching.description:read_shipped",
        ".npz",
        lambda: [ex.npz(matrix=np.eye(3), meta=np.frombuffer(json.dumps(DESCRIPTION).encode(), np.uint8))],
        lambda path: description.read_shipped(path, "key", 3),
    ),
    _reader(
        "remainder of a skin",
        "core.skin.remainder:Remainder.read",
        ".npz",
        lambda: [ex.npz(**REMAINDER)],
        lambda path: Remainder.read(path).functions(np.zeros((1, 3))),
    ),
    _reader(
        "readings of a sweep",
        "core.sweep.readings:read_readings",
        ".npz",
        lambda: [ex.npz(counts=np.zeros((4, 20), np.uint16))],
        sweep_readings.read_readings,
    ),
    _reader(
        "part of a sweep",
        "core.design.collect:_read_part",
        ".npz",
        lambda: [ex.npz(commands=np.zeros((2, 3)), readings=np.zeros((2, 20)), left=np.zeros(3))],
        _whole,
    ),
    _reader(
        "ONNX",
        "core.surrogate.onnx:OnnxFit.__init__ core.surrogate.onnx:read_meta",
        ".onnx",
        lambda: [ex.surrogate_files()[1]],
        _use_onnx,
    ),
    _reader(
        "surrogate",
        "core.surrogate.store:load",
        ".npz",
        lambda: [ex.surrogate_files()[0]],
        _use_surrogate,
        beside=_write_graph,
    ),
    _reader("sample table", "core.surrogate.table:read_table", ".npz", lambda: [ex.npz(**SAMPLES)], table.read_table),
    _reader(
        "sample table, CSV",
        "core.surrogate.table:read_table",
        ".csv",
        lambda: [b"1,2,3,4\n5,6,7,8\n"],
        table.read_table,
    ),
    _reader(
        "stimuli",
        "core.skin.sensor:read_stimuli",
        ".npz",
        lambda: [ex.npz(**STIMULI)],
        lambda path: sensor.read_stimuli(path, 2),
    ),
    _reader(
        "stimuli, CSV",
        "core.skin.sensor:read_stimuli",
        ".csv",
        lambda: [b"t,a,b\n0,1,2\n1,2,3\n"],
        lambda path: sensor.read_stimuli(path, 2),
    ),
    _reader(
        "recording",
        "core.number_rows:lines_of core.number_rows:numbers_of",
        ".csv",
        lambda: [ex.recording()],
        recordings.read_recording,
    ),
    _reader(
        "recorded table",
        "core.number_rows:lines_of core.number_rows:numbers_of",
        ".csv",
        lambda: [ex.recorded_table()],
        lambda path: recorded_table.read_table(path, np.ones(3), ENDS),
    ),
    _reader(
        "packets",
        " ".join(f"core.stream.protocols.packets:{name}" for name in PACKETS),
        ".bin",
        ex.frames,
        _use_frames,
        file=False,
    ),
    _reader(
        "OSC",
        "core.stream.protocols.osc:read_message core.stream.protocols.osc:read_bundle",
        ".bin",
        lambda: [bundle(1, [message_head("/dermis/touch") + bytes(4)]), TOUCH],
        _use_osc,
        file=False,
    ),
    _reader(
        "force sensor",
        "core.stream.daq.force_sensor:ForceSensor.load",
        ".json",
        lambda: [ForceSensor("s", ("Fx", "Tz"), ("N", "N m"), 5.0, ((1.0, 2.0), (3.0, 4.0))).dumps().encode()],
        _use_force_sensor,
    ),
    _reader(
        "keys of paired boards",
        "core.stream.protocols.pairs:load",
        ".json",
        lambda: [
            json.dumps({"DERMISU1": "00" * KEY}).encode(),
            json.dumps({"DERMISU1": {"key": "00" * KEY, "address": "udp://h:1?board=DERMISU1"}}).encode(),
        ],
        pairs.load,
    ),
    _reader(
        "sealed datagrams",
        "core.stream.protocols.sealed:HostSeals.unseal core.stream.protocols.sealed:BoardSeals.take",
        ".bin",
        lambda: [HostSeals(VIRTUAL_KEY).ask(), BoardSeals(VIRTUAL_KEY, lambda: 0).seal(b"\0")],
        _use_seals,
        file=False,
    ),
    _reader(
        "torque board",
        "core.stream.protocols.torque:Torque.receive",
        ".bin",
        lambda: [b"DA\1\0" + bytes(8)],
        _use_torque,
        file=False,
    ),
    _reader(
        "Maestro's answers",
        "core.stream.protocols.maestro:Maestro.receive",
        ".bin",
        lambda: [b"\x20\0"],
        _use_maestro,
        file=False,
    ),
    _reader(
        "Dynamixel's answers",
        "core.stream.protocols.bus.dynamixel:answers core.stream.protocols.bus.dynamixel:Dynamixel._describe "
        "core.stream.protocols.bus.dynamixel:Dynamixel._measured",
        ".bin",
        lambda: _identity("dynamixel"),
        lambda path: _use_servos(path, dynamixel.Dynamixel(ex.wire(), {})),
        file=False,
    ),
    _reader(
        "Feetech's answers",
        "core.stream.protocols.bus.feetech:Feetech._number",
        ".bin",
        lambda: _identity("feetech"),
        lambda path: _use_servos(path, feetech.Feetech(ex.wire(), {})),
        file=False,
    ),
    _reader(
        "parcel",
        "core.work.parcel:unpacked core.work.parcel:array_from",
        ".npz",
        lambda: [parcel.packed({"job": "a", "large": [1, None]}, {"x": np.ones((2, 3)), "y/1": np.arange(4)})],
        lambda path: parcel.unpacked(path.read_bytes(), "a parcel"),
        file=False,
    ),
    _reader(
        "sweep",
        "core.sweep.spec:read",
        ".toml",
        lambda: [ex.SWEEP.encode()],
        lambda path: [*sweep_spec.read(path).variants()],
    ),
    _reader(
        "row of a sweep",
        "core.sweep.table:kept",
        ".json",
        lambda: [b'{"method": "DM2", "off": 0.25, "samples": 20}'],
        _use_row,
    ),
    _reader(
        "stream log",
        "core.stream.log.binary:read core.stream.log.binary:loads core.stream.log.binary:_end",
        ".dlog",
        lambda: [ex.stream_log(), ex.stream_log(0)],
        _use_stream_log,
    ),
    _reader("request", "", ".json", lambda: [ex.request()], _use_request, file=False),
)

# What reads, and reads nothing of others: functions, or whole modules, and why they are in no table.
OWN = {
    "core.matching.description:digest_of": "the engine's own sources, of which a digest is made",
    "core.matching.description:write_shipped": "what it writes itself",
    "blender_addon.comparison.compared:find": "its own child's answer",
    "blender_addon.comparison.told:find": "its own child's answer",
    "core.comparison.job:_encoded": "its own words; scenes and presets have readers in the table",
    "core.kernels.building:_compiled": "writes",
    "core.kernels.building:declared": "its own sources",
    "core.kernels.building:digest": "its own sources",
    "core.kernels.building:whole": "whole by its digest, or not there",
    "core.kernels.library:loaded_copy": "writes; its original is whole by its digest",
    "core.kernels.records:numbers_of": "its own record in memory",
    "core.matching.adapt:adapt_job": "files that it has just written",
    "core.matching.screen_map:ScreenMap.save": "writes",
    "core.matching.table:SkinTable.save": "writes",
    "core.pipeline.share_job:arrays_of": "writes",
    "core.pipeline.share_job:made_of": "its own child's answer",
    "core.pipeline.shot:presets_of": "a person's presets, which travel as they are; they are read where they arrive",
    "core.pipeline.shot:shot_of": "its own worker's answer",
    "core.pipeline.shot:work": "files that it has just written",
    "core.pipeline.shots:_bytes": "a scene that travels as it is; it is read where it arrives",
    "core.pipeline.shots:Skins.make": "its own words",
    "core.presets:Library.load": "copies what it holds",
    "core.skin.job:make_files": "files that it has just written",
    "core.scene.scene_file:save": "writes",
    "core.skin.store:write_model": "writes",
    "core.skin.store:write_arrays": "writes",
    "core.stream.protocols.pairs:keep": "writes",
    "core.command_line.stream_log:run": "writes; the reader 'stream log' has the rest",
    "core.stream.log.files:_published": "writes",
    "core.stream.log.writer:serve": "its own sender's ring",
    "core.stream.log.ring": "its own sender's rows and setup",
    "core.work.mapped:MappedRecord.number": "its own parent's or child's record",
    "core.work.mapped:MappedRecord._slot": "whole by its check sum, or not there",
    "core.stream.shared_state": "whole by its check sum, or not there; the reader 'request' has the rest",
    "core.stream.outbox:Outbox._may_leave": "asks whether a bucket is open",
    "core.stream.log.udp_tee:UdpTee._may_leave": "asks whether a bucket is open",
    "blender_addon.sampling.meshes:MeshReader._look": "what it has just read of a mesh in Blender's memory",
    "blender_addon.sampling.image_files:_tiff": "asks the readers of TIFF, which are in the table",
    "blender_addon.sampling.render_surfaces:_quiet": "opens the null device",
    "blender_addon.sampling.render_surfaces:_read": "a file that Blender has just written for it",
    "core.stream.links.record:_opened": "writes a record",
    "core.stream.sender": "its own parent's shared state",
    "core.stream.links.serial_port": "a port, not a file",
    "core.stream.links.sockets:Tcp._queued": "a number of the system's",
    "core.stream.connection": "a link, not a file",
    "core.stream.links.transport": "the system's list of processes",
    **{
        f"core.stream.virtual.servo_bus:{name}": "the other end of the readers of smart servos, simulated"
        for name in (
            "DynamixelDevice._do",
            "DynamixelDevice._instruction",
            "DynamixelDevice._set",
            "SimulatedServo.word",
        )
    },
    "core.stream.virtual.torque:TorqueDevice.feed": "the other end of the reader 'torque board', simulated",
    "core.surrogate.store:save": "writes",
    "core.sweep.devices:rows": "a scene's hash; the reader 'scene' has the rest",
    "core.sweep.job:figures_of": "its own worker's answer",
    "core.version:version": "the manifest beside the program",
    "core.work.engine:_digest": "its own sources and presets",
    "core.contact.packed_forces:_decoded": "unpacks what this process packed; nothing of it comes from a file",
    "core.work.parcel:packed": "writes",
    "core.work.processes": "its own child or parent, and the arrays between them",
    "blender_addon.streaming.built_devices:_read_fingers": "tests/blender/test_readers.py damages it",
    "blender_addon.results.owners:loads": "tests/blender/test_readers.py damages it",
    "blender_addon.results.store:_read": "tests/blender/test_readers.py damages it",
    "blender_addon.results.store:_write": "writes",
    "blender_addon.results.stored_skins:_unpacked": "tests/blender/test_readers.py damages it",
    "blender_addon.streaming.streamed_track:track_path": "writes",
    "blender_addon.devices.thimble_adaptation:_meta": "tests/blender/test_readers.py damages it",
}
