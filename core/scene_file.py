"""Sampled scenes as files: an .npz with a header in JSON, written and read chunk by chunk.

The file is a zip of plain .npy arrays beside `header.json`, stored without compression and with fixed time stamps, so
that equal scenes give equal bytes. Nothing in it is ever executed or unpickled.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DermisError, Finding
from .files import atomic, put_array, put_text
from .scene import SCENE_VERSION, Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene, header

FORMAT = "dermis-scene"
_SERIES = ("frames", "times", "fingers", "bodies", "screens")


def save(scene: TactileScene, path: Path) -> None:
    """Write a scene; its chunks are drawn one after the other and not kept.

    Raises:
        DermisError: the file cannot be written, or a parameter is not a plain JSON value.
    """
    with atomic(Path(path)) as part, zipfile.ZipFile(part, "w", allowZip64=True) as archive:
        for i, body in enumerate(scene.bodies):
            if body.mesh is not None:
                put_array(archive, f"body/{i}/vertices", body.mesh.vertices)
                put_array(archive, f"body/{i}/triangles", body.mesh.triangles)
        for i, screen in enumerate(scene.screens):
            put_array(archive, f"screen/{i}/height_map", screen.height_map)
        surfaces = _SurfaceWriter(archive)
        chunks = []
        for k, chunk in enumerate(scene.chunks):
            for name in _SERIES:
                put_array(archive, f"chunk/{k}/{name}", getattr(chunk, name))
            for i, name in enumerate(sorted(chunk.channels)):
                put_array(archive, f"chunk/{k}/channel/{i}", chunk.channels[name])
            chunks.append({
                "channels": sorted(chunk.channels),
                "surfaces": {str(b): surfaces.put(f"chunk/{k}/surface/{b}", chunk.surfaces[b]) for b in chunk.surfaces},
            })  # fmt: skip
        put_text(archive, "header.json", _header_text(scene, chunks))


def load(path: Path) -> TactileScene:
    """Read a scene's header; its chunks are read when they are iterated, and again each time.

    Raises:
        DermisError: missing, not a scene, damaged, or written by a newer version; reading its chunks may raise it too.
    """
    path = Path(path)
    with _opened(path) as archive:
        data = _header(archive, path)
        try:
            return TactileScene(
                name=data["name"],
                fps=Fraction(*data["fps"]),
                frame_range=(int(data["frame_range"][0]), int(data["frame_range"][1])),
                rate=float(data["rate"]),
                gravity=(float(data["gravity"][0]), float(data["gravity"][1]), float(data["gravity"][2])),
                fingers=tuple(
                    Finger(
                        f["name"],
                        tuple(DeviceUse(d["preset"], d["parameters"], d["screen"]) for d in f["devices"]),
                        f["parameters"],
                    )
                    for f in data["fingers"]
                ),
                bodies=tuple(_body(archive, path, i, b) for i, b in enumerate(data["bodies"])),
                screens=tuple(_screen(archive, path, i, s) for i, s in enumerate(data["screens"])),
                chunks=SceneChunks(path, tuple(data["chunks"])),
                findings=_findings(data["findings"]),
            )
        except (KeyError, TypeError, ValueError, IndexError, ZeroDivisionError) as error:
            if isinstance(error, DermisError):
                raise
            raise DermisError("the header is damaged", where=str(path), value=repr(error)) from error


@dataclass(frozen=True)
class SceneChunks:
    """The chunks of a scene file, read one at a time whenever they are iterated.

    Attributes:
        path: the file; it must stay where it is.
        table: what the header says of each chunk.
    """

    path: Path
    table: tuple[Mapping[str, Any], ...]

    def __len__(self) -> int:
        return len(self.table)

    def __iter__(self) -> Iterator[Chunk]:
        triangles: dict[int, NDArray[np.int32]] = {}
        for k, entry in enumerate(self.table):
            with _opened(self.path) as archive:
                series = {name: _get(archive, self.path, f"chunk/{k}/{name}") for name in _SERIES}
                channels = {
                    name: _get(archive, self.path, f"chunk/{k}/channel/{i}") for i, name in enumerate(entry["channels"])
                }
                surfaces = {
                    int(b): self._surfaces(archive, f"chunk/{k}/surface/{b}", ids, triangles)
                    for b, ids in entry["surfaces"].items()
                }
            yield Chunk(**series, surfaces=surfaces, channels=channels)

    def _surfaces(
        self, archive: zipfile.ZipFile, name: str, ids: list[int], triangles: dict[int, NDArray[np.int32]]
    ) -> tuple[Mesh, ...]:
        vertices = _get(archive, self.path, f"{name}/vertices")
        counts = _get(archive, self.path, f"{name}/counts")
        if len(counts) != len(ids) or counts.sum() != len(vertices) or (counts < 0).any():
            raise DermisError("a surface is damaged", where=f"{self.path}, {name}")
        for i in ids:
            if i not in triangles:
                triangles[i] = _get(archive, self.path, f"triangles/{i}")
        parts = np.split(vertices, np.cumsum(counts)[:-1]) if len(counts) else []
        return tuple(Mesh(part, triangles[i]) for part, i in zip(parts, ids, strict=True))


class _SurfaceWriter:
    """Writes deforming surfaces, each list of triangles only once."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._known: dict[tuple[str, tuple[int, ...], bytes], int] = {}
        self._last: tuple[NDArray[np.int32], int] | None = None

    def put(self, name: str, meshes: tuple[Mesh, ...]) -> list[int]:
        """Write the vertices of consecutive surfaces; return which triangles each of them has."""
        stacked = np.concatenate([m.vertices for m in meshes]) if meshes else np.empty((0, 3))
        put_array(self._archive, f"{name}/vertices", stacked)
        put_array(self._archive, f"{name}/counts", np.array([len(m.vertices) for m in meshes], dtype=np.int64))
        return [self._triangles(m.triangles) for m in meshes]

    def _triangles(self, triangles: NDArray[np.int32]) -> int:
        if self._last is not None and self._last[0] is triangles:
            return self._last[1]
        key = (triangles.dtype.str, triangles.shape, triangles.tobytes())
        if key not in self._known:
            self._known[key] = len(self._known)
            put_array(self._archive, f"triangles/{self._known[key]}", triangles)
        self._last = (triangles, self._known[key])
        return self._last[1]


def _header_text(scene: TactileScene, chunks: list[dict[str, Any]]) -> str:
    data = {"format": FORMAT, **header(scene), "chunks": chunks, "findings": [f.as_dict() for f in scene.findings]}
    for entry, screen in zip(data["screens"], scene.screens, strict=True):
        entry["findings"] = [f.as_dict() for f in screen.findings]
    for finding in (*data["findings"], *(f for s in data["screens"] for f in s["findings"])):
        if not isinstance(finding["value"], str | int | float | bool | None):
            finding["value"] = str(finding["value"])
    try:
        return json.dumps(data, sort_keys=True, ensure_ascii=False, indent=1)
    except (TypeError, ValueError) as error:
        raise DermisError("a parameter cannot be written", where=f"scene '{scene.name}'", value=str(error)) from error


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except OSError as error:
        raise DermisError("the file cannot be read", where=str(path), value=error.strerror or str(error)) from error
    except zipfile.BadZipFile as error:
        raise DermisError("not a sampled scene, or cut short", where=str(path), value=str(error)) from error


def _header(archive: zipfile.ZipFile, path: Path) -> dict[str, Any]:
    try:
        data = json.loads(archive.read("header.json").decode("utf-8"))
    except (KeyError, ValueError, RecursionError, zipfile.BadZipFile) as error:
        raise DermisError("not a sampled scene: it has no header", where=str(path), value=str(error)) from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise DermisError("not a sampled scene", where=str(path), value=found, limit=FORMAT)
    version = data.get("version")
    if version != SCENE_VERSION:
        newer = isinstance(version, int) and version > SCENE_VERSION
        raise DermisError(
            "written by a newer version of Dermis" if newer else "an unknown version of the format", where=str(path),
            value=f"version {version}", limit=f"version {SCENE_VERSION}", remedy="Update Dermis" if newer else "",
        )  # fmt: skip
    return data


def _body(archive: zipfile.ZipFile, path: Path, i: int, data: Mapping[str, Any]) -> Body:
    mesh = None
    if not data["deforming"]:
        mesh = Mesh(_get(archive, path, f"body/{i}/vertices"), _get(archive, path, f"body/{i}/triangles"))
    return Body(data["name"], mesh, data["parameters"], tuple(data["content"]), bool(data["simulated"]))


def _screen(archive: zipfile.ZipFile, path: Path, i: int, data: Mapping[str, Any]) -> Screen:
    return Screen(
        data["name"],
        (float(data["size"][0]), float(data["size"][1])),
        _get(archive, path, f"screen/{i}/height_map"),
        float(data["height_unit"]),
        data["parameters"],
        _findings(data["findings"]),
    )


def _findings(entries: list[dict[str, Any]]) -> tuple[Finding, ...]:
    known = {f.name for f in fields(Finding)}
    return tuple(Finding(**{k: v for k, v in entry.items() if k in known}) for entry in entries)


def _get(archive: zipfile.ZipFile, path: Path, name: str) -> NDArray[Any]:
    try:
        return np.lib.format.read_array(io.BytesIO(archive.read(f"{name}.npy")), allow_pickle=False)
    except (KeyError, ValueError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise DermisError("the file is damaged", where=f"{path}, {name}", value=str(error)) from error
