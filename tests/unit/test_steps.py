"""Long work is drained, told in other words, and closed with whoever has it."""

from __future__ import annotations

from collections.abc import Generator

from core.steps import drain, in_words

closed: list[str] = []


def counting(n: int) -> Generator[int, None, str]:
    try:
        yield from range(n)
        return "made"
    finally:
        closed.append("closed")


def test_work_is_drained_and_its_steps_told() -> None:
    seen: list[int] = []
    assert drain(counting(3), seen.append) == "made" and seen == [0, 1, 2]
    assert drain(counting(0)) == "made"


def test_work_is_told_in_other_words_and_closed_with_them() -> None:
    seen: list[str] = []
    assert drain(in_words(counting(2), str), seen.append) == "made" and seen == ["0", "1"]
    closed.clear()
    steps = in_words(counting(2), str)
    next(steps)
    steps.close()
    assert closed == ["closed"]
