"""Solution of one frame of contact on skin that follows the neo-Hookean law.

Contact on linear skin is solved and the law is evaluated in turn until both agree. If they do not converge, as after a
long drag in one frame, the pressing objects are moved to their poses in several parts. If that fails too, as for a
finger that begins deep inside an object, the objects are pressed straight in from where nothing touches. If this fails
as well, the frame keeps the solution of least residual, or that of linear skin, and reports that it did not converge.

Nonlinear contact may have a second equilibrium, with skin folded into itself: pushed in on the mesh, and out at the
points where forces act. The solver then looks for the equilibrium of straight pressing, and notes whether it found one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from ...arrays import Array, Indices
from .between import matter_moved
from .bodies import ContactBody, NodeGaps, owned
from .cone import carrying
from .law_skin import Fold, LawSkin
from .path_step import SolvedFrame

ROUNDS = 80  # largest number of alternations between contact and the law
USABLE = 0.1  # residual of the law up to which a solution is better than that of linear skin
# Numbers of parts that are tried: for the movement since the last frame, and for straight pressing.
PARTS, STRAIGHT = (4, 16), (4, 16)


class LinearContact(Protocol):
    """Solver of contact on linear skin."""

    @property
    def points(self) -> Array:
        """Points of the undeformed skin [m], shape (n, 3)."""
        ...

    @property
    def bodies(self) -> tuple[ContactBody, ...]:
        """Bodies near in the last frame."""
        ...

    def iterated(self, b: Array, shift: Array | None, gaps: NodeGaps, soft: Array, start: Array) -> SolvedFrame:
        """Solve a frame.

        Args:
            b: offset of the contact problem [m], shape (n, 3).
            shift: displacement that no contact force causes [m], shape (n, 3); None for none.
            gaps: gaps of the points.
            soft: compliance of the object below each point [m/N], shape (n,).
            start: forces to start from [N], shape (n, 3).
        """
        ...

    def beyond(self) -> Array:
        """Return the current correction c at the points [m], shape (n, 3), see `LawSkin.beyond`."""
        ...

    def nodal(self, force: Array) -> Array:
        """Return forces on the points [N] as forces on the nodes of the skin's mesh, shape (m, 3)."""
        ...


def solved_by_law(
    solver: LinearContact, law: LawSkin, b: Array, gaps: NodeGaps, soft: Array, start: Array
) -> SolvedFrame:
    """Solve a frame, if possible without a fold of the skin; for the arguments see `_settled`."""
    tried = law.fold is Fold.KEPT
    found = _settled(solver, law, b, gaps, soft, start)
    if not law.folded(float(np.vdot(found.solution.force, found.image))):
        return found
    fold = law.save()
    for parts in () if tried else STRAIGHT:  # not tried again in every frame, since it takes seconds
        law.reset()
        other, ends = _walked(solver, law, b, gaps, soft, np.zeros_like(b), _depth(gaps), parts)
        if ends and law.settled and not law.folded(float(np.vdot(other.solution.force, other.image))):
            law.note_fold(Fold.LEFT)
            return other
    law.restore(fold)
    law.note_fold(Fold.KEPT)
    return found


def _settled(solver: LinearContact, law: LawSkin, b: Array, gaps: NodeGaps, soft: Array, start: Array) -> SolvedFrame:
    """Alternate between contact and the law until they agree, from the last frame, or from rest if that fails.

    Args:
        solver: contact solver for linear skin.
        law: nonlinear law of the same skin, in its state at the last frame.
        b, gaps, soft, start: as for `LinearContact.iterated`.
    """
    if not (gaps.gap < 0.0).any():  # skin at rest is in equilibrium; a fold of earlier frames is forgotten
        law.reset()
        start = np.zeros_like(start)
    before = law.save()
    found = _agreed(solver, law, b, np.zeros_like(b), gaps, soft, start, _went(solver, gaps, start))
    if law.settled:
        return found
    best, least = found, law.save()
    tried = before.left == np.inf  # it failed in the last frame; less is tried then, since it takes seconds
    way = np.nan_to_num(_moved(solver, gaps, gaps.body))
    numbers = PARTS[:1] if tried else PARTS
    for parts in numbers if way.any() else ():
        law.restore(before)
        found, ends = _walked(solver, law, b, gaps, soft, start, way, parts)
        if law.settled:
            return found
        if ends and law.left < least.left:
            best, least = found, law.save()
    none = np.zeros_like(b)
    fixed = replace(gaps, where=None)  # so far from its solution, a gap that follows the points leads astray
    for parts in STRAIGHT if least.left > USABLE and not tried else ():
        law.reset()
        found, ends = _walked(solver, law, b, fixed, soft, none, _depth(gaps), parts)
        if ends and law.left < least.left:
            best, least = found, law.save()
        if law.settled:
            break
    if least.left <= USABLE:
        law.restore(least)
        return best
    law.give_up()
    found = solver.iterated(b, None, gaps, soft, start)
    return found._replace(solution=replace(found.solution, residual=max(found.solution.residual, 1.0)))


def _walked(
    solver: LinearContact, law: LawSkin, b: Array, gaps: NodeGaps, soft: Array, start: Array, way: Array, parts: int
) -> tuple[SolvedFrame, bool]:
    """Move the pressing bodies along a path in equal parts.

    Args:
        solver, law, b, gaps, soft, start: as for `_settled`.
        way: movement of the bodies at each point [m], shape (n, 3).
        parts: number of parts.

    Returns:
        The last frame that was solved, and whether all parts were solved.
    """
    going = way.any(axis=1)
    went = np.append(way[going].mean(axis=0), np.zeros(3)) / parts if going.any() else None
    for part in range(1, parts + 1):
        found = _agreed(solver, law, b, (1.0 - part / parts) * way, gaps, soft, start, went)
        if not law.settled:
            break
        start = found.solution.force
    return found, part == parts


def _agreed(
    solver: LinearContact,
    law: LawSkin,
    b: Array,
    back: Array,
    gaps: NodeGaps,
    soft: Array,
    start: Array,
    went: Array | None,
) -> SolvedFrame:
    """Alternate until the law has converged, or no step lowers its residual.

    Arguments are those of `_settled`, with the way that the bodies have yet to go [m], shape (n, 3), and `went` of
    `LawSkin.begin`.
    """
    law.begin(went)
    iterations, told = 0, False
    for again in range(ROUNDS):
        less = solver.beyond()
        found = solver.iterated(b, back - less, gaps, soft, start)
        iterations += found.solution.iterations
        if told:  # no step lowers the residual: this is the solution for the best c
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
    return SolvedFrame(solution, found.image - less, found.work, found.gaps)


def _depth(gaps: NodeGaps) -> Array:
    """Return the movement along the normals from where nothing touches [m], shape (n, 3)."""
    return max(0.0, -float(gaps.gap.min(initial=0.0))) * gaps.normal


def _went(solver: LinearContact, gaps: NodeGaps, force: Array) -> Array | None:
    """Return the mean movement of the bodies where skin carried force, and their rotation times a lever.

    None if it is not known.

    Returns:
        Translation and rotation about the loaded points [m], shape (6,).
    """
    touched = carrying(force)
    way = _moved(solver, gaps, np.where(touched, gaps.body, -1))[touched]
    if not len(way) or np.isnan(way).any():
        return None
    arm = solver.points[touched] - solver.points[touched].mean(axis=0)
    size = float((arm * arm).sum(axis=1).mean()) ** 0.5
    return np.append(way.mean(axis=0), np.cross(arm, way).mean(axis=0) / max(size, 1e-12))


def _moved(solver: LinearContact, gaps: NodeGaps, bodies: Indices) -> Array:
    """Return the movement of bodies at points since the last frame [m], shape (n, 3); nan if it is not known.

    Args:
        solver: solver with the bodies of the last frame.
        gaps: present gaps of the points.
        bodies: index of the body for each point, -1 for none, shape (n,).
    """
    out, last = np.zeros((len(bodies), 3)), solver.bodies
    for body, points in owned(bodies):
        now, at, triangle = gaps.bodies[body], solver.points[points], gaps.triangle[points]
        way = matter_moved(last[body], now, at, triangle) if body < len(last) else None
        out[points] = np.nan if way is None else way
    return out
