"""Files of sampled scenes, written and read chunk by chunk.

A file is a zip archive (.npz) of plain .npy arrays and `header.json`, without compression and with fixed time stamps.
Equal scenes in equal chunks therefore give equal bytes. No content of a file is ever executed or unpickled.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SEVERITIES, DermisError, Finding
from ..files import atomic, put_array, put_text
from ..foreign import damage_told, json_of
from ..npz import ArrayFile, opened_npz
from .tactile_scene import SCENE_VERSION, Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene, header

FORMAT = "dermis-scene"
MAX_HEADER = 1 << 26  # [bytes] large, because the header has a number per sample for the triangles of a deforming mesh
# Arrays of a chunk: number of dimensions, and size of the last dimension if it is fixed.
_SERIES = {"frames": (1,), "times": (1,), "fingers": (4, 4), "bodies": (4, 4), "screens": (4, 4)}


def save(scene: TactileScene, path: Path | str) -> None:
    """Write a scene to a file.

    The chunks are consumed one at a time and not kept.

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
            if screen.holes is not None:
                put_array(archive, f"screen/{i}/holes", screen.holes)
        surfaces = _SurfaceWriter(archive)
        chunks = []
        for k, chunk in enumerate(scene.chunks):
            for name in _SERIES:
                put_array(archive, f"chunk/{k}/{name}", getattr(chunk, name))
            for i, name in enumerate(sorted(chunk.animated)):
                put_array(archive, f"chunk/{k}/channel/{i}", chunk.animated[name])
            chunks.append(
                {
                    "channels": sorted(chunk.animated),
                    "surfaces": {
                        str(b): surfaces.put(f"chunk/{k}/surface/{b}", chunk.surfaces[b]) for b in chunk.surfaces
                    },
                }
            )
        put_text(archive, "header.json", _header_text(scene, chunks))


def load(path: Path | str) -> TactileScene:
    """Read a scene from its file.

    The header is read at once. The chunks are read at each iteration over them.

    Raises:
        DermisError: the file is missing or damaged, is no scene, or was written by another version. Reading the chunks
            may raise it, too.
    """
    path = Path(path)
    with opened_npz(path, kind="a sampled scene") as archive:
        data = _header(archive)
        with damage_told("the header is damaged", str(path)):
            return TactileScene(
                name=_text(data["name"]),
                fps=Fraction(*data["fps"]),
                frame_range=(int(data["frame_range"][0]), int(data["frame_range"][1])),
                rate=float(data["rate"]),
                gravity=(float(data["gravity"][0]), float(data["gravity"][1]), float(data["gravity"][2])),
                fingers=tuple(
                    Finger(
                        _text(f["name"]),
                        tuple(
                            DeviceUse(_text(d["preset"]), _mapping(d["parameters"]), _text(d["screen"]))
                            for d in f["devices"]
                        ),
                        _mapping(f["parameters"]),
                    )
                    for f in data["fingers"]
                ),
                bodies=tuple(_body(archive, i, b) for i, b in enumerate(data["bodies"])),
                screens=tuple(_screen(archive, i, s) for i, s in enumerate(data["screens"])),
                chunks=SceneChunks(path, tuple(data["chunks"])),
                findings=_findings(data["findings"]),
            )


@dataclass(frozen=True)
class SceneChunks:
    """The chunks of a scene file, read one at a time at each iteration.

    Attributes:
        path: path of the file, which must stay in place as long as chunks are read.
        table: the header's entry for each chunk.
    """

    path: Path
    table: tuple[Mapping[str, Any], ...]

    def __repr__(self) -> str:
        return f"SceneChunks({self.path}, {len(self)} chunks)"

    def __len__(self) -> int:
        return len(self.table)

    def __iter__(self) -> Iterator[Chunk]:
        triangles: dict[int, NDArray[np.int32]] = {}
        # A file with many chunks has a long table of contents, so the file is opened only once.
        with opened_npz(self.path, kind="a sampled scene") as archive:
            for k, entry in enumerate(self.table):
                yield self._chunk(archive, k, entry, triangles)

    def _chunk(
        self, archive: ArrayFile, k: int, entry: Mapping[str, Any], triangles: dict[int, NDArray[np.int32]]
    ) -> Chunk:
        where = f"{self.path}, chunk {k}"
        with damage_told("a chunk of the scene is damaged", where):
            series = {name: _numbers(archive, f"chunk/{k}/{name}", *_SERIES[name]) for name in _SERIES}
            names = [_text(name) for name in entry["channels"]]
            animated = {name: _numbers(archive, f"chunk/{k}/channel/{i}", 1) for i, name in enumerate(names)}
            surfaces = {
                int(b): self._surfaces(archive, f"chunk/{k}/surface/{b}", ids, triangles)
                for b, ids in entry["surfaces"].items()
            }
            chunk = Chunk(**series, surfaces=surfaces, animated=animated)
            _check_lengths(chunk, where)
        return chunk

    def _surfaces(
        self, archive: ArrayFile, name: str, ids: list[int], triangles: dict[int, NDArray[np.int32]]
    ) -> tuple[Mesh, ...]:
        vertices = _numbers(archive, f"{name}/vertices", 2, 3)
        counts = _numbers(archive, f"{name}/counts", 1, kinds="iu")
        within = (counts >= 0) & (counts <= len(vertices))
        if len(counts) != len(ids) or not within.all() or counts.sum() != len(vertices):
            raise DermisError("a surface is damaged", where=f"{self.path}, {name}")
        for i in ids:
            if i not in triangles:
                triangles[i] = _triangles(archive, f"triangles/{int(i)}")
        parts = np.split(vertices, np.cumsum(counts)[:-1]) if len(counts) else []
        return tuple(Mesh(part, triangles[i]) for part, i in zip(parts, ids, strict=True))


class _SurfaceWriter:
    """Writes deforming surfaces, and each array of triangles only once."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._known: dict[tuple[str, tuple[int, ...], bytes], int] = {}
        self._last: tuple[NDArray[np.int32], int] | None = None

    def put(self, name: str, meshes: tuple[Mesh, ...]) -> list[int]:
        """Write consecutive surfaces; return the index of each one's triangles."""
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


def _header(archive: ArrayFile) -> dict[str, Any]:
    where = archive.where
    if "header.json" not in archive:
        raise DermisError("not a sampled scene: it has no header", where=where)
    data = json_of(archive.text("header.json", MAX_HEADER), where, MAX_HEADER, constants=True)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise DermisError("not a sampled scene", where=where, value=str(found)[:80], limit=FORMAT)
    version = data.get("version")
    if version != SCENE_VERSION:
        newer = isinstance(version, int) and version > SCENE_VERSION
        raise DermisError(
            "written by a newer version of Dermis" if newer else "an unknown version of the format",
            where=where,
            value=f"version {str(version)[:80]}",
            limit=f"version {SCENE_VERSION}",
            remedy="Update Dermis" if newer else "",
        )
    return data


def _body(archive: ArrayFile, i: int, data: Mapping[str, Any]) -> Body:
    mesh = None
    if not data["deforming"]:
        mesh = Mesh(_numbers(archive, f"body/{i}/vertices", 2, 3), _triangles(archive, f"body/{i}/triangles"))
    content = tuple(_text(name) for name in data["content"])
    return Body(_text(data["name"]), mesh, _mapping(data["parameters"]), content, bool(data["simulated"]))


def _screen(archive: ArrayFile, i: int, data: Mapping[str, Any]) -> Screen:
    heights = archive.array(f"screen/{i}/height_map")
    if heights.dtype.kind not in "f" or heights.ndim not in (2, 3):
        raise DermisError("not a map of heights", where=f"{archive.where}, screen {i}", value=str(heights.shape)[:80])
    named = f"screen/{i}/holes"
    holes = archive.array(named) if named in archive.names else None
    if holes is not None and (holes.dtype.kind != "b" or holes.shape != heights.shape):
        raise DermisError(
            "the holes do not fit the map", where=f"{archive.where}, screen {i}", value=str(holes.shape)[:80]
        )
    return Screen(
        _text(data["name"]),
        (float(data["size"][0]), float(data["size"][1])),
        heights,
        float(data["height_unit"]),
        _mapping(data["parameters"]),
        _findings(data["findings"]),
        holes,
    )


def _findings(entries: list[dict[str, Any]]) -> tuple[Finding, ...]:
    known = {f.name for f in fields(Finding)}
    found = tuple(Finding(**{k: v for k, v in entry.items() if k in known}) for entry in entries)
    for finding in found:
        if finding.severity not in SEVERITIES or not all(
            isinstance(text, str) for text in (finding.code, finding.what, finding.where, finding.limit, finding.remedy)
        ):
            raise ValueError("a malformed finding")
        str(finding)
    return found


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{str(value)[:80]!r} is no text")
    return value


def _mapping(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError(f"{str(value)[:80]!r} is no object")
    return value


def _numbers(archive: ArrayFile, name: str, sides: int, last: int = 0, *, kinds: str = "f") -> NDArray[Any]:
    """Read an array of numbers.

    Args:
        archive: the file.
        name: name of the array in the file.
        sides: number of dimensions that the array must have.
        last: size that its last dimension must have; 0 for any.
        kinds: kinds of NumPy types that the array may have.

    Raises:
        DermisError: the array is not as required.
    """
    array = archive.array(name)
    if array.ndim != sides or (last and array.shape[-1] != last) or array.dtype.kind not in kinds:
        raise DermisError(
            "the file is damaged", where=f"{archive.where}, {name}", value=f"{array.dtype} {array.shape}"[:80]
        )
    return array


def _triangles(archive: ArrayFile, name: str) -> NDArray[np.int32]:
    return _numbers(archive, name, 2, 3, kinds="iu").astype(np.int32, copy=False)


def _check_lengths(chunk: Chunk, where: str) -> None:
    n = len(chunk.frames)
    lengths = {len(chunk.times), *map(len, chunk.animated.values()), *map(len, chunk.surfaces.values())}
    poses = (chunk.fingers, chunk.bodies, chunk.screens)
    if lengths != {n} or any(p.shape[1:] != (n, 4, 4) for p in poses):
        raise DermisError("a chunk's arrays have different lengths", where=where, limit=f"{n} samples")
