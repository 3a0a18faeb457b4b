"""The last few things: built once, the one asked for longest ago goes first."""

from __future__ import annotations

import doctest

import pytest

from core import recent
from core.recent import Recent


def test_what_was_asked_for_longest_ago_goes_first() -> None:
    built: list[str] = []
    kept: Recent[str, int] = Recent(2)
    for key in ("a", "b", "a", "c", "a", "b"):
        assert kept.make(key, lambda key=key: built.append(key) or len(built)) == {"a": 1, "b": 2, "c": 3}[key] or (
            built == ["a", "b", "c", "b"]
        )
    assert built == ["a", "b", "c", "b"] and list(kept) == ["a", "b"]


def test_room_is_made_before_the_new_one_is_built_and_a_failure_leaves_no_trace() -> None:
    kept: Recent[str, int] = Recent(1)
    kept.make("old", lambda: 1)
    with pytest.raises(ZeroDivisionError):
        kept.make("new", lambda: len(kept) // 0)
    assert not kept
    assert kept.make("new", lambda: len(kept)) == 0


def test_none_is_a_value() -> None:
    kept: Recent[str, int | None] = Recent(2)
    assert kept.make("a", lambda: None) is kept.make("a", lambda: 1) is None


def test_its_example_holds() -> None:
    assert doctest.testmod(recent).attempted == 2 and not doctest.testmod(recent).failed
