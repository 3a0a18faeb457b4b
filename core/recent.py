"""Recent: the last few things that took long to make."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Recent(dict[K, V]):
    """Values by key; where there are too many, the one that was asked for longest ago makes room.

    >>> squares = Recent(2)
    >>> [squares.make(n, lambda: print("made") or n * n) for n in (3, 3)]
    made
    [9, 9]

    Args:
        size: how many are kept.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self.size = size

    def make(self, key: K, build: Callable[[], V]) -> V:
        """Return the value of a key, built where it is not kept; room is made before that, since values may be large.

        Raises:
            Exception: whatever `build` raises; then nothing is kept under the key.
        """
        if key in self:
            value = self[key]
            self.pop(key, None)  # another thread may have asked at the same time
        else:
            while len(self) >= self.size:
                self.pop(next(iter(self)), None)
            value = build()
        self[key] = value
        return value
