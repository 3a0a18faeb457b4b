"""The compiled library: found, checked before use, missed in one sentence; devices without a skin do without it."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.kernels import COPIES, building, library, records
from core.surface.gap import Surface

HERE = building.this_platform()


@pytest.fixture
def nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let there be no library."""
    missing = DermisError("the compiled kernels are missing", where="here", code=library.CODE)
    monkeypatch.setattr(library, "_loaded", lambda: missing)


def own_library() -> Path:
    """Return the library that the tests run on."""
    return library.kernels().path


def test_the_one_that_the_tests_run_on_is_of_these_sources() -> None:
    path = own_library()
    assert path.name.startswith(f"dermis-{HERE}-{building.digest()}-") and building.whole(path)
    assert library.kernels() is library.kernels()


def test_a_missing_one_is_told_with_platform_file_and_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(DermisError) as told:
        library.find("linux-x64", [tmp_path])
    said = str(told.value)
    assert told.value.code == "no-kernels" and said.count("\n") == 0
    for word in ("linux-x64", building.stem("linux-x64"), str(tmp_path), "build_addon.py kernels", "without a skin"):
        assert word in said
    with pytest.raises(
        DermisError, match=r"sunos-sparc: there are no compiled kernels .*allowed: linux-x64, windows-x64"
    ):
        library.find("sunos-sparc", [tmp_path])


def test_the_first_folder_that_has_it_is_taken(tmp_path: Path) -> None:
    name = f"{building.stem('windows-x64')}{building.of_content(b'any')}.dll"
    for folder in ("a", "b", "c"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / (name if folder != "a" else "dermis-windows-x64-other.dll")).write_bytes(b"any")
    assert library.find("windows-x64", [tmp_path / "a", tmp_path / "b", tmp_path / "c"]) == tmp_path / "b" / name


@pytest.mark.parametrize("content", [b"", b"half", b"whole\0"])
def test_a_damaged_one_is_never_loaded(content: bytes, tmp_path: Path) -> None:
    """Half a library ends the process that loads it, and takes unsaved work along."""
    path = tmp_path / f"{building.stem('linux-x64')}{building.of_content(b'whole')}.so"
    path.write_bytes(content)
    with pytest.raises(DermisError, match="the compiled kernels for linux-x64 are damaged") as told:
        library.find("linux-x64", [tmp_path])
    assert str(path) in str(told.value) and told.value.code == "no-kernels"
    path.write_bytes(b"whole")
    assert library.find("linux-x64", [tmp_path]) == path


@pytest.mark.parametrize("what", ["folder", "dangling"])
def test_one_that_cannot_be_read_is_told(what: str, tmp_path: Path) -> None:
    """As a damaged one: without the sentence, devices without a skin would fail too."""
    path = tmp_path / f"{building.stem('linux-x64')}{building.of_content(b'any')}.so"
    path.mkdir() if what == "folder" else path.symlink_to(tmp_path / "nowhere")
    with pytest.raises(DermisError, match="damaged or cannot be read") as told:
        library.find("linux-x64", [tmp_path])
    assert str(path) in str(told.value) and told.value.code == "no-kernels"


@pytest.mark.parametrize("what", ["text", "another"])
def test_one_that_cannot_be_loaded_is_told(what: str, tmp_path: Path) -> None:
    """A text, and a library of something else: the same sentence, with the system's own reason."""
    import _ctypes

    path = tmp_path / own_library().name
    path.write_bytes(b"not a library" if what == "text" else Path(_ctypes.__file__).read_bytes())
    with pytest.raises(DermisError, match=f"the compiled kernels for {HERE} cannot be loaded") as told:
        library.Kernels(path)
    assert str(path) in str(told.value) and "Install" in told.value.remedy and told.value.code == "no-kernels"


def test_one_of_other_sources_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    path = own_library()  # before the digest is another: what is found first is kept for all later tests
    monkeypatch.setattr(building, "digest", lambda: "0123456789abcdef")
    with pytest.raises(DermisError, match=r"of another version of Dermis.*allowed: sources 0123456789abcdef"):
        library.Kernels(path)


def test_one_whose_records_differ_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing through a record of another layout would destroy memory."""
    path = own_library()  # before a record is another: what is found first is kept for all later tests
    other = [*records.QueryRecord._fields_, ("more", ctypes.c_int64)]
    monkeypatch.setitem(records.RECORDS, "query", type("QueryRecord", (ctypes.Structure,), {"_fields_": other}))
    with pytest.raises(DermisError, match=r"of another version of Dermis.*allowed: sources \w{16}, records \w{16}"):
        library.Kernels(path)


@pytest.mark.parametrize(("name", "record"), [("fit", "tree"), ("sum", "sums"), ("draw_skin", "drawn"), ("law", "law")])
def test_a_damaged_record_is_told_by_each_function(name: str, record: str) -> None:
    kernels, damaged = library.kernels(), records.RECORDS[record]()
    setattr(damaged, records.HEADER.records[record][0].name, -1)
    with pytest.raises(DermisError, match="a record for the kernels is damaged") as told:
        getattr(kernels, name)(ctypes.byref(damaged))
    assert kernels.path.name in str(told.value)


@pytest.fixture
def copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of copies, as the extension names it."""
    monkeypatch.setenv(COPIES, str(tmp_path / "copies"))
    library._loaded.cache_clear()
    yield tmp_path / "copies"
    monkeypatch.undo()
    library._loaded.cache_clear()


def test_a_copy_is_loaded_where_the_extension_names_a_folder(copies: Path) -> None:
    """The original is never locked, so that an update can replace it; other versions' copies go."""
    original = own_library()
    assert original.parent == copies
    library._loaded.cache_clear()
    original.unlink()  # not written over: this process has it loaded
    original.write_bytes(b"damaged")
    old = copies / f"dermis-{HERE}-0123-{building.of_content(b'old')}{original.suffix}"
    old.write_bytes(b"old")
    assert building.whole(own_library()) and list(copies.iterdir()) == [original]


def test_a_folder_of_copies_that_cannot_be_written_leaves_the_original(copies: Path) -> None:
    copies.write_text("no folder")
    assert own_library().parent != copies and library.have_kernels()


def test_a_copy_that_is_locked_stays(copies: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stand-in for Windows, which does not let a loaded file go; the next start tries again."""
    copies.mkdir()
    old = copies / f"dermis-{HERE}-0123-{building.of_content(b'old')}{building.TARGETS[HERE].suffix}"
    old.write_bytes(b"old")
    unlink = Path.unlink

    def locked(path: Path, missing_ok: bool = False) -> None:
        if path == old:
            raise PermissionError(13, "The process cannot access the file: it is being used by another process")
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", locked)
    assert own_library().parent == copies and old.is_file()
    monkeypatch.setattr(Path, "unlink", unlink)
    library._loaded.cache_clear()
    assert own_library().parent == copies and not old.exists()


def test_skins_refuse_without_it(nobody: None) -> None:
    from core.contact.solver.nodes import Nodes
    from core.contact.solver.path_solver import PathSolver

    nodes = Nodes.of(np.eye(3), np.eye(3), None, np.eye(9))
    with pytest.raises(DermisError, match="kernels are missing") as told:
        PathSolver(nodes)
    assert told.value.code == "no-kernels"


def test_distances_are_measured_without_it(nobody: None) -> None:
    """A device without a skin follows its pad's centre: the same distances, but for rounding."""
    block = Surface.block(0.02, 0.02, 0.02)
    points = np.random.default_rng(0).uniform(-0.02, 0.02, (200, 3))
    gap = block.query(points).gap
    q = np.abs(points + [0.0, 0.0, 0.01]) - 0.01
    exact = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)
    np.testing.assert_allclose(gap, exact, atol=1e-15)


def test_a_haptip_is_rendered_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole way of a device without a skin: the same commands as with the library, but for rounding."""
    from core.pipeline.render import run
    from core.presets import Library
    from core.scene.from_poses import scene_from_poses
    from core.scene.tactile_scene import Body, DeviceUse, Finger

    finger, ball = Finger("Index", (DeviceUse("haptip"),)), Surface.sphere(8e-3, 300).mesh
    way = [(1e-4 * k, 0.0, 10e-3 - 0.2 * k / 240) for k in range(25)]  # down at 0.2 m/s
    scene = scene_from_poses(
        240.0, [(finger, way)], [(Body("Ball", ball, Library().material("wood")), (0.0, 0.0, 0.0))]
    )
    whole = run(scene).outputs[0].track.values
    monkeypatch.setattr(library, "_loaded", lambda: DermisError("missing", code=library.CODE))
    mesh = Surface.sphere(8e-3, 300).mesh  # another one: surfaces are kept with their meshes
    scene = scene_from_poses(
        240.0, [(finger, way)], [(Body("Ball", mesh, Library().material("wood")), (0.0, 0.0, 0.0))]
    )
    without = run(scene).outputs[0].track.values
    assert np.ptp(whole, axis=0).max() > 0.0
    np.testing.assert_allclose(whole, without, rtol=1e-9, atol=1e-9)
