"""ReleaseWatch: detection of frames in which skin lets go of an object at once.

Skin that is held by friction moves as far as what holds it, and skin that slides stays where it is. Skin moves farther
only where it springs back: it slips off an edge, or the load that held it leaves. Contact then passes from one state to
another within a frame, however short the frame is. The frame in which it does depends on small errors of the path
before, so on how often the path is sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...arrays import Array, Indices
from .bodies import ContactBody, moved
from .cone import along
from .path_step import PathStep

# OWN: way of the loaded skin over that of the objects from which on most of it is the skin's own.
# SEEN: change of the force in such a frame, over the largest force of the touch, that is told: no force at an edge is
# trusted to less.
OWN, SEEN = 2.0, 0.04


class _Drawn(NamedTuple):
    """Skin that carried force in a frame.

    Attributes:
        points: points of the undeformed skin [m], shape (m, 3). body: index of the body at each point, shape (m,).
        loaded: indices of the points that carried force, shape (n,).
        forces: on these points [N], shape (n, 3).
        way: mean displacement of these points, weighted by the forces [m], shape (3,).
        force: sum of the forces [N], shape (3,).
        most: largest size of that sum in this touch so far [N].
    """

    points: Array
    body: Indices
    loaded: Indices
    forces: Array
    way: Array
    force: Array
    most: float


class ReleaseWatch:
    """Monitor of the skin's own movement from frame to frame."""

    def __init__(self) -> None:
        self._drawn: _Drawn | None = None

    def forget(self) -> None:
        """Reset; the next contact does not continue an earlier one."""
        self._drawn = None

    def save(self) -> _Drawn | None:
        """Return the state between two frames, for `restore`."""
        return self._drawn

    def restore(self, state: _Drawn | None) -> None:
        """Go back to a saved state."""
        self._drawn = state

    def released(self, came: Sequence[ContactBody], step: PathStep, points: Array) -> float:
        """Return the change of the force in a frame in which skin let go, over the largest force; zero in others.

        Skin that an object leaves, and which it does no more work on, is not told.

        Args:
            came: bodies at the begin of the frame.
            step: result of the frame.
            points: points of the undeformed skin [m], shape (m, 3).
        """
        before, now = self._drawn, _drawn(step, points)
        size = 0.0 if now is None else float(np.sqrt(now.force @ now.force))
        self._drawn = None if now is None else now._replace(most=max(size, before.most if before else 0.0))
        if before is None or not before.most > 0.0:  # there is no share of nothing
            return 0.0
        change = before.force if now is None else now.force - before.force
        share = float(np.sqrt(change @ change)) / max(size, before.most)
        if share <= SEEN:
            return 0.0
        went = before.way if now is None else now.way - before.way
        far, work = _way(came, step, before)
        return share if work >= 0.0 and np.sqrt(went @ went) > OWN * far else 0.0


def _drawn(step: PathStep, points: Array) -> _Drawn | None:
    """Return the skin that carries force after a frame; None if none does."""
    loaded = step.solution.loaded.nonzero()[0]
    if step.gaps is None or not len(loaded):
        return None
    force = step.solution.force.take(loaded, axis=0)
    size = np.sqrt(along(force, force))
    way = size @ step.displacement.take(loaded, axis=0) / size.sum()
    return _Drawn(points, step.gaps.body, loaded, force, way, force.sum(axis=0), 0.0)


def _way(came: Sequence[ContactBody], step: PathStep, drawn: _Drawn) -> tuple[float, float]:
    """Return how far the bodies that pressed moved in the frame at most [m], and their work on the skin [J].

    The way is infinite where it is not known.
    """
    far, work, body = 0.0, 0.0, drawn.body.take(drawn.loaded)
    for index in set(body.tolist()):
        if step.gaps is None or index < 0 or index >= min(len(came), len(step.gaps.bodies)):
            return np.inf, 0.0
        a, b = came[index], step.gaps.bodies[index]
        if a.away or b.away or a.surface is not b.surface:
            return np.inf, 0.0
        way = moved(a, b, drawn.points[drawn.loaded[body == index]])
        far = max(far, float(np.sqrt((way * way).sum(axis=1)).max()))
        work += float(np.vdot(way, drawn.forces[body == index]))
    return far, work
