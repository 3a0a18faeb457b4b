"""A frame of contact of skin with one node."""

from __future__ import annotations

import numpy as np

from core.arrays import Array
from core.contact.solver.bodies import BONE, ContactBody, NodeGaps
from core.contact.solver.path_step import PathStep
from core.contact.solver.solution import Solution, status_of


def one_node(body: ContactBody, force: Array, displacement: Array) -> PathStep:
    """Return a frame in which a body presses along Z on a node at the origin.

    Args:
        force: on the skin [N], shape (1, 3). displacement: of the node [m], shape (1, 3).
    """
    normal, friction = np.array([[0.0, 0.0, -1.0 if force[0, 2] < 0.0 else 1.0]]), np.full(1, 10.0)
    one, none = np.zeros(1, dtype=np.int64), np.zeros(1)
    status = status_of(force, normal, friction)
    solution = Solution(force, np.zeros((1, 3)), normal, friction, status, 1, 0.0, 1.0, "sweeps")
    gaps = NodeGaps((body,), none, none, normal, one, one, friction, none)
    return PathStep(solution, displacement, gaps, "solved", False, force, None, np.zeros((1, 3)), BONE)
