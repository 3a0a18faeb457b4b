"""Sampled scenes as files: everything comes back to the bit, lazily; the same scene gives the same bytes."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError, Finding
from core.npz import opened_npz
from core.scene import scene_file
from core.scene.content_hash import ContentHash
from core.scene.scene_file import load, save
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene, header

TETRA = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32)


def chunk(first: int, n: int, same: bool = True) -> Chunk:
    rng = np.random.default_rng(first)
    mesh = tuple(Mesh(rng.normal(size=(4, 3)), TETRA) for _ in range(n))
    if not same:  # topology that changes: the last has one vertex and one face less
        mesh = (*mesh[:-1], Mesh(rng.normal(size=(3, 3)), TETRA[:1]))
    return Chunk(
        np.arange(first, first + n) / 10,
        np.arange(first, first + n) / 240,
        rng.normal(size=(2, n, 4, 4)),
        rng.normal(size=(2, n, 4, 4)),
        rng.normal(size=(1, n, 4, 4)),
        {1: mesh},
        {"finger/0/pattern": rng.normal(size=n), "body/0/friction": np.arange(n) + 0.1},
    )


def scene(chunks: object = None) -> TactileScene:
    return TactileScene(
        name="Ä scene",
        fps=Fraction(30000, 1001),
        frame_range=(1, 250),
        rate=240.0,
        fingers=(
            Finger(
                "Index",
                (DeviceUse("haptip", {"use_weight": False}), DeviceUse("screen", {}, "Panel")),
                {"touch_distance": 0.1 + 0.2},
            ),
            Finger("Thumb"),
        ),
        bodies=(Body("Ball", Mesh(np.eye(3), TETRA[:1]), {"friction": 0.5}, ("Cloth",), True), Body("Cloth", None)),
        screens=(
            Screen(
                "Panel",
                (0.1, 0.07),
                np.arange(6, dtype=np.float32).reshape(2, 3),
                0.001,
                {"profile": "slope"},
                (Finding("info", "repaired", "two holes", value=2),),
            ),
        ),
        chunks=(chunk(0, 5), chunk(5, 3, same=False), chunk(8, 1)) if chunks is None else chunks,  # type: ignore[arg-type]
        gravity=(0.0, 0.1, -9.81),
        findings=(Finding("warning", "w", "odd", frame=3.5, value=(1, 2)),),
    )


def digest(of: TactileScene) -> str:
    content = ContentHash(of)
    for _ in content.through(of.chunks):
        pass
    return content.hexdigest()


def test_everything_comes_back(tmp_path: Path) -> None:
    save(scene(), tmp_path / "s.npz")
    found = load(tmp_path / "s.npz")
    assert json.dumps(header(found), sort_keys=True) == json.dumps(header(scene()), sort_keys=True)
    assert found.fps == Fraction(30000, 1001) and found.screens[0].findings == scene().screens[0].findings
    assert found.findings == (replace(scene().findings[0], value="(1, 2)"),)
    assert digest(found) == digest(scene())
    assert digest(found) == digest(found), "the chunks can be read again"
    chunks = list(found.chunks)
    assert [len(c.times) for c in chunks] == [5, 3, 1]
    assert chunks[0].surfaces[1][0].triangles is chunks[2].surfaces[1][0].triangles, "held topology is one array"
    assert chunks[1].surfaces[1][2].triangles.tolist() == [[0, 2, 1]]


def test_holes_of_a_map_come_back_and_belong_to_the_scene(tmp_path: Path) -> None:
    plain = scene()
    holes = np.zeros(plain.screens[0].height_map.shape, bool)
    holes[0, 1] = True
    holed = replace(plain, screens=(replace(plain.screens[0], holes=holes), *plain.screens[1:]))
    save(holed, tmp_path / "holed.npz")
    found = load(tmp_path / "holed.npz").screens[0]
    np.testing.assert_array_equal(found.holes, holes)
    assert ContentHash(holed).hexdigest() != ContentHash(plain).hexdigest()
    wrong = replace(plain, screens=(replace(plain.screens[0], holes=holes[:1]), *plain.screens[1:]))
    save(wrong, tmp_path / "wrong.npz")
    with pytest.raises(DermisError, match="screen 0: the holes do not fit the map"):
        load(tmp_path / "wrong.npz")


def test_same_scene_same_bytes(tmp_path: Path) -> None:
    save(scene(), tmp_path / "a.npz")
    save(load(tmp_path / "a.npz"), tmp_path / "b.npz")
    turned = tuple(replace(c, animated=dict(reversed(c.animated.items()))) for c in scene().chunks)
    save(scene(turned), tmp_path / "c.npz")
    first, second, third = ((tmp_path / f"{n}.npz").read_bytes() for n in "abc")
    assert first == third
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {i.date_time for i in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert {i.compress_type for i in archive.infolist()} == {zipfile.ZIP_STORED}
    # the finding's value became a text on the way: the only thing that differs is nothing
    assert first == second


def test_numpy_reads_its_arrays(tmp_path: Path) -> None:
    save(scene(), tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["chunk/0/times"], np.arange(5) / 240)


def test_chunks_are_drawn_one_by_one_and_read_lazily(tmp_path: Path) -> None:
    alive: list[int] = []

    def draw() -> Iterator[Chunk]:
        for i in range(3):
            alive.append(i)
            yield chunk(i, 1)

    save(scene(draw()), tmp_path / "s.npz")
    assert alive == [0, 1, 2]
    found = load(tmp_path / "s.npz")
    parts = iter(found.chunks)
    next(parts)
    with (tmp_path / "s.npz").open("r+b") as file:  # the rest is not read yet
        file.truncate(1000)
    with pytest.raises(DermisError, match="damaged"):
        next(parts)
    (tmp_path / "s.npz").unlink()
    with pytest.raises(DermisError, match="the file cannot be read"):
        next(iter(found.chunks))


def test_the_table_of_contents_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has some rows for every chunk, so reading it again for each chunk would take the square of their number."""
    save(scene(chunk(i, 1) for i in range(5)), tmp_path / "s.npz")
    found, opened = load(tmp_path / "s.npz"), list[Path]()
    monkeypatch.setattr(scene_file, "opened_npz", lambda path, **how: opened.append(path) or opened_npz(path, **how))
    assert len(list(found.chunks)) == 5
    assert opened == [tmp_path / "s.npz"]


def test_sampling_that_fails_leaves_no_file(tmp_path: Path) -> None:
    def draw() -> Iterator[Chunk]:
        yield chunk(0, 1)
        raise DermisError("the finger is gone", where="frame 7")

    with pytest.raises(DermisError, match="frame 7: the finger is gone"):
        save(scene(draw()), tmp_path / "s.npz")
    assert list(tmp_path.iterdir()) == []


def rewritten(path: Path, change: dict[str, object] | None = None, drop: str = "") -> Path:
    """Return a copy of a file with fields of its header changed, or a member left out."""
    other = path.with_name("other.npz")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(other, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "header.json":
                data = json.dumps({**json.loads(data), **(change or {})}).encode()
            if name != drop:
                new.writestr(name, data)
    return other


@pytest.mark.parametrize(
    ("change", "drop", "message"),
    [
        ({"version": 2}, "", r"a newer version of Dermis \(found 'version 2'; allowed: version 1\). Update"),
        ({"version": 0}, "", "an unknown version of the format"),
        ({"format": "other"}, "", r"not a sampled scene \(found 'other'; allowed: dermis-scene\)"),
        ({"fps": [24, 0]}, "", "the header is damaged"),
        ({"fingers": 3}, "", "the header is damaged"),
        ({"bodies": [{}]}, "", "the header is damaged"),
        (None, "header.json", "not a sampled scene: it has no header"),
        (None, "body/0/vertices.npy", "body/0/vertices: .* a part is missing"),
        (None, "chunk/1/times.npy", "chunk/1/times: .* a part is missing"),
        (None, "triangles/0.npy", "triangles/0: .* a part is missing"),
    ],
)
def test_refusals(tmp_path: Path, change: dict[str, object] | None, drop: str, message: str) -> None:
    save(scene(), tmp_path / "s.npz")
    with pytest.raises(DermisError, match=message) as caught:
        list(load(rewritten(tmp_path / "s.npz", change, drop)).chunks)
    assert "other.npz" in caught.value.where


def test_no_scene_at_all(tmp_path: Path) -> None:
    with pytest.raises(DermisError, match=r"none.npz: the file cannot be read \(found 'No such file or directory'\)"):
        load(tmp_path / "none.npz")
    (tmp_path / "text").write_text("t_s,x[m]\n")
    with pytest.raises(DermisError, match="not a sampled scene, or cut short"):
        load(tmp_path / "text")


def test_flipped_bits_are_noticed(tmp_path: Path) -> None:
    """Every array's bytes are under the zip's CRC-32, which finds any single flip."""
    save(scene(), tmp_path / "s.npz")
    data = bytearray((tmp_path / "s.npz").read_bytes())
    at = data.find((np.arange(5) / 240).tobytes())
    data[at + 9] ^= 4
    (tmp_path / "s.npz").write_bytes(data)
    with pytest.raises(DermisError, match=r"chunk/0/times: the array cannot be read .*CRC"):
        list(load(tmp_path / "s.npz").chunks)


def test_arrays_of_objects_are_never_unpickled(tmp_path: Path) -> None:
    save(scene(), tmp_path / "s.npz")
    other = rewritten(tmp_path / "s.npz", drop="chunk/0/times.npy")
    with zipfile.ZipFile(other, "a") as archive, archive.open("chunk/0/times.npy", "w") as member:
        np.lib.format.write_array(member, np.array([{"a": 1}], dtype=object))
    with pytest.raises(DermisError, match="chunk/0/times: .*neither numbers nor texts.*does not unpickle"):
        list(load(other).chunks)


def test_a_parameter_that_is_no_plain_value(tmp_path: Path) -> None:
    bad = replace(scene(), fingers=(Finger("F", (), {"x": np.zeros(2)}),))
    with pytest.raises(DermisError, match="scene 'Ä scene': a parameter cannot be written"):
        save(bad, tmp_path / "s.npz")
    assert list(tmp_path.iterdir()) == []
