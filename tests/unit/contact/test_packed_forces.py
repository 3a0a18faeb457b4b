"""Packed forces against the forces themselves: how far off, what stays exact, and how much smaller."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.packed_forces import BLOCK, PackedForces
from core.errors import DermisError

PLACES = 300
Sample = tuple[np.ndarray, np.ndarray]


def path(samples: int, seed: int = 1, scale: float = 0.1) -> list[Sample]:
    """Forces that swell and ebb on some places, which come and go, in no order."""
    rng = np.random.default_rng(seed)
    where, turn = rng.permutation(PLACES)[:60], rng.uniform(0.0, 6.0, (60, 3))
    found = []
    for i in range(samples):
        loads = scale * np.sin(0.02 * i + turn) * rng.uniform(0.999, 1.0, (60, 3))
        on = np.sin(0.05 * i + turn[:, 0]) > -0.5
        found.append((where[on], loads[on]))
    return found


def dense(samples: list[Sample]) -> np.ndarray:
    out = np.zeros((len(samples), PLACES, 3))
    for row, (places, force) in zip(out, samples, strict=True):
        row[places] = force
    return out


@pytest.mark.parametrize("scale", [1e-7, 0.1, 37.0])
@pytest.mark.parametrize("count", [1, BLOCK - 1, BLOCK, 3 * BLOCK + 5])
def test_forces_come_back_within_what_is_said_of_the_largest_about(count: int, scale: float) -> None:
    given = path(count, scale=scale)
    packed, exact = PackedForces(given, PLACES), dense(given)
    assert packed.shape == exact.shape and len(packed) == count
    for start in range(0, count, BLOCK):
        some = slice(start, start + BLOCK)
        assert np.abs(np.asarray(packed)[some] - exact[some]).max() <= np.abs(exact[some]).max() / 65536
    np.testing.assert_array_equal(np.asarray(packed, np.float64), np.asarray(packed))
    for k in {0, count // 2, count - 1}:
        places, force = packed.at(k)
        assert places.tolist() == sorted(given[k][0].tolist())  # those without much force, too
        np.testing.assert_array_equal(packed[k][places], force)
        np.testing.assert_array_equal(packed[k], np.asarray(packed)[k])
    with pytest.raises(IndexError):
        packed.at(count)


def test_packing_again_changes_nothing() -> None:
    """Also where the largest force lies by a power of two: it may be rounded up to it."""
    for scale in (0.1, 0.125 / np.sin(np.pi / 2), 0.1249999, 0.12499, 1.0):
        given = path(2 * BLOCK + 3, scale=scale)
        given[5][1][0] = scale
        once = PackedForces(given, PLACES)
        again = PackedForces((once.at(k) for k in range(len(once))), PLACES)
        assert np.asarray(again).tobytes() == np.asarray(once).tobytes()


def test_jumps_from_one_end_to_the_other_survive() -> None:
    """The second differences are as large as they can be, and every byte of them is needed."""
    signs = np.where(np.arange(2 * BLOCK) % 2, 1.0, -1.0)
    given = [(np.array([7, 3]), np.full((2, 3), sign)) for sign in signs]
    np.testing.assert_array_equal(np.asarray(PackedForces(given, 8)), [dense_row(sign) for sign in signs])


def dense_row(sign: float) -> np.ndarray:
    row = np.zeros((8, 3))
    row[[3, 7]] = sign
    return row


def test_it_is_smaller_the_smoother_the_way_and_nothing_is_little() -> None:
    given = path(20 * BLOCK)
    full = sum(12 * len(places) for places, _ in given)
    assert PackedForces(given, PLACES).nbytes < 0.5 * full
    still = PackedForces([given[0]] * (20 * BLOCK), PLACES)
    assert still.nbytes < 0.05 * full
    nothing = PackedForces([(np.zeros(0, np.intp), np.zeros((0, 3)))] * 5, PLACES)
    assert nothing.nbytes < 100 and not np.asarray(nothing).any() and len(nothing.at(4)[0]) == 0
    assert np.asarray(PackedForces([], PLACES)).shape == (0, PLACES, 3)


def test_a_force_that_is_no_number_is_refused() -> None:
    for bad in (np.nan, np.inf):
        with pytest.raises(DermisError, match="no finite number"):
            PackedForces([(np.array([1]), np.array([[0.0, bad, 0.0]]))], PLACES)
