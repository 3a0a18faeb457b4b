"""What a mesh resolves of a pin array: gains against closed forms, and inverse methods on a coarse skin."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from core.contact.skin_sampler import SkinSampler
from core.devices import pin_array
from core.devices.pin_array import PinContacts, PinLayout
from core.matching import pin_resolution, pins
from core.matching.deformation import RANK_TOLERANCE
from core.matching.pin_report import compare
from core.presets import Library
from core.scene.sliding import sliding_plane
from core.scene.tactile_scene import DeviceUse
from core.skin.model import fingertip_skin

SPREAD = 0.8e-3
UP = np.array([0.0, 0.0, 1.0])
SPEC = Library().device("pin_array_128")


@pytest.mark.parametrize("distance", [0.3e-3, 1.5e-3, 4e-3])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_two_pins_have_two_gains(distance, angle):
    """Overlap e: alike sqrt(1 + e), against each other sqrt(1 - e)."""
    points = np.array([[0.0, 0.0, 0.0], [distance, 0.0, 0.0]])
    directions = np.array([UP, [np.sin(angle), 0.0, np.cos(angle)]])
    overlap = np.exp(-(distance**2) / (4 * SPREAD**2)) * np.cos(angle)
    exact = np.sqrt((1 - overlap) / (1 + overlap))
    assert pin_resolution.weakest_gain(points, directions, SPREAD) == pytest.approx(exact, rel=1e-12)


def test_one_pin_is_as_strong_as_itself():
    assert pin_resolution.weakest_gain(np.zeros((1, 3)), UP[None], SPREAD) == 1.0


def flat(points, nodes):
    """A for pins pressing straight onto a plane of nodes."""
    count = len(points)
    layout = PinLayout(points, np.tile(UP, (count, 1)), 0.4, 5e-3, SPREAD, 0.0)
    met = PinContacts(points, np.ones(count, dtype=bool), np.zeros(count), ())
    return layout, met, pin_array.distribution(layout, met, nodes)


def grid(step, half):
    line = np.arange(-half, half + step / 2, step)
    x, y = np.meshgrid(line, line)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def test_a_fine_mesh_has_the_gains_of_real_skin_and_sees_every_pattern():
    points = grid(1.5e-3, 3e-3)
    layout, met, distribution = flat(points, grid(0.3e-3, 8e-3))
    gains = np.linalg.svd(distribution, compute_uv=False)
    exact = pin_resolution.weakest_gain(points, layout.directions, SPREAD)
    assert gains[-1] / gains[0] == pytest.approx(exact, rel=2e-2)  # the mesh's Gaussians end at three deviations
    assert gains[-1] / gains[0] > pin_resolution.tolerance_of(layout, met)


def test_a_pattern_that_the_nodes_cannot_tell_is_not_seen():
    """Twelve pins over nine nodes: at least three patterns press on nothing."""
    points = grid(1.5e-3, 3e-3)[:12]
    layout, met, distribution = flat(points, grid(3e-3, 3e-3))
    gains = np.linalg.svd(distribution, compute_uv=False)
    assert (gains > pin_resolution.tolerance_of(layout, met) * gains[0]).sum() <= 9


def test_no_pin_on_the_skin_leaves_rounding_alone():
    layout, met, _ = flat(np.zeros((1, 3)), grid(1e-3, 1e-3))
    missed = PinContacts(met.points, np.zeros(1, dtype=bool), met.travel, ())
    assert pin_resolution.tolerance_of(layout, missed) == RANK_TOLERANCE


@functools.cache
def felt(level):
    scene = sliding_plane(1e-3, slide=0.5)
    sampler = SkinSampler(scene, {0: fingertip_skin(level=level)})
    for chunk in scene.chunks:
        sampler.add(chunk)
    return sampler.finish()[0]


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_inverse_methods_press_on_a_coarse_skin_as_on_the_standard_one():
    """Both meshes are of the same finger, so relative to the target a method presses alike."""
    ratios = {}
    for level in ("draft", "standard"):
        ratios[level] = np.array([r.normal_force / r.target_normal for r in compare(felt(level), SPEC)])
    assert ratios["draft"] == pytest.approx(ratios["standard"], rel=0.3)  # FM1 clamps what is ill-posed there


def test_the_standard_skin_sees_every_pattern_of_the_papers_array():
    matcher = pins.setup(fingertip_skin(level="standard"), SPEC).matcher
    assert matcher.controllable_patterns == len(matcher.active) == 128
    expected = np.linalg.pinv(pins.setup(fingertip_skin(level="standard"), SPEC).distribution)
    assert np.abs(matcher.force_inverse - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("level", "method", "told"),
    [("draft", "FM1", True), ("draft", "DM0", True), ("draft", "DM2", False), ("standard", "FM1", False)],
)
def test_an_inverse_on_a_mesh_coarser_than_the_pins_is_told(level, method, told):
    use = DeviceUse("pin_array_128", {"pin_method": method})
    rendered = pins.render(None, sliding_plane(1e-3, slide=0.5), 0, use, SPEC, felt(level))
    found = [f for f in rendered.findings if f.code == "coarse-skin"]
    assert len(found) == told
    if told:
        assert found[0].severity == "warning" and method in found[0].what
        nodes = (
            np.abs(pins.setup(fingertip_skin(level=level), SPEC).distribution).reshape(-1, 3, 128).max(axis=(1, 2)) > 0
        )
        assert found[0].value == f"{nodes.sum()} nodes under 126 pins"
