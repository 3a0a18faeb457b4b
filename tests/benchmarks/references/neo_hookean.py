"""Neo-Hookean tissue of hexahedra with mean dilatation, pressed by Newton's method. Lengths in mm, forces in N.

W = shear / 2 (tr F'F - 3 - 2 ln J) at the points of the elements, + first / 2 (ln of the element's mean J)^2. Each step
factorises the tangent, condenses it to the nodes that may touch, and solves contact on that; the balance of the nodes
is then that of the law itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from core.skin.assembly import degrees

from .contact import MAX_ROUNDS, TOLERANCE, Press, Pressed
from .hexahedra import GAUSS, HexMesh
from .shapes import Shape
from .tissue import BED, CENTRE, CHUNK, MATERIAL, PA, ROWS, Condensed, Index, assembled, interpolated

Array = NDArray[np.float64]
BALANCED = 1e-7  # forces that are left, over those of contact
SETTLED = 1e-4  # the last step of Newton's method [mm]
MAX_STEPS = 40
FLATTEST = 0.02  # of its volume is left of no point of an element


class NeoHookean:
    """The law on a mesh, per N/mm^2."""

    def __init__(self, mesh: HexMesh) -> None:
        self.mesh = mesh
        self.first, self.shear = (PA * value for value in MATERIAL.lame)
        parts = [slice(k, k + CHUNK) for k in range(0, len(mesh.elements), CHUNK)]
        self._parts = [(mesh.elements[part], *mesh.slopes(mesh.elements[part], GAUSS)) for part in parts]

    def flattest(self, moved: Array) -> float:
        """Return the least share of its volume that a point keeps under a displacement, shape (n, 3)."""
        return min(float(np.linalg.det(_gradient(moved, *part[:2])).min()) for part in self._parts)

    def forces(self, moved: Array) -> Array:
        """Return the forces that hold a displacement, shape (n, 3)."""
        out = np.zeros_like(moved)
        for elements, slope, volume in self._parts:
            turned, mean, pressure, widening = self._state(moved, elements, slope, volume)
            own = self.shear * (_gradient(moved, elements, slope) - turned)
            held = np.einsum("eqij,eqaj,eq->eai", own, slope, volume, optimize=True)
            np.add.at(out, elements, held + pressure[:, None, None] * widening)
        return out if self.mesh.bed is None else out + BED * (self.mesh.bed @ moved.ravel()).reshape(-1, 3)

    def tangent(self, moved: Array) -> csr_array:
        """Return the stiffness about a displacement, sparse (3 n, 3 n)."""
        total = csr_array((moved.size, moved.size))
        for elements, slope, volume in self._parts:
            turned, mean, pressure, widening = self._state(moved, elements, slope, volume)
            share = pressure[:, None] * np.linalg.det(_gradient(moved, elements, slope))
            across = np.einsum("eqij,eqaj->eqai", turned, slope)
            own = np.einsum("eqai,eqbk,eq->eaibk", across, across, share * volume, optimize=True)
            own += np.einsum("eqak,eqbi,eq->eaibk", across, across, (self.shear - share) * volume, optimize=True)
            dots = self.shear * np.einsum("eqaj,eqbj,eq->eab", slope, slope, volume, optimize=True)
            for i in range(3):
                own[:, :, i, :, i] += dots
            flat = widening.reshape(-1, 24)
            stiffer = self.first * (1.0 - np.log(mean)) / mean**2 / volume.sum(axis=1)
            own = own.reshape(-1, 24, 24) + stiffer[:, None, None] * flat[:, :, None] * flat[:, None]
            total = total + assembled(own, elements, self.mesh)
        return total if self.mesh.bed is None else total + BED * self.mesh.bed

    def stress(self, moved: Array, points: Array) -> Array:
        """Return the Cauchy stress [Pa] of the tissue that was at points [mm], shape (p, 6)."""
        found = []
        for elements, slope, volume in self._parts:
            _, _, pressure, _ = self._state(moved, elements, slope, volume)
            f = _gradient(moved, elements, self.mesh.slopes(elements, CENTRE)[0])[:, 0]
            own = self.shear * (f @ np.swapaxes(f, 1, 2) - np.eye(3)) / np.linalg.det(f)[:, None, None]
            own += pressure[:, None, None] * np.eye(3)
            found.append(np.stack([own[:, i, j] for i, j in ROWS], axis=1) / PA)
        return interpolated(self.mesh, np.concatenate(found), points)

    def _state(self, moved: Array, elements: Index, slope: Array, volume: Array) -> tuple[Array, Array, Array, Array]:
        """Return of elements: F^-T, the mean dilatation, its pressure, and the slopes of the volume (e, 8, 3)."""
        f = _gradient(moved, elements, slope)
        share = np.linalg.det(f)
        turned = np.swapaxes(np.linalg.inv(f), -1, -2)
        mean = (share * volume).sum(axis=1) / volume.sum(axis=1)
        widening = np.einsum("eqij,eqaj,eq->eai", turned, slope, share * volume, optimize=True)
        return turned, mean, self.first * np.log(mean) / mean, widening


def _gradient(moved: Array, elements: Index, slope: Array) -> Array:
    """Return the deformation gradients at the points of elements, shape (e, q, 3, 3)."""
    return np.einsum("eai,eqaj->eqij", moved[elements], slope, optimize=True) + np.eye(3)


def pressed(
    mesh: HexMesh, touched: Index, shape: Shape, friction: float, start: Array, depths: Sequence[float], step: float
) -> list[tuple[Pressed, Array, float]]:
    """Press along +Z, as `Press.depths` does.

    Returns:
        At each depth contact, the displacement of all nodes (n, 3), and the forces left over those of contact.

    Raises:
        ArithmeticError: Newton's method does not settle.
    """
    law, moved = NeoHookean(mesh), np.zeros_like(mesh.nodes)
    nodes, state, reached, found = mesh.nodes[touched], None, 0.0, []
    for depth in depths:
        parts = np.linspace(reached, depth, max(int(np.ceil((depth - reached) / step - 1e-9)), 1) + 1)[1:]
        for part in parts:
            place = np.asarray(start) + [0.0, 0.0, part]
            last = state or Pressed(np.zeros_like(nodes), np.zeros_like(nodes), np.asarray(start, float))
            state, moved, left = _settled(law, touched, shape, friction, place, last, moved)
        press = Press(np.zeros((0, 0)), nodes, shape, friction, mesh.cut[touched])
        found.append((replace(state, residual=press.residual(state, last)), moved, left))
        reached = depth
    return found


def _settled(
    law: NeoHookean, touched: Index, shape: Shape, friction: float, place: Array, last: Pressed, moved: Array
) -> tuple[Pressed, Array, float]:
    """Return contact in one place, the displacement of all nodes and what is left of the forces."""
    mesh, nodes, rows = law.mesh, law.mesh.nodes[touched], degrees(touched)
    force, before = last.force, last.displacement
    for _ in range(MAX_STEPS):
        condensed = Condensed(mesh, law.tangent(moved), touched)
        held = law.forces(moved).ravel()
        still = moved + condensed.solve(-held)[0].reshape(-1, 3)  # where the nodes go without contact
        press = Press(condensed.compliance, nodes + still[touched], shape, friction, mesh.cut[touched])
        own = press.settled(place, Pressed(force, before - still[touched], last.place), TOLERANCE, MAX_ROUNDS)
        force = own.force
        load = -held
        load[rows] += force.ravel()
        way = condensed.solve(load)[0].reshape(-1, 3)
        share = 1.0
        while law.flattest(moved + share * way) < FLATTEST:
            share *= 0.5
            if share < 1e-3:
                raise ArithmeticError("an element turns inside out")
        moved = moved + share * way
        out = -law.forces(moved).ravel()
        out[rows] += force.ravel()
        left = float(np.linalg.norm(out[condensed.free]) / max(np.linalg.norm(force), 1e-30))
        if share == 1.0 and left < BALANCED and np.abs(way).max() < SETTLED:
            return Pressed(force, moved[touched], place, own.change, own.rounds), moved, left
    raise ArithmeticError(f"tissue and contact are not balanced: {left:.1e}")
