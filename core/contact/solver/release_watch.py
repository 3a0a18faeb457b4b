"""ReleaseWatch: detection of frames in which skin lets go of an object at once.

Skin that is held by friction moves as far as what holds it, and skin that slides stays where it is. Skin moves farther
only where it springs back: it slips off an edge, or the load that held it leaves. Contact then passes from one state to
another within a frame, however short the frame is. The frame in which it does depends on small errors of the path
before, so on how often the path is sampled. With friction, each part of a frame that is solved in parts is watched as a
frame: in a long frame, skin springs back less far than what moves it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .bodies import ContactBody, moved
from .path_step import PathStep

# OWN: way of the loaded skin over that of the objects from which on most of it is the skin's own.
# SEEN: change of the force in such a frame, over the largest force of the touch, that is told: no force at an edge is
# trusted to less.
OWN, SEEN = 2.0, 0.04


class ReleaseWatch:
    """Monitor of the skin's own movement from frame to frame."""

    def __init__(self) -> None:
        # the last frame, and the largest force of the touch so far [N]; None without force
        self._last: tuple[PathStep, float] | None = None

    def forget(self) -> None:
        """Reset; the next contact does not continue an earlier one."""
        self._last = None

    def save(self) -> tuple[PathStep, float] | None:
        """Return the state between two frames, for `restore`."""
        return self._last

    def restore(self, state: tuple[PathStep, float] | None) -> None:
        """Go back to a saved state."""
        self._last = state

    def released(self, came: Sequence[ContactBody], step: PathStep) -> float:
        """Return the change of the force in a frame in which skin let go, over the largest force; zero in others.

        Skin that an object leaves, and which it does no more work on, is not told.

        Args:
            came: bodies at the begin of the frame.
            step: result of the frame.
        """
        last, sums = self._last, step.sums
        force, most = np.array(sums.resultant), 0.0 if last is None else last[1]
        most = max(float(np.sqrt(force @ force)), most)
        self._last = None if step.gaps is None or not sums.size > 0.0 else (step, most)
        if last is None or not last[1] > 0.0:  # there is no share of nothing
            return 0.0
        change = force - last[0].sums.resultant
        share = float(np.sqrt(change @ change)) / most
        if share <= SEEN:
            return 0.0
        went = np.array(last[0].sums.mean) - sums.mean  # without force the mean is 0, as of skin that has sprung back
        far, work = _driven(came, step, last[0])
        return share if work >= 0.0 and np.sqrt(went @ went) > OWN * far else 0.0


def _driven(came: Sequence[ContactBody], step: PathStep, last: PathStep) -> tuple[float, float]:
    """Return how far the bodies that pressed moved in the frame at most [m], and their work on the skin [J].

    The way is infinite where it is not known.
    """
    loaded, far, work = last.solution.loaded.nonzero()[0], 0.0, 0.0
    assert last.gaps is not None
    body, force = last.gaps.body.take(loaded), last.solution.force.take(loaded, axis=0)
    for index in set(body.tolist()):
        if step.gaps is None or index < 0 or index >= min(len(came), len(step.gaps.bodies)):
            return np.inf, 0.0
        a, b = came[index], step.gaps.bodies[index]
        if a.away or b.away or a.surface is not b.surface:
            return np.inf, 0.0
        way = moved(a, b, last.points[loaded[body == index]])
        far = max(far, float(np.sqrt((way * way).sum(axis=1)).max()))
        work += float(np.vdot(way, force[body == index]))
    return far, work
