"""StoredEnergy: what contact and devices ask of an energy of patterns, a series or the law itself."""

from __future__ import annotations

from typing import Any, Protocol

from ..arrays import Array


class StoredEnergy(Protocol):
    """What tissue stores beyond linear tissue at E = 1, as a function of k patterns of its skin.

    Amounts are what a touch keeps of it: of each pattern, and of what is beneath where that is sought, not told.
    """

    @property
    def astray(self) -> bool:
        """Whether what is beneath was not found from where it was last: such a step is too long, and takes long."""
        ...

    @property
    def count(self) -> int:
        """Number of patterns k."""
        ...

    def far(self, q: Array) -> float:
        """Return how far amounts are, 1 where the energy is trusted no more."""
        ...

    def force(self, q: Array) -> Array:
        """Return its slope by the patterns at amounts, shape (k,)."""
        ...

    def value(self, q: Array) -> float:
        """Return it at amounts."""
        ...

    def force_and_stiffness(self, q: Array) -> tuple[Array, Array]:
        """Return slope and second derivative by the patterns, shapes (k,) and (k, k), at amounts of these alone."""
        ...

    def sharpened(self, q: Array) -> tuple[Array, Array]:
        """Return the same with the second derivative of that very place, where another may serve for a while."""
        ...

    def followed(self) -> StoredEnergy:
        """Return what one skin follows from touch to touch: itself, where nothing is remembered."""
        ...

    def amounts(self, q: Array) -> Array:
        """Return the amounts that a touch keeps where skin was last asked for so much of each pattern."""
        ...

    def save(self) -> Any:
        """Return what is remembered, for `restore`."""
        ...

    def restore(self, state: Any) -> None:
        """Go back to what was remembered."""
        ...
