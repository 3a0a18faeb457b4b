"""KeptShares: results of fingers from earlier bakes, for reuse.

A bake renders only fingers whose inputs have changed. Fingers that may hold an object together form a lot, and the
results of a lot are stored together, as a `Share`. The key of a share is a hash of all inputs of its lot: version and
settings of the scene; names, parameters, devices and paths of the fingers; objects that the fingers may hold, or that
ever come near them; presets; files that the settings of the devices name; and whether the skins have a smooth pad. An
object that stays away from the fingers of a lot may therefore move and change without a new key.
"""

from __future__ import annotations

import glob
import hashlib
import json
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..contact.held_body import can_be_held
from ..contact.posed_scene import PosedScene
from ..errors import DermisError
from ..parameters.skin import DEFAULT_SKIN
from ..presets import Library
from ..scene.tactile_scene import Chunk, DeviceUse, Mesh, TactileScene, header
from ..skin.surface_store import smooth_pad
from ..version import made_by
from .share_job import Share

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact
    from ..skin.model import SkinModel

# [bytes] default limit of the arrays of all shares together; largest number of shares. The number is limited, because
# shares also refer to skin models, whose size is not counted.
LIMIT_BYTES, MOST = 300_000_000, 24
# A body is near a finger if its bounding box is at most REACH times the radius of the pad, plus MARGIN [m], from the
# finger's origin. The radius is the largest distance of a pad node from this origin. Contact never reaches as far.
REACH, MARGIN = 2.0, 2.5e-3
ALL = ("frames/", "times/")  # prefixes of the series that are inputs of every finger


class KeptShares:
    """Shares of earlier bakes by their key, at most `MOST` of them.

    A new share replaces the shares that have been unused for longest.

    Args:
        limit_bytes: largest size of all shares together [bytes]. A single larger share is not stored.

    Attributes:
        found: number of shares that `get` has returned.
        made: number of shares that were passed to `put`.
    """

    def __init__(self, limit_bytes: int = LIMIT_BYTES) -> None:
        self._limit = limit_bytes
        self._shares: dict[str, tuple[Share, int]] = {}
        self.found = self.made = 0

    def __len__(self) -> int:
        return len(self._shares)

    @property
    def size(self) -> int:
        """Size of the arrays of all stored shares [bytes]."""
        return sum(size for _, size in self._shares.values())

    def get(self, key: str) -> Share | None:
        """Return the share of a key; None if it is not stored."""
        if key not in self._shares:
            return None
        self._shares[key] = self._shares.pop(key)
        self.found += 1
        return self._shares[key][0]

    def put(self, key: str, share: Share) -> None:
        """Store a share; shares unused for longest make room for it."""
        self.made += 1
        size = size_of(share)
        self._shares.pop(key, None)
        if size > self._limit:
            return
        while self._shares and (self.size + size > self._limit or len(self._shares) >= MOST):
            del self._shares[next(iter(self._shares))]
        self._shares[key] = (share, size)

    def clear(self) -> None:
        """Drop all shares."""
        self._shares.clear()


def size_of(share: Share) -> int:
    """Return the size of a share's arrays [bytes]."""
    outputs = [made.output for devices in share.driven.values() for made in devices if made.output is not None]
    arrays = [series for o in outputs for series in (o.track.times, o.track.values, *o.signals.values())]
    felt = sum(touch.nbytes for touch in share.felt.values())
    return felt + sum(np.asarray(array).nbytes for array in arrays)


def keys_of(
    scene: TactileScene,
    chunks: Sequence[Chunk],
    pad_contact: PadContact,
    lots: Collection[tuple[int, ...]],
    models: Mapping[int, SkinModel],
    library: Library,
) -> dict[tuple[int, ...], str]:
    """Return the key of each lot of fingers.

    Args:
        scene: the scene's header.
        chunks: chunks of the whole scene.
        pad_contact: contact of the pads over the whole scene.
        lots: indices of the fingers of each lot, see `lots_of`.
        models: skin models of the fingers whose skin is simulated, by the index of the finger.
        library: the presets.
    """
    whole = header(scene)
    near = _near(scene, chunks, pad_contact, models)
    series = _series(scene, chunks)
    return {lot: _key(lot, scene, whole, near, series, models, library) for lot in lots}


def _key(
    lot: tuple[int, ...],
    scene: TactileScene,
    whole: Mapping[str, Any],
    near: Mapping[int, set[int]],
    series: Mapping[str, str],
    models: Mapping[int, SkinModel],
    library: Library,
) -> str:
    bodies = sorted(set[int]().union(*(near[f] for f in lot)))
    owners = {("finger", str(f)) for f in lot} | {("device", str(f)) for f in lot} | {("body", str(b)) for b in bodies}
    own = {
        name: value
        for name, value in series.items()
        if name.startswith(ALL) or tuple(name.split("/")[:2]) in owners or "/touch_distance/" in name
    }
    told = {
        "version": made_by(),
        "scene": {name: value for name, value in whole.items() if name not in ("fingers", "bodies", "screens")},
        "counts": [len(scene.fingers), len(scene.bodies)],
        # The longest touch distance determines the search radius of every finger.
        "reach": [finger.parameters.get("touch_distance") for finger in scene.fingers],
        "fingers": {f: whole["fingers"][f] for f in lot},
        "bodies": {b: whole["bodies"][b] for b in bodies},
        "series": own,
        "skins": {f: _skin(models[f]) for f in lot if f in models},
        "default skin": library.skin(DEFAULT_SKIN),
        "devices": [device_sources(use, library) for f in lot for use in scene.fingers[f].devices],
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()


def _near(
    scene: TactileScene, chunks: Sequence[Chunk], pad_contact: PadContact, models: Mapping[int, SkinModel]
) -> dict[int, set[int]]:
    """Return the bodies that ever come near each finger, and their content.

    Bodies near a skin are found by their bounding boxes, see `REACH`. Bodies that may be held are near a finger if they
    come within the search radius of its pad.
    """
    near: dict[int, set[int]] = {f: set() for f in range(len(scene.fingers))}
    for f, b in pad_contact.pairs:
        if can_be_held(scene, b, pad_contact.animated):
            near[f].add(b)
    posed = PosedScene(scene.bodies)
    for chunk in chunks:
        if not len(chunk.times):
            continue
        posed.take(chunk)
        for f, model in models.items():
            reach = REACH * float(np.sqrt((model.positions**2).sum(axis=1).max())) + MARGIN
            place = chunk.fingers[f, :, :3, 3]
            close, middle, half, _ = posed.near(place.min(axis=0) - reach, place.max(axis=0) + reach)
            within = (np.abs(place - middle) <= half + reach).all(axis=2)
            near[f] |= set(close[np.any(within, axis=1)].tolist())
    index = {body.name: b for b, body in enumerate(scene.bodies)}
    for bodies in near.values():
        waiting = list(bodies)
        while waiting:
            inside = {index[name] for name in scene.bodies[waiting.pop()].content if name in index} - bodies
            bodies |= inside
            waiting += inside
    return near


def _series(scene: TactileScene, chunks: Sequence[Chunk]) -> dict[str, str]:
    """Return hashes of all paths, surfaces and animated parameters, by name.

    The names begin as those of `Chunk.animated`. The hashes do not depend on the division of the scene into chunks.
    """
    found: dict[str, Any] = {}

    def add(name: str, rows: NDArray[Any]) -> None:
        sha = found.setdefault(f"{name}/{rows.dtype.str}{rows.shape[1:]}", hashlib.sha256())
        sha.update(np.ascontiguousarray(rows).data)

    for b, body in enumerate(scene.bodies):
        if body.mesh is not None:
            add(f"body/{b}/vertices", body.mesh.vertices)
            add(f"body/{b}/triangles", body.mesh.triangles)
    last: dict[int, Mesh | None] = {b: body.mesh for b, body in enumerate(scene.bodies)}
    count = 0
    for chunk in chunks:
        for b, meshes in chunk.surfaces.items():
            for i, mesh in enumerate(meshes, count):
                if mesh is not last[b]:
                    last[b] = mesh
                    for part in (np.array([i]), mesh.vertices, mesh.triangles):
                        add(f"body/{b}/surface", part.ravel())
        count += len(chunk.times)
        add("frames", chunk.frames)
        add("times", chunk.times)
        for kind, poses in (("finger", chunk.fingers), ("body", chunk.bodies)):
            for index, pose in enumerate(poses):
                add(f"{kind}/{index}/pose", pose)
        for name, values in chunk.animated.items():
            add(name, values)
    return {name: sha.hexdigest() for name, sha in found.items()}


def _skin(model: SkinModel) -> list[Any]:
    """Return the properties of a skin that depend on the presence of tables."""
    return [model.tissue, smooth_pad(model) is not None]


def device_sources(use: DeviceUse, library: Library) -> list[Any]:
    """Return the inputs of a device that are not in the scene.

    They are the hash of its preset (or the error of reading it), and the stamps of the files that its settings name.
    """
    try:
        preset = library.device(use.preset).hash
    except DermisError as error:
        preset = str(error)
    return [preset, [_stamps(value) for value in use.parameters.values() if isinstance(value, str)]]


def _stamps(value: str) -> list[tuple[str, int, int]]:
    """Return path, size and modification time [ns] of the files of a setting.

    If the setting is the path of a folder, these are all files in the folder and its subfolders. Otherwise they are the
    files whose paths begin with the setting. A setting without a slash names no files.
    """
    if "/" not in value and "\\" not in value:
        return []
    path = Path(value)
    files = path.rglob("*") if path.is_dir() else path.parent.glob(f"{glob.escape(path.name)}*")
    try:
        return sorted((str(file), file.stat().st_size, file.stat().st_mtime_ns) for file in files if file.is_file())
    except OSError:  # A file was deleted meanwhile. The time makes the key differ from all stored keys.
        return [(value, -1, time.time_ns())]
