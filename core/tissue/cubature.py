"""Cubature: a few elements whose weighed sum stands for the sum over all (energy-conserving sampling and weighting).

Source: Farhat, Chapman and Avery, Int. J. Numer. Meth. Engng 102 (2015) 1077; the active set of Lawson and Hanson 1974.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Floats32, Indices

GROWTH = 25  # a round takes in one element for each so many that are there
_RIDGE = 1e-9  # of the mean of the diagonal


def sampled(rows: Floats32, count: int) -> tuple[Indices, Array, float]:
    """Return elements, what each one's share is multiplied with, positive, and what is left, relative to the sums.

    Args:
        rows: what each element brings to sums that are to be kept, shape (sums, elements). count: elements to take, or
            fewer where all that is left out would have to be subtracted.
    """
    gram = rows.T @ rows
    goal = gram.sum(axis=1, dtype=np.float64)
    size = np.sqrt(np.maximum(np.diag(gram).astype(np.float64), np.finfo(np.float32).tiny))
    share = np.zeros(len(gram))
    taken = np.zeros(0, np.int64)
    while len(taken) < count:
        pull = (goal - gram[:, taken] @ share[taken]) / size
        pull[taken] = -np.inf
        most = min(max(1, len(taken) // GROWTH), count - len(taken))
        new = np.argsort(-pull, kind="stable")[:most]
        new = new[pull[new] > 0.0]
        before = taken
        taken = _kept(gram, goal, share, np.concatenate([taken, new]))
        if not len(new) or np.array_equal(np.sort(taken), np.sort(before)):
            break
    order = np.sort(taken)
    missed = rows[:, order].astype(np.float64) @ share[order] - rows.sum(axis=1, dtype=np.float64)
    whole = float(np.linalg.norm(rows.sum(axis=1, dtype=np.float64)))
    return order, share[order], float(np.linalg.norm(missed)) / max(whole, 1e-300)


def _kept(gram: Floats32, goal: Array, share: Array, taken: Indices) -> Indices:
    """Balance the shares of some elements, in place, and return those that stay positive."""
    while len(taken):
        part = gram[np.ix_(taken, taken)].astype(np.float64)
        part[np.diag_indices(len(part))] += _RIDGE * np.trace(part) / len(part)
        wanted, now = np.linalg.solve(part, goal[taken]), share[taken]
        down = wanted <= 0.0
        if not down.any():
            share[taken] = wanted
            break
        # as far towards them as all stay positive; who comes to nothing leaves
        way = float((now[down] / np.maximum(now[down] - wanted[down], 1e-300)).min())
        now = now + way * (wanted - now)
        stays = now > 1e-12 * max(float(now.max()), 1e-300)
        if stays.all():
            stays = ~down | (now > now[down].min())
        share[taken] = np.where(stays, now, 0.0)
        taken = taken[stays | (~down & (wanted > 0.0))]
    return taken
