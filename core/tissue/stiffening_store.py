"""Where a skin's stiffening comes from: a file that ships, the cache, or a fit that takes a while."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from dataclasses import asdict
from pathlib import Path
from typing import Protocol, TypeVar

from ..cache import Cache, cache_key
from ..errors import DermisError
from ..recent import Recent
from ..shipped import BUILT_IN
from ..skin.model import SkinModel
from ..skin.shape import FingertipShape
from ..stiffening.stiffening import VERSION, Stiffening
from .stiffening_fit import fit_stiffening

STIFFENING_VERSION = 3  # part of every key: raise it whenever mesh, touches or fit changes
SHIPPED = BUILT_IN / "skins"
POISSON = (0.3, 0.49)  # chosen: errors were measured at 0.48, and nearer to 0.5 averaged nodal pressure oscillates

_known: Recent[str, Stiffening] = Recent(10)  # a person's fingers


class Keyed(Protocol):
    """A table that knows what it was made for."""

    @property
    def key(self) -> str:
        """See `key_of`."""


Kept = TypeVar("Kept", bound=Keyed)


def key_of(version: str, shape: FingertipShape, poisson: float) -> str:
    """Return the key of a table of a shape and Poisson's ratio: a length to the nanometre is the same length."""
    lengths = {name: round(length, 9) for name, length in asdict(shape).items()}
    return cache_key(version, json.dumps(lengths, sort_keys=True), repr(round(poisson, 6)))


def find_kept(
    read: Callable[[Path], Kept], key: str, name: str, shipped: Path | None, cache: Cache | None
) -> Kept | None:
    """Return a table that was made before: of a file that ships by its name, else from the cache.

    Files that are damaged, or were made for another skin, count as not there: they can be made again.
    """
    for path in (None if shipped is None else shipped / name, None if cache is None else cache.get(key)):
        if path is None or not path.is_file():
            continue
        try:
            found = read(path)
        except DermisError:
            continue
        if found.key == key:
            return found
    return None


def stiffening_key(shape: FingertipShape, poisson: float) -> str:
    """Return the key of a stiffening: it depends on the shape and on Poisson's ratio, and on nothing else.

    To a nanometre: a length that was read in millimetres, or typed into a window, is the same length.
    """
    return key_of(f"dermis-stiffening {STIFFENING_VERSION} {VERSION}", shape, poisson)


def shipped_name(shape: FingertipShape, poisson: float) -> str:
    """Return the name of the file in which a stiffening ships."""
    return f"stiffening_{stiffening_key(shape, poisson)[:16]}.npz"


def find_stiffening(
    shape: FingertipShape, poisson: float, *, shipped: Path | None = None, cache: Cache | None = None
) -> Stiffening | None:
    """Return a stiffening that was made before, or None: one that ships, else from the cache.

    Files that are damaged, or were made for another skin, count as not there: they can be made again.
    """
    key, name = stiffening_key(shape, poisson), shipped_name(shape, poisson)
    return find_kept(Stiffening.read, key, name, shipped, cache)


def make_stiffening(
    shape: FingertipShape, poisson: float, *, cache: Cache | None = None
) -> Generator[tuple[int, int], None, Stiffening]:
    """Work out a stiffening and keep it in the cache, whole or not at all; yields (done, total).

    Raises:
        DermisError: Poisson's ratio out of range, a shape that cannot be meshed, or a folder that cannot be written.
    """
    check_poisson(poisson)
    made = yield from fit_stiffening(shape, poisson, key=stiffening_key(shape, poisson))
    if cache is not None:
        cache.put(made.key, made.write)
    return made


def find_series(skin: SkinModel) -> Stiffening | None:
    """Return the stiffening of a skin, which fingers of one shape share; None where none is made, or can be."""
    try:
        shape = check_stiffens(skin)
    except DermisError:
        return None
    key = stiffening_key(shape, skin.material.poisson)
    found = _known.get(key) or find_stiffening(shape, skin.material.poisson, shipped=SHIPPED, cache=skin.cache)
    return None if found is None else _known.make(key, lambda: found)


def check_stiffens(skin: SkinModel) -> FingertipShape:
    """Return the shape of a skin whose stiffening can be worked out.

    Raises:
        DermisError: a mesh of one's own, or Poisson's ratio out of range.
    """
    if skin.shape is None:
        raise no_shape()
    check_poisson(skin.material.poisson)
    return skin.shape


def check_poisson(poisson: float, where: str = "skin, poisson") -> None:
    """Refuse a Poisson's ratio for which the series was not measured.

    Raises:
        DermisError: it is out of range.
    """
    low, high = POISSON
    if not low <= poisson <= high:
        raise DermisError(
            "tissue that stiffens is not worked out for this Poisson's ratio",
            where=where,
            value=poisson,
            limit=f"{low} to {high}",
            remedy="Choose a ratio in this range, or linear tissue",
            code="stiffening-poisson",
        )


def no_shape(where: str = "skin") -> DermisError:
    """Return the error of a mesh of one's own, whose tissue is linear."""
    return DermisError(
        "a mesh of one's own has no tissue that stiffens",
        where=where,
        limit="a fingertip of lengths",
        remedy="Choose linear tissue, or a fingertip of lengths",
        code="no-stiffening",
    )
