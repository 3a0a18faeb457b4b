"""Motors that move alike: the paper's own coefficients, and what sharing a pulley costs where it is known."""

from __future__ import annotations

import numpy as np

from core.design.shared_pulleys import alike, shared_pulleys, with_shared
from core.design.synergies import components, reduce
from core.matching.sweep import halton
from core.matching.table import SkinTable


def test_the_papers_two_proximal_cables_are_alike():
    """E of tip-flat-tip, columns as printed; those of flat-like touches, .58 .60 .56, are all alike."""
    tip = np.array([[0.45, 0.89], [0.65, -0.34], [0.61, -0.30]])
    assert alike(tip) == ((1, 2),)
    assert alike(np.array([[0.58], [0.60], [0.56]])) == ((0, 1, 2),)
    assert alike(np.eye(3)) == ()


def test_all_of_a_group_are_alike_not_only_neighbours_in_a_chain():
    assert alike(np.array([[1.0], [0.92], [0.84]])) == ((0, 1),)


def linear(rows=4000):
    """A table whose readings are ten channels of the three commands, linear, so that errors are known."""
    commands = halton(rows, 3)
    mix = np.random.default_rng(2).standard_normal((3, 10))
    return SkinTable(commands, np.rint(2000 + 3000 * commands @ mix).astype(int), 0, np.ones(3)), mix


def moved(unlike):
    """Commands in which motors 2 and 3 do the same but for a share, and motor 1 something else."""
    t = np.linspace(0.0, 2.0 * np.pi, 300)
    one, other = 0.5 + 0.25 * np.sin(t), 0.5 + 0.25 * np.cos(2.0 * t)
    return np.column_stack([one, other, 0.5 + (1.0 - unlike) * (other - 0.5)])


def test_shared_motors_move_as_one_and_come_nearest_to_what_was_asked():
    commands = moved(0.08)
    parts = components(commands, np.ones(3))
    made = with_shared(parts, commands, 2, ((1, 2),))
    np.testing.assert_allclose(made[:, 1] - parts.mean[1], made[:, 2] - parts.mean[2], atol=1e-12)
    left = commands - made
    np.testing.assert_allclose(left @ np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]), 0.0, atol=1e-9)
    np.testing.assert_allclose(with_shared(parts, commands, 2, ()), parts.reconstructed(commands, 2), atol=1e-12)


def test_sharing_costs_nothing_where_motors_do_the_same_and_more_the_less_they_do():
    table, mix = linear()
    lost = []
    for unlike in (0.0, 0.04, 0.09):
        commands = moved(unlike)
        sensed = 2000 + 3000 * commands @ mix
        found = reduce(table, [sensed], 0.1, commands=[commands])
        shared = shared_pulleys(table, [sensed], [commands], found, 2)
        assert shared.groups == ((1, 2),) and shared.words() == ("2 and 3",)
        lost.append(shared.percent - found.percent()[0, 1])
    assert abs(lost[0]) < 0.01 and lost[1] > 0.05 and lost[2] > 2.0 * lost[1]
    apart = np.random.default_rng(0).uniform(0.2, 0.8, (300, 3))
    found = reduce(table, [2000 + 3000 * apart @ mix], 0.1, commands=[apart])
    assert shared_pulleys(table, [2000 + 3000 * apart @ mix], [apart], found, 3).groups == ()
