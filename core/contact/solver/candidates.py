"""The inverse (C + rho I)^-1 over the nodes that may touch, kept up as nodes come and go.

A few nodes are added by bordering and removed by a Schur complement, in a fraction of a rebuild. Single precision is
enough: the shifted matrix is well conditioned, and the iteration multiplies only changes by it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Floats32, Indices

# After so many block updates the next rebuild is due; the error of each is about 1e-6.
MAX_UPDATES = 400
# Nodes join the candidates when their gap is predicted to fall below these fractions of the node spacing: at once,
# and ahead of time, a few each frame; they leave above the third.
ENTER, PREFETCH, LEAVE = 0.05, 0.4, 1.2
BUDGET = 4
# An inverse that is off by more than this is made again.
DRIFT = 0.02
# Of the room for the inverse, where it is too small.
GROWTH = 1.5
# More nodes than this at once are cheaper by starting over.
REBUILD = 16


class CandidateInverse:
    """(C + softness + rho I)^-1 restricted to a growing and shrinking set of nodes.

    Args:
        compliance: C of all nodes [m/N], shape (3 m, 3 m).
        rho: the shift of each node [m/N], shape (m,).
        ahead, leave: gaps, over the spacing of the nodes, below which they join ahead of time and above which they go.
        most: nodes that are updated at once; where more come or go, it starts over.
        budget: nodes that join ahead of time at once. few: that are worth an update.
        share: of the members that is updated at once, where that is more than `most`.
    """

    def __init__(
        self,
        compliance: NDArray[np.floating],
        rho: Array,
        ahead: float = PREFETCH,
        leave: float = LEAVE,
        most: int = REBUILD,
        budget: int = BUDGET,
        few: int = 1,
        share: float = 0.0,
    ) -> None:
        self.rho, self.ahead, self.leave, self.most = rho, ahead, leave, most
        self.budget, self.few, self.share = budget, few, share
        self.count = compliance.shape[0] // 3
        self._c = compliance
        self._store = np.zeros((0, 0), dtype=np.float32)
        self._softness = np.zeros(self.count)
        self.members: Indices = np.zeros(0, dtype=np.int64)
        self.inside = np.zeros(self.count, dtype=bool)
        self.updates = 0
        self.rebuilds = 0
        self._saved = False

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`; the inverse is copied when it changes next."""
        self._saved = True
        kept = self.members.copy(), self.inside.copy(), self._softness.copy()
        return self._store, *kept, self.updates, self.rebuilds

    def restore(self, state: tuple[Any, ...], compliance: NDArray[np.floating], rho: Array) -> None:
        """Go back to a saved state, of the nodes that these belong to."""
        self._store, members, inside, softness, self.updates, self.rebuilds = state
        self.members, self.inside, self._softness = members.copy(), inside.copy(), softness.copy()
        self.count, self._c, self.rho = len(rho), compliance, rho
        self._saved = True

    @property
    def matrix(self) -> Floats32:
        """The inverse in the order of `members`, three rows a node, shape (3 k, 3 k)."""
        n = 3 * self.members.size
        return self._store[:n, :n]

    def renumber(self, order: Indices, compliance: NDArray[np.floating], rho: Array) -> None:
        """Go over to other nodes: some of the old ones in a new order, then new ones, which are no members yet."""
        count = compliance.shape[0] // 3
        place = np.full(self.count, -1)
        place[order] = np.arange(len(order))
        leaving = self.members[place[self.members] < 0]
        if leaving.size > self._most():
            self.members = self.members[:0]
        else:
            self.remove(leaving)
        softness = np.zeros(count)
        softness[: len(order)] = self._softness[order]
        self.members = place[self.members]
        self.inside = np.zeros(count, dtype=bool)
        self.inside[self.members] = True
        self.rho, self.count, self._c, self._softness = rho, count, compliance, softness

    def _most(self) -> int:
        """Return how many nodes are updated at once: large inverses are made again at a larger price."""
        return max(self.most, int(self.share * self.members.size))

    def stale(self, softness: Array) -> bool:
        """Whether the members' softness [m/N], shape (m,), is no longer what was inverted, or drift is due."""
        changed = not np.array_equal(self._softness[self.members], softness[self.members])
        return changed or self.updates > MAX_UPDATES

    def drifts(self) -> bool:
        """Return whether updates have made the inverse of the members wrong, by trying it on a vector."""
        if self.updates == 0 or self.members.size == 0:
            return False
        probe = np.random.default_rng(self.updates).choice([-1.0, 1.0], 3 * self.members.size)
        off = self._shifted(self.members, self._softness) @ (self.matrix @ probe) - probe
        return not float(np.abs(off).max()) <= DRIFT

    def follow(self, gap: Array, loaded: NDArray[np.bool_], spacing: Array, softness: Array) -> None:
        """Bring the members up to date: at once for nodes that may touch, ahead of time for those that come near.

        Args:
            gap: predicted for the deformed skin [m], inf where nothing is near, shape (m,).
            loaded: whether a node carries force, shape (m,).
            spacing: of the nodes [m], shape (m,).
            softness: of what is below each node [m/N], shape (m,).
        """
        needed = (gap < ENTER * spacing) | loaded
        if self.share:
            changed = self.members[self._softness[self.members] != softness[self.members]]
            if 0 < changed.size <= self._most():
                self.remove(changed)
        missing = (needed & ~self.inside).nonzero()[0]
        if self.members.size == 0 or missing.size > self._most() or self.stale(softness):
            self.rebuild(np.flatnonzero(needed | (gap < self.ahead * spacing)), softness)
            return
        coming = ((gap < self.ahead * spacing) & ~self.inside).nonzero()[0]
        if missing.size:
            self.add(missing if self.few == 1 else np.union1d(missing, coming), softness)
        else:
            if coming.size >= self.few:
                self.add(coming[np.argsort(gap[coming])[: self.budget]], softness)
                return
        leaves = (gap > self.leave * spacing) & ~loaded
        leaving = self.members[leaves[self.members]]
        if leaving.size >= self.budget:
            self.remove(leaving[: 2 * self.budget])

    def rebuild(self, nodes: Indices, softness: Array) -> None:
        """Start over with the given nodes; softness of all nodes [m/N], shape (m,)."""
        n = 3 * nodes.size
        self._make_room(n)
        self._store[:n, :n] = _inverse(self._shifted(nodes, softness))
        self.members = nodes.copy()
        self.inside[:] = False
        self.inside[nodes] = True
        self._softness = softness.copy()
        self.updates = 0
        self.rebuilds += 1

    def add(self, nodes: Indices, softness: Array) -> None:
        """Border the inverse with new nodes."""
        if nodes.size == 0:
            return
        if self.members.size == 0:
            self.rebuild(nodes, softness)
            return
        n, new = 3 * self.members.size, 3 * nodes.size
        self._make_room(n + new)
        old = self._store[:n, :n]
        side = self._c[_rows(self.members)[:, None], _rows(nodes)].astype(np.float32)
        image = old @ side
        corner = self._shifted(nodes, softness).astype(np.float64, copy=False) - side.T.astype(np.float64) @ image
        block = _inverse(corner)
        weighted = image @ block
        old += weighted @ image.T
        self._store[:n, n : n + new] = -weighted
        self._store[n : n + new, :n] = -weighted.T
        self._store[n : n + new, n : n + new] = block
        self.members = np.concatenate([self.members, nodes])
        self.inside[nodes] = True
        self._softness[nodes] = softness[nodes]
        self.updates += 1

    def remove(self, nodes: Indices) -> None:
        """Take nodes out again."""
        going = np.flatnonzero(np.isin(self.members, nodes))
        if going.size == 0:
            return
        n = 3 * self.members.size
        self._make_room(n)
        whole = self._store[:n, :n]
        leaving = _rows(going)
        side = whole[:, leaving]
        corner = np.linalg.inv(side[leaving].astype(np.float64)).astype(np.float32)
        whole -= (side @ corner) @ side.T
        self.inside[self.members[going]] = False
        # the last nodes move into the holes, so that only their rows are copied
        size = self.members.size - going.size
        holes = going[going < size]
        movers = np.setdiff1d(np.arange(size, self.members.size), going)
        if holes.size:
            to, source = _rows(holes), _rows(movers)
            whole[to] = whole[source]
            whole[:, to] = whole[:, source]
            self.members[holes] = self.members[movers]
        self.members = self.members[:size].copy()
        self.updates += 1

    def _make_room(self, wanted: int) -> None:
        room = len(self._store)
        if wanted > room or self._saved:
            n = 3 * self.members.size
            size = min(int(GROWTH * wanted), 3 * self.count) if wanted > room else room
            store = np.empty((size, size), dtype=np.float32)
            store[:n, :n] = self._store[:n, :n]
            self._store, self._saved = store, False

    def _shifted(self, nodes: Indices, softness: Array) -> Array:
        rows = _rows(nodes)
        block = self._c[rows[:, None], rows].astype(np.float64)
        block[np.diag_indices(rows.size)] += np.repeat(self.rho[nodes] + softness[nodes], 3)
        return block


def _rows(nodes: Indices) -> Indices:
    return (3 * nodes[:, None] + np.arange(3)).reshape(-1)


def _inverse(matrix: Array) -> Floats32:
    """Inverse of a symmetric positive definite matrix, by its Cholesky factor in single precision."""
    if matrix.shape[0] <= 96:
        return np.linalg.inv(matrix.astype(np.float64, copy=False)).astype(np.float32)
    from scipy.linalg.lapack import spotrf, spotri

    inverse = matrix.astype(np.float32)
    info = spotrf(inverse.T, lower=1, overwrite_a=1)[1] or spotri(inverse.T, lower=1, overwrite_c=1)[1]
    if info != 0:
        return np.linalg.inv(matrix).astype(np.float32)
    for row in range(len(inverse)):  # in place: half of it is what is above the diagonal
        inverse[row + 1 :, row] = inverse[row, row + 1 :]
    return inverse
