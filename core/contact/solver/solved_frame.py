"""The solution of contact in one frame."""

from __future__ import annotations

from typing import NamedTuple

from ...arrays import Array
from .solve import Solution


class SolvedFrame(NamedTuple):
    """A frame that was solved.

    Attributes:
        solution: forces and residuals of all nodes.
        image: displacement of the nodes under the forces [m], shape (m, 3).
        work: as in `PathStep`.
    """

    solution: Solution
    image: Array
    work: str
