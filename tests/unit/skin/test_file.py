"""Mesh files: what goes out comes back, other units and defaults, and clear refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.skin.file import SCHEMA, load_mesh
from core.skin.fingertip import fingertip_mesh
from core.skin.model import fingertip_skin, mesh_skin
from tests.tissue import save_mesh

TETRAHEDRON = {
    "schema": SCHEMA, "unit": "mm", "nodes": [[0, 0, 2], [2, 0, 2], [0, 2, 2], [0.5, 0.5, 0]],
    "tetrahedra": [[0, 2, 1, 3]], "fixed": [0, 1, 2], "pad": [3],
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_round_trip_is_exact(tmp_path: Path, suffix: str) -> None:
    mesh = fingertip_mesh(level="draft")
    save_mesh(mesh, tmp_path / f"finger{suffix}")
    assert load_mesh(tmp_path / f"finger{suffix}").hash == mesh.hash


def test_bytes_do_not_depend_on_time(tmp_path: Path) -> None:
    mesh = fingertip_mesh(level="draft")
    for name in ("a.npz", "b.npz"):
        save_mesh(mesh, tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_defaults_find_skin_and_pad(tmp_path: Path) -> None:
    mesh = fingertip_mesh(level="draft")
    np.savez(
        tmp_path / "own.npz",
        schema=SCHEMA,
        unit="mm",
        nodes=mesh.nodes * 1e3,
        tetrahedra=mesh.tetrahedra,
        fixed=mesh.fixed,
    )
    own = load_mesh(tmp_path / "own.npz")
    assert own.nodes == pytest.approx(mesh.nodes, abs=1e-17, rel=1e-15)
    assert set(mesh.pad) <= set(own.pad)
    skin = {tuple(sorted(t)) for t in mesh.surface.tolist()}
    held = set(mesh.fixed.tolist())
    assert {t for t in skin if not set(t) <= held} <= {tuple(sorted(t)) for t in own.surface.tolist()}
    # the same pad on the loaded mesh gives the same skin
    again = mesh_skin(load_mesh(tmp_path / "own.npz"))
    place = np.searchsorted(again.mesh.pad, mesh.pad)
    chosen = (3 * place[:, None] + np.arange(3)).ravel()
    ours = fingertip_skin(level="draft").unit_compliance
    assert again.unit_compliance[np.ix_(chosen, chosen)] == pytest.approx(ours, abs=1e-9 * np.abs(ours).max())


def test_the_documented_example_loads(tmp_path: Path) -> None:
    path = tmp_path / "one.json"
    path.write_text(json.dumps(TETRAHEDRON))
    mesh = load_mesh(path)
    assert mesh.volumes == pytest.approx([8e-9 / 6]) and mesh.name == "one"
    assert mesh_skin(mesh).compliance.shape == (3, 3)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"schema": "other 1"}, "unknown schema"),
        ({"schema": None}, "unknown schema"),
        ({"unit": "N"}, "unit of length"),
        ({"tetrahedra": [[0, 1, 2]]}, "shape"),
        ({"nodes": [[0, 0], [1, 1]]}, "shape"),
        ({"nodes": [["a", 0, 0]]}, "numbers"),
        ({"tetrahedra": [[0, 2, 1, 7]]}, "does not exist"),
        ({"tetrahedra": [[0, 2, 1, -1]]}, "does not exist"),
        ({"tetrahedra": [[0, 1, 2, 3]]}, "inverted"),
        ({"tetrahedra": [[0.5, 1, 2, 3]]}, "whole"),
        ({"tetrahedra": []}, "no tetrahedra"),
        ({"fixed": [0, 1]}, "too few fixed"),
        ({"pad": [2]}, "fixed"),
        ({"pad": []}, "no pad"),
        ({"nodes": None}, "shape"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, change: dict[str, object], what: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(json.dumps({**TETRAHEDRON, **change}))
    with pytest.raises(DermisError, match=what):
        load_mesh(path)


@pytest.mark.parametrize("missing", ["nodes", "tetrahedra", "fixed"])
def test_missing_fields_are_named(tmp_path: Path, missing: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(json.dumps({k: v for k, v in TETRAHEDRON.items() if k != missing}))
    with pytest.raises(DermisError, match=f"'{missing}' is missing"):
        load_mesh(path)


def test_objects_and_garbage_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "pickled.npz", schema=SCHEMA, nodes=np.array([{}], dtype=object))
    (tmp_path / "noise.npz").write_bytes(b"not a zip at all")
    (tmp_path / "noise.json").write_text("[1, 2")
    (tmp_path / "list.json").write_text("[1, 2]")
    for name in ("pickled.npz", "noise.npz", "noise.json", "list.json", "absent.npz", "absent.json"):
        with pytest.raises(DermisError):
            load_mesh(tmp_path / name)
