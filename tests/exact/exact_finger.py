"""ExactFinger: neo-Hookean tissue under contact, nothing reduced: what tables of it are made and judged by.

The unknowns are all nodes of the mesh. Each frame is Newton's method on the balance of the tissue, with the tissue
beneath the pad eliminated exactly (`Dissection`) and Coulomb's laws at the pad solved in float64 on what is left. The
gaps and the anchors of friction are those of `PathSolver`; gaps are measured again until they are those of the
displaced nodes. Between two answers to the same poses stands only the tissue. A frame takes a second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array
from core.contact.solver.bodies import BONE, ContactBody, NodeGaps
from core.contact.solver.cone import along, assess
from core.contact.solver.history import ContactHistory
from core.contact.solver.smooth_contact import SmoothContact
from core.skin.assembly import degrees
from core.skin.model import SkinModel
from tests.contact_laws import solve
from tests.grips import nodes_of

from .dissection import Dissection
from .neo_hookean import NeoHookean

SOFTEST = 0.1  # of linear tissue's stiffness: no Newton step follows anything softer
SLOW = 0.2  # a step that leaves more of the residual asks for a new tangent
FLATTEST = 0.03  # of its volume is left of no element of a step
MAX_STEPS = 60
MAX_PARTS = 16
# The nodes look again until their gaps are measured this close to where they are [m], at most LOOKS times in a frame.
SEEN, LOOKS = 1e-9, 20


@dataclass(frozen=True)
class Held:
    """One frame: tissue and contact in balance.

    Attributes:
        displacement: of all nodes [m], shape (n, 3). force: on the pad nodes [N], shape (m, 3).
        gaps: that it was solved for. offset: b of its contact problem [m], shape (m, 3).
        residual: of the balance of all nodes, over the forces. steps: of Newton's method.
    """

    displacement: Array
    force: Array
    gaps: NodeGaps
    offset: Array
    residual: float
    steps: int


class Tangent:
    """The tissue about a state, condensed to the pad.

    Attributes:
        stiffness: of the pad, nothing below a share of linear tissue's [N/m], shape (3 m, 3 m).
        compliance: its inverse.
    """

    def __init__(self, finger: ExactFinger, displacement: Array, softest: Array | None) -> None:
        free, inner = finger.free, ~finger.on_pad
        matrix = (finger.law.tangent(displacement) * finger.modulus)[free][:, free].tocsr()
        owner = free // 3
        self._parts = Dissection(matrix, owner, np.zeros(len(free), bool), finger.on_pad, finger.skin.mesh.nodes)
        self._rows = matrix[finger.on_pad][:, inner].tocsr()
        self._inner = inner
        self.stiffness = self._parts.schur if softest is None else _floored(self._parts.schur, softest)
        self.compliance = np.linalg.inv(self.stiffness)
        self.compliance = 0.5 * (self.compliance + self.compliance.T)

    def inner_step(self, left: Array, pad: Array) -> Array:
        """Return how all free degrees move so that nothing is left inside, the pad being moved so [m]."""
        step, _ = self._parts.solve(pad, left)
        return step

    def on_pad(self, inner: Array) -> Array:
        """Return the forces on the pad that hold what moves inside [N], shape (3 m,)."""
        return np.asarray(self._rows @ inner[self._inner])


def _floored(stiffness: Array, linear: Array) -> Array:
    """Return a stiffness of which no mode is softer than a share of linear tissue's."""
    try:
        np.linalg.cholesky(stiffness - SOFTEST * linear)
        return stiffness
    except np.linalg.LinAlgError:
        root = np.linalg.cholesky(linear)
        half = np.linalg.solve(root, np.linalg.solve(root, stiffness).T)
        values, vectors = np.linalg.eigh(0.5 * (half + half.T))
        turned = root @ vectors
        return np.asarray((turned * np.maximum(values, SOFTEST)) @ turned.T)


class ExactFinger:
    """Contact of a neo-Hookean finger, frame after frame.

    Args:
        skin: whose mesh, material and pad it has. tolerance: of the balance and of contact, over the forces.
    """

    def __init__(self, skin: SkinModel, tolerance: float = 1e-6, looks: int = LOOKS) -> None:
        self.looks = looks  # most often that gaps are measured in a frame
        self.skin, self.tolerance, self.modulus = skin, tolerance, skin.material.modulus
        self.law = NeoHookean(skin.mesh, skin.material.poisson)
        self.free = degrees(skin.mesh.free)
        self.on_pad = np.isin(self.free, degrees(skin.mesh.pad))
        assert (np.diff(skin.mesh.pad) > 0).all(), "the pad's nodes are in the order of the mesh"
        spacing = np.sqrt(np.prod(np.sort(np.ptp(skin.positions, axis=0))[1:]) / skin.pad_count)
        self.search_radius = max(2.5 * float(spacing), 2.5e-3)
        self._contact = SmoothContact(self.search_radius, BONE)
        self._nodes = nodes_of(skin)
        rest = np.zeros_like(skin.mesh.nodes)
        self._first = Tangent(self, rest, None)
        self._linear = self._first.stiffness
        self.reset()

    def reset(self) -> None:
        """Go back to rest."""
        self.displacement = np.zeros_like(self.skin.mesh.nodes)
        self.force = np.zeros((self.skin.pad_count, 3))
        self.history = ContactHistory(self.skin.pad_count)
        self._tangent = self._first

    def step(self, bodies: list[ContactBody], before: list[ContactBody] | None = None) -> Held:
        """Solve the next frame; where Newton's method fails, in parts of the way from where bodies were.

        Raises:
            ArithmeticError: it fails in the smallest parts, too.
        """
        parts, done = 1, 0
        while True:
            part = bodies if before is None else _between(before, bodies, (done + 1) / parts)
            try:
                held = self._frame(part)
            except ArithmeticError:
                if before is None or 2 * parts > MAX_PARTS:
                    raise
                parts, done = 2 * parts, 2 * done
                self._tangent = Tangent(self, self.displacement, self._linear)
                continue
            done += 1
            if done == parts:
                return held

    def _frame(self, bodies: list[ContactBody]) -> Held:
        skin, pad = self.skin, self.skin.mesh.pad
        points = skin.positions
        expected = self.history.expected(bodies, points + self.displacement[pad], self.search_radius)
        where, slip = expected - points, None
        for _ in range(self.looks):
            gaps = self._contact.look(self._nodes, bodies, where)
            if slip is None:
                slip = self.history.offset(gaps, points)
            normal = gaps.normal
            offset = slip + (np.where(gaps.body < 0, 0.0, gaps.gap) - along(slip, normal))[:, None] * normal
            near = np.flatnonzero(gaps.body >= 0)
            displacement, force, status, residual, steps = self._balanced(gaps, offset, near)
            moved, where = np.abs(displacement[pad] - where).max(), displacement[pad]
            self.displacement, self.force = displacement, force
            if moved < SEEN:
                break
        relative = displacement[pad] + offset
        found, none = np.zeros(skin.pad_count, np.int8), np.zeros((skin.pad_count, 3))
        found[near] = status
        self.history.keep(gaps, found, none, relative, points + displacement[pad], none[:, 0])
        return Held(displacement, force, gaps, offset, residual, steps)

    def _balanced(
        self, gaps: NodeGaps, offset: Array, near: NDArray[np.intp]
    ) -> tuple[Array, Array, NDArray[np.int8], float, int]:
        """Return displacement of all nodes, forces on the pad, what the near nodes do, the residual and the steps."""
        pad, free = self.skin.mesh.pad, self.free
        rows, inner = degrees(near), ~self.on_pad
        moved, force = self.displacement.copy(), self.force.copy()
        left, last = self._left(moved), np.inf
        for count in range(1, MAX_STEPS + 1):
            # what the pad would carry if it stood still, and what it carries for moving
            still = self._tangent.inner_step(np.where(inner, left, 0.0), np.zeros(3 * len(pad)))
            held = self._tangent.on_pad(still) - left[self.on_pad]
            matrix = self._tangent.compliance
            stood = moved[pad] - (matrix @ held).reshape(-1, 3)
            found = solve(
                matrix[rows[:, None], rows],
                stood[near] + offset[near],
                gaps.friction[near],
                normals=gaps.normal[near],
                start=force[near],
                tolerance=0.1 * self.tolerance,
            )
            force = np.zeros_like(force)
            force[near] = found.force
            way = stood.reshape(-1) + matrix @ force.reshape(-1) - moved[pad].reshape(-1)
            step = np.zeros(moved.size)
            step[free] = self._tangent.inner_step(np.where(inner, left, 0.0), way)
            share = 1.0
            while self._flattest(moved + share * step.reshape(-1, 3)) < FLATTEST:
                share *= 0.5
                if share < 1e-3:
                    raise ArithmeticError("an element turns inside out")
            moved = moved + share * step.reshape(-1, 3)
            left = self._left(moved)
            out = left.copy()
            out[self.on_pad] += force.reshape(-1)
            residual = float(np.linalg.norm(out)) / max(float(np.linalg.norm(force)), 1e-9)
            if share == 1.0 and residual <= self.tolerance:
                return moved, force, found.status, residual, count
            if residual > SLOW * last or share < 1.0:
                self._tangent = Tangent(self, moved, self._linear)
            last = residual
        raise ArithmeticError(f"tissue and contact are not balanced: {residual:g}")

    def _left(self, displacement: Array) -> Array:
        """Return what the tissue does not carry of no load, less its stresses' forces [N], at the free degrees."""
        stresses = self.law.response(displacement[None, None]).piola
        return -self.modulus * self.law.forces(stresses)[0, 0].reshape(-1)[self.free]

    def _flattest(self, displacement: Array) -> float:
        mesh = self.skin.mesh
        gradient = np.einsum("eai,eaj->eij", displacement[mesh.tetrahedra], self.law.geometry.gradients)
        return float(np.linalg.det(gradient + np.eye(3)).min())

    def stress(self, displacement: Array) -> Array:
        """Return the Cauchy stress of each element [Pa], xx, yy, zz, yz, xz, xy, shape (e, 6)."""
        return self.modulus * self.law.response(displacement[None, None]).cauchy()[0, 0]

    def reaction(self, displacement: Array) -> Array:
        """Return the forces on the pad that hold a displacement [N], shape (m, 3)."""
        return -self._left(displacement)[self.on_pad].reshape(-1, 3)

    def contact_residual(self, held: Held) -> float:
        """Return how far the tissue's own forces are from Coulomb's laws at its own displacement, over the forces."""
        force = self.reaction(held.displacement)
        relative = held.displacement[self.skin.mesh.pad] + held.offset
        near = held.gaps.body >= 0
        rho = float(np.sqrt(np.prod(np.linalg.eigvalsh(self.skin.compliance)[[0, -1]])))
        found = assess(force[near], relative[near], held.gaps.normal[near], held.gaps.friction[near], 1 / rho)[0]
        return float(np.hypot(found, np.linalg.norm(force[~near]) / max(float(np.linalg.norm(force)), 1e-12)))


def _between(before: list[ContactBody], after: list[ContactBody], share: float) -> list[ContactBody]:
    """Return bodies on their way, which do not turn."""
    places = [a.translation + share * (b.translation - a.translation) for a, b in zip(before, after, strict=True)]
    return [replace(body, translation=place) for body, place in zip(after, places, strict=True)]
