"""Recent: a dictionary of a few recent values that took long to make."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Recent(dict[K, V]):
    """Dictionary of limited size.

    The value that was used longest ago makes room for a new one.

    >>> squares = Recent(2)
    >>> [squares.make(n, lambda: print("made") or n * n) for n in (3, 3)]
    made
    [9, 9]

    Args:
        size: largest number of values.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self.size = size

    def make(self, key: K, build: Callable[[], V]) -> V:
        """Return the value of a key; build and keep the value if there is none.

        Room is made before the value is built, because values may be large.

        Args:
            key: key of the value.
            build: function that returns the value.

        Raises:
            Exception: `build` raised it; then no value is kept under the key.
        """
        if key in self:
            value = self[key]
            self.pop(key, None)  # None avoids an error if another thread has just removed the key
        else:
            while len(self) >= self.size:
                self.pop(next(iter(self)), None)
            value = build()
        self[key] = value
        return value
