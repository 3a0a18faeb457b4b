"""Files that are small and would become large: refused within a second and 300 MB, in a process of its own."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tomllib
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import core
from core import images
from core.errors import DermisError
from core.files import opened, read_bytes, write_npz
from core.foreign import toml_of
from core.npz import array_of, opened_npz, read_npz

pytestmark = pytest.mark.shared_tests("words of refusals; each line tries half of them")

ROOT = Path(core.__file__).parents[1]
MAX_SECONDS, MAX_MEGABYTES = 1.0, 300.0
CHILD = """
import resource, sys, time
from pathlib import Path
import numpy as np
from core import files, images, npz, presets
from core.scene import scene_file
from core.skin import sensor
from core.errors import DermisError
from core.track import export
from core.matching.screen_map import ScreenMap
from core.matching.table import SkinTable
from core.skin import file as skin
from core.surrogate import table
from core.sweep import spec
reader = eval(sys.argv[1])
before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
try:
    reader(Path(sys.argv[2]))
    print("read")
except DermisError as error:
    print(error)
print(time.process_time() - started, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def tried(reader: str, path: Path) -> tuple[str, float, float]:
    """Read a file in a child; return its words, the seconds of a processor that it took and the megabytes it added."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, "-c", CHILD, reader, str(path)], capture_output=True, text=True, timeout=120, env=environment
    )
    assert done.returncode == 0, done.stderr[-2000:]
    *words, numbers = done.stdout.strip().splitlines()
    seconds, megabytes = map(float, numbers.split())
    return "\n".join(words), seconds, megabytes


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def zeros(count: int) -> bytes:
    """Return so many zero bytes, packed by zlib, without ever holding them."""
    packer, parts = zlib.compressobj(9), []
    for at in range(0, count, 1 << 24):
        parts.append(packer.compress(bytes(min(1 << 24, count - at))))
    return b"".join([*parts, packer.flush()])


def png(columns: int, rows: int, depth: int, colour: int, unpacked: int) -> bytes:
    head = struct.pack(">IIBBBBB", columns, rows, depth, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zeros(unpacked)) + chunk(b"IEND", b"")


def npy_header(descr: str, shape: str) -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text


def packed(path: Path, members: dict[str, tuple[bytes, int]]) -> None:
    """Write a zip of members, each a header and so many zeros after it."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, (head, count) in members.items():
            with archive.open(name, "w", force_zip64=True) as member:
                member.write(head)
                for at in range(0, count, 1 << 24):
                    member.write(bytes(min(1 << 24, count - at)))


def sparse(path: Path, head: bytes, size: int) -> None:
    with path.open("wb") as file:
        file.write(head)
        file.truncate(size)


def flat_png(path: Path) -> None:
    path.write_bytes(png(16_384, 16_384, 16, 6, 1 << 26))


def allowed_png(path: Path) -> None:
    path.write_bytes(png(9_999, 9_999, 8, 0, 10_000 * 9_999))


def one_bit_png(path: Path) -> None:
    path.write_bytes(png(9_999, 9_999, 1, 3, 1251 * 9_999))


def endless_png(path: Path) -> None:
    path.write_bytes(png(64, 64, 8, 0, 1 << 28))


def big_npz(path: Path) -> None:
    rows = (128 << 20) // 24
    packed(path, {"x.npy": (npy_header("<f8", f"({rows}, 3)"), rows * 24)})


def huge_npz(path: Path) -> None:
    """The same, and its directory says 3 GB."""
    big_npz(path)
    data = bytearray(path.read_bytes())
    at = data.rfind(b"PK\1\2") + 24
    data[at : at + 4] = struct.pack("<L", 3 << 30)
    path.write_bytes(data)


def many_npz(path: Path) -> None:
    rows = (60 << 20) // 24
    names = ("x", "channels", "memory", "trajectory")
    packed(path, {f"{n}.npy": (npy_header("<f8", f"({rows}, 3)"), rows * 24) for n in names})


def lying_npz(path: Path) -> None:
    packed(path, {f"{n}.npy": (npy_header("<f8", "(4000000000,)"), 8) for n in ("times", "stimuli")})


def empty_npz(path: Path) -> None:
    packed(path, {f"{n}.npy": (npy_header("<f8", "(4000000000, 0)"), 0) for n in ("x", "channels")})


def lying_npy(path: Path) -> None:
    path.write_bytes(npy_header("<f8", "(4000000000,)") + bytes(64))


def members_npz(path: Path) -> None:
    """A directory of 400,000 members that all lie on the same empty place."""
    entry = struct.pack("<4s4B4HL2L5H2L", b"PK\1\2", 20, 3, 20, 0, 0, 0, 0, 0, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0)
    names = b"".join(entry + b"%08d" % i for i in range(400_000))
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 65535, 65535, len(names), 0, 0)
    path.write_bytes(names + end)


def header_scene(path: Path) -> None:
    packed(path, {"header.json": (b"", 100 << 20)})


def text_netpbm(path: Path) -> None:
    path.write_bytes(b"P2 10000 10000 255\n" + b"1 " * 1000)


def sparse_pgm(path: Path) -> None:
    sparse(path, b"P5 10000 10000 255\n", 3 << 30)


def sparse_csv(path: Path) -> None:
    sparse(path, b"t_s,x\n", 1 << 29)


def sparse_preset(path: Path) -> None:
    sparse(path, b"{", 1 << 32)


def nested_preset(path: Path) -> None:
    path.write_bytes(b"[" * 8_000_000)


def wide_preset(path: Path) -> None:
    path.write_bytes(b"[" + b"{}," * 8_000_000 + b"{}]")


# What is not large, and takes a time that grows with its square: twice the bytes, four times the seconds.


def nested_header_sweep(path: Path) -> None:
    path.write_text("[" + ".".join("a" * 100_000) + "]")


def nested_key_sweep(path: Path) -> None:
    path.write_text('schema = "x"\n' + " . ".join(["a-b", '"c"', "'d'"] * 20_000) + " = 1")


def nested_inline_sweep(path: Path) -> None:
    path.write_text("a = {" + ".".join("b" * 100_000) + " = 1}")


def wide_sweep(path: Path) -> None:
    path.write_text("a = [" + "1," * 2_000_000 + "]")


def hexadecimal_sweep(path: Path) -> None:
    path.write_text("schema = 0x" + "f" * 200_000)


def twice_preset(path: Path) -> None:
    """A key that stands twice, at the end of many."""
    path.write_text("{" + ",".join(f'"{i}":0' for i in [*range(200_000), 199_999]) + "}")


def track(header: str, columns: str = "t_s,x[m]") -> str:
    known = "# device: d\n# kind: shear_tactor\n# spec_hash: a\n# rate: 1.0\n# units: SI\n"
    return f"# dermis-track 1\n{known}{header}{columns}\n" + ",".join(["0"] * (columns.count(",") + 1)) + "\n"


def headed_csv(path: Path) -> None:
    notes = "".join(f"# x.{i}: {i}\n" for i in range(100_000))
    path.write_text(track(notes))


def broad_csv(path: Path) -> None:
    names = [f"c{i}" for i in range(10_000)]
    header = "".join(f'# channel.{n}: {{"rest": 0}}\n# limited.{n}.range: 1\n' for n in names)
    path.write_text(track(header + "# samples: 2\n", ",".join(["t_s", *(f"{n}[m]" for n in names)])))


READ_TABLE = "table.read_table"
BOMBS: list[tuple[Callable[[Path], None], str, str]] = [
    (flat_png, "images.read", "too large"),
    (allowed_png, "images.read", "too large for their packed size"),
    (one_bit_png, "images.read", "too large for their packed size"),
    (huge_npz, READ_TABLE, "too large"),
    (big_npz, READ_TABLE, "too large for their packed size"),
    (many_npz, READ_TABLE, "too large for their packed size"),
    (lying_npz, "lambda p: sensor.read_stimuli(p, 2)", "declares"),
    (empty_npz, READ_TABLE, "a side that is too long"),
    (lying_npy, "images.read", "declares"),
    (members_npz, READ_TABLE, "members"),
    (header_scene, "scene_file.load", "too large for their packed size"),
    (text_netpbm, "images.read", "cut short"),
    (sparse_pgm, "images.read", "too large"),
    (sparse_csv, "export.read", "not a Dermis command track"),
    (sparse_preset, "presets.read", "too large"),
    (nested_preset, "presets.read", "nested too deeply"),
    (wide_preset, "presets.read", "too large"),
    (nested_header_sweep, "spec.read", "nested too deeply"),
    (nested_key_sweep, "spec.read", "nested too deeply"),
    (nested_inline_sweep, "spec.read", "nested too deeply"),
    (wide_sweep, "spec.read", "too large"),
    (hexadecimal_sweep, "spec.read", "the whole number has too many digits"),
    (twice_preset, "presets.read", "a key appears twice"),
    (headed_csv, "export.read", "is missing in the header"),
    (broad_csv, "export.read", "the number of rows"),
    (big_npz, "SkinTable.load", "missing"),
    (big_npz, "ScreenMap.load", "missing"),
    (big_npz, "skin.load_mesh", "schema"),
]


@pytest.mark.skipif(sys.platform == "win32", reason="measures as POSIX does")
@pytest.mark.parametrize(("make", "reader", "words"), BOMBS, ids=lambda v: getattr(v, "__name__", None))
def test_a_bomb_is_refused_before_it_grows(
    make: Callable[[Path], None], reader: str, words: str, tmp_path: Path
) -> None:
    make(tmp_path / "bomb")
    said, seconds, megabytes = tried(reader, tmp_path / "bomb")
    without = ("missing", "cut short", "schema", "a key appears twice", "is missing in the header")
    assert words in said and "allowed" in said + " allowed" * (words in without)
    assert megabytes < MAX_MEGABYTES, said
    assert seconds < MAX_SECONDS or os.getloadavg()[0] > (os.cpu_count() or 1), said


@pytest.mark.skipif(sys.platform == "win32", reason="measures as POSIX does")
def test_pixels_that_are_unpacked_beyond_the_picture_are_not_unpacked(tmp_path: Path) -> None:
    endless_png(tmp_path / "a.png")
    said, _, megabytes = tried("images.read", tmp_path / "a.png")
    assert "more pixels than its size" in said and megabytes < 50


def test_the_limits_leave_what_people_have(tmp_path: Path) -> None:
    """A flat map of 4,096 x 4,096, and arrays that do not compress, are read."""
    (tmp_path / "flat.png").write_bytes(png(4_096, 4_096, 8, 0, 4_097 * 4_096))
    assert images.read(tmp_path / "flat.png").values.shape == (4_096, 4_096)
    noise = np.random.default_rng(1).random((1 << 20, 2))
    np.savez_compressed(tmp_path / "a.npz", noise=noise, turned=np.asfortranarray(noise[:100]), word=np.array("é"))
    found = read_npz(tmp_path / "a.npz")
    assert np.array_equal(found["noise"], noise) and np.array_equal(found["turned"], noise[:100])
    assert found["turned"].flags.writeable and str(found["word"]) == "é" and found["word"].shape == ()


@pytest.mark.parametrize(
    "text",
    [
        "a = [" + "1.5, " * 1000 + "]",
        'a = "' + "b." * 1000 + '"  # ' + "c." * 1000,
        "a = '''\n" + "b." * 1000 + "\n'''\nd = 1",
        'a = """\n' + 'b.\\"""' * 1000 + 'x""""\nd."e.f" = 1',
        ".".join("a" * 32) + " = 1",
        "".join(f"a.b.c{i} = 1979-05-27\n" for i in range(1000)),
    ],
    ids=["numbers", "string and comment", "literal", "quotes", "deepest", "many"],
)
def test_dots_that_nest_nothing_are_read(text: str) -> None:
    assert toml_of(text, "a") == tomllib.loads(text)


@pytest.mark.parametrize("kind", ["<f8", ">f4", "|u1", "|b1", "<c16", "<U3", "|S2", "<i8"])
def test_arrays_come_back_as_numpy_gives_them(kind: str, tmp_path: Path) -> None:
    for array in (np.ones((2, 3, 4)).astype(kind), np.zeros((0, 3)).astype(kind), np.array(1).astype(kind)):
        write_npz(tmp_path / "a.npz", {"a": array})
        with opened_npz(tmp_path / "a.npz") as archive:
            back = archive.array("a")
        assert back.dtype == array.dtype and back.shape == array.shape and np.array_equal(back, array)
        np.save(tmp_path / "a.npy", array)
        assert np.array_equal(array_of((tmp_path / "a.npy").read_bytes(), "a"), array)


def test_a_member_that_lies_about_its_size_is_refused(tmp_path: Path) -> None:
    write_npz(tmp_path / "a.npz", {"a": np.arange(100.0)})
    data = bytearray((tmp_path / "a.npz").read_bytes())
    at = data.rfind(b"PK\1\2") + 20
    data[at : at + 8] = struct.pack("<LL", 300, 300)  # both sizes in the directory: less than there is
    (tmp_path / "b.npz").write_bytes(data)
    with pytest.raises(DermisError, match="cannot be read"):
        read_npz(tmp_path / "b.npz")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_file_that_becomes_a_pipe_between_two_looks_is_refused_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plain").write_bytes(b"x")
    plain = os.stat(tmp_path / "plain")
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setattr("core.files.os.stat", lambda path: plain)
    with pytest.raises(DermisError, match="a pipe"), opened(tmp_path / "pipe"):
        pass


def test_refusals_name_file_value_limit_and_remedy(tmp_path: Path) -> None:
    sparse(tmp_path / "a.json", b"{", 1 << 25)
    with pytest.raises(DermisError) as caught:
        read_bytes(tmp_path / "a.json", most=1 << 24)
    error = caught.value
    assert (error.where, error.value, error.limit) == (str(tmp_path / "a.json"), f"{1 << 25} bytes", f"{1 << 24} bytes")
    assert error.remedy and json.dumps(str(error))
