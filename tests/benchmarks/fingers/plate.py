"""Plate: a flat plate pressed on a fingertip and dragged, as measured fingers were.

Contact is solved on even squares of the smooth skin, finer than the product's own points on what is flat: an area then
grows in small steps. Everything is quasi-static: no relaxation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.contact.solver.bodies import ContactBody
from core.contact.solver.cone import OPEN, STICK
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.skin.model import SkinModel
from core.skin.nodal_forces import NodalForces
from core.skin.surface_compliance import SurfaceCompliance
from tests.touches import flat

Array = NDArray[np.float64]

MM = 1e-3
HIGH = 3.0 * MM  # above the pad's lowest point: skin that a plate 2 mm deep cannot reach
TOLERANCE = 1e-4  # of the contact
STEP = 0.05 * MM  # until a force is reached
DEEPEST = 2.5 * MM  # where a force is sought
CLOSE = 2e-3  # to which a force is sought, of itself
SLIDES = 0.01  # share of the contact that may still stick when all of it is said to slide


@dataclass(frozen=True, eq=False)
class Moment:
    """A plate on the skin at one moment.

    Attributes:
        place: of the plate, from where it met the skin [m], shape (3,). force: on the skin [N], shape (3,). Both in the
            plate's axes: to the side, to the tip, into the skin.
        skin: area of the skin that touches. plate: area that it covers on the plate [m^2].
        stuck: area of what sticks, as a share of what touches.
        points: what touches, on the plate [m], shape (n, 2). areas: of its squares [m^2], shape (n,).
        pressure: there [Pa], shape (n,). sticks: shape (n,).
        settled: contact's laws hold.
    """

    place: Array
    force: Array
    skin: float
    plate: float
    stuck: float
    points: Array
    areas: Array
    pressure: Array
    sticks: NDArray[np.bool_]
    settled: bool


@dataclass(frozen=True, eq=False)
class _Cells(Nodes):
    """Some cells of a smooth pad, whose tissue's law is that of a mesh, as points that stay."""

    on: NodalForces | None = None

    def at_points(self, displacement: Array) -> Array:
        assert self.on is not None
        return self.on.gather(self.cells, displacement)

    def to_nodes(self, force: Array) -> Array:
        assert self.on is not None
        return self.on.spread(self.cells, force)


class Plate:
    """A flat plate that presses along its normal and drags a fingertip.

    Args:
        skin: of the fingertip. pad: it, smooth. level: of its tree of cells, whose squares are the points of contact.
        friction: Coulomb's coefficient. tilt: between plate and nail, the tip being nearer to it [rad].
    """

    def __init__(
        self, skin: SkinModel, pad: SurfaceCompliance, level: int = 1, friction: float = 0.6, tilt: float = 0.0
    ) -> None:
        c, s = np.cos(tilt), np.sin(tilt)
        self._turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        starts = pad.chart.starts
        every = np.arange(starts[level], starts[level + 1])
        above = pad.cells.positions[every] @ self._turn[:, 2]
        self._meets = pad.cells.positions[every[above.argmin()]]
        self.cells = every[above < above.min() + HIGH]
        self.patches, self.places, self.friction = pad.cells.take(self.cells), pad.chart.places[self.cells], friction
        compliance = pad.rows(self.cells, self.cells).astype(np.float64)
        own, on = self.patches, NodalForces.of(skin.mesh, pad.chart, skin.follows_law)
        nodes = _Cells.of(own.positions, own.normals, own.areas, 0.5 * (compliance + compliance.T))
        self._solver = PathSolver(
            replace(nodes, cells=self.cells, on=on),
            tolerance=TOLERANCE,
            name="plate",
            depth_limit=np.inf,
            law=LawSkin.of(skin),
        )
        self._flat = flat()
        self._kept: dict[float, tuple[list[Moment], Any]] = {}  # of forces that were pressed to

    def press(self, depths: Sequence[float]) -> list[Moment]:
        """Press from rest to one depth after the other [m]."""
        self._solver.reset()
        return [self._at(np.array([0.0, 0.0, d])) for d in depths]

    def press_to(self, force: float) -> list[Moment]:
        """Press from rest until a force is reached [N]."""
        if force in self._kept:
            out, state = self._kept[force]
            self._solver.restore(state)
            return list(out)
        self._solver.reset()
        out = []
        for depth in np.arange(STEP, DEEPEST, STEP):
            out.append(self._at(np.array([0.0, 0.0, depth])))
            if out[-1].force[2] >= force:
                break
        for _ in range(8):
            if abs(out[-1].force[2] / force - 1.0) <= CLOSE:
                break
            out.append(self._at(out[-1].place + [0.0, 0.0, _missing(out, force)]))
        self._kept[force] = list(out), self._solver.save()
        return out

    def drag(self, force: float, direction: Sequence[float], way: float, step: float) -> list[Moment]:
        """Press to a force [N], then drag in steps until all slides, the force being held, or skin gives way.

        Args:
            direction: in the plate's plane. way: at most [m]. step: [m].

        Returns:
            The moments from before the first step on. Only the last may be unsettled: skin that gave way has lost what
            it had been dragged by, and what it does then belongs to no drag.
        """
        out = self.press_to(force)
        along, begun = np.array([*direction, 0.0]), len(out) - 1
        for _ in range(round(way / step)):
            out.append(self._at(out[-1].place + step * along + [0.0, 0.0, _missing(out, force)]))
            if out[-1].stuck < SLIDES or not out[-1].settled:
                break
        return out[begun:]

    def _at(self, place: Array) -> Moment:
        stands = self._meets + self._turn @ place
        step = self._solver.step([ContactBody(self._flat, self._turn, stands, self.friction)])
        found = step.solution
        on = np.flatnonzero(found.status != OPEN)
        areas, sticks = self.patches.areas[on], found.status[on] == STICK
        moved = ((self.patches.positions + step.displacement - stands) @ self._turn)[:, :2]
        force, skin = found.force @ self._turn, float(areas.sum())
        return Moment(
            place,
            force.sum(axis=0),
            skin,
            skin * _stretch(self.places[on], self.patches.positions[on], moved[on]),
            float(areas[sticks].sum() / skin) if skin else 0.0,
            moved[on],
            areas,
            force[on, 2] / areas,
            sticks,
            found.converged,
        )


def _missing(moments: Sequence[Moment], force: float) -> float:
    """Return by how much a plate must rise for a force to be there again [m]."""
    first, last = moments[-2:]
    rise = last.place[2] - first.place[2]
    stiffness = force / (0.5 * last.place[2])  # of a force that grows with the square of depth
    if abs(rise) > 1e-3 * last.place[2] and last.force[2] > first.force[2]:
        stiffness = max((last.force[2] - first.force[2]) / rise, 0.5 * stiffness)
    return float(np.clip((force - last.force[2]) / stiffness, -STEP, STEP))


def _stretch(places: Array, points: Array, moved: Array) -> float:
    """Return the area that skin covers on the plate over its own at rest, by triangles between its points."""
    from scipy.spatial import Delaunay

    if len(places) < 8:
        return 1.0
    corners = Delaunay(places).simplices
    rest, now = points[corners], moved[corners]
    own = np.linalg.norm(np.cross(rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]), axis=1)
    (ax, ay), (bx, by) = (now[:, 1] - now[:, 0]).T, (now[:, 2] - now[:, 0]).T
    return float(np.abs(ax * by - ay * bx).sum() / own.sum())
