"""A press without a scene is a bake in the same place."""

from __future__ import annotations

import numpy as np
import pytest

from core.experiment import fingertip, press
from core.skin.model import SkinModel
from core.surface import shapes
from core.surface.gap import Surface
from tests.presses import SURFACES, baked

NAMES = ("plate", "ball of 5 mm", "edge of 90 degrees", "edge of 60 degrees")
LIMIT = 0.01  # of the force


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip(level="draft")


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("depth", [0.5e-3, 1.5e-3])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("contact", ["points", "nodes"])
def test_it_is_a_bake_in_the_same_place(contact: str, name: str, depth: float, skin: SkinModel) -> None:
    if contact == "nodes" and name.startswith("edge"):
        pytest.skip("at nodes an edge is told as smaller than the mesh")
    touch = press(skin, SURFACES[name], depth, friction=0.3, contact=contact, at=(0.7e-3, 1.1e-3))
    assert touch.place is not None
    force = baked(SURFACES[name], touch.place, depth, 0.3, contact)[-1].sum(axis=0)
    assert np.linalg.norm(force - touch.force.sum(axis=0)) <= LIMIT * np.linalg.norm(force)


def test_nothing_felt_in_the_skin_is_told(skin: SkinModel) -> None:
    """A needle between nodes came with 0 N and without a word."""
    touch = press(skin, Surface.sphere(0.3e-3), 0.3e-3, contact="nodes", at=(0.4e-3, 0.4e-3))
    assert not touch.force.any() and "smaller-than-mesh" in [f.code for f in touch.findings]


def test_what_a_bake_says_of_a_needle_is_said(skin: SkinModel) -> None:
    touch = press(skin, Surface.sphere(0.3e-3), 1.5e-3, friction=0.0)
    assert {f.code for f in touch.findings} & {"slips-in", "passed-through"}
    assert all(f.frame is None for f in touch.findings), "a press has no frames"


def test_what_a_bake_says_of_a_corner_is_said(skin: SkinModel) -> None:
    vertices, triangles = shapes.block(10e-3, 10e-3, 10e-3)
    corner = Surface.build(vertices + [5e-3, 5e-3, 0.0], triangles)
    for contact, told in (("points", ["sharp-corner"]), ("nodes", [])):
        touch = press(skin, corner, 0.3e-3, friction=0.0, contact=contact, at=(0.0, 0.0))
        assert [f.code for f in touch.findings if f.code == "sharp-corner"] == told
