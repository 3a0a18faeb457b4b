"""SingleTouch: contact of one body with a skin without a scene, solved as in a bake."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..errors import Finding
from ..parameters.skin import CONTACT, SKIN_CONTACT
from ..skin.model import SkinModel
from ..skin.point_forces import PointForces
from ..skin.surface_store import no_smooth_pad, smooth_pad
from .coarse_touches import CoarseTouches
from .compliant_bone import CompliantBone
from .doubtful_touches import DoubtfulTouches
from .first_touch import CLOSE, first_touch
from .solver.between import lowered
from .solver.bodies import ContactBody
from .solver.path_solver import PathStep

STEP = 0.1e-3  # longest step [m], since friction depends on the path; the same as in a bake of 24 mm/s at 240 Hz


class SingleTouch:
    """Contact of a body that starts at first touch with a finger's undeformed skin, and is moved from there.

    Args:
        skin: model of the finger's skin.
        body: the body in the finger's axes; its position along Z does not matter.
        name: name for findings.
        contact: 'nodes' to solve at the nodes of the skin's mesh, or 'points' for points of the smooth skin, if it has
            one.

    Attributes:
        place: present position of the body [m], shape (3,).
        step: the contact at this position.
        pad: the smooth pad; None if contact is solved at nodes.

    Raises:
        DermisError: the name of the contact is unknown, or the body does not meet the pad.
    """

    def __init__(self, skin: SkinModel, body: ContactBody, name: str, contact: str = CONTACT) -> None:
        SKIN_CONTACT["contact"].check(contact, name)
        self.skin, self.name, self._body = skin, name, body
        self.pad = smooth_pad(skin) if contact == "points" else None
        self._told = (no_smooth_pad(skin, name),) if contact == "points" and self.pad is None else ()
        self._bone = CompliantBone.of(skin, {}, name, surface=self.pad)
        self._coarse = None if self.pad is not None else CoarseTouches(skin.mesh, name)
        self._doubts = DoubtfulTouches(name, lambda _: "the surface")
        self.place = np.array([*body.translation[:2], first_touch(skin, body)])
        start = replace(body, translation=self.place)
        self.step = self._bone.step([start], 0.0, lambda: [lowered(start, CLOSE)]).step

    def move(self, way: Sequence[float] | Array) -> PathStep:
        """Move the body along a vector [m], shape (3,), in steps; return the contact at the end."""
        way, start = np.asarray(way, np.float64), self.place
        parts = int(np.ceil(np.linalg.norm(way) / STEP * (1.0 - 1e-9)))
        for part in range(1, parts + 1):
            self.place = start + part / parts * way
            self.step = self._bone.step([replace(self._body, translation=self.place)], 0.0).step
            if self._coarse is not None:
                self._coarse.take(self.step.solution, 0.0)
            self._doubts.take(self.step, 0.0, on_points=self.pad is not None)
        return self.step

    @property
    def points(self) -> PointForces | None:
        """Forces on points of the smooth skin; None if contact is solved at nodes."""
        solver, force = self._bone.solver, self.step.solution.force
        if self.pad is None:
            return None
        loaded = np.flatnonzero(force.any(axis=1))
        return PointForces(self.pad, solver.cells[loaded], force[loaded], self.step.amounts)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings as of a bake, without frames."""
        coarse = () if self._coarse is None else self._coarse.findings
        found = (*self._told, *self._bone.solver.findings, *self._bone.findings, *coarse, *self._doubts.findings)
        return tuple(replace(finding, frame=None) for finding in found)
