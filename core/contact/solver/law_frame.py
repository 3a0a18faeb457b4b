"""One frame of skin that follows the neo-Hookean law: contact on linear skin and the law, by turns until both agree.

Where they do not, as after a long drag in one frame, the objects that press are led there in parts of their way. Where
nothing near is found, as where a finger begins deep in something, they are led straight in from where nothing touches.
Where that does not help either, the frame keeps the solution of least residual, or that of linear skin, and says that
it did not converge.

The same forces may hold skin on a fold of itself, pushed in on the mesh and out at the points where they act. That
balance is left for the one that straight pressing leads to, and the frame says so, also where none is found.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from ...arrays import Array, Indices
from .between import matter_moved
from .bodies import ContactBody, NodeGaps, owned
from .law_skin import Fold, LawSkin
from .path_step import SolvedFrame

ROUNDS = 80  # of both
USABLE = 0.1  # residual of the law: a solution with less than that is better than linear skin
PARTS, STRAIGHT = (1, 4, 16), (4, 16)  # of the way since the last frame, and of the straight one


class LinearContact(Protocol):
    """A solver of contact on linear skin.

    Attributes:
        points: undeformed [m], shape (n, 3). bodies: those near in the last frame.
    """

    points: Array

    @property
    def bodies(self) -> tuple[ContactBody, ...]:
        """Bodies near in the last frame."""
        ...

    def iterated(self, b: Array, gaps: NodeGaps, soft: Array, start: Array) -> SolvedFrame:
        """Solve a frame, from the offset b [m], shape (n, 3), and the softness below each point [m/N], shape (n,)."""
        ...

    def beyond(self) -> Array:
        """Return by how much less than linear skin the points give way now [m], shape (n, 3)."""
        ...

    def nodal(self, force: Array) -> Array:
        """Return forces on the points [N] as forces on the nodes of the skin's mesh, shape (m, 3)."""
        ...


def solved_by_law(
    solver: LinearContact, law: LawSkin, b: Array, gaps: NodeGaps, soft: Array, start: Array
) -> SolvedFrame:
    """Solve a frame, off any fold of the skin; for the arguments see `_settled`."""
    tried = law.fold is Fold.KEPT
    found = _settled(solver, law, b, gaps, soft, start)
    if not law.folded(float(np.vdot(found.solution.force, found.image))):
        return found
    fold = law.save()
    for parts in () if tried else STRAIGHT:  # to try it in every frame would take seconds each
        law.reset()
        other, ends = _walked(solver, law, b, gaps, soft, np.zeros_like(b), _depth(gaps), parts)
        if ends and law.settled and not law.folded(float(np.vdot(other.solution.force, other.image))):
            law.note_fold(Fold.LEFT)
            return other
    law.restore(fold)
    law.note_fold(Fold.KEPT)
    return found


def _settled(solver: LinearContact, law: LawSkin, b: Array, gaps: NodeGaps, soft: Array, start: Array) -> SolvedFrame:
    """Take turns until contact and the law agree, from the last frame or, where that leads nowhere, from rest.

    Args:
        solver: contact solver for linear skin.
        law: nonlinear law of the same skin, in its state at the last frame.
        b, gaps, soft: as in `PathSolver.iterated`. start: forces to start from [N], shape (n, 3).
    """
    if not (gaps.gap < 0.0).any():  # skin at rest is in balance; a fold that pressing left would press on air
        law.reset()
        start = np.zeros_like(start)
    before = law.save()
    found = _agreed(solver, law, b, gaps, soft, start, _went(solver, gaps, start))
    if law.settled:
        return found
    best, least = found, law.save()
    way = np.nan_to_num(_moved(solver, gaps, gaps.body))
    for parts in PARTS if way.any() else PARTS[:1]:
        law.restore(before)
        found, ends = _walked(solver, law, b, gaps, soft, start, way, parts)
        if law.settled:
            return found
        if ends and law.left < least.left:
            best, least = found, law.save()
    none = np.zeros_like(b)
    tried = before.left == np.inf  # given up in the last frame: to try it in every one would take seconds each
    for parts in STRAIGHT if least.left > USABLE and not tried else ():
        law.reset()
        found, ends = _walked(solver, law, b, gaps, soft, none, _depth(gaps), parts)
        if ends and law.left < least.left:
            best, least = found, law.save()
        if law.settled:
            break
    if least.left <= USABLE:
        law.restore(least)
        return best
    law.give_up()
    found = solver.iterated(b, gaps, soft, start)
    return found._replace(solution=replace(found.solution, residual=max(found.solution.residual, 1.0)))


def _walked(
    solver: LinearContact, law: LawSkin, b: Array, gaps: NodeGaps, soft: Array, start: Array, way: Array, parts: int
) -> tuple[SolvedFrame, bool]:
    """Lead the bodies that press along a way [m], shape (n, 3); return where that ends, and whether it is the end."""
    going = way.any(axis=1)
    went = np.append(way[going].mean(axis=0), np.zeros(3)) / parts if going.any() else None
    for part in range(1, parts + 1):
        found = _agreed(solver, law, b + (1.0 - part / parts) * way, gaps, soft, start, went)
        if not law.settled:
            break
        start = found.solution.force
    return found, part == parts


def _agreed(
    solver: LinearContact, law: LawSkin, b: Array, gaps: NodeGaps, soft: Array, start: Array, went: Array | None
) -> SolvedFrame:
    """Take turns until the law has settled, or no step lowers its residual."""
    law.begin(went)
    iterations, told = 0, False
    for again in range(ROUNDS):
        less = solver.beyond()
        found = solver.iterated(b - less, gaps, soft, start)
        iterations += found.solution.iterations
        if told:  # that no step leads nearer: this is where least was left
            break
        law.look(solver.nodal(found.solution.force))
        if law.settled:
            break
        told = law.lost
        if again == ROUNDS - 2 and not told:
            law.take_best()
            told = True
        start = found.solution.force
    solution = replace(found.solution, iterations=iterations)
    if not law.settled:
        solution = replace(solution, residual=max(solution.residual, law.left))
    return SolvedFrame(solution, found.image - less, found.work)


def _depth(gaps: NodeGaps) -> Array:
    """Return the way straight in from where nothing touches [m], shape (n, 3)."""
    return max(0.0, -float(gaps.gap.min(initial=0.0))) * gaps.normal


def _went(solver: LinearContact, gaps: NodeGaps, force: Array) -> Array | None:
    """Return how bodies moved where skin carried force, and turned about there [m], shape (6,), if known."""
    touched = force.any(axis=1)
    way = _moved(solver, gaps, np.where(touched, gaps.body, -1))[touched]
    if not len(way) or np.isnan(way).any():
        return None
    arm = solver.points[touched] - solver.points[touched].mean(axis=0)
    size = float((arm * arm).sum(axis=1).mean()) ** 0.5
    return np.append(way.mean(axis=0), np.cross(arm, way).mean(axis=0) / max(size, 1e-12))


def _moved(solver: LinearContact, gaps: NodeGaps, bodies: Indices) -> Array:
    """Return how far bodies moved at points since the last frame, nan where that is not known [m], shape (n, 3).

    Args:
        bodies: that is asked about at each point, -1 for none, shape (n,).
    """
    out, last = np.zeros((len(bodies), 3)), solver.bodies
    for body, points in owned(bodies):
        way = None
        if body < len(last) and not last[body].away and not gaps.bodies[body].away:
            way = matter_moved(last[body], gaps.bodies[body], solver.points[points], gaps.triangle[points])
        out[points] = np.nan if way is None else way
    return out
