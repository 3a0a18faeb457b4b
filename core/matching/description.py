"""Description: the few components of stress that a device can make on a skin, which targets and poses are compared by.

They are found from movements that a device is tried with. That takes seconds, so descriptions of the skins and devices
that ship lie beside the presets. Such a file names the sources that it was computed by, with a digest of what they
said. When one of them has changed since, the file is not used, and the description is computed again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path, PurePosixPath

import numpy as np

from ..arrays import Array
from ..cache import cache_key
from ..devices.disc_device import DiscDevice
from ..errors import DermisError
from ..files import write_npz
from ..foreign import json_of
from ..npz import read_npz
from ..parameters.skin import TISSUE
from ..recent import Recent
from ..shipped import BUILT_IN
from ..skin.model import SkinModel
from ..skin.store import kept
from ..skin.surface_store import remainder_key
from ..steps import drain
from ..surrogate.dataset import Dataset, record
from ..surrogate.learned import Descriptors, descriptors
from ..surrogate.press_points import pressed_on
from ..surrogate.store import contact_of, device_key
from ..surrogate.subspace import TOLERANCE
from ..version import version

DESCRIPTOR_MOVEMENTS = 240  # enough for the subspace: more change its size by one component at most
SCHEMA = "dermis-description 1"
SHIPPED = BUILT_IN / "skins"
CORE = Path(__file__).resolve().parents[1]

_known: Recent[tuple[str, str, str, float, float], Descriptors] = Recent(8)
_movements: Recent[tuple[str, str, str, str, float, int], Dataset] = Recent(1)


def movements_of(device: DiscDevice, skin: SkinModel, friction: float) -> Dataset:
    """Return what a device does to a skin between random configurations; the last is kept, since a floor asks again."""
    key = (skin.key, pressed_on(skin), repr(skin.material), device_key(device), friction, DESCRIPTOR_MOVEMENTS)
    return _movements.make(
        key, lambda: drain(record(device, contact_of(device, skin.linear, friction), DESCRIPTOR_MOVEMENTS))
    )


def describe(device: DiscDevice, skin: SkinModel, friction: float, tolerance: float = TOLERANCE) -> Descriptors:
    """Return the descriptors of a device on a skin, kept in memory for the next finger of the same kind."""

    def made() -> Descriptors:
        # no part of the key: movements end at a force, so that without one stiffness for all the first finger decided
        nominal = skin.with_material(young=TISSUE["young"].default, alpha=1.0)
        data = movements_of(device, nominal, friction)
        return descriptors(data, skin.stress_components(), tolerance=tolerance)

    return _known.make((skin.key, pressed_on(skin), device_key(device), friction, tolerance), made)


def observation_of(device: DiscDevice, skin: SkinModel, friction: float) -> Array:
    """Return the observation matrix of `describe`: one that ships, one from the cache, or a new one; (k, 3 m)."""
    shipped = shipped_of(device, skin, friction)
    if shipped is not None:
        return shipped

    def made() -> dict[str, Array]:
        return {"table": describe(device, skin, friction).observation_matrix}

    return kept(skin.cache, _cached_key(device, skin, friction), {"table": (None, 3 * skin.pad_count)}, made)["table"]


def description_key(device: DiscDevice, skin: SkinModel, friction: float) -> str:
    """Return the key of a description: everything that it depends on but the engine's sources."""
    points = pressed_on(skin)
    smooth = ""
    if points == "points" and skin.shape is not None:
        smooth = remainder_key(skin.shape, skin.material.poisson)
    nominal = repr(TISSUE["young"].default)
    what = [skin.rounded_key or skin.key, "", points, smooth, device_key(device), repr(float(friction))]
    return cache_key(SCHEMA, *what, nominal, repr(TOLERANCE), repr(DESCRIPTOR_MOVEMENTS))


def shipped_name(device: DiscDevice, skin: SkinModel, friction: float) -> str:
    """Return the name of the file in which a description ships."""
    return f"description_{description_key(device, skin, friction)[:16]}.npz"


def write_shipped(
    path: Path, device: DiscDevice, skin: SkinModel, friction: float, matrix: Array, sources: Iterable[str]
) -> None:
    """Write a description that ships.

    Args:
        sources: files of the engine that the matrix was computed by, relative to its folder, with slashes.
    """
    names = sorted(sources)
    meta = {
        "schema": SCHEMA,
        "key": description_key(device, skin, friction),
        "sources": names,
        "digest": digest_of(tuple(names)),
    }
    write_npz(path, {"matrix": matrix, "meta": np.frombuffer(json.dumps(meta, sort_keys=True).encode(), np.uint8)})


def shipped_of(device: DiscDevice, skin: SkinModel, friction: float) -> Array | None:
    """Return the matrix of the description that ships, None where none does or none may be used."""
    path = SHIPPED / shipped_name(device, skin, friction)
    return read_shipped(path, description_key(device, skin, friction), 3 * skin.pad_count) if path.is_file() else None


def read_shipped(path: Path, key: str, size: int) -> Array | None:
    """Return the matrix of a description that ships, shape (k, size).

    None where it is damaged or of another skin, device or friction, and where the sources that it was computed by have
    changed.

    Args:
        key: see `description_key`.
    """
    try:
        arrays = read_npz(path)
        meta = json_of(arrays["meta"].tobytes(), path.name)
        names = tuple(str(name) for name in meta["sources"])
        matrix = np.asarray(arrays["matrix"])
        current = meta["schema"] == SCHEMA and meta["key"] == key and meta["digest"] == digest_of(names)
    except (DermisError, KeyError, TypeError):
        return None
    fits = matrix.ndim == 2 and matrix.shape[1] == size and matrix.dtype == np.float64
    return matrix if current and fits and bool(np.isfinite(matrix).all()) else None


@cache
def digest_of(names: tuple[str, ...]) -> str:
    """Return a digest of what sources of the engine say, '' where one is missing; line ends do not count."""
    sha = hashlib.sha256()
    for name in names:
        place = PurePosixPath(name)
        path = CORE.joinpath(*place.parts)
        if place.is_absolute() or ".." in place.parts or not path.is_file():
            return ""
        data = path.read_bytes().replace(b"\r\n", b"\n")
        sha.update(f"{name} {len(data)}\n".encode())
        sha.update(data)
    return sha.hexdigest()


def _cached_key(device: DiscDevice, skin: SkinModel, friction: float) -> str:
    return cache_key(version(), skin.key, pressed_on(skin), device_key(device), repr(friction), "observation")
