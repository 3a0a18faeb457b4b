"""Where the exact law of a skin's tissue comes from: a file that ships, the cache, or exact touches that take long."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

from ..cache import Cache
from ..errors import DermisError
from ..recent import Recent
from ..skin.material import Elastic
from ..skin.model import SkinModel, fingertip_skin
from ..skin.shape import FingertipShape
from ..stiffening.sampled_stiffening import SampledStiffening
from . import sampled_table_fit
from . import stiffening_store as series
from .sampled_table import VERSION, SampledTable
from .sampled_table_fit import fit_table

SAMPLED_VERSION = 2  # part of every key: raise it whenever mesh, touches or fit changes

_known: Recent[str, SampledStiffening] = Recent(4)  # some 60 MB each


def table_key(shape: FingertipShape, poisson: float) -> str:
    """Return the key of a table: it depends on the shape, to a nanometre, and on Poisson's ratio."""
    return series.key_of(f"dermis-exact-tissue {SAMPLED_VERSION} {VERSION}", shape, poisson)


def shipped_name(shape: FingertipShape, poisson: float) -> str:
    """Return the name of the file in which a table ships."""
    return f"exact_{table_key(shape, poisson)[:16]}.npz"


def find_table(
    shape: FingertipShape, poisson: float, *, shipped: Path | None = None, cache: Cache | None = None
) -> SampledTable | None:
    """Return a table that was made before, or None: one that ships, else from the cache.

    Files that are damaged, or were made for another skin, count as not there: they can be made again.
    """
    key, name = table_key(shape, poisson), shipped_name(shape, poisson)
    return series.find_kept(SampledTable.read, key, name, shipped, cache)


def make_table(
    shape: FingertipShape, poisson: float, *, cache: Cache | None = None
) -> Generator[tuple[int, int], None, SampledTable]:
    """Work out a table and keep it in the cache, whole or not at all; yields (done, total).

    Raises:
        DermisError: Poisson's ratio out of range, a shape that cannot be meshed, or a folder that cannot be written.
    """
    series.check_poisson(poisson)
    made = yield from fit_table(shape, poisson, key=table_key(shape, poisson))
    if cache is not None:
        cache.put(made.key, made.write)
    return made


def exactly_stiffened(skin: SkinModel) -> SkinModel | None:
    """Return a skin of the exact law, which fingers of one shape share; None where a table has not been made yet.

    The series of the same tissue belongs to it.

    Raises:
        DermisError: a mesh of one's own, or Poisson's ratio out of range.
    """
    shape, poisson = series.check_stiffens(skin), skin.material.poisson
    key = table_key(shape, poisson)
    known = _known.get(key)
    if known is None:
        quick = series.stiffened(skin)
        found = None if quick is None else find_table(shape, poisson, shipped=series.SHIPPED, cache=skin.cache)
        if quick is None or quick.stiffening is None or found is None:
            return None
        known = _ready(found, shape, poisson, quick, skin.cache)
        if known is None:
            return None
    ready = known
    return skin.with_stiffening(_known.make(key, lambda: ready))


def _ready(
    table: SampledTable, shape: FingertipShape, poisson: float, quick: SkinModel, cache: Cache | None
) -> SampledStiffening | None:
    """Return a table ready for contact; None of one that is of another mesh: it can be made again."""
    assert quick.stiffening is not None
    level = sampled_table_fit.STANDARD.level
    made = fingertip_skin(shape, Elastic(poisson=poisson), level=level, cache=cache)
    try:
        return table.stiffening(made, quick.stiffening)
    except DermisError:
        return None
