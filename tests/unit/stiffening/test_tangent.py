"""StiffTangent and StressChannels: a line through the law of the tissue, and stress with its slope."""

import numpy as np
import pytest

from core.stiffening.stress_channels import StressChannels
from core.stiffening.tangent import STIFFEST, StiffTangent
from tests.stiff_skins import COUNT, FIELDS, USUAL, stiff_skin

Q = USUAL * np.array([0.9, -0.3, 0.4, 0.2, -0.6])


def energy(strength: float = 1.0):
    stiffening = stiff_skin(strength=strength).stiffening
    assert stiffening is not None
    return stiffening.energy


def test_at_rest_skin_is_linear() -> None:
    tangent, z = StiffTangent.rest(COUNT), 3.0 * Q
    np.testing.assert_array_equal(tangent.amounts_at(z), z)
    assert not tangent.offset.any()


def test_line_touches_the_law_where_it_was_laid() -> None:
    tangent = StiffTangent.at(energy(), Q)
    z = Q + tangent.force
    np.testing.assert_allclose(tangent.amounts_at(z), Q, rtol=1e-12)
    off = []
    for step in (0.02, 0.01):
        exact = tangent
        for _ in range(9):
            exact = exact.moved(energy(), (1.0 + step) * z)
        line = tangent.amounts_at((1.0 + step) * z)
        np.testing.assert_allclose(line + tangent.force_at((1.0 + step) * z), (1.0 + step) * z, rtol=1e-12)
        off.append(np.linalg.norm(line - exact.q))
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.15)


def test_steps_meet_the_law_by_squares() -> None:
    tangent, z = StiffTangent.rest(COUNT), 1.5 * (Q + energy().force(Q))
    left = []
    for _ in range(9):
        tangent = tangent.moved(energy(), z)
        left.append(float(np.linalg.norm(tangent.q + tangent.force - z) / np.linalg.norm(z)))
    assert left[-1] < 1e-12
    assert left[2] < 2.0 * left[1] ** 2 / left[0]


def test_no_pattern_is_stiffer_than_compliances_bear() -> None:
    tangent = StiffTangent.at(energy(strength=1e3), Q)
    ends = np.linalg.eigvalsh(tangent.softening)[[0, -1]]
    assert ends[1] == pytest.approx(STIFFEST)


def test_channels_are_the_series_with_its_slope() -> None:
    stiffening = stiff_skin().stiffening
    assert stiffening is not None
    weights = np.random.default_rng(3).standard_normal((3, FIELDS))
    channels = StressChannels(stiffening.stress, weights)
    value, slope = channels.at(Q)
    wanted = weights @ stiffening.stress.amounts(Q)
    np.testing.assert_allclose(value, wanted, rtol=1e-5)
    step = 1e-3 * USUAL
    for a, one in enumerate(np.eye(COUNT)):
        measured = (channels.at(Q + step * one)[0] - channels.at(Q - step * one)[0]) / (2.0 * step)
        np.testing.assert_allclose(slope[:, a], measured, rtol=1e-3, atol=1e-4 * np.abs(slope).max())
    assert not channels.at(np.zeros(COUNT))[0].any()
