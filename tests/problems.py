"""Named problems whose answers are known exactly, for tests and benchmarks of every level."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.skin.disk import split_hexahedra
from core.skin.mesh import TetraMesh, boundary_faces

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]


# Elasticity on a cube ------------------------------------------------------------------------------------------------


# Kuhn's six tetrahedra of a hexahedron, all round the diagonal from vertex 0 to vertex 6
_KUHN = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))


def cube_mesh(cells: int, side: float = 1.0, warp: float = 0.0, *, kuhn: bool = False) -> TetraMesh:
    """Return a cube [0, side]^3 of split hexahedra; its boundary is fixed but for the inside of the face z = 0.

    Args:
        cells: hexahedra along each edge.
        warp: moves inner nodes smoothly by this part of the side, for tests that must not profit from a regular grid.
        kuhn: six tetrahedra a hexahedron, all alike, instead of five in a checkerboard (which locks less).
    """
    n = cells + 1
    i, j, k = np.meshgrid(*[np.arange(n)] * 3, indexing="ij")
    grid = np.stack([i, j, k], axis=-1).reshape(-1, 3)
    x = grid / cells
    bump = np.prod(np.sin(np.pi * x), axis=1)
    nodes = side * (x + warp * bump[:, None] * np.array([0.6, -0.8, 0.5]))
    number = np.arange(n**3).reshape(n, n, n)
    low, high = slice(0, -1), slice(1, None)
    corner = [(low, low, low), (high, low, low), (high, high, low), (low, high, low)]
    corner += [(a, b, high) for a, b, _ in corner]
    hexahedra = np.stack([number[c].ravel() for c in corner], axis=1).astype(np.int32)
    colour = grid.sum(axis=1) % 2
    tetrahedra = hexahedra[:, np.array(_KUHN)].reshape(-1, 4) if kuhn else split_hexahedra(hexahedra, colour)
    outside = ((grid == 0) | (grid == cells)).any(axis=1)
    bottom = (grid[:, 2] == 0) & ~((grid[:, :2] == 0) | (grid[:, :2] == cells)).any(axis=1)
    fixed = np.flatnonzero(outside & ~bottom).astype(np.int32)
    pad = np.flatnonzero(bottom).astype(np.int32)
    return TetraMesh(nodes, tetrahedra, fixed, pad, boundary_faces(tetrahedra), "cube")


def linear_field(points: Array, gradient: Array) -> Array:
    """Return u = H x, whose strain and stress are uniform."""
    return points @ gradient.T


def uniform_stress(gradient: Array, young: float, poisson: float) -> Array:
    """Return Hooke's stress of a uniform displacement gradient, xx, yy, zz, yz, xz, xy."""
    strain = 0.5 * (gradient + gradient.T)
    stress = young / (1 + poisson) * (strain + poisson / (1 - 2 * poisson) * np.trace(strain) * np.eye(3))
    return np.array([stress[0, 0], stress[1, 1], stress[2, 2], stress[1, 2], stress[0, 2], stress[0, 1]])


@dataclass(frozen=True)
class Swirl:
    """A divergence-free displacement on the unit cube: curl of (0, 0, s(x) s(y) s(z)) with s(t) = sin(pi t).

    No volume changes, so the exact solution does not depend on Poisson's ratio; the body force is -mu laplace(u) =
    3 pi^2 mu u. What an element adds to the error as Poisson's ratio nears 1/2 is locking.
    """

    @staticmethod
    def displacement(points: Array) -> Array:
        """Return u [m], shape (n, 3)."""
        sine, cosine = np.sin(np.pi * points), np.cos(np.pi * points)
        ux = np.pi * sine[:, 0] * cosine[:, 1] * sine[:, 2]
        uy = -np.pi * cosine[:, 0] * sine[:, 1] * sine[:, 2]
        return np.stack([ux, uy, np.zeros_like(ux)], axis=1)

    @classmethod
    def body_force(cls, points: Array, shear: float) -> Array:
        """Return the body force [N/m^3], shape (n, 3)."""
        return 3.0 * np.pi**2 * shear * cls.displacement(points)


@dataclass(frozen=True)
class Bulge:
    """A displacement that does change volume: u = (s(x) s(y) s(z), 0, 0) with s(t) = sin(pi t)."""

    @staticmethod
    def displacement(points: Array) -> Array:
        """Return u [m], shape (n, 3)."""
        out = np.zeros_like(points)
        out[:, 0] = np.prod(np.sin(np.pi * points), axis=1)
        return out

    @staticmethod
    def body_force(points: Array, first: float, shear: float) -> Array:
        """Return -(lambda + mu) grad div u - mu laplace u [N/m^3], shape (n, 3)."""
        s, c = np.sin(np.pi * points), np.cos(np.pi * points)
        sx, sy, sz = s.T
        cx, cy, cz = c.T
        both = np.pi**2 * (first + shear)
        return np.stack(
            [both * sx * sy * sz + 3 * np.pi**2 * shear * sx * sy * sz, -both * cx * cy * sz, -both * cx * sy * cz],
            axis=1,
        )


# Contact on a half-space ---------------------------------------------------------------------------------------------


def square_grid(radius: float, spacing: float) -> Array:
    """Return the nodes of a square grid within a radius [m], one at the centre, shape (m, 2)."""
    n = int(radius / spacing)
    axis = np.arange(-n, n + 1) * spacing
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis, indexing="ij"))
    inside = np.hypot(x, y) <= radius * (1.0 + 1e-9)
    return np.stack([x[inside], y[inside]], axis=1)


def half_space_compliance(points: Array, side: float, young: float, poisson: float) -> Array:
    """Return the compliance of square patches on a half-space (Boussinesq, Cerruti, Love) [m/N].

    Args:
        points: centres of equal squares in the plane [m], shape (m, 2). z points into the half-space.
        side: of the squares [m]; each carries its force as a uniform traction.

    Returns:
        displacement of the centres for forces on the squares, x, y, z by square, shape (3 m, 3 m), symmetric.
    """
    count = len(points)
    dx = points[:, None, 0] - points[None, :, 0]
    dy = points[:, None, 1] - points[None, :, 1]

    def integral(antiderivative):  # type: ignore[no-untyped-def]
        total = np.zeros((count, count))
        for sx in (-0.5, 0.5):
            for sy in (-0.5, 0.5):
                total += 4.0 * sx * sy * antiderivative(dx + sx * side, dy + sy * side)
        return total

    def r(x, y):  # type: ignore[no-untyped-def]
        return np.hypot(x, y)

    inverse = integral(lambda x, y: x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y)))  # 1 / r
    xx = integral(lambda x, y: y * np.arcsinh(x / np.abs(y)))  # x^2 / r^3
    yy = integral(lambda x, y: x * np.arcsinh(y / np.abs(x)))  # y^2 / r^3
    xy = integral(lambda x, y: -r(x, y))  # x y / r^3
    x2 = integral(lambda x, y: x * np.arctan(y / x) + 0.5 * y * np.log(x * x + y * y))  # x / r^2
    y2 = integral(lambda x, y: y * np.arctan(x / y) + 0.5 * x * np.log(x * x + y * y))  # y / r^2
    shear = (1 + poisson) / (np.pi * young * side**2)
    half = 0.5 * (1 - 2 * poisson)
    out = np.empty((count, 3, count, 3))
    out[:, 0, :, 0] = shear * ((1 - poisson) * inverse + poisson * xx)
    out[:, 1, :, 1] = shear * ((1 - poisson) * inverse + poisson * yy)
    out[:, 2, :, 2] = shear * (1 - poisson) * inverse
    out[:, 0, :, 1] = out[:, 1, :, 0] = shear * poisson * xy
    out[:, 2, :, 0], out[:, 0, :, 2] = shear * half * x2, -shear * half * x2
    out[:, 2, :, 1], out[:, 1, :, 2] = shear * half * y2, -shear * half * y2
    return out.reshape(3 * count, 3 * count)


@dataclass(frozen=True)
class Hertz:
    """A rigid sphere pressed into a half-space without friction (or with friction on an incompressible one).

    Attributes:
        radius: of the sphere [m]. young, poisson: of the half-space.
    """

    radius: float
    young: float
    poisson: float

    @property
    def modulus(self) -> float:
        """Plane strain modulus E / (1 - nu^2) [Pa]."""
        return self.young / (1 - self.poisson**2)

    def contact_radius(self, depth: float) -> float:
        """Return the radius of the contact [m]."""
        return float(np.sqrt(self.radius * depth))

    def force(self, depth: float) -> float:
        """Return the force [N]."""
        return 4.0 / 3.0 * self.modulus * float(np.sqrt(self.radius)) * depth**1.5

    def peak_pressure(self, depth: float) -> float:
        """Return the pressure in the middle [Pa]."""
        return 2.0 * self.modulus * float(np.sqrt(depth / self.radius)) / np.pi


@dataclass(frozen=True)
class CattaneoMindlin:
    """A Hertz contact at constant depth moved sideways before it slips as a whole.

    Attributes:
        hertz: the normal contact. friction: Coulomb's coefficient.
    """

    hertz: Hertz
    friction: float

    def stick_radius(self, depth: float, tangential: float) -> float:
        """Return the radius of the part that sticks [m] under a tangential force [N]."""
        share = 1.0 - tangential / (self.friction * self.hertz.force(depth))
        return self.hertz.contact_radius(depth) * share ** (1.0 / 3.0)

    def force(self, depth: float, shift: float) -> float:
        """Return the tangential force [N] at a shift [m] (mu P where everything slips)."""
        shear = self.hertz.young / (2 * (1 + self.hertz.poisson))
        a, normal = self.hertz.contact_radius(depth), self.hertz.force(depth)
        limit = 3 * self.friction * normal * (2 - self.hertz.poisson) / (16 * shear * a)
        return self.friction * normal * (1 - max(0.0, 1 - shift / limit) ** 1.5)


def sneddon_flat_pin(radius: float, depth: float, young: float, poisson: float) -> float:
    """Return the force [N] on a flat rigid pin pressed into a half-space, 2 E a d / (1 - nu^2)."""
    return 2.0 * young * radius * depth / (1.0 - poisson**2)


# A flat press on the finger ------------------------------------------------------------------------------------------


def flat_press(compliance: Array, heights: Array, depth: float, *, iterations: int = 200) -> Array:
    """Press a skin on a smooth rigid plate exactly, by an active set on the condensed compliance.

    Args:
        compliance: of the pad [m/N], shape (3 m, 3 m), x, y, z by node.
        heights: of the pad nodes above the first to touch [m], shape (m,).
        depth: of the plate [m].

    Returns:
        forces on the skin [N], shape (m, 3), all along z and none below zero.
    """
    normal = compliance[2::3, 2::3]
    gap = heights - depth
    active = gap < 0
    for _ in range(iterations):
        chosen = np.flatnonzero(active)
        force = np.zeros(len(heights))
        force[chosen] = np.linalg.solve(normal[np.ix_(chosen, chosen)], -gap[chosen])
        after = normal @ force + gap
        new = np.where(active, force > 0, after < 0)
        if np.array_equal(new, active):
            out = np.zeros((len(heights), 3))
            out[:, 2] = force
            return out
        active = new
    raise AssertionError("the active set did not settle")
