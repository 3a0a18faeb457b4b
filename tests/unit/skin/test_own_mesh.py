"""A mesh file in a finger's parameters stands for the lengths."""

from __future__ import annotations

import numpy as np
import pytest

from core.cache import Cache
from core.errors import DermisError
from core.skin.fingertip import fingertip_mesh
from core.skin.model import fingertip_skin, skin_from_parameters
from core.skin.own_mesh import digest
from core.skin.shape import FingertipShape
from tests.tissue import save_mesh

PLACE = "finger 'Index', skin"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    out = tmp_path_factory.mktemp("mesh") / "mine.npz"
    save_mesh(fingertip_mesh(FingertipShape(), "draft"), out)
    return out


def test_it_is_the_skin_of_the_mesh_with_the_material_given(path, tmp_path):
    """Saved and loaded, our own draft fingertip is our own draft fingertip; E and alpha scale it."""
    ours = fingertip_skin(level="draft")
    for cache in (None, Cache(tmp_path, 10**9)):
        loaded = skin_from_parameters({"mesh": str(path), "mesh_hash": digest(path)}, level="fine", cache=cache)
        np.testing.assert_allclose(loaded.compliance, ours.compliance, rtol=1e-12, atol=0)
        np.testing.assert_array_equal(loaded.positions, ours.positions)
    stiff = skin_from_parameters({"mesh": str(path), "young": 2e5, "alpha": 0.5, "poisson": 0.48})
    np.testing.assert_allclose(stiff.compliance, ours.compliance, rtol=1e-12, atol=0)


def test_a_mesh_and_lengths_exclude_each_other(path):
    with pytest.raises(DermisError, match="unknown parameter"):
        skin_from_parameters({"mesh": str(path), "width": 0.016})
    with pytest.raises(DermisError, match="unknown parameter"):
        skin_from_parameters({"mesh_hash": digest(path)})


def test_another_file_and_no_file_are_refused(path, tmp_path):
    with pytest.raises(DermisError, match="has changed") as refused:
        skin_from_parameters({"mesh": str(path), "mesh_hash": "0" * 64}, where=PLACE)
    assert refused.value.where == PLACE
    with pytest.raises(DermisError):
        skin_from_parameters({"mesh": str(tmp_path / "gone.npz")}, where=PLACE)
    (tmp_path / "bad.json").write_text('{"schema": "something else"}')
    with pytest.raises(DermisError, match="schema"):
        skin_from_parameters({"mesh": str(tmp_path / "bad.json")}, where=PLACE)
