"""Description: stress components for comparing poses with targets.

They are the principal components of the stress that a device makes on a skin during simulated movements. It takes
seconds to compute them. Descriptions of shipped skins and devices are therefore shipped with the presets. Each file
names the source files that computed the description, and has a digest of their text. If one of these source files has
changed since, the description is not used but computed again.
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

# Number of simulated movements. With more movements, the number of components changes by one at most.
DESCRIPTOR_MOVEMENTS = 240
SCHEMA = "dermis-description 1"
SHIPPED = BUILT_IN / "skins"
CORE = Path(__file__).resolve().parents[1]

_known: Recent[tuple[str, str, str, float], Descriptors] = Recent(8)
_movements: Recent[tuple[str, str, str, str, float, int], Dataset] = Recent(1)


def movements_of(device: DiscDevice, skin: SkinModel, friction: float) -> Dataset:
    """Return simulated movements of a device on a skin.

    The movements are between random configurations. The last result is kept in memory, because the search for the least
    error (`matching.floor`) uses it again.
    """
    key = (skin.key, pressed_on(skin), repr(skin.material), device_key(device), friction, DESCRIPTOR_MOVEMENTS)
    return _movements.make(
        key, lambda: drain(record(device, contact_of(device, skin.linear, friction), DESCRIPTOR_MOVEMENTS))
    )


def describe(device: DiscDevice, skin: SkinModel, friction: float) -> Descriptors:
    """Return the descriptors of a device on a skin.

    They are kept in memory for other fingers with the same shape of skin.

    Args:
        device: the mechanism.
        skin: model of the skin; its stiffness has no effect.
        friction: friction coefficient between disc and skin.
    """

    def made() -> Descriptors:
        # Movements end at a force, so they depend on the stiffness, which is not in the key. With a nominal stiffness,
        # the result is the same whichever finger is computed first.
        nominal = skin.with_material(young=TISSUE["young"].default, alpha=1.0)
        data = movements_of(device, nominal, friction)
        return descriptors(data, skin.stress_components())

    return _known.make((skin.key, pressed_on(skin), device_key(device), friction), made)


def observation_of(device: DiscDevice, skin: SkinModel, friction: float) -> Array:
    """Return the observation matrix of a device on a skin, shape (k, 3 m).

    The matrix is shipped, read from the cache, or computed.
    """
    shipped = shipped_of(device, skin, friction)
    if shipped is not None:
        return shipped

    def made() -> dict[str, Array]:
        return {"table": describe(device, skin, friction).observation_matrix}

    return kept(skin.cache, _cached_key(device, skin, friction), {"table": (None, 3 * skin.pad_count)}, made)["table"]


def description_key(device: DiscDevice, skin: SkinModel, friction: float) -> str:
    """Return the key of a description.

    It is made from all inputs of the description except the engine's source files.

    Args:
        device: the mechanism.
        skin: model of the skin; its stiffness has no effect.
        friction: friction coefficient between disc and skin.
    """
    points = pressed_on(skin)
    smooth = ""
    if points == "points" and skin.shape is not None:
        smooth = remainder_key(skin.shape, skin.material.poisson)
    nominal = repr(TISSUE["young"].default)
    what = [skin.rounded_key or skin.key, "", points, smooth, device_key(device), repr(float(friction))]
    return cache_key(SCHEMA, *what, nominal, repr(TOLERANCE), repr(DESCRIPTOR_MOVEMENTS))


def shipped_name(device: DiscDevice, skin: SkinModel, friction: float) -> str:
    """Return the file name of a shipped description."""
    return f"description_{description_key(device, skin, friction)[:16]}.npz"


def write_shipped(
    path: Path, device: DiscDevice, skin: SkinModel, friction: float, matrix: Array, sources: Iterable[str]
) -> None:
    """Write a description to be shipped.

    Args:
        path: file to write.
        device, skin, friction: inputs of the description.
        matrix: observation matrix of the description, shape (k, 3 m).
        sources: paths of the source files that computed the matrix, relative to the engine's folder, with slashes.
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
    """Return the observation matrix of a shipped description, shape (k, 3 m).

    The result is None if no valid description is shipped.
    """
    path = SHIPPED / shipped_name(device, skin, friction)
    return read_shipped(path, description_key(device, skin, friction), 3 * skin.pad_count) if path.is_file() else None


def read_shipped(path: Path, key: str, size: int) -> Array | None:
    """Read the observation matrix of a shipped description.

    Args:
        path: file to read.
        key: key that the file must have, see `description_key`.
        size: number of columns that the matrix must have.

    Returns:
        The matrix, shape (k, size); None if the file is damaged, has another key, or was computed by source files that
        have changed since.
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
    """Return a digest of the text of source files; '' if a file is missing.

    Line ends do not count.
    """
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
