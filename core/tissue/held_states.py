"""HeldStates: what the law itself makes of skin that is held displaced, without any contact.

A pad that is held in its patterns needs no more of the tissue than a balance beneath it, which steps with the stiffness
at rest come to, mixed so that together they leave least: a tenth of the price of Newton's method.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats, Floats32
from ..stiffening.mixing import mixed
from .held_tissue import HeldTissue

TOLERANCE = 1e-4  # of what is left beneath, over the forces on the pad
STEPS, MIXED = 60, 8  # of one state; steps that are mixed


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
    for n, q in enumerate(amounts):
        yield n, len(amounts)
        moved = np.asarray(np.tensordot(q, patterns, axes=1), np.float64)
        state = _balanced(linear, moved)
        if state is not None:
            found.append((q, *_beyond(linear, patterns, moved, state)))
    kept = [np.array(part) for part in zip(*found, strict=True)] or [np.zeros((0, *shape)) for shape in _none(patterns)]
    return HeldStates(kept[0], kept[1], kept[2].astype(np.float32))


def _none(patterns: Floats) -> tuple[tuple[int, ...], ...]:
    return (len(patterns),), (len(patterns),), (patterns.shape[1], 4)


def _balanced(linear: HeldTissue, moved: Array) -> Array | None:
    """Return the displacement of all nodes where the pad stays as it is moved and all beneath is in balance."""
    inner, out = linear.beneath, moved.copy()
    flat = out.reshape(-1)
    learned: list[tuple[Array, Array]] = []
    last: tuple[Array, Array] | None = None
    with np.errstate(all="ignore"):  # a state that goes astray is left out
        for _ in range(STEPS):
            force = linear.tissue.forces(linear.tissue.response(out[None, None]).piola)[0, 0].reshape(-1)
            left = np.linalg.norm(force[inner]) / np.linalg.norm(force[linear.pad])
            if left <= TOLERANCE:
                return out
            if not np.isfinite(left):
                return None
            x, way = flat[inner], linear.held(force[inner])
            if last is not None:
                learned = [*learned[1 - MIXED :], (x - last[0], way - last[1])]
            last = x, way
            flat[inner] = mixed(x, way, learned)
    return None


def _beyond(linear: HeldTissue, patterns: Floats, moved: Array, state: Array) -> tuple[Array, Array]:
    """Return what a state has beyond linear tissue moved so: the force in each pattern, and what is beneath."""
    pad, tissue = linear.tissue.mesh.pad, linear.tissue
    response = tissue.response(state[None, None])
    own = tissue.response(np.stack([np.zeros_like(moved), moved])[:, None])
    force = tissue.forces(response.piola)[0, 0] - tissue.forces(own.piola)[1, 0]
    work = np.einsum("kni,ni->k", patterns[:, pad], force[pad])
    more = np.concatenate([state - moved, (response.nodal[0, 0] - own.nodal[1, 0])[:, None]], axis=1)
    return work, more
