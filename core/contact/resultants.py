"""Resultants: what a skin's contact forces come to at every sample, as series and as a CSV file."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..files import atomic
from .skin_contact import SkinContact

VERSION = 1
# Column -> unit, in the order of the file.
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
}


def resultants(touch: SkinContact) -> dict[str, Array]:
    """Return series by the names of `COLUMNS`, in SI and in the finger's frame, shape (n,) each.

    `force` is the sum on the skin; `centre` is the mean of the undeformed pad nodes weighted by the force into the
    skin, nan without contact.
    """
    n = len(touch.times)
    total, centre = np.zeros((n, 3)), np.full((n, 3), np.nan)
    if len(touch.contact):
        force = touch.force.astype(np.float64)
        total[touch.contact] = force.sum(axis=1)
        push = np.maximum(-np.einsum("kmi,mi->km", force, touch.model.normals), 0.0)
        whole = push.sum(axis=1)
        pressed = whole > 0.0
        centre[touch.contact[pressed]] = (push[pressed] @ touch.model.positions) / whole[pressed, None]
    axes = {
        f"{name}_{axis}": values[:, i]
        for name, values in (("force", total), ("centre", centre))
        for i, axis in enumerate("xyz")
    }
    known = {"frame": touch.frames, "time": touch.times, **axes}
    return {name: np.asarray(known.get(name, getattr(touch, name, None)), np.float64) for name in COLUMNS}


def dumps(touch: SkinContact, meta: Mapping[str, str] | None = None) -> str:
    """Return the resultants as CSV text: comments with what they are of, names with units, one row a sample."""
    out = io.StringIO()
    out.write(f"# dermis-resultants {VERSION}\n")
    for name, value in {**(meta or {}), "frame of reference": "finger: +Y to the tip, +Z to the nail"}.items():
        out.write(f"# {name}: {' '.join(str(value).split())}\n")
    out.write(",".join(f"{name}[{unit}]" for name, unit in COLUMNS.items()) + "\n")
    series = resultants(touch)
    for row in zip(*(series[name].tolist() for name in COLUMNS), strict=True):
        out.write(",".join("" if value != value else f"{value:.9g}" for value in row) + "\n")
    return out.getvalue()


def write(touch: SkinContact, path: Path, meta: Mapping[str, str] | None = None) -> None:
    """Write the resultants as CSV, whole or not at all.

    Raises:
        DermisError: the file cannot be written.
    """
    with atomic(Path(path)) as part:
        part.write_bytes(dumps(touch, meta).encode("utf-8"))
