"""CoarseTouches: detection of contacts that a skin's mesh does not resolve.

A contact is too small for the mesh, or the object is too sharply curved. Such a contact may have several solutions, and
the way there decides between them. Each touch is judged at the sample of largest force, because every touch begins with
a negligible force on a single node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Indices
from ..errors import Finding
from ..skin.mesh import TetraMesh
from .solver.cone import OPEN
from .solver.notes import Notes
from .solver.solution import Solution

# Least number of nodes that must carry a touch, which is the number in a circle with a radius of two spacings. With
# fewer nodes, the radius of the contact is uncertain by half, and the force grows with the radius or a higher power of
# it.
FEWEST_NODES = 12
# Largest angle between the object's normals at two neighbouring nodes [rad]. The object's radius of curvature is then
# four spacings. At edges the angle is ten times as large, whatever the mesh.
SHARPEST_TURN = 0.25
# What it means, in the words of the finding.
HANGS = ", and the force depends on the way there and on how often it is sampled"


class _Peak(NamedTuple):
    """Sample of largest force of a touch so far.

    Attributes:
        force: normal force [N].
        frame: scene frame.
        nodes: number of nodes that carry force.
        turn: largest angle between the normals of two neighbouring nodes [rad].
    """

    force: float
    frame: float
    nodes: int
    turn: float


NOTHING = _Peak(0.0, 0.0, 0, 0.0)


class CoarseTouches:
    """Monitor of one finger's contact at the nodes of its mesh, sample after sample.

    Args:
        mesh: mesh of the skin.
        name: name of the finger, for the finding.
    """

    def __init__(self, mesh: TetraMesh, name: str) -> None:
        self._notes = Notes(name)
        self._edges = _pad_edges(mesh)
        self._peak = NOTHING

    def take(self, solution: Solution, frame: float) -> None:
        """Take the solution of a sample, with the forces on all pad nodes."""
        force = float(solution.normal_force.sum())
        if not force > 0.0:
            self.end()
        elif force > self._peak.force:
            touching = solution.status != OPEN
            self._peak = _Peak(force, frame, int(touching.sum()), self._turn(solution, touching))

    def end(self) -> None:
        """Judge the touch that has ended, if there was one."""
        peak, self._peak = self._peak, NOTHING
        remedy = "Solve its contact on points of the smooth skin, or on a finer mesh"
        if 0 < peak.nodes < FEWEST_NODES:
            what = "the contact is smaller than the mesh: too few nodes carry it" + HANGS
            limit = f">= {FEWEST_NODES} nodes"
            self._notes.warn("smaller-than-mesh", what, peak.frame, value=peak.nodes, limit=limit, remedy=remedy)
        elif peak.turn > SHARPEST_TURN:
            what = "the contact is smaller than the mesh: what presses bends between two nodes" + HANGS
            value, limit = (f"{np.degrees(angle):.0f} degrees" for angle in (peak.turn, SHARPEST_TURN))
            self._notes.warn("smaller-than-mesh", what, peak.frame, value=value, limit=f"<= {limit}", remedy=remedy)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings so far; a touch that continues is judged as if it ended now."""
        saved = self.save()
        self.end()
        found = self._notes.findings()
        self.restore(saved)
        return found

    def save(self) -> tuple[_Peak, Notes]:
        """Return the state between two samples, for `restore`."""
        return self._peak, self._notes.copy()

    def restore(self, state: tuple[_Peak, Notes]) -> None:
        """Go back to a saved state."""
        self._peak, self._notes = state[0], state[1].copy()

    def _turn(self, solution: Solution, touching: Indices) -> float:
        """Return the largest angle between the contact normals of two neighbouring nodes [rad]."""
        both = self._edges[touching[self._edges].all(axis=1)]
        if not len(both):
            return 0.0
        normals = solution.normals[both]
        return float(np.arccos(np.clip(np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]).min(), -1.0, 1.0)))


def _pad_edges(mesh: TetraMesh) -> Indices:
    """Return the edges between pad nodes, as pairs of positions in `mesh.pad`, shape (n, 2)."""
    place = np.full(len(mesh.nodes), -1)
    place[mesh.pad] = np.arange(len(mesh.pad))
    triangles = place[mesh.surface]
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    return np.asarray(np.unique(pairs[pairs[:, 0] >= 0], axis=0))
