"""A platform pressed into skin that follows the neo-Hookean law: the law row by row, tables of two tissues apart."""

from functools import lru_cache

import numpy as np
import pytest

from core.contact.solver.law_skin import TOLERANCE
from core.design.collect import _deeper
from core.devices.poses import inverted
from core.devices.press import Press, Pressed
from core.devices.row_laws import RowLaws
from core.matching.platforms import mechanism
from core.matching.readings import readings_of
from core.matching.sweep import commands_swept, platform_poses, reached, sweep
from core.matching.table import belongs, build, press_of, tabulate
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin, skin_from_parameters
from core.skin.sensor import electrode_sensor
from core.skin.stimulus import Stimulus
from core.surrogate.press_points import press_points

FRICTION = 0.4


@lru_cache
def skin() -> SkinModel:
    return fingertip_skin(level="draft").with_law()


def commands() -> np.ndarray:
    """Return commands that press straight and askew, shallow and deep; the last is the deepest."""
    device, tilts = mechanism(Library().device("hexapod")), np.array([0.0, -0.2, 0.1, 0.05])
    depth = np.array([0.3e-3, 0.6e-3, 0.9e-3, 1.1e-3])
    return device.commands(platform_poses(skin().positions, depth, tilts, -tilts, np.zeros((4, 2)), depth * 0))


def pressed(model: SkinModel, steps: int = 3) -> tuple[Press, Pressed]:
    press = Press(press_points(model), mechanism(Library().device("hexapod")), FRICTION, steps=steps)
    return press, press.press(commands())


@pytest.mark.parametrize("on", ["nodes", "points"])
def test_rows_obey_the_law(on: str) -> None:
    press, found = pressed(skin() if on == "points" else skin().on_nodes)
    assert press.points.on == on and found.touching.sum() >= 3 and found.amounts is not None
    assert found.residual[found.touching].max() < 5e-3 and found.left.max() == 0.0
    for row in np.flatnonzero(found.touching):
        force = found.force[row].astype(float)
        given = Stimulus(skin(), force, None, found.amounts[row].astype(float))
        alone = Stimulus(skin(), force)
        assert alone.amounts is not None and given.amounts is not None
        assert np.linalg.norm(given.amounts - alone.amounts) < 0.1 * np.linalg.norm(alone.amounts)
        if on == "nodes":
            moved = given.pad_displacement
            np.testing.assert_allclose(found.displacement[row], moved, atol=2e-3 * np.abs(moved).max())


def test_the_deepest_row_is_stiffer_than_linear_skin() -> None:
    (_, hard), (_, soft) = pressed(skin()), pressed(skin().linear)
    assert soft.amounts is None and not soft.left.any()
    assert hard.force[-1].sum(axis=0)[2] > 1.05 * soft.force[-1].sum(axis=0)[2]


def test_more_steps_lead_to_the_same_forces_without_friction() -> None:
    found = []
    for steps in (2, 3, 8):
        press = Press(press_points(skin()), mechanism(Library().device("hexapod")), 0.0, steps=steps)
        found.append(press.press(commands()).force[-1])
    size = np.linalg.norm(found[-1])
    assert np.linalg.norm(found[0] - found[-1]) < 4.0 * TOLERANCE * size
    assert np.linalg.norm(found[1] - found[-1]) < 4.0 * TOLERANCE * size


def test_rows_do_not_depend_on_each_other() -> None:
    press = press_of(skin(), Library().device("hexapod"))
    rows = commands()
    together, alone = press.press(rows), press.press(rows[-1:])
    size = np.linalg.norm(alone.force[0])
    assert np.linalg.norm(together.force[-1] - alone.force[0]) < 2.0 * TOLERANCE * size


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_cables_give_way_until_skin_and_springs_are_in_balance() -> None:
    spec = Library().device("cable_platform")
    press = press_of(skin(), spec)
    rows, _ = sweep(spec, press.points.positions, 64)
    found = press.press(rows)
    good = found.touching & (found.residual < 5e-3) & (found.left == 0.0)
    assert good.sum() > 0.6 * found.touching.sum() > 5
    assert np.median(found.imbalance[good]) < 2e-3
    kept, _, left = tabulate(readings_of(skin()), rows, found)  # rows that the law is far from are left out, and told
    assert len(kept) + left["rest_rows"] + left["unbalanced_rows"] == len(rows)


def test_tables_of_two_tissues_are_kept_apart() -> None:
    spec, linear = Library().device("hexapod"), skin().linear
    table = build(spec, skin(), readings_of(skin()), 64)
    assert not belongs(table, spec, skin())
    assert [f.code for f in belongs(table, spec, linear)] == ["other-skin"]


def test_electrodes_read_the_displacement_by_the_law() -> None:
    _, found = pressed(skin().on_nodes)
    assert found.amounts is not None
    sensor, readings = electrode_sensor(skin()), readings_of(skin())
    felt = Stimulus(skin(), found.force[-1].astype(float), None, found.amounts[-1].astype(float))
    inward = -np.einsum("cm,mk,mk->c", sensor.weights, skin().normals, felt.pad_displacement) / sensor.thickness
    counts = readings.counts(found.force[-1:], found.amounts[-1:])[0] - readings.rest
    np.testing.assert_allclose(counts[:19], 6000.0 * inward, rtol=1e-6, atol=1e-9)
    given, alone = (readings.counts(found.force[-1:], a)[0] for a in (found.amounts[-1:], None))
    np.testing.assert_allclose(alone, given, rtol=2e-2)


def test_rows_that_press_hard_keep_their_balance_and_no_row_takes_the_others_along() -> None:
    """A soft platform deep in a small finger: the law is far off at first, and no step may lead farther and farther."""
    small = skin_from_parameters(Library().skin("index_small"), level="draft").with_law()
    spec, points = Library().device("cable_platform"), press_points(small)
    rows = np.random.default_rng(1).permutation(sweep(spec, points.positions, 729)[0])[[0, 2, 13, 18, 5]]
    found = Press(points, mechanism(spec), 0.6).press(rows)
    assert found.touching.all() and found.imbalance.max() < 0.05 and found.residual.max() < 5e-3
    assert np.isfinite(found.left).all() and np.abs(found.force).max() < 1.0
    assert np.abs(found.poses.centre - mechanism(spec).carry(rows, mechanism(spec).rest_poses(5)).centre).max() < 2e-3


def test_a_matrix_without_an_inverse_has_no_numbers_and_the_others_have_theirs() -> None:
    some = np.random.default_rng(0).normal(size=(3, 6, 6))
    some[1] = 1e30  # what is added to it is lost: its rows are all alike
    out = inverted(some)
    assert np.isnan(out[1]).all()
    np.testing.assert_allclose(out[[0, 2]] @ some[[0, 2]], np.tile(np.eye(6), (2, 1, 1)), atol=1e-12)
    some[1] = np.nan
    assert not np.isfinite(inverted(some)[1]).any() and np.isfinite(inverted(some)[[0, 2]]).all()


def test_rows_that_come_back_from_deeper_on_a_thumb_have_forces_of_the_law() -> None:
    """Where offsets ran away, two rows had forces that were no numbers, and two more were not the law's."""
    spec = Library().device("cable_platform")
    thumb = skin_from_parameters(Library().skin("thumb_medium"), level="draft").with_law()
    press = press_of(thumb, spec)
    each = [commands_swept(one, press.points.positions, 96) for one in (spec, _deeper(spec))]
    within = reached(spec, each[0]) & reached(spec, each[1])
    there, deeper = (rows[within][[18, 21]] for rows in each)
    straight, back = press.press(there), press.press(there, via=deeper)
    for found in (straight, back):
        assert all(np.isfinite(getattr(found, name)).all() for name in ("force", "displacement", "amounts"))
        assert found.touching.all() and found.left.max() == 0.0 and found.residual.max() < 5e-3
    apart = np.linalg.norm(back.force.sum(axis=1) - straight.force.sum(axis=1), axis=1)
    assert (apart < 0.1 * np.linalg.norm(straight.force.sum(axis=1), axis=1)).all()  # of friction


def test_a_row_whose_offset_is_no_number_has_no_force_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    press, begin = press_of(skin(), Library().device("hexapod")), RowLaws.begin

    def far_off(laws: RowLaws) -> None:
        begin(laws)
        laws.less[0] = np.nan

    monkeypatch.setattr(RowLaws, "begin", far_off)
    found = press.press(commands()[-1:])
    assert not found.force.any() and np.isfinite(found.displacement).all() and found.left[0] == np.inf
