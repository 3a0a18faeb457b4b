"""Resultants: total contact forces on a skin at every sample, as series and as CSV."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..files import atomic
from ..parameters.error_bands import error_band
from .skin_contact import SkinContact

VERSION = 2
# Unit of each column, in the order of the file.
COLUMNS = {
    "frame": "1",
    "time": "s",
    "normal_force": "N",
    "tangential_force": "N",
    "force_x": "N",
    "force_y": "N",
    "force_z": "N",
    "centre_x": "m",
    "centre_y": "m",
    "centre_z": "m",
    "depth": "m",
    "lift": "m",
    "sticking": "1",
    "slipping": "1",
    "slide": "m",
    "stress_error": "1",
    "force_error": "1",
}


def resultants(skin_contact: SkinContact) -> dict[str, Array]:
    """Return the series of `COLUMNS` by name, in SI units and in the finger's frame, shape (n,) each.

    'force' is the total force on the skin. 'centre' is the mean position of the undeformed pad nodes, weighted with the
    force into the skin. 'stress_error' and 'force_error' are the errors of the tissue model at this depth and slide:
    the median of simulated touches, see `error_band`. The last three are nan without contact.
    """
    n = len(skin_contact.times)
    total, centre = np.zeros((n, 3)), np.full((n, 3), np.nan)
    if len(skin_contact.contact):
        force = skin_contact.force.astype(np.float64)
        total[skin_contact.contact] = force.sum(axis=1)
        push = np.maximum(-np.einsum("kmi,mi->km", force, skin_contact.model.normals), 0.0)
        whole = push.sum(axis=1)
        pressed = whole > 0.0
        centre[skin_contact.contact[pressed]] = (push[pressed] @ skin_contact.model.positions) / whole[pressed, None]
    axes = {
        f"{name}_{axis}": values[:, i]
        for name, values in (("force", total), ("centre", centre))
        for i, axis in enumerate("xyz")
    }
    slide = np.full(n, np.nan) if skin_contact.slide is None else skin_contact.slide
    stress_error, force_error = np.full(n, np.nan), np.full(n, np.nan)
    for i in skin_contact.contact.tolist():
        band = error_band(skin_contact.model.tissue, float(skin_contact.depth[i]), float(np.nan_to_num(slide[i])))
        stress_error[i], force_error[i] = band.stress.median, band.force.median
    errors = {"slide": slide, "stress_error": stress_error, "force_error": force_error}
    known = {"frame": skin_contact.frames, "time": skin_contact.times, **axes, **errors}
    return {name: np.asarray(known.get(name, getattr(skin_contact, name, None)), np.float64) for name in COLUMNS}


def dumps(skin_contact: SkinContact, meta: Mapping[str, str] | None = None) -> str:
    """Return the resultants as CSV text: comments with their origin, names with units, one row for each sample.

    Args:
        skin_contact: the touch.
        meta: further comments, by name.
    """
    out = io.StringIO()
    out.write(f"# dermis-resultants {VERSION}\n")
    own = {"tissue": skin_contact.model.tissue, "frame of reference": "finger: +Y to the tip, +Z to the nail"}
    for name, value in {**(meta or {}), **own}.items():
        out.write(f"# {name}: {' '.join(str(value).split())}\n")
    out.write(",".join(f"{name}[{unit}]" for name, unit in COLUMNS.items()) + "\n")
    series = resultants(skin_contact)
    for row in zip(*(series[name].tolist() for name in COLUMNS), strict=True):
        out.write(",".join("" if value != value else f"{value:.9g}" for value in row) + "\n")
    return out.getvalue()


def write(skin_contact: SkinContact, path: Path, meta: Mapping[str, str] | None = None) -> None:
    """Write the resultants to a CSV file; after an error the file is unchanged.

    Raises:
        DermisError: the file cannot be written.
    """
    with atomic(Path(path)) as part:
        part.write_bytes(dumps(skin_contact, meta).encode("utf-8"))
