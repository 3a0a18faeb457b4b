"""Devices never push neo-Hookean skin into a fold of itself, though no device looks for one: see `tests.device_ways`.

Its rule was written before its outcomes; what is tried here is the beginning of its final set. That the rule can see a
fold is tried with the forces that once folded skin: beyond the mesh they kept their moment.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from core.devices.disc import DiscContact
from core.skin.nodal_forces import NodalForces
from core.skin.surface_store import smooth_pad
from core.surrogate import press_points
from core.surrogate.store import contact_of
from tests.device_ways import (
    FINAL,
    HELD,
    Compared,
    compared,
    device_of,
    disc_way,
    discs,
    followed,
    from_rest,
    pins,
    rows,
    searched,
    skin_of,
)

pytestmark = pytest.mark.one_line("3.11", "numbers alone; the laws that make them are tried on both lines elsewhere")

FOLDING = FINAL + 14  # the way of six legs whose first end was on a fold under the old forces
DISCS = ("thimble_3rrs", "hexapod")


def none_folded(found: list[Compared], friction: float) -> None:
    """Check that poses were compared, that nearly all are settled, and that none is on another balance."""
    assert len(found) >= 8 and sum(c.settled for c in found) >= 0.9 * len(found)
    assert not [c for c in found if c.folded(friction)]


@pytest.mark.parametrize("friction", [0.0, 0.6])
@pytest.mark.parametrize("kind", DISCS)
def test_a_disc_driven_roughly_is_where_rest_would_lead(kind: str, friction: float) -> None:
    none_folded(discs(kind, "draft", friction, range(FINAL, FINAL + 4)), friction)


def test_commands_that_are_searched_for_rough_touches_lead_to_no_fold() -> None:
    none_folded(searched("thimble_3rrs", "draft", "stress", range(FINAL, FINAL + 1)), 0.6)


@pytest.mark.parametrize("kind", ["cable_platform", "hexapod"])
def test_rows_of_tables_are_where_ways_of_more_parts_lead(kind: str) -> None:
    none_folded(rows(kind, "draft", 0.0, range(FINAL, FINAL + 8)), 0.0)


@pytest.mark.parametrize("method", ["DM2", "FM2"])
def test_skin_under_pins_is_where_their_forces_lead_it_from_rest(method: str) -> None:
    none_folded(pins("draft", method, range(FINAL, FINAL + 1)), 0.0)  # type: ignore[arg-type]


def test_the_rule_sees_the_fold_that_forces_beyond_the_mesh_once_made() -> None:
    """Six legs, tilted: with the old forces skin carried a third more than from rest, and worked against them."""
    skin, device = skin_of("draft"), device_of("hexapod")
    own, pad = contact_of(device, skin, 0.0), smooth_pad(skin)
    assert pad is not None
    cells, point, share = press_points._parts(pad.chart)
    bent = press_points._made(
        NodalForces(skin.mesh, pad.chart), pad.with_material(young=1.0, alpha=1.0), cells, point, share
    )
    once = DiscContact(replace(own.points, nodal=bent["nodal"]), own.disc, 0.0)
    way, ends = disc_way(device, own, FOLDING)
    way = way[: ends[0] + 1] + [way[ends[0]]] * HELD
    found = [compared(skin, c, followed(device, c, way)[-1], from_rest(device, c, way[-1])) for c in (own, once)]
    assert not found[0].folded(0.0) and found[0].settled
    assert found[1].folded(0.0) and found[1].work < 0.5 and found[1].larger > 1.2
