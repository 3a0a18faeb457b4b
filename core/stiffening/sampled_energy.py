"""SampledEnergy: what patterns of the pad store beyond linear tissue, which is followed beneath as they change."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from .mixing import mixed
from .sampled_tissue import SampledTissue

TOLERANCE = 1e-5  # of what is left beneath, over |q|
WALL = 0.3  # of |reach|^2: less lets tissue run away, more takes a drag for a push
FAR = 0.8  # of |q|, beyond which a tangent is taken anew: it takes as long as a hundred steps with an old one
SLOW, PATIENCE, RENEWED = 0.5, 6, 2  # a step that leaves more asks for a new tangent, after so many, so often
MIXED = 4  # steps that are mixed
STEPS, PARTS, SHORTEST = 18, 8, 0.05  # at one q; of the way there where it is not found, and the least of them


class _Beneath(NamedTuple):
    """What is beneath at one q: amounts, slopes of Phi by q and by them, and what is left over |q|."""

    x: Array
    force: Array
    rest: Array
    left: float


class SampledEnergy:
    """A `StoredEnergy` that asks the law itself: the slope n(q) and its stiffness, for `Balance`.

    What is beneath is sought from where it was last, with a tangent that serves for many q. Its
    answer depends on the way there by the tolerance only, or where tissue beneath has several balances.

    Beyond `reach`, where t = |q / reach| is above 1, no state was seen that fields and samples were made of: there the
    force is t n(q / t), as of tissue that stiffens no more, and a wall (t - 1)^3 keeps it from running away.

    Args:
        tissue: at E = 1. reach: amounts up to which it is asked, shape (k,); anywhere where None.

    Attributes:
        x: amounts of what is beneath, for the last q or its part within reach, shape (j + r,). left: of their balance,
            over |q|. astray: that balance was not found from where it was last, but by a way led there, if at all.
    """

    def __init__(self, tissue: SampledTissue, reach: Array | None = None) -> None:
        self.tissue, self.reach = tissue, reach
        self.reset()

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return self.tissue.count

    def reset(self) -> None:
        """Go back to rest."""
        self.x, self.left = np.zeros(len(self.tissue.inner)), 0.0
        self._q, self._at = np.zeros(self.count), np.zeros(self.count)
        self._stiffness, self._inverse, self._coupling = self._rest
        self._learned: tuple[tuple[Array, Array], ...] = ()
        self.astray = self._vain = False

    @cached_property
    def _rest(self) -> tuple[Array, Array, Array]:
        k, inner = self.count, self.tissue.inner
        return np.zeros((k, k)), np.asarray(np.linalg.inv(inner), np.float64), np.zeros((len(inner), k))

    def followed(self) -> SampledEnergy:
        """Return another of the same tissue, at rest."""
        new = SampledEnergy.__new__(SampledEnergy)
        new.tissue, new.reach = self.tissue, self.reach
        new.__dict__["_rest"] = self._rest
        new.reset()
        return new

    def save(self) -> tuple[Any, ...]:
        """Return where what is beneath was found, and with which tangent."""
        at = self.x, self.left, self._q, self._at, self.astray, self._vain, self._learned
        return *at, self._stiffness, self._inverse, self._coupling

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back there."""
        self.x, self.left, self._q, self._at, self.astray, self._vain, self._learned, *tangent = state
        self._stiffness, self._inverse, self._coupling = tangent

    def far(self, q: Array) -> float:
        """Return t = |q / reach|, 0 where nothing bounds it; q may have what is beneath behind it."""
        return 0.0 if self.reach is None else float(np.linalg.norm(q[: self.count] / self.reach))

    def amounts(self, q: Array) -> Array:
        """Return the last q with what is beneath behind it, shape (k + j + r,)."""
        return np.concatenate([q, max(self.far(q), 1.0) * self.x])

    def force(self, q: Array) -> Array:
        """Return the slope of the energy at amounts, shape (k,): with what is beneath, or seeking it from rest."""
        k = self.count
        if len(q) == k:
            return self.followed().force_and_stiffness(q)[0]
        if not q.any():
            return np.zeros(k)
        t = max(self.far(q), 1.0)
        return t * self.tissue.forces(q[:k] / t, q[k:] / t)[0] + self._wall(q[:k])[1]

    def value(self, q: Array) -> float:
        """Return the energy at amounts, with what is beneath, or seeking it from where it was last."""
        k = self.count
        if len(q) == k:
            self.force_and_stiffness(q)
            q = self.amounts(q)
        t = max(self.far(q), 1.0)
        return t * t * self.tissue.value(q[:k] / t, q[k:] / t) + self._wall(q[:k])[0]

    def force_and_stiffness(self, q: Array) -> tuple[Array, Array]:
        """Return the slope of the energy, (k,), and its stiffness near there, (k, k): the same as long as it serves."""
        t = max(self.far(q), 1.0)
        force, stiffness = self._within(q / t)
        if t == 1.0:
            return force, stiffness
        _, pushed, bend = self._wall(q)
        return t * force + pushed, stiffness + bend

    def sharpened(self, q: Array) -> tuple[Array, Array]:
        """Return the same with the stiffness of that place: a tangent takes a hundred times as long as a slope."""
        self.force_and_stiffness(q)
        if q.any():
            self._take(q / max(self.far(q), 1.0), self.x)
        return self.force_and_stiffness(q)

    def _wall(self, q: Array) -> tuple[float, Array, Array]:
        """Return what keeps q from running away: its value, slope and second derivative."""
        t = self.far(q)
        if self.reach is None or t <= 1.0:
            return 0.0, np.zeros(self.count), np.zeros((self.count, self.count))
        along = q / (self.reach * self.reach * t)  # slope of t
        s, firm = t - 1.0, WALL * float((self.reach**2).max())
        across = (np.diag(self.reach**-2.0) - np.outer(along, along)) / t
        bend = firm * (2.0 * s * np.outer(along, along) + s * s * across)
        return firm * s**3 / 3.0, firm * s * s * along, bend

    def _within(self, q: Array) -> tuple[Array, Array]:
        size = float(np.linalg.norm(q))
        if size == 0.0:
            self.reset()
            return np.zeros(self.count), np.zeros((self.count, self.count))
        if np.linalg.norm(q - self._at) > FAR * size:
            self._take(self._q if np.linalg.norm(self._q - self._at) > 0.3 * FAR * size else q, self.x)
        with np.errstate(over="ignore", invalid="ignore"):  # a step that goes astray is not taken
            found = self._balanced(q, self._expected(q, self._q, self.x), size)
            self.astray = found.left > 10.0 * TOLERANCE
            if self.astray and not self._vain:  # who was led in vain is not led again
                found = self._led(q, size)
        self._vain = found.left > 100.0 * TOLERANCE
        self._q, self.x, self.left = q.copy(), found.x, found.left
        return found.force - self._coupling.T @ (self._inverse @ found.rest), self._stiffness

    def _expected(self, q: Array, before: Array, x: Array) -> Array:
        return x - self._inverse @ (self._coupling @ (q - before))

    def _led(self, q: Array, size: float) -> _Beneath:
        """Return what is beneath and what is left, led there in parts of the way from the last q."""
        start, x, at, part = self._q, self.x, 0.0, 0.5
        found = None
        for _ in range(PARTS):
            here = start + at * (q - start)
            self._take(here, x)
            to = min(1.0, at + part)
            there = start + to * (q - start)
            found = self._balanced(there, self._expected(there, here, x), size)
            if found.left <= 100.0 * TOLERANCE:
                x, at, part = found.x, to, 1.5 * part
            else:
                part *= 0.4
            if at == 1.0 or part < SHORTEST:
                break
        if found is None or found.x is not x or at < 1.0:
            found = _Beneath(x, *self.tissue.forces(q, x), np.inf if found is None else found.left)
        return found

    def _balanced(self, q: Array, x: Array, size: float) -> _Beneath:
        """Return the best of a few mixed steps with an old tangent, and what it leaves over the size of q.

        The next q begins with what the last ones learned.
        """
        best, before = _Beneath(x, np.zeros(self.count), np.zeros(len(x)), np.inf), np.inf
        last: tuple[Array, Array] | None = None
        renewed = 0
        for step in range(STEPS):
            force, rest = self.tissue.forces(q, x)
            left = float(np.linalg.norm(rest)) / size
            if not np.isfinite(left):
                break
            if left < best.left:
                best = _Beneath(x, force, rest, left)
            if left <= TOLERANCE:
                break
            if left > SLOW * before and step >= PATIENCE and renewed < RENEWED:
                self._take(q, best.x)
                last, renewed = None, renewed + 1
            way = self._inverse @ rest
            if last is not None:
                self._learned = *self._learned[1 - MIXED :], (x - last[0], way - last[1])
            last, before = (x, way), left
            x = mixed(x, way, self._learned)
        return best

    def _take(self, q: Array, x: Array) -> None:
        """Take the tangent of a state, unless it is none."""
        k = self.count
        whole = self.tissue.tangent(q, x)
        if not np.isfinite(whole).all():
            return
        self._inverse, self._coupling, self._at = np.asarray(np.linalg.inv(whole[k:, k:])), whole[k:, :k], q.copy()
        self._stiffness = whole[:k, :k] - self._coupling.T @ (self._inverse @ self._coupling)
        self._stiffness = 0.5 * (self._stiffness + self._stiffness.T)
        self._learned = ()
