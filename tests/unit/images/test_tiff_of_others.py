"""TIFFs that tifffile 2026.3.3 wrote, of every type of sample, packing, byte order and layout, beside what they hold.

The file beside this one holds their bytes, and the arrays under the same names with ':values'.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core import images
from core.errors import DermisError

with np.load(Path(__file__).with_name("written_by_tifffile.npz")) as archive:
    FILES = {name: archive[name] for name in archive.files}
NAMES = [name for name in FILES if not name.endswith(":values")]
LUMA = np.array([0.2126, 0.7152, 0.0722])


def read(tmp_path, name):
    path = tmp_path / "map.tif"
    path.write_bytes(FILES[name].tobytes())
    return images.read(path), FILES[f"{name}:values"]


def expected(values):
    largest = np.iinfo(values.dtype).max if values.dtype.kind in "ui" else 1
    return (values[::-1].astype(np.float64) / largest).astype(np.float32)


@pytest.mark.parametrize("name", [n for n in NAMES if n[0] in "uif"])
def test_samples_are_what_was_written(tmp_path, name):
    raster, values = read(tmp_path, name)
    np.testing.assert_array_equal(raster.values, expected(values))
    assert raster.signed == (values.dtype.kind == "i") and not raster.holes.any()
    assert raster.levels == (0 if values.dtype.kind == "f" else np.iinfo(values.dtype).max + 1)


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith("refused")])
def test_other_samples_are_refused_in_words(tmp_path, name):
    with pytest.raises(DermisError, match="pixels of this kind are not supported .*(sample|complex|compressed)"):
        read(tmp_path, name)


def test_colours_in_planes_are_read(tmp_path):
    raster, values = read(tmp_path, "colour planes of u1")
    np.testing.assert_allclose(raster.values, np.moveaxis(values, 0, 2)[::-1] @ LUMA / 255, rtol=1e-6)


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith("no data")])
def test_declared_no_data_is_a_hole(tmp_path, name):
    raster, values = read(tmp_path, name)
    number = np.array(float(name.split()[-1])).astype(values.dtype)
    wanted = np.isnan(values) if np.isnan(number) else values == number
    assert 0 < wanted.sum() < wanted.size
    holes = raster.holes | ~np.isfinite(raster.values)
    np.testing.assert_array_equal(holes, wanted[::-1])


def test_no_data_that_is_no_number_is_refused(tmp_path):
    path = tmp_path / "map.tif"
    path.write_bytes(FILES["no data: f4 -9999"].tobytes().replace(b"-9999\0", b"none.\0"))
    with pytest.raises(DermisError, match="tag 42113.*'no data' is not a number.*none"):
        images.read(path)
