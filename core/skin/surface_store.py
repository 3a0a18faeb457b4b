"""Where the smooth pad's remainder comes from: a file that ships, the cache, or a fit that takes a while."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..cache import Cache, cache_key
from ..errors import DermisError, Finding
from ..recent import Recent
from ..shipped import BUILT_IN
from ..version import version
from .fingertip import fingertip_mesh
from .material import Elastic
from .model import SkinModel, condensed_pad, shape_and_material
from .pad_chart import CELL_SIDES, PadChart
from .remainder import STEPS, Remainder, fit_remainder
from .shape import FingertipShape
from .store import kept
from .surface_compliance import SurfaceCompliance

REMAINDER_VERSION = 1  # part of every key: raise it whenever mesh, kernel or fit changes
CHART_VERSION = 1  # the same, of a chart's neighbours
QUICK, FINEST = "fine", "reference"  # meshes: for any shape in a worker, and for those that ship
SHIPPED = BUILT_IN / "skins"

_pads: Recent[str, SurfaceCompliance] = Recent(10)  # a person's fingers


def remainder_key(shape: FingertipShape, poisson: float) -> str:
    """Return the key of a remainder: it depends on the shape and on Poisson's ratio, and on nothing else.

    To a nanometre: a length that was read in millimetres, or typed into a window, is the same length.
    """
    lengths = json.dumps(asdict(_rounded(shape)), sort_keys=True)
    return cache_key(f"dermis-remainder {REMAINDER_VERSION}", lengths, repr(round(poisson, 6)))


def _rounded(shape: FingertipShape) -> FingertipShape:
    return FingertipShape(**{name: round(length, 9) for name, length in asdict(shape).items()})


def shipped_name(shape: FingertipShape, poisson: float) -> str:
    """Return the name of the file in which a remainder ships."""
    return f"remainder_{remainder_key(shape, poisson)[:16]}.npz"


def find_remainder(
    shape: FingertipShape, poisson: float, *, shipped: Path | None = None, cache: Cache | None = None
) -> Remainder | None:
    """Return a remainder that was made before, or None: one that ships, else from the cache."""
    places = [None if shipped is None else shipped / shipped_name(shape, poisson)]
    places.append(None if cache is None else cache.get(remainder_key(shape, poisson)))
    for path in places:
        if path is None or not path.is_file():
            continue
        try:
            return Remainder.read(path)
        except DermisError:  # damaged: it can be made again
            continue
    return None


def make_remainder(
    shape: FingertipShape, poisson: float, level: str = QUICK, *, cache: Cache | None = None
) -> Generator[tuple[int, int], None, Remainder]:
    """Fit the remainder of a fingertip to a fine mesh of it and keep it in the cache; yields (done, total).

    Args:
        level: of the mesh: 'fine' (some 20 s and 1.3 GB) or 'reference' (two minutes and 3 GB).

    Raises:
        DermisError: a shape that cannot be meshed.
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
    """Return the smooth pad of a skin; fingers of one shape share its tables, whatever their stiffness and mesh.

    None where the skin is a mesh of one's own, which has no smooth pad, or where its remainder has not been made yet:
    it ships for the presets' lengths, and is looked for in the skin's cache for others.
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
        own = replace(material, poisson=round(material.poisson, 6))  # the same, whoever asks first
        known = SurfaceCompliance(_chart(_rounded(skin.shape), skin.cache), own, remainder)
    pad = _pads.make(key, lambda: known)
    return pad.with_material(young=material.young, alpha=material.alpha)


def _chart(shape: FingertipShape, cache: Cache | None) -> PadChart:
    """Return the chart of a shape that knows its neighbours: finding them loads what nobody else needs."""
    chart = PadChart.of(shape)
    key = cache_key(f"dermis-chart {CHART_VERSION}", version(), repr(shape), repr(CELL_SIDES))

    def made() -> dict[str, Array]:
        return {"beside": chart.beside.astype(np.float64)}

    found = kept(cache, key, {"beside": (chart.starts[1], 3, 3)}, made)["beside"]
    chart.__dict__["beside"] = found.astype(np.int64)
    return chart


def no_smooth_pad(skin: SkinModel, name: str) -> Finding:
    """Return why contact is solved at the nodes of a skin whose `smooth_pad` is None. The name is the finger's."""
    what = "contact is solved at the nodes of the skin's mesh, which edges and small things slip between"
    if skin.shape is None:
        why, remedy = "a mesh of one's own has no smooth skin", "Use a finer mesh, or a fingertip of lengths"
    else:
        why = "these lengths, or this Poisson's ratio, have no table of the smooth skin yet"
        remedy = "Let Blender make it, which takes some 20 s once, or use a preset's lengths"
    return Finding("warning", "contact-on-nodes", what, name, why, remedy=remedy)


def surface_compliance(
    parameters: Mapping[str, Any], *, shipped: Path | None = None, cache: Cache | None = None, where: str = "skin"
) -> SurfaceCompliance | None:
    """Return the smooth pad of the skin that parameters describe (see `skin_from_parameters`).

    None where it is a mesh of one's own, which has no smooth pad, or where its remainder has not been made yet.

    Args:
        shipped: folder of the remainders that ship. cache: of skins.

    Raises:
        DermisError: an unknown parameter, or values out of range.
    """
    shape, material = shape_and_material(parameters, where)
    if shape is None:
        return None
    remainder = find_remainder(shape, material.poisson, shipped=shipped, cache=cache)
    return None if remainder is None else SurfaceCompliance(PadChart.of(shape), material, remainder)
