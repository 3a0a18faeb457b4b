"""The BLAS of numpy and of scipy is held at one thread and given back."""

from __future__ import annotations

import sys
import threading

import pytest

pytest.importorskip("scipy")

from core.skin.blas import one_thread, pools


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
