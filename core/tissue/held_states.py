"""HeldStates: what the law itself makes of skin that is held displaced, without any contact.

A pad that is held in its patterns needs no more of the tissue than a balance beneath it, which steps with the stiffness
at rest come to (`LawTables.held`): a hundredth of the price of Newton's method.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats, Floats32
from ..skin.assembly import degrees
from ..skin.law_tables import LawTables
from .held_tissue import HeldTissue

TOLERANCE = 3e-5  # of what is left beneath


@dataclass(frozen=True, eq=False)
class HeldStates:
    """States that were found.

    Attributes:
        amounts: of the patterns that the pad is held in, shape (s, k).
        force: that takes beyond linear tissue's, in each pattern at E = 1, shape (s, k).
        beyond: displacement x, y, z [m] and pressure of the nodes beyond linear tissue's, shape (s, n, 4).
    """

    amounts: Array
    force: Array
    beyond: Floats32


def held_states(linear: HeldTissue, patterns: Floats, amounts: Array) -> Generator[tuple[int, int], None, HeldStates]:
    """Return the states of amounts (s, k), less those that are not found; yields (done, s).

    Args:
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3).
    """
    found = []
    mesh = linear.tissue.mesh
    tables, free = LawTables(mesh, linear.tissue.poisson, lambda: np.zeros((0, 0), np.float32)), degrees(mesh.free)
    for n, q in enumerate(amounts):
        yield n, len(amounts)
        moved = np.asarray(np.tensordot(q, patterns, axes=1), np.float64)
        state, left = tables.held(moved.reshape(-1)[free].astype(np.float32), TOLERANCE)
        if left <= TOLERANCE:
            found.append((q, *_beyond(linear, patterns, moved, tables.nodes(state).astype(np.float64))))
    kept = [np.array(part) for part in zip(*found, strict=True)] or [np.zeros((0, *shape)) for shape in _none(patterns)]
    return HeldStates(kept[0], kept[1], kept[2].astype(np.float32))


def _none(patterns: Floats) -> tuple[tuple[int, ...], ...]:
    return (len(patterns),), (len(patterns),), (patterns.shape[1], 4)


def _beyond(linear: HeldTissue, patterns: Floats, moved: Array, state: Array) -> tuple[Array, Array]:
    """Return what a state has beyond linear tissue moved so: the force in each pattern, and what is beneath."""
    pad, tissue = linear.tissue.mesh.pad, linear.tissue
    response = tissue.response(state[None, None])
    own = tissue.response(np.stack([np.zeros_like(moved), moved])[:, None])
    force = tissue.forces(response.piola)[0, 0] - tissue.forces(own.piola)[1, 0]
    work = np.einsum("kni,ni->k", patterns[:, pad], force[pad])
    more = np.concatenate([state - moved, (response.nodal[0, 0] - own.nodal[1, 0])[:, None]], axis=1)
    return work, more
