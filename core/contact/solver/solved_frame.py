"""What comes of the contact of one frame."""

from __future__ import annotations

from typing import NamedTuple

from ...arrays import Array
from .solve import Solution


class Begin(NamedTuple):
    """What the iteration of a frame begins with.

    Attributes:
        reference: forces whose image is known, and image: their displacement on linear skin [N], [m], shapes (m, 3).
        force, y: expected forces [N] and scaled multipliers, shapes (m, 3).
    """

    reference: Array
    image: Array
    force: Array
    y: Array


class SolvedFrame(NamedTuple):
    """A frame that was solved.

    Attributes:
        solution: forces and residuals of all nodes.
        y: scaled multipliers that the next frame starts from, shape (m, 3).
        image: displacement of the nodes under the forces [m], shape (m, 3).
        work: as in `PathStep`.
    """

    solution: Solution
    y: Array
    image: Array
    work: str
