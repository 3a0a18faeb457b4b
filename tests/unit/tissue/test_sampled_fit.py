"""Tissue told in a few fields on a few elements, against the exact law on all of them."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.typing import NDArray

from core.skin.assembly import degrees
from core.skin.model import SkinModel, fingertip_skin
from core.stiffening.sampled_energy import SampledEnergy
from core.stiffening.sampled_tissue import SampledTissue
from core.tissue.exact_finger import ExactFinger
from core.tissue.held_tissue import HeldTissue
from core.tissue.neo_hookean import NeoHookean
from core.tissue.sampled_fit import Bases, SampledSize, fit_bases, fit_sampled, on_elements
from core.tissue.stiffening_fit import reach_of
from tests.problems import cube_mesh
from tests.stiff import press
from tests.touches import ball, flat, rod

Array = NDArray[np.float64]
SIZE = SampledSize(patterns=24, beneath=24, pressures=24, elements=250)


@functools.cache
def _skin() -> SkinModel:
    return fingertip_skin(level="draft")


@functools.cache
def _law() -> NeoHookean:
    return NeoHookean(_skin().mesh, _skin().material.poisson)


@functools.cache
def _states() -> tuple[Array, Array]:
    """Return displacements of all nodes [m] and forces of the pad over E, of exact touches."""
    skin, finger = _skin(), ExactFinger(_skin(), 1e-7)
    moved, forces = [], []
    for surface, slide in ((flat(), 1.2e-3), (ball(5e-3), 1.2e-3), (rod(6e-3), 0.0)):
        finger.reset()
        touch, before = press(skin, surface, 1.4e-3, slide=slide, step=0.2e-3), None
        for i in range(len(touch.position)):
            held = finger.step(touch.bodies(i), before)
            before = touch.bodies(i)
            moved.append(held.displacement)
            forces.append(held.force.ravel() / skin.material.modulus)
    return np.array(moved), np.array(forces)


@functools.cache
def _bases() -> Bases:
    stiffness = np.linalg.inv(_skin().unit_compliance)
    return fit_bases(HeldTissue(_law()), 0.5 * (stiffness + stiffness.T), _states()[0], SIZE)


@functools.cache
def _whole() -> SampledTissue:
    volumes = np.asarray(_skin().mesh.volumes)
    return on_elements(_law(), _bases(), np.arange(len(volumes)), volumes)


@functools.cache
def _few() -> SampledTissue:
    return fit_sampled(_law(), _bases(), SIZE)


def _deep() -> list[int]:
    return [6, 12, 19, 25, 32]  # pressed and drawn, three touches


def test_patterns_store_half_and_fields_leave_the_pad_alone() -> None:
    bases, pad = _bases(), degrees(_skin().mesh.pad)
    stored = bases.pad @ np.linalg.solve(_skin().unit_compliance, bases.pad.T)
    np.testing.assert_allclose(stored, np.eye(len(stored)), atol=1e-6)
    assert np.abs(bases.beneath.reshape(len(bases.beneath), -1)[:, pad]).max() == 0.0
    np.testing.assert_allclose(bases.linear.reshape(len(stored), -1)[:, pad], bases.pad, atol=1e-15)


@pytest.mark.parametrize(("few", "within"), [(False, 0.02), (True, 0.06)])
def test_exact_states_are_balanced(few: bool, within: float) -> None:
    """The pad's forces beyond linear tissue's are those of the exact law, and nothing is left beneath."""
    bases, tissue = _bases(), _few() if few else _whole()
    k = tissue.count
    for state in _deep():
        amounts = bases.amounts[state]
        wanted = bases.pad @ _states()[1][state] - amounts[:k]
        energy = SampledEnergy(tissue)
        for share in (0.25, 0.5, 0.75, 1.0):
            force = energy.force_and_stiffness(share * amounts[:k])[0]
        assert energy.left < 1e-4
        linear = np.linalg.norm(bases.pad @ _states()[1][state])
        assert np.linalg.norm(wanted) > 2.0 * within * linear, "tissue hardly stiffens there"
        assert np.linalg.norm(force - wanted) < within * linear


def test_the_force_is_the_slope_of_the_energy() -> None:
    energy, q = SampledEnergy(_few()), _bases().amounts[12][: _few().count]
    for share in (0.3, 0.6, 1.0):
        force = energy.force_and_stiffness(share * q)[0]
    way = 0.02 * np.linalg.norm(q) * _bases().amounts[19][: len(q)] / np.linalg.norm(_bases().amounts[19][: len(q)])
    risen = energy.value(q + way) - energy.value(q - way)
    assert abs(2.0 * float(force @ way) - risen) < 0.01 * abs(risen)


def test_a_state_that_is_asked_for_again_is_not_worked_out_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is shown of a touch asks for the forces that its contact was solved with."""
    energy, asked = SampledEnergy(_few()).followed(), []
    worked_out = SampledTissue._forces
    monkeypatch.setattr(SampledTissue, "_forces", lambda self, q, x: asked.append(0) or worked_out(self, q, x))
    q = 0.5 * _bases().amounts[_deep()[0], : energy.count]
    told = energy.force_and_stiffness(q)[0]
    count, size = len(asked), float(np.abs(told).max())
    assert count > 0
    np.testing.assert_allclose(energy.force(energy.amounts(q)), told, atol=1e-3 * size)
    assert len(asked) == count


def test_tangent_is_the_slope_of_the_forces() -> None:
    tissue, amounts = _few(), _bases().amounts[12]
    k, way = tissue.count, 0.02 * (_bases().amounts[19] - amounts)
    more = np.concatenate(tissue.forces((amounts + way)[:k], (amounts + way)[k:]))
    less = np.concatenate(tissue.forces((amounts - way)[:k], (amounts - way)[k:]))
    told = 2.0 * tissue.tangent(amounts[:k], amounts[k:]) @ way
    assert np.linalg.norm(more - less - told) < 0.01 * np.linalg.norm(told)


def test_small_loads_find_linear_tissue() -> None:
    q = _bases().amounts[12][: _few().count]
    sizes = [np.linalg.norm(SampledEnergy(_few()).force_and_stiffness(share * q)[0]) for share in (0.04, 0.02)]
    assert sizes[0] < 0.1 * 0.04 * np.linalg.norm(q)
    assert 3.5 < sizes[0] / sizes[1] < 4.6  # of second order


def _reached() -> Array:
    amounts = _bases().amounts[:, : _few().count]
    return np.asarray(reach_of(amounts))


def test_a_closed_way_gives_its_work_back() -> None:
    """Within reach the force is the slope of one energy, however it was come to."""
    energy, k = SampledEnergy(_few(), _reached()), _few().count
    one, other = _bases().amounts[12][:k], _bases().amounts[19][:k]
    work, moved, before = 0.0, 0.0, np.zeros(k)
    angles = np.linspace(0.0, 2.0 * np.pi, 65)
    places = [0.6 * one + 0.3 * (np.cos(a) - 1.0) * one + 0.3 * np.sin(a) * other for a in angles]
    for share in np.linspace(0.1, 1.0, 10):
        force = energy.force_and_stiffness(share * places[0])[0]
    first = force
    before = places[0]
    for place in places[1:]:
        after = energy.force_and_stiffness(place)[0]
        work += float(0.5 * (force + after) @ (place - before))
        moved += 0.5 * float(np.linalg.norm(force + after) * np.linalg.norm(place - before))
        force, before = after, place
    assert np.linalg.norm(force - first) < 1e-3 * np.linalg.norm(first)
    assert abs(work) < 2e-3 * moved


def test_beyond_what_was_seen_it_is_followed_no_more() -> None:
    """There force goes on without a jump, pushes back ever more, and the law is asked for nothing unseen."""
    k, reach = _few().count, _reached()
    way = _bases().amounts[12][:k] / np.linalg.norm(_bases().amounts[12][:k] / reach)
    energy = SampledEnergy(_few(), reach)
    assert np.linalg.norm(_bases().amounts[:, :k] / reach, axis=1).max() == pytest.approx(1.0)
    along = []
    for t in np.concatenate([np.linspace(0.1, 1.0, 10), np.linspace(1.1, 6.0, 50)]):
        force = energy.force_and_stiffness(t * way)[0]
        inside = energy.amounts(t * way)[k:] / max(t, 1.0)
        along.append(float((t * way + force) @ way))
        if t == 1.0:
            edge, beneath = force, inside
        if t > 1.0:
            np.testing.assert_allclose(inside, beneath, atol=1e-3 * np.linalg.norm(beneath))
    assert (np.diff(along) > 0.0).all()
    close = energy.force_and_stiffness(1.0001 * way)[0]
    assert np.linalg.norm(close - edge) < 1e-3 * np.linalg.norm(edge)
    told = energy.amounts(1.5 * way)
    energy.force_and_stiffness(1.5 * way)
    assert energy.far(told) == pytest.approx(1.5)


def test_amounts_say_what_was_found() -> None:
    """What a touch keeps gives the force again without seeking, and a saved state gives the same bytes."""
    k = _few().count
    energy, q = SampledEnergy(_few(), _reached()), _bases().amounts[12][:k]
    for share in (0.3, 0.6):
        energy.force_and_stiffness(share * q)
    state = energy.save()
    first = energy.force_and_stiffness(q)[0]
    told = energy.amounts(q)
    shared = SampledEnergy(_few(), _reached())
    assert np.linalg.norm(shared.force(told) - first) < 1e-4 * np.linalg.norm(first)
    energy.force_and_stiffness(0.2 * q)
    energy.restore(state)
    np.testing.assert_array_equal(energy.force_and_stiffness(q)[0], first)
    assert not shared.force(np.zeros(len(told))).any() and shared.x.max() == 0.0


def test_a_homogeneous_stretch_is_that_of_the_law() -> None:
    """A patch: where one pattern is a uniform stretch of a block, force and stress are those in closed form."""
    mesh = cube_mesh(3)
    tissue = NeoHookean(mesh, 0.4)
    first, shear = tissue.lame
    nodes = mesh.nodes
    size = float(np.ptp(nodes[:, 2]))
    bottom = nodes[:, 2].min()
    stretch = 0.95
    moved = np.zeros_like(nodes)
    moved[:, 2] = (stretch - 1.0) * (nodes[:, 2] - bottom)
    volumes = tissue.geometry.volumes
    pattern = moved[None] / size
    bases = Bases(
        np.zeros((1, 3 * len(mesh.pad))),
        pattern,
        np.zeros((1, *nodes.shape)),
        np.ones((1, len(nodes))),
        np.zeros((0, 0)),
    )
    few = on_elements(tissue, bases, np.arange(len(volumes)), np.asarray(volumes))
    pressure = first * np.log(stretch) / stretch  # of the law; linear tissue's is first * (stretch - 1)
    x = np.array([0.0, pressure - first * (stretch - 1.0)])
    force, rest = few.forces(np.array([size]), x)
    lengthened = volumes.sum() * (stretch - 1.0)
    nominal = shear * (stretch - 1.0 / stretch) + first * np.log(stretch) / stretch
    linear = (first + 2.0 * shear) * (stretch - 1.0)
    # powers of the pressure beyond the fourth are left out of the law in pressures
    assert float(force[0]) * size == pytest.approx((nominal - linear) * lengthened, rel=2e-2)
    assert abs(float(rest[1])) < 2e-2 * abs(pressure) * volumes.sum()


def test_sharpened_stiffness_is_the_slope_of_the_force() -> None:
    """Where a tangent from elsewhere would do for the force, and is off by more."""
    k = _few().count
    q = _bases().amounts[12][:k]
    energy, way = SampledEnergy(_few()), 0.01 * _bases().amounts[19][:k]
    for share in (0.4, 0.7, 0.85, 1.0):
        stale = energy.force_and_stiffness(share * q)[1]
    force, sharp = energy.sharpened(q)
    state = energy.save()
    more = energy.force_and_stiffness(q + way)[0]
    energy.restore(state)
    slope = 0.5 * (more - energy.force_and_stiffness(q - way)[0])
    assert np.linalg.norm(sharp @ way - slope) < 0.02 * np.linalg.norm(slope) < np.linalg.norm(stale @ way - slope)
    energy.restore(state)
    np.testing.assert_allclose(energy.force_and_stiffness(q)[0], force, atol=1e-4 * np.linalg.norm(force))


def test_a_step_that_is_too_long_says_so() -> None:
    energy, q = SampledEnergy(_few()), _bases().amounts[12][: _few().count]
    for share in (0.25, 0.5, 0.75, 1.0):
        energy.force_and_stiffness(share * q)
        assert not energy.astray
    energy.force_and_stiffness(-8.0 * q)
    assert energy.astray
