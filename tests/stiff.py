"""A small stiffening of a skin, made in a second or two: for tests of what any touch on stiff skin must obey."""

from __future__ import annotations

import functools
from collections.abc import Generator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.contact.solver.bodies import ContactBody
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.path import PathSolver
from core.skin.assembly import degrees
from core.skin.model import SkinModel, fingertip_skin
from core.stiffening.patterns import Patterns
from core.stiffening.stiffening import Stiffening
from core.stiffening.stress_series import StressSeries
from core.tissue.energy_fit import fit_energy
from core.tissue.neo_hookean import NeoHookean
from core.tissue.pair_modes import PairModes
from tests.made_up_tissue import no_cubes
from tests.touches import Solid, Touch, ball, edge, flat, rod

Array = NDArray[np.float64]
T = TypeVar("T")

COUNT, MODES = 36, 30
MIRROR = np.array([-1.0, 1.0, 1.0])


@functools.cache
def stiff_skin(level: str = "draft") -> SkinModel:
    """Return a standard fingertip whose tissue follows the law, with a series in a few patterns for devices."""
    skin = fingertip_skin(level=level)
    return skin.with_law(small_stiffening(skin))


def small_stiffening(skin: SkinModel) -> Stiffening:
    """Return what a skin does beyond linear skin, of displacement alone: its stress is linear skin's."""
    from scipy.sparse.linalg import splu

    mesh = skin.mesh
    law = NeoHookean(mesh, skin.material.poisson)
    root = np.linalg.cholesky(skin.unit_compliance)
    samples = _samples(skin)
    size = np.linalg.norm(samples, axis=1)
    vectors = np.linalg.svd((root.T @ samples.T) / (size + 0.05 * size.max()), full_matrices=False)[0][:, :COUNT]
    pad, loads = root @ vectors, np.linalg.solve(root.T, vectors)
    stiff = law.tangent(np.zeros_like(mesh.nodes))
    on_pad, inner = degrees(mesh.pad), degrees(np.setdiff1d(mesh.free, mesh.pad))
    factor = splu(stiff[inner][:, inner].tocsc())
    patterns = np.zeros((COUNT, mesh.nodes.size))
    patterns[:, on_pad] = pad.T
    patterns[:, inner] = -factor.solve(stiff[inner][:, on_pad] @ pad).T
    assert np.allclose((stiff @ patterns.T)[on_pad], loads, atol=1e-6 * np.abs(loads).max())
    work = samples @ pad
    modes = PairModes.of(work, np.full(COUNT, np.linalg.norm(work, axis=1).max()), COUNT, MODES)
    energy = drained(fit_energy(law, factor.solve, patterns.reshape(COUNT, -1, 3), modes))
    none = np.zeros((len(mesh.tetrahedra), 6, 1), np.float32)
    squares = np.zeros((1, COUNT * (COUNT + 1) // 2), np.float32)
    stress = StressSeries(mesh.nodes, mesh.tetrahedra, none, squares, *no_cubes(1, COUNT))
    return Stiffening(energy, Patterns.through(skin.positions, pad.reshape(-1, 3, COUNT)), stress)


def drained(run: Generator[Any, None, T]) -> T:
    """Return what a generator returns."""
    while True:
        try:
            next(run)
        except StopIteration as end:
            return end.value


def on_nodes(skin: SkinModel, tolerance: float = 1e-6, name: str = "finger") -> PathSolver:
    """Return what follows a touch at the nodes of a skin, stiff or not, however deep.

    The law is followed as closely as contact is solved, or as single precision lets it be.
    """
    law = LawSkin.of(skin, None if tolerance >= 3e-5 else max(10.0 * tolerance, 2e-5))
    return PathSolver(
        skin.compliance, skin.positions, areas=skin.areas, tolerance=tolerance, name=name, depth_limit=np.inf, law=law
    )


def press(
    skin: SkinModel,
    surface: Solid,
    depth: float,
    *,
    slide: float = 0.0,
    friction: float = 0.6,
    pitch: float = 0.0,
    roll: float = 0.0,
    step: float = 0.2e-3,
    across: tuple[float, float] = (1.0, 0.0),
) -> Touch:
    """Return a touch at the pad's lowest place, pressed straight and then drawn in the finger's X and Y [m]."""
    foot = skin.positions[skin.positions[:, 2].argmin()]
    pressed = np.linspace(0.0, depth, round(depth / step) + 1)[1:]
    drawn = np.linspace(0.0, slide, round(slide / step) + 1)[1:]
    position = np.zeros((len(pressed) + len(drawn), 3))
    position[:, 2] = np.concatenate([pressed, np.full(len(drawn), depth)])
    position[len(pressed) :, :2] = drawn[:, None] * across
    count = len(position)
    return Touch("press", surface, foot + position, np.full(count, pitch), np.full(count, roll), friction)


def _samples(skin: SkinModel) -> Array:
    """Return forces of touches on linear skin and of their mirror images, shape (s, 3 m)."""
    cases = [
        (flat(), 0.0, 0.0), (flat(), 0.3, 0.0), (flat(), -0.2, 0.25), (flat(), 0.1, 0.3),
        (ball(4e-3), 0.0, 0.0), (ball(10e-3), 0.2, 0.2), (rod(5e-3), 0.0, 0.0), (rod(8e-3, "y"), 0.1, 0.15),
        (edge(0.2e-3), 0.0, 0.0), (edge(0.2e-3), 0.15, 0.2),
    ]  # fmt: skip
    linear = skin.with_stiffening(None)
    turned = mirrored(skin)
    out = []
    for number, (surface, pitch, roll) in enumerate(cases):
        heading = 2.4 * number
        across = (float(np.cos(heading)), float(np.sin(heading)))
        touch = press(skin, surface, 2e-3, slide=3e-3, pitch=pitch, roll=roll, across=across, step=0.25e-3)
        path = on_nodes(linear, 1e-4)
        forces = [path.step(touch.bodies(i)).solution.force for i in range(len(touch.position))]
        out += [f for force in forces[3::4] for f in (force, force[turned] * MIRROR)]
    return np.array(out).reshape(len(out), -1)


def mirrored(skin: SkinModel) -> NDArray[np.intp]:
    """Return which pad node is on the other side of X = 0 from each, shape (m,)."""
    from scipy.spatial import cKDTree

    far, other = cKDTree(skin.positions).query(skin.positions * MIRROR)
    assert far.max() < 1e-9, "the pad is not symmetric"
    return np.asarray(other)


def closed_loop(skin: SkinModel, depth: Array, slide: Array, friction: float, tolerance: float) -> tuple[float, float]:
    """Return the work of a plane on the finger over press, slide, return and release, and of the press alone [J].

    Args:
        depth, slide: of the plane on its way [m], from zero on.
    """
    foot = skin.positions[skin.positions[:, 2].argmin()]
    ways = [(0.0, d) for d in depth] + [(x, depth[-1]) for x in slide[1:]] + [(x, depth[-1]) for x in slide[-2::-1]]
    ways += [(0.0, d) for d in depth[-2::-1]]
    path, work, pressing, place, force = on_nodes(skin, tolerance), 0.0, 0.0, foot, np.zeros(3)
    for n, (x, z) in enumerate(ways):
        now = foot + np.array([x, 0.0, z])
        step = path.step([ContactBody(flat(), translation=now, friction=friction)])
        assert step.solution.converged
        total = step.solution.force.sum(axis=0)
        work += 0.5 * float((force + total) @ (now - place))
        place, force = now, total
        if n == len(depth) - 1:
            pressing = work
    return work, pressing
