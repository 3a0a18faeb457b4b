"""What points see of bodies: shortcuts of the compiled look."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.contact.solver import smooth_contact
from core.contact.solver.bodies import ContactBody
from core.contact.solver.path_solver import BONE
from core.contact.solver.point_set import PointSet
from core.contact.solver.point_solver import REACH
from core.contact.solver.smooth_contact import SmoothContact
from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.surface_store import surface_compliance
from core.surface.gap import Surface


@pytest.mark.parametrize("x", np.arange(-8, 9, 2).tolist())
def test_a_point_over_one_flat_face_sees_from_one_place_what_it_sees_from_all(x: float) -> None:
    """The edge of a block is under the pad, at other distances from the points for each x [mm]."""
    pad = surface_compliance(Library().skin("index_medium"), shipped=Path(BUILT_IN) / "skins")
    assert pad is not None
    points = PointSet(pad)
    places = pad.cells.positions[: pad.chart.starts[1]]
    low = np.flatnonzero(places[:, 2] < places[:, 2].min() + 1.5e-3)
    points.change(np.zeros(0, dtype=np.int64), low)
    block = ContactBody(Surface.block(0.02, 0.02), translation=np.array([1e-3 * x, 0.01, places[:, 2].min() + 0.5e-3]))
    contact, still = SmoothContact(REACH, BONE), np.zeros((len(low), 3))
    seen = contact.look(points, [block], still)
    all_places = contact._prepared(points, [block], still)
    all_places.record.thorough = 1
    smooth_contact._call(all_places.record)
    wanted = smooth_contact._gaps(all_places, [block])
    near = np.flatnonzero(wanted.clearance < 0.1e-3)  # points farther away look but once at first
    assert len(near) > 20
    np.testing.assert_allclose(seen.clearance[near], wanted.clearance[near], atol=1e-12)
    np.testing.assert_allclose(seen.normal[near], wanted.normal[near], atol=1e-9)
