"""Sources of the smooth pad's remainder: files, a cache and a fit.

Files are shipped for the presets. The fit takes 20 s or more.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ..cache import Cache, cache_key
from ..errors import DermisError, Finding
from ..recent import Recent
from ..shipped import BUILT_IN
from ..version import version
from .fingertip import fingertip_mesh
from .material import Elastic
from .model import SkinModel, condensed_pad, shape_and_material
from .pad_chart import CELL_SIDES, TABLES, PadChart
from .remainder import STEPS, Remainder, fit_remainder
from .shape import FingertipShape
from .store import kept
from .surface_compliance import SurfaceCompliance

REMAINDER_VERSION = 1  # part of the key of every remainder; increase it when mesh, kernel or fit changes
CHART_VERSION = 2  # part of the key of a chart's tables; increase it when their computation changes
QUICK, FINEST = "fine", "reference"  # levels of the mesh for the fit: of any shape, and of the shipped shapes
SHIPPED = BUILT_IN / "skins"

_pads: Recent[str, SurfaceCompliance] = Recent(10)  # enough for the fingers of one person


def remainder_key(shape: FingertipShape, poisson: float) -> str:
    """Return the key of a remainder.

    It depends only on the shape and Poisson's ratio. Lengths are rounded to a nanometre, so that a length has the same
    key in metres and in millimetres.
    """
    lengths = json.dumps(asdict(_rounded(shape)), sort_keys=True)
    return cache_key(f"dermis-remainder {REMAINDER_VERSION}", lengths, repr(round(poisson, 6)))


def _rounded(shape: FingertipShape) -> FingertipShape:
    return FingertipShape(**{name: round(length, 9) for name, length in asdict(shape).items()})


def shipped_name(shape: FingertipShape, poisson: float) -> str:
    """Return the file name of a shipped remainder."""
    return f"remainder_{remainder_key(shape, poisson)[:16]}.npz"


def find_remainder(
    shape: FingertipShape, poisson: float, *, shipped: Path | None = None, cache: Cache | None = None
) -> Remainder | None:
    """Return a remainder from shipped files or the cache; None for none.

    Args:
        shape: the fingertip.
        poisson: Poisson's ratio.
        shipped: folder of the shipped remainders; None for none.
        cache: cache of skins; None for none.
    """
    places = [None if shipped is None else shipped / shipped_name(shape, poisson)]
    places.append(None if cache is None else cache.get(remainder_key(shape, poisson)))
    for path in places:
        if path is None or not path.is_file():
            continue
        try:
            return Remainder.read(path)
        except DermisError:  # a damaged file counts as missing
            continue
    return None


def make_remainder(
    shape: FingertipShape, poisson: float, level: str = QUICK, *, cache: Cache | None = None
) -> Generator[tuple[int, int], None, Remainder]:
    """Fit the remainder of a fingertip, and store it in the cache.

    Args:
        shape: the fingertip.
        poisson: Poisson's ratio.
        level: resolution of the mesh: 'fine' (some 20 s and 1.3 GB) or 'reference' (two minutes and 3 GB).
        cache: cache of skins; None: the remainder is not stored.

    Yields:
        Number of finished steps and number of all steps.

    Returns:
        The remainder.

    Raises:
        DermisError: the shape cannot be meshed.
    """
    yield 0, STEPS
    chart = PadChart.of(shape, 1)
    mesh = fingertip_mesh(shape, level)
    condensed = condensed_pad(mesh, Elastic(1.0, poisson, 1.0), "anp", response=True)
    made = yield from fit_remainder(chart, mesh, condensed, poisson)
    if cache is not None:
        cache.put(remainder_key(shape, poisson), made.write)
    return made


def smooth_pad(skin: SkinModel) -> SurfaceCompliance | None:
    """Return the smooth pad of a skin; None if it has none.

    A mesh of the user's own has no smooth pad. For a parametric fingertip, the pad needs a remainder. Remainders for
    the lengths of the presets are shipped; others must be in the skin's cache. Fingers with the same shape and
    Poisson's ratio share the pad's tables, even if their stiffness or mesh differs.
    """
    if skin.shape is None:
        return None
    material = skin.material
    key = remainder_key(skin.shape, material.poisson)
    known = _pads.get(key)
    if known is None:
        remainder = find_remainder(skin.shape, material.poisson, shipped=SHIPPED, cache=skin.cache)
        if remainder is None:
            return None
        # Poisson's ratio is rounded as in the key, so that the pad does not depend on which finger comes first.
        own = replace(material, poisson=round(material.poisson, 6))
        known = SurfaceCompliance(_chart(_rounded(skin.shape), skin.cache), own, remainder)
    pad = _pads.make(key, lambda: known)
    return pad.with_material(young=material.young, alpha=material.alpha)


def _chart(shape: FingertipShape, cache: Cache | None) -> PadChart:
    """Return the chart of a shape with its cells and neighbours, which are read from the cache if they are there."""
    key = cache_key(f"dermis-chart {CHART_VERSION}", version(), repr(shape), repr(CELL_SIDES))
    return PadChart.restored(shape, kept(cache, key, TABLES, lambda: PadChart.of(shape).tables()))


def no_smooth_pad(skin: SkinModel, name: str) -> Finding:
    """Return the finding for a finger whose skin has no smooth pad.

    Args:
        skin: the finger's skin.
        name: name of the finger.
    """
    what = "contact is solved at the nodes of the skin's mesh; edges and small objects can pass between them"
    if skin.shape is None:
        why, remedy = (
            "only a fingertip that is described by lengths has a smooth skin",
            "Use a finer mesh, or describe the fingertip by its lengths",
        )
    else:
        why = "these lengths, or this Poisson's ratio, have no table of the smooth skin yet"
        remedy = "Let Blender make it, which takes some 20 s once, or use a preset's lengths"
    return Finding("warning", "contact-on-nodes", what, name, why, remedy=remedy)


def surface_compliance(
    parameters: Mapping[str, Any], *, shipped: Path | None = None, cache: Cache | None = None, where: str = "skin"
) -> SurfaceCompliance | None:
    """Return the smooth pad of the skin that parameters describe.

    None if the skin has no smooth pad, or its remainder is not found, see `smooth_pad`.

    Args:
        parameters: as for `skin_from_parameters`.
        shipped: folder of the shipped remainders; None for none.
        cache: cache of skins; None for none.
        where: name of the finger, for errors.

    Raises:
        DermisError: a parameter is unknown, or a value is out of range.
    """
    shape, material = shape_and_material(parameters, where)
    if shape is None:
        return None
    remainder = find_remainder(shape, material.poisson, shipped=shipped, cache=cache)
    return None if remainder is None else SurfaceCompliance(PadChart.of(shape), material, remainder)
