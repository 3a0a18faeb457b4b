"""The BLAS of numpy and of scipy is held at one thread and given back; eigenvectors without Python's lock."""

from __future__ import annotations

import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip("scipy")

import scipy.linalg  # noqa: F401  (its library is held, too)

from core.skin import blas
from core.skin.blas import one_thread, pools, symmetric_eigenvectors


def counts() -> dict[str, int]:
    return {pool["filepath"]: pool["num_threads"] for pool in pools().info()}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="wheels elsewhere may use another BLAS")
def test_count_is_held_and_restored_even_after_an_error() -> None:
    with pools().limit(limits=2):
        before = counts()
        assert len(before) == 2 and set(before.values()) == {2}, "numpy's and scipy's"
        with pytest.raises(ZeroDivisionError), one_thread():
            assert set(counts().values()) == {1}
            with one_thread():
                assert set(counts().values()) == {1}
            assert set(counts().values()) == {1}, "the inner one gives back what it found"
            1 / 0  # noqa: B018
        assert counts() == before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="wheels elsewhere may use another BLAS")
def test_a_block_of_another_thread_keeps_the_count_until_it_ends_too() -> None:
    inside, done = threading.Event(), threading.Event()

    def hold() -> None:
        with one_thread():
            inside.set()
            done.wait(10)

    with pools().limit(limits=2):
        before, other = counts(), threading.Thread(target=hold)
        with one_thread():
            other.start()
            assert inside.wait(10)
        assert set(counts().values()) == {1}, "the other one goes on"
        done.set()
        other.join(10)
        with one_thread():
            assert set(counts().values()) == {1}
        assert counts() == before


def test_libraries_are_looked_up_once() -> None:
    assert pools() is pools()


def symmetric(rows: int) -> np.ndarray:
    """Return a matrix whose eigenvalues span eight decades."""
    parts = np.random.default_rng(rows).normal(size=(rows, rows)) * np.logspace(0, -4, rows)
    return parts @ parts.T


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("rows", [1, 2, 3, 40, 250])
def test_eigenvectors_are_those_of_scipy_to_the_last_bit(
    rows: int, wide: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where SciPy's LAPACK has integers of 64 bits: there SciPy is asked."""
    from scipy.linalg import eigh

    assert blas._dsyevr() is not None
    if wide:
        monkeypatch.setattr(blas, "_dsyevr", lambda: None)
    matrix = symmetric(rows)
    with one_thread():
        for mine, scipys in zip(symmetric_eigenvectors(matrix), eigh(matrix), strict=True):
            assert mine.tobytes("A") == scipys.tobytes("A") and mine.flags.f_contiguous == scipys.flags.f_contiguous
    assert np.array_equal(matrix, symmetric(rows)), "the matrix is left as it is"


def test_a_matrix_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="infs or NaNs"):
        symmetric_eigenvectors(np.array([[1.0, np.nan], [np.nan, 1.0]]))


def test_other_threads_run_while_eigenvectors_are_computed() -> None:
    """Otherwise a window would stand still for as long."""
    matrix = symmetric(700)
    symmetric_eigenvectors(matrix[:2, :2])  # loads the library
    computing = threading.Thread(target=symmetric_eigenvectors, args=(matrix,))
    turns = 0
    computing.start()
    while computing.is_alive():
        time.sleep(1e-3)
        turns += 1
    assert turns > 20
