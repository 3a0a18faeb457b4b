"""A platform pressed into skin that stiffens: the law of its tissue row by row, and a disc's contact as another way."""

from functools import lru_cache

import numpy as np
import pytest

from core.devices.press import Press, Pressed
from core.devices.press_problem import PressPoints
from core.matching.platforms import mechanism
from core.matching.readings import readings_of
from core.matching.sweep import platform_poses, sweep
from core.matching.table import belongs, build, press_of
from core.presets import Library
from core.skin.felt_state import felt_key
from core.skin.model import SkinModel
from core.skin.sensor import electrode_sensor
from core.skin.stimulus import Stimulus
from core.surrogate.press_points import press_points
from tests.stiff_skins import stiff_skin

FRICTION = 0.4


@lru_cache
def skin() -> SkinModel:
    return stiff_skin()


def commands() -> np.ndarray:
    """Return commands that press straight and askew, shallow and deep; the last is the deepest."""
    device, tilts = mechanism(Library().device("hexapod")), np.array([0.0, -0.2, 0.1, 0.15])
    depth = np.array([0.4e-3, 0.8e-3, 1.2e-3, 1.5e-3])
    return device.commands(platform_poses(skin().positions, depth, tilts, -tilts, np.zeros((4, 2)), depth * 0))


def pressed(model: SkinModel, steps: int = 3) -> tuple[Press, Pressed]:
    press = Press(press_points(model), mechanism(Library().device("hexapod")), FRICTION, steps=steps)
    return press, press.press(commands())


@pytest.mark.parametrize("on", ["nodes", "points"])
def test_rows_obey_the_law_of_the_tissue(on: str) -> None:
    press, found = pressed(skin() if on == "points" else skin().on_nodes)
    assert press.points.on == on and found.touching.sum() >= 3 and found.amounts is not None
    stiff = skin().stiffening
    assert stiff is not None
    for row in np.flatnonzero(found.touching):
        q = found.amounts[row].astype(float)
        taken = stiff.energy.force(q)
        felt = Stimulus(skin(), found.force[row].astype(float), None, q)
        if on == "nodes":  # forces on nodes are those on points but for how they are spread
            work = skin().stiff.pad.T @ felt.force.ravel() / skin().material.modulus
            assert np.linalg.norm(q + taken - work) < 2e-3 * np.linalg.norm(work)
            moved = felt.pad_displacement
            np.testing.assert_allclose(found.displacement[row], moved, atol=2e-3 * np.abs(moved).max())
    assert found.residual[found.touching].max() < 5e-3


def test_the_deepest_row_is_stiffer_than_linear_skin() -> None:
    (_, hard), (_, soft) = pressed(skin()), pressed(skin().with_stiffening(None))
    assert soft.amounts is None
    assert hard.force[-1].sum(axis=0)[2] > 1.1 * soft.force[-1].sum(axis=0)[2]


def test_more_steps_lead_to_the_same_forces_without_friction() -> None:
    """Without friction the way does not matter, and so neither do the tangents on it."""
    found = []
    for steps in (2, 3, 8):
        press = Press(press_points(skin()), mechanism(Library().device("hexapod")), 0.0, steps=steps)
        found.append(press.press(commands()).force[-1])
    size = np.linalg.norm(found[-1])
    assert np.linalg.norm(found[0] - found[-1]) < 5e-3 * size
    assert np.linalg.norm(found[1] - found[-1]) < 5e-3 * size


def test_rows_do_not_depend_on_each_other() -> None:
    press = press_of(skin(), Library().device("hexapod"))
    rows = commands()
    together, alone = press.press(rows), press.press(rows[-1:])
    size = np.linalg.norm(alone.force[0])
    assert np.linalg.norm(together.force[-1] - alone.force[0]) < 2e-3 * size


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_cables_give_way_until_skin_and_springs_are_in_balance() -> None:
    spec = Library().device("cable_platform")
    press = press_of(skin(), spec)
    rows, _ = sweep(spec, press.points.positions, 64)
    found = press.press(rows)
    good = found.touching & (found.residual < 5e-3)
    assert good.sum() > 0.8 * found.touching.sum() > 5
    assert np.median(found.imbalance[good]) < 2e-3


def test_tables_of_two_tissues_are_kept_apart() -> None:
    spec, linear = Library().device("hexapod"), skin().with_stiffening(None)
    table = build(spec, skin(), readings_of(skin()), 64)
    assert not belongs(table, spec, skin())
    assert [f.code for f in belongs(table, spec, linear)] == ["other-skin"]
    assert felt_key(linear) == linear.key != felt_key(skin())


def test_electrodes_read_the_displacement_of_the_tissue() -> None:
    press, found = pressed(skin().on_nodes)
    assert found.amounts is not None
    sensor, readings = electrode_sensor(skin()), readings_of(skin())
    felt = Stimulus(skin(), found.force[-1].astype(float), None, found.amounts[-1].astype(float))
    inward = -np.einsum("cm,mk,mk->c", sensor.weights, skin().normals, felt.pad_displacement) / sensor.thickness
    counts = readings.counts(found.force[-1:], found.amounts[-1:])[0] - readings.rest
    np.testing.assert_allclose(counts[:19], 6000.0 * inward, rtol=1e-6, atol=1e-9)
    assert isinstance(press.points, PressPoints)
    given, alone = (readings.counts(found.force[-1:], a)[0] for a in (found.amounts[-1:], None))
    np.testing.assert_allclose(alone, given, rtol=1e-2)
