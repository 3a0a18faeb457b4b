"""The BLAS thread count is held at one and given back."""

from __future__ import annotations

import sys

import numpy as np
import pytest

pytest.importorskip("scipy")

from scipy.linalg import blas as scipy_blas

from core.skin.blas import controls, one_thread, thread_counts


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="wheels elsewhere may use another BLAS")
def test_count_is_held_and_restored_even_after_an_error() -> None:
    scipy_blas.dgemm(1.0, np.eye(3), np.eye(3))
    before = thread_counts()
    if not before:
        pytest.skip("no OpenBLAS in this environment")
    with pytest.raises(ZeroDivisionError), one_thread():
        assert set(thread_counts()) == {1}
        with one_thread():
            assert set(thread_counts()) == {1}
        1 / 0  # noqa: B018
    assert thread_counts() == before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="wheels elsewhere may use another BLAS")
def test_what_was_set_comes_back() -> None:
    scipy_blas.dgemm(1.0, np.eye(3), np.eye(3))
    found = controls()
    before = thread_counts()
    try:
        for _, put in found:
            put(2)
        raised = thread_counts()
        with one_thread():
            assert set(thread_counts()) <= {1}
        assert thread_counts() == raised
    finally:
        for (_, put), count in zip(found, before, strict=True):
            put(count)
    assert thread_counts() == before
