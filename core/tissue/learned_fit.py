"""How tissue follows where its series does not tell: fields and amounts from states that the law was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..stiffening.following import Following, Learned
from .following_fit import nodal_weight
from .held_states import HeldStates
from .held_tissue import HeldTissue
from .mirror import MIRROR, mirrored

RIDGE = 0.03  # over the states' mean likeness to themselves
FAINT = 0.7  # power of a state's size that it is told over: faint touches count, and strong ones count for more


def fit_learned(
    linear: HeldTissue, following: Following, states: HeldStates, reach: Array, even: int, rank: int
) -> Following:
    """Return how tissue follows, with the main fields of what it leaves out of states.

    Args:
        reach: amounts that likeness is measured over, shape (k,). even: number of patterns that a mirror keeps, which
            come first. rank: fields to add.
    """
    weight = nodal_weight(linear).ravel()
    seen = states.beyond.reshape(len(states.beyond), -1)
    fields = following.fields.reshape(len(weight), -1)
    told = np.array([fields @ following.amounts(q).astype(np.float32) for q in states.amounts])
    sizes = np.linalg.norm(seen * weight, axis=1) ** -FAINT
    left, amounts = ((seen - told) * weight).astype(np.float64), states.amounts
    image = mirrored(linear.tissue.mesh.nodes)
    if image is not None and even < len(reach):
        signs = np.where(np.arange(len(reach)) < even, 1.0, -1.0)
        turned = (left.reshape(len(left), -1, 4)[:, image] * [*MIRROR, 1.0]).reshape(left.shape)
        left, amounts = np.concatenate([left, turned]), np.concatenate([amounts, amounts * signs])
        sizes = np.concatenate([sizes, sizes])
    sizes = sizes / np.median(sizes)
    scaled = left * sizes[:, None]
    values, vectors = np.linalg.eigh(scaled @ scaled.T)
    rank = min(rank, int((values > 1e-12 * values[-1]).sum()))
    right = (scaled.T @ vectors[:, -rank:]) / np.sqrt(values[-rank:])
    like = (amounts / reach) @ (amounts / reach).T
    like = like * like * (1.0 + like) * sizes[:, None] * sizes
    like[np.diag_indices(len(like))] += RIDGE * float(np.trace(like)) / len(like)
    weights = np.linalg.solve(like, (left @ right) * sizes[:, None]) * sizes[:, None]
    more = (right / weight[:, None]).reshape(*following.fields.shape[:2], rank).astype(np.float32)
    learned = Learned((amounts / reach / reach).astype(np.float32), weights.astype(np.float32))
    return replace(following, fields=np.concatenate([following.fields, more], axis=2), learned=learned)
