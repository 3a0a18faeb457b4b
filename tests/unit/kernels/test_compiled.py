"""The same bytes from every compiler, in every floating-point environment; nothing read or written beside arrays."""

from __future__ import annotations

import ctypes
import os
import platform
import shutil
import struct
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import build_addon
from core.kernels import building, library
from tests.kernel_cases.bodies import Arrays, drawn, drawn_survey, drawn_touch
from tests.kernel_cases.case import Case, gcc, opened
from tests.kernel_cases.contacts import GIVEN, drawn_arrivals, drawn_contact, drawn_friction
from tests.kernel_cases.discs import drawn_pressed, drawn_search
from tests.kernel_cases.pads import drawn_change, drawn_pieces, drawn_rows
from tests.kernel_cases.skins import drawn_law, drawn_rest, drawn_skin

from .remote_library import RemoteLibrary

ROOT = Path(__file__).resolve().parents[3]
LINUX = sys.platform.startswith("linux") and platform.machine() == "x86_64"
needs_gcc = pytest.mark.skipif(
    not (LINUX and shutil.which("gcc")), reason="THE KERNELS ARE NOT TRIED BY GCC: apt-get install gcc"
)
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
WINE = shutil.which("wine64") or next((p for p in ("/usr/lib/wine/wine64",) if Path(p).exists()), None)
CONTROL = """
unsigned control(void) { return __builtin_ia32_stmxcsr(); }
void set_control(unsigned bits) { __builtin_ia32_ldmxcsr(bits); }
"""
ROUND_UP, FLUSH, ZERO = 0x4000, 0x8000, 0x0040  # towards infinity, denormal results to zero, denormal operands are zero


def answers(own: ctypes.CDLL | RemoteLibrary) -> list[bytes]:
    """Return a library's answers for arrays of all kinds."""
    out = []
    for arrays in cases():
        assert not any(arrays.call(own))
        out.append(arrays.answer())
    return out


def cases() -> list[Case]:
    """Return arrays of all kinds for all functions."""
    surveys = [drawn_survey(seed) for seed in range(12)]
    tissue = [*map(drawn_law, range(20)), *map(drawn_rest, range(6))]
    pads = [*surveys, *map(drawn_pieces, range(6)), *map(drawn_skin, range(27))]
    contacts = [*map(drawn_contact, range(20)), *map(drawn_friction, range(20)), *map(drawn_pressed, range(40))]
    contacts += [*map(drawn_touch, range(30)), *map(drawn_search, range(40))]
    pads += [*map(drawn_rows, range(12)), *map(drawn_change, range(20)), *map(drawn_arrivals, range(12))]
    return [*(drawn(seed) for seed in range(0, 40, 3)), *contacts, *tissue, *pads]


@pytest.fixture(scope="module")
def wanted() -> list[bytes]:
    """The answers of the library that ships."""
    return answers(opened(library.kernels().path))


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Reads and sets the control bits of a thread, as a library that was built for speed does when it is loaded."""
    folder = tmp_path_factory.mktemp("control")
    (folder / "control.c").write_text(CONTROL)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", str(folder / "a.so"), str(folder / "control.c")], check=True)
    return ctypes.CDLL(str(folder / "a.so"))


@pytest.mark.one_line("3.11", "it is C")
@needs_gcc
@pytest.mark.parametrize("flags", ["-march=x86-64-v2", "-O0", "-O3 -march=x86-64-v3"])
def test_another_compiler_gives_the_same_bytes(flags: str, wanted: list[bytes], tmp_path: Path) -> None:
    if "v3" in flags and "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no AVX2")
    path = tmp_path / "gcc.so"
    done = subprocess.run(gcc(path, *WARNINGS, *flags.split()), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert answers(opened(path)) == wanted


@needs_gcc
@pytest.mark.parametrize(
    "bits", [ROUND_UP, FLUSH | ZERO, ROUND_UP | FLUSH | ZERO], ids=["rounding", "flushing", "both"]
)
def test_a_changed_floating_point_environment_changes_no_byte_and_is_left_as_it_was(
    bits: int, wanted: list[bytes], control: ctypes.CDLL
) -> None:
    own = opened(library.kernels().path)
    before = control.control()
    small, third = np.full(1, 1e-310), np.ones(1)
    for arrays, answer in zip(cases(), wanted, strict=True):
        control.set_control(before | bits)
        try:
            changed = (third / 3.0)[0], (small * 1.0)[0]
            statuses = arrays.call(own)
            after = control.control()
        finally:
            control.set_control(before)
        assert changed != ((third / 3.0)[0], (small * 1.0)[0]), "the environment was changed"
        assert not any(statuses) and arrays.answer() == answer
        assert after & 0xFFC0 == (before | bits) & 0xFFC0


@needs_gcc
def test_denormal_numbers_are_kept(control: ctypes.CDLL) -> None:
    """A distance of 2e-155 m has a square that is denormal: flushed, it would be 0."""
    own = opened(library.kernels().path)
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    arrays = Arrays(corners, np.array([[0, 1, 2]]), np.array([[0.25, 0.25, 2e-155], [0.0, 0.0, -2e-155]]))
    before = control.control()
    control.set_control(before | FLUSH | ZERO)
    try:
        assert not any(arrays.call(own))
    finally:
        control.set_control(before)
    np.testing.assert_allclose(arrays.found["gap"], [2e-155, -2e-155], rtol=1e-6)


@pytest.mark.one_line("3.13", "it is C")
@needs_gcc
def test_nothing_is_read_or_written_beside_the_arrays(tmp_path: Path) -> None:
    """Random arrays, numbers that are none, hints that are no triangles: under the address and undefined sanitizers."""
    path = tmp_path / "sanitized.so"
    flags = ("-O1", "-march=x86-64-v2", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    subprocess.run(gcc(path, *flags), check=True)
    told = subprocess.run(["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    variables = {
        **os.environ,
        "LD_PRELOAD": told.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONMALLOC": "malloc",
    }
    code = f"from tests.unit.kernels.test_compiled import sanitized\nsanitized({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=variables, capture_output=True, text=True)
    assert done.returncode == 0 and "tried" in done.stdout, done.stdout + done.stderr[-4000:]
    beyond = f"from tests.unit.kernels.test_compiled import sanitized\nsanitized({str(path)!r}, short=True)"
    done = subprocess.run([sys.executable, "-c", beyond], cwd=ROOT, env=variables, capture_output=True, text=True)
    assert done.returncode != 0 and "heap-buffer-overflow" in done.stderr, "an array that is too short is seen"


def sanitized(path: str, short: bool = False) -> None:
    """Call a library of which every access is checked; in a process of its own.

    Args:
        short: give it an array that is shorter than the records say.
    """
    own, refused = opened(Path(path)), 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        arrays = drawn(seed)
        if short:
            arrays.packed = arrays.packed[:-1].copy()
        bad = (np.nan, np.inf, -np.inf, 1e308, -1e200, 1e-320)
        for array in (arrays.table.rows, arrays.table.bounds, arrays.points):
            if seed % 2 and rng.random() < 0.5:
                array.flat[rng.integers(0, array.size, 3)] = rng.choice(bad, 3)
        if seed % 5 == 0:
            for indices in (arrays.topology.corners, arrays.topology.across, arrays.part):
                indices.flat[rng.integers(0, indices.size)] = rng.integers(-(2**62), 2**62)
        if seed % 7 == 0:
            arrays.limit = float(rng.choice([0.0, 1e-300, 1e300, np.inf, np.nan, -1.0]))
        refused += any(arrays.call(own))
        contact = drawn_contact(seed)
        for name in GIVEN if seed % 2 else ():
            array = getattr(contact, name)
            array.flat[rng.integers(0, array.size)] = rng.choice(bad)
        refused += any(contact.call(own))
        friction = drawn_friction(seed)
        for name in ("poses", "material", "force", "image", "moved", "friction") if seed % 2 else ():
            friction.arrays[name].flat[rng.integers(0, friction.arrays[name].size)] = rng.choice(bad)
        if seed % 5 == 0:
            friction.arrays["below"][rng.integers(0, len(friction.arrays["below"]))] = rng.choice([-2, 3, 2**62])
        refused += any(friction.call(own))
        survey = drawn_survey(seed)
        for name in ("positions", "normals", "sides", "limits") if seed % 2 else ():
            array = getattr(survey, name)
            array.flat[rng.integers(0, array.size)] = rng.choice(bad)
        refused += any(survey.call(own))
        law = drawn_law(seed)
        if seed % 2:
            law.moved.flat[rng.integers(0, law.moved.size)] = rng.choice(bad)
        if seed % 5 == 0:
            law.corners.flat[rng.integers(0, law.corners.size)] = rng.integers(-(2**31), 2**31)
        refused += any(law.call(own))
        rest = drawn_rest(seed)
        rest.force.flat[rng.integers(0, rest.force.size)] = rng.choice(bad)
        refused += any(rest.call(own))
        pieces = drawn_pieces(seed)
        pieces.sides.flat[rng.integers(0, pieces.sides.size)] = rng.choice(bad)
        refused += any(pieces.call(own))
        change, rows = drawn_change(seed), drawn_rows(seed)
        rows.pieces.positions.flat[rng.integers(0, rows.pieces.positions.size)] = rng.choice(bad)
        for name in ("places", "former", "left", "sources", "order") if seed % 2 else ():
            array = getattr(change, name)
            if array.size:
                array[rng.integers(0, array.size)] = rng.choice([-2, 200, 2**62])
        if seed % 5 == 0:
            rows.source[rng.integers(0, len(rows.source))] = rng.choice([-1, 12, 2**62])
        refused += any(change.call(own)) + any(rows.call(own))
        touch = drawn_touch(seed)
        for name in ("points", "where", "offset", "force", "areas", "compliance") if seed % 2 else ():
            array = getattr(touch, name)
            array.flat[rng.integers(0, array.size)] = rng.choice(bad)
        if seed % 5 == 0:
            touch.wrong = int(rng.choice([-(2**62), 2, 2**62]))
        refused += any(touch.call(own))
        skin = drawn_skin(seed)
        skin.force.flat[rng.integers(0, skin.force.size)] = rng.choice(bad)
        if seed % 5 == 0:
            indices = skin.corners if seed % 2 else skin.starts
            indices.flat[rng.integers(0, indices.size)] = rng.integers(-(2**31), 2**31)
        refused += any(skin.call(own))
        pressed = drawn_pressed(seed)
        for name in ("positions", "places", "anchors", "pose", "told", "compliance") if seed % 2 else ():
            array = getattr(pressed, name)
            array.flat[rng.integers(0, array.size)] = rng.choice(bad)
        if seed % 3 == 0:
            pressed.near[rng.integers(0, len(pressed.near))] = rng.integers(-(2**62), 2**62) % len(pressed.positions)
        refused += any(pressed.call(own))
        search = drawn_search(seed)
        for name in ("target", "observation", "x", "low", "matrix") if seed % 2 else ():
            array = getattr(search, name)
            array.flat[rng.integers(0, array.size)] = rng.choice(bad)
        refused += any(search.call(own))
    assert 0 < refused < 1000
    print("tried; refused", refused)


@pytest.mark.skipif(not (LINUX and shutil.which("nm")), reason="needs nm")
def test_the_library_needs_no_other_one() -> None:
    """Whatever C library a system has, or none."""
    command = ["nm", "--dynamic", str(library.kernels().path)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n")
    assert not [line for line in told if " U " in line]
    names = {line.split()[-1] for line in told if " T " in line}
    assert names and all(name.startswith("dermis_") for name in names)
    assert not [line for line in told if line[17:18] in ("B", "D", "b", "d")], "no state is kept"


# -- all platforms ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def zig() -> list[str]:
    """The pinned compiler."""
    return [str(build_addon.compiler(Path(sys.executable)))]


@pytest.mark.long
@pytest.mark.parametrize("target", building.TARGETS)
def test_a_platforms_library_is_the_same_bytes_twice(target: str, zig: list[str], tmp_path: Path) -> None:
    one, other = (building.build(target, tmp_path / name, zig) for name in ("a", "b/longer"))
    assert one.name == other.name and one.read_bytes() == other.read_bytes() and building.whole(one)
    assert building.build(target, tmp_path / "a", ["nothing"]) == one, "it is kept"


@pytest.mark.long
def test_macos_would_load_its_library(zig: list[str], tmp_path: Path) -> None:
    """For arm64, signed ad hoc, with the system's library alone; it cannot be run here."""
    content = building.build("macos-arm64", tmp_path, zig).read_bytes()
    magic, cpu, _, kind, count, _, _, _ = struct.unpack_from("<8I", content)
    assert (magic, cpu, kind) == (0xFEEDFACF, 0x0100000C, 6)  # 64 bits, arm64, a dylib
    at, commands, needed = 32, set(), []
    for _ in range(count):
        command, size = struct.unpack_from("<2I", content, at)
        commands.add(command)
        if command == 0xC:  # LC_LOAD_DYLIB
            needed.append(content[at + 24 : at + size].split(b"\0")[0])
        at += size
    assert 0x1D in commands, "LC_CODE_SIGNATURE"
    assert needed == [b"/usr/lib/libSystem.B.dylib"]


@pytest.mark.long
def test_windows_library_needs_no_other_one_and_runs(zig: list[str], tmp_path: Path, wanted: list[bytes]) -> None:
    """Under wine it answers with the bytes of Linux's."""
    path = building.build("windows-x64", tmp_path, zig)
    content = path.read_bytes()
    at = struct.unpack_from("<I", content, 0x3C)[0]
    machine, flags = struct.unpack_from("<H", content, at + 4)[0], struct.unpack_from("<H", content, at + 22)[0]
    imports = struct.unpack_from("<2I", content, at + 24 + 112 + 8)
    assert machine == 0x8664 and flags & 0x2000 and imports == (0, 0)
    if WINE is None:
        pytest.skip("THE WINDOWS LIBRARY IS NOT RUN: apt-get install wine64")
    program = tmp_path / "calls_dll.exe"
    source = Path(__file__).with_name("calls_dll.c")
    command = [*zig, "cc", "-target", "x86_64-windows-gnu", "-std=c11", "-O1", "-nostdlib"]
    subprocess.run([*command, str(source), "-lkernel32", "-o", str(program)], check=True)
    shutil.copyfile(path, tmp_path / "kernels.dll")
    variables = {**os.environ, "WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([WINE, str(program)], cwd=tmp_path, env=variables, **pipes) as process:
        watch = threading.Timer(300.0, process.kill)
        watch.start()
        try:
            assert answers(RemoteLibrary(process)) == wanted
        finally:
            watch.cancel()
            process.stdin.close()
    assert process.returncode == 0
