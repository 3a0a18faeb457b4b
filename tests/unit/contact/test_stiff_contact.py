"""What any touch on skin that follows the neo-Hookean law must obey: on the nodes of a coarse finger."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")


from core.contact.solver.bodies import ContactBody
from core.contact.solver.cone import assess
from core.contact.solver.pad_points import PadPoints
from core.contact.solver.path_step import PathStep
from core.skin.assembly import degrees
from core.skin.model import SkinModel
from core.skin.stimulus import Stimulus
from core.surface.gap import Surface
from tests.exact.exact_finger import ExactFinger
from tests.exact.neo_hookean import NeoHookean
from tests.stiff import MIRROR, closed_loop, mirrored, on_nodes, press, stiff_skin
from tests.touches import Solid, Touch, ball, edge, flat, rod, solver_on

Array = NDArray[np.float64]
SHAPES = {"plane": flat, "ball": lambda: ball(5e-3), "rod": lambda: rod(6e-3), "edge": lambda: edge(0.2e-3)}


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return stiff_skin()


def follow(skin: SkinModel, touch: Touch, tolerance: float = 1e-6) -> list[PathStep]:
    path = on_nodes(skin, tolerance)
    return [path.step(touch.bodies(i)) for i in range(len(touch.position))]


def totals(steps: list[PathStep]) -> Array:
    return np.array([step.solution.force.sum(axis=0) for step in steps])


@pytest.mark.parametrize("shape", SHAPES)
def test_pressing_deeper_never_pulls_and_takes_ever_more_force(skin: SkinModel, shape: str) -> None:
    touch = press(skin, SHAPES[shape](), 2e-3, step=0.1e-3)
    steps = follow(skin, touch)
    assert all(step.solution.converged for step in steps)
    for step in steps:
        assert step.solution.normal_force.min() >= -1e-9 * np.abs(step.solution.force).max()
    up = totals(steps)[:, 2]
    assert (np.diff(up) > 0.0).all()
    assert (np.diff(up, 2) > 0.0)[2:].mean() > 0.7  # ever more a millimetre; nodes that come to touch are steps
    linear = totals(follow(skin.linear, touch))[:, 2]
    assert up[-1] > 1.05 * linear[-1]


def test_a_card_is_felt_like_a_block(skin: SkinModel) -> None:
    foot = skin.positions[skin.positions[:, 2].argmin()]
    force = []
    for thickness in (0.02, 0.5e-3):
        path, surface = on_nodes(skin), Surface.block(height=thickness)
        for depth in np.arange(1, 16) * 0.1e-3:
            step = path.step([ContactBody(surface, translation=foot + [0.0, 0.0, depth], friction=0.6)])
        force.append(step.solution.force)
    assert np.linalg.norm(force[1] - force[0]) <= 1e-4 * np.linalg.norm(force[0])


def test_a_touch_that_begins_in_contact_is_the_end_of_its_path(skin: SkinModel) -> None:
    fine, once = (press(skin, flat(), 1.5e-3, friction=0.0, step=step) for step in (0.1e-3, 1.5e-3))
    along, at_once = (follow(skin, touch)[-1] for touch in (fine, once))
    assert at_once.solution.converged
    off = np.linalg.norm(at_once.solution.force - along.solution.force)
    assert off <= 1e-3 * np.linalg.norm(along.solution.force)
    assert along.amounts is not None and at_once.amounts is not None
    assert np.linalg.norm(at_once.amounts - along.amounts) <= 1e-3 * np.linalg.norm(along.amounts)


def loop(skin: SkinModel, friction: float) -> tuple[float, float]:
    return closed_loop(skin, np.linspace(0.0, 1.5e-3, 16), np.linspace(0.0, 2e-3, 21), friction, 1e-6)


def test_a_closed_loop_gives_no_energy_and_friction_takes_some(skin: SkinModel) -> None:
    work, pressing = loop(skin, 0.0)
    assert abs(work) <= 1e-3 * pressing  # of a trapezium's error in both ways of the same press
    work, pressing = loop(skin, 0.5)
    assert work > 0.05 * pressing


@pytest.mark.parametrize("shape", ["plane", "ball"])
def test_what_is_held_does_not_creep(skin: SkinModel, shape: str) -> None:
    touch = press(skin, SHAPES[shape](), 1.5e-3, slide=2e-3)
    path = on_nodes(skin)
    for i in range(len(touch.position)):
        path.step(touch.bodies(i))
    last, forces = touch.bodies(-1)[0], []
    for n in range(110):  # no frame is the same pose again, which would not be solved
        shaken = last.translation + np.array([0.0, 0.0, 1e-10 * (-1) ** n])
        forces.append(path.step([ContactBody(last.surface, last.rotation, shaken, last.friction)]).solution.force)
    settled = forces[9]  # what is bent is looked at anew where skin came to lie
    assert np.linalg.norm(forces[-1] - settled) <= 1e-5 * np.linalg.norm(settled)


def test_a_mirrored_touch_gives_mirrored_forces(skin: SkinModel) -> None:
    other = mirrored(skin)
    found = []
    for side in (1.0, -1.0):
        touch = press(skin, ball(6e-3), 1.5e-3, slide=1.5e-3, roll=side * 0.2, across=(side * 0.8, 0.6))
        found.append(follow(skin, touch)[-1].solution.force)
    assert np.linalg.norm(found[1] - found[0][other] * MIRROR) <= 1e-3 * np.linalg.norm(found[0])


def test_forces_scale_with_stiffness(skin: SkinModel) -> None:
    touch = press(skin, rod(6e-3), 1.5e-3, slide=1e-3)
    soft, stiff = (follow(skin.with_material(alpha=alpha), touch)[-1] for alpha in (1.0, 4.0))
    off = np.linalg.norm(stiff.solution.force - 4.0 * soft.solution.force)
    assert off <= 1e-5 * np.linalg.norm(stiff.solution.force)


def test_light_touches_are_linear_and_the_difference_is_of_first_order(skin: SkinModel) -> None:
    off = []
    for depth in (0.1e-3, 0.05e-3):
        touch = press(skin, ball(15e-3), depth, step=depth)
        stiff, linear = (follow(s, touch, 1e-7)[-1].solution.force for s in (skin, skin.linear))
        off.append(np.linalg.norm(stiff - linear) / np.linalg.norm(linear))
    assert off[1] < 0.02
    assert off[0] / off[1] == pytest.approx(2.0, abs=0.5)


def test_a_step_that_is_taken_back_and_taken_again_gives_the_same(skin: SkinModel) -> None:
    touch = press(skin, edge(0.2e-3), 1.5e-3, slide=1.5e-3)
    path = on_nodes(skin)
    for i in range(6):
        path.step(touch.bodies(i))
    path.step(touch.bodies(6))
    state = path.save()
    first = [path.step(touch.bodies(i)).solution.force for i in range(7, 12)]
    path.restore(state)
    again = [path.step(touch.bodies(i)).solution.force for i in range(7, 12)]
    assert [a.tobytes() for a in first] == [b.tobytes() for b in again]


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("shape", SHAPES)
def test_tissue_is_in_balance_and_the_laws_hold_where_it_lies(skin: SkinModel, shape: str) -> None:
    """Each frame against the law in double precision, at the displacement that is found again from what is kept."""
    law, free = NeoHookean(skin.mesh, skin.material.poisson), degrees(skin.mesh.free)
    touch = press(skin, SHAPES[shape](), 1.8e-3, slide=2e-3)
    rho = float(np.sqrt(np.prod(np.linalg.eigvalsh(skin.compliance)[[0, -1]])))
    for step in follow(skin, touch):
        force, found = step.solution.force, step.solution
        assert step.amounts is not None and step.gaps is not None and found.converged
        moved = Stimulus(skin, force, given=step.amounts).displacement
        left = skin.material.modulus * law.forces(law.response(moved[None, None]).piola)[0, 0]
        left[skin.mesh.pad] -= force
        assert np.linalg.norm(left.ravel()[free]) <= 2e-2 * np.linalg.norm(force) + 1e-9
        apart = moved[skin.mesh.pad] - step.displacement
        assert np.linalg.norm(apart) <= 1e-5 * np.linalg.norm(moved[skin.mesh.pad])
        # above an edge a normal of no length is left where nothing is felt yet
        near = (step.gaps.body >= 0) & (np.einsum("ij,ij->i", found.normals, found.normals) > 0.5)
        relative = found.displacement + apart
        assert assess(force[near], relative[near], found.normals[near], found.friction[near], 1 / rho)[0] < 2e-4
        assert not force[~near].any()


def test_points_and_nodes_agree_as_they_do_on_linear_skin(skin: SkinModel) -> None:
    touch = press(skin, Surface.sphere(10e-3, 20_000), 1.6e-3, slide=1e-3)
    apart = []
    for one in (skin.linear, skin):
        nodes = totals(follow(one, touch))
        path = solver_on(one)
        points = np.array([path.step(touch.bodies(i)).solution.force.sum(axis=0) for i in range(len(touch.position))])
        assert isinstance(path.contact_points, PadPoints)
        apart.append(np.linalg.norm(points[4:] - nodes[4:], axis=1) / np.linalg.norm(nodes[4:], axis=1))
    assert (apart[1] <= apart[0] + 0.05).all()


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("shape", ["plane", "tilted", "ball"])
@pytest.mark.parametrize(("depth", "slide"), [(4e-3, 0.0), (2e-3, 6e-3)])
def test_far_beyond_its_range_it_is_graceful_and_no_worse_than_linear(
    skin: SkinModel, shape: str, depth: float, slide: float
) -> None:
    surface: Solid = ball(8e-3) if shape == "ball" else flat()
    touch = press(skin, surface, depth, slide=slide, pitch=0.25 if shape == "tilted" else 0.0, step=0.5e-3)
    exact = ExactFinger(skin)
    before, truth = None, []
    for i in range(len(touch.position)):
        truth.append(exact.step(touch.bodies(i), before).force.sum(axis=0))
        before = touch.bodies(i)
    off = []
    for one in (skin, skin.linear):
        path = on_nodes(one, 3e-5)
        steps = [path.step(touch.bodies(i)) for i in range(len(touch.position))]
        assert all(np.isfinite(step.solution.force).all() for step in steps)
        told = {finding.code for finding in path.findings}
        assert all(step.solution.converged for step in steps) or "not-converged" in told
        off.append(np.linalg.norm(totals(steps) - truth, axis=1) / np.linalg.norm(truth, axis=1))
    assert off[0][-1] <= off[1][-1] + 0.02
    assert np.median(off[0]) <= np.median(off[1])
