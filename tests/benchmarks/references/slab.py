"""A slab in plane strain under shapes along Y, with cells fine enough for their roundings. Lengths in mm, forces N/mm.

What three dimensions cannot pay for: without friction skin slides round a rounding, and wider cells than a tenth of its
radius hold it back. Quadrilaterals with mean dilatation, as `tissue.py` has hexahedra.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from .contact import Press
from .shapes import Shape
from .sliding import both
from .tissue import MATERIAL, PA

Array = NDArray[np.float64]
WIDTH, HEIGHT = 8.0, 4.0  # half of the slab's width, and its thickness [mm]
ROUND = 8.0  # radius of the skin [mm]
GROWTH, MOST = 0.25, 0.6  # of the cells beyond the even ones, and their largest size [mm]
REACH = 1.5  # so far beside the outermost place skin may be touched [mm]
DEPTH, WAY, STEP = 1.0, (0.0, 0.2, 0.4), 0.1  # of a press, the places that it is moved to, the longest step [mm]
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)


def cells(places: Sequence[float], even: float, half: float) -> tuple[Array, Array]:
    """Return x and z of the grid's lines [mm], from the skin at z = 0 upwards.

    Args:
        places: x that the cells are even about [mm]. even: their size. half: half width of the even part about each.
    """
    across = _line(-WIDTH, WIDTH, lambda x: np.abs(x[:, None] - np.array(places)).min(axis=1) - half, even)
    return across, _line(0.0, HEIGHT, lambda z: z - 0.3 * half, even)


def skin(across: Array, up: Array, reach: float) -> tuple[Array, Array]:
    """Return the points of the skin with |x| < reach [mm], shape (k, 3), and their compliance [mm/N], (3 k, 3 k).

    Along Y a point gives way as along Z, by itself: nothing pushes it there.
    """
    x, z = np.meshgrid(across, up, indexing="ij")
    nodes = np.stack([x.ravel(), z.ravel()], axis=1)
    number = np.arange(len(nodes)).reshape(x.shape)
    elements = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    own = _stiffness(nodes[elements])
    rows = (2 * elements[:, :, None] + np.arange(2)).reshape(-1, 8)
    at = np.repeat(rows, 8, axis=1).ravel(), np.tile(rows, (1, 8)).ravel()
    total = coo_array((own.ravel(), at), shape=(nodes.size, nodes.size)).tocsc()
    held = (nodes[:, 1] == HEIGHT) | (np.abs(nodes[:, 0]) == WIDTH)
    free = np.flatnonzero(np.repeat(~held, 2))
    touched = np.flatnonzero((nodes[:, 1] == 0.0) & (np.abs(nodes[:, 0]) < reach))
    loads = np.zeros((len(free), 2 * len(touched)))
    unknowns = np.searchsorted(free, (2 * touched[:, None] + np.arange(2)).ravel())
    loads[unknowns, np.arange(2 * len(touched))] = 1.0
    plane = splu(total[free][:, free]).solve(loads)[unknowns].reshape(len(touched), 2, len(touched), 2)
    compliance = np.zeros((len(touched), 3, len(touched), 3))
    compliance[:, ::2, :, ::2] = plane
    each = np.arange(len(touched))
    compliance[each, 1, each, 1] = compliance[each, 2, each, 2]
    points = np.stack([nodes[touched, 0], 0.0 * touched, 0.5 * nodes[touched, 0] ** 2 / ROUND], axis=1)
    return points, compliance.reshape(3 * len(touched), -1)


def slid_apart(
    shape: Shape, places: Sequence[float], even: float, half: float, friction: float
) -> tuple[Array, Array, Array]:
    """Press a shape into the slab and move it sideways, and press it in the same places.

    Args:
        places, even, half: of the cells, as `cells` has them. friction: Coulomb's coefficient.

    Returns:
        Forces after the way to each place, shape (p, 3), forces pressed there, and |slid - pressed| / |pressed|, (p,).
    """
    points, compliance = skin(*cells(places, even, half), max(np.abs(places)) + REACH)
    press = Press(compliance, points, shape, friction)
    ends = np.array([[x, 0.0, DEPTH] for x in WAY])
    slid, pressed = (np.array([s.force.sum(axis=0) for s in states]) for states in both(press, ends, DEPTH, STEP))
    return slid, pressed, np.linalg.norm(slid - pressed, axis=1) / np.linalg.norm(pressed, axis=1)


def _line(low: float, high: float, beyond: Callable[[Array], Array], even: float) -> Array:
    at = np.linspace(low, high, 20_001)
    density = 1.0 / np.minimum(even + GROWTH * np.maximum(beyond(at), 0.0), MOST)
    count = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(at) * (density[1:] + density[:-1]))])
    out = np.interp(np.linspace(0.0, count[-1], int(np.ceil(count[-1])) + 1), count, at)
    out[[0, -1]] = low, high
    return np.asarray(out)


def _stiffness(corners: Array) -> Array:
    """Return the stiffness of quadrilaterals, shape (e, 4, 2) to (e, 8, 8)."""
    at = CORNERS / np.sqrt(3.0)
    along = 0.25 * np.stack([CORNERS[:, k] * (1.0 + at[:, None, 1 - k] * CORNERS[:, 1 - k]) for k in range(2)], axis=2)
    jacobian = np.einsum("eai,qak->eqik", corners, along)
    area = np.linalg.det(jacobian)
    slope = np.einsum("qak,eqki->eqai", along, np.linalg.inv(jacobian))
    strain = np.zeros((*slope.shape[:2], 4, 8))  # xx, zz, yy, twice xz
    strain[..., 0, 0::2] = strain[..., 3, 1::2] = slope[..., 0]
    strain[..., 1, 1::2] = strain[..., 3, 0::2] = slope[..., 1]
    flat = slope.reshape(*slope.shape[:2], 8)
    mean = np.einsum("eqr,eq->er", flat, area) / area.sum(axis=1)[:, None]
    strain[..., :3, :] += ((mean[:, None] - flat) / 3.0)[..., None, :]
    first, shear = (PA * value for value in MATERIAL.lame)
    law = np.diag(shear * np.array([2.0, 2.0, 2.0, 1.0]))
    law[:3, :3] += first
    return np.asarray(np.einsum("eqir,ij,eqjs,eq->ers", strain, law, strain, area, optimize=True))
