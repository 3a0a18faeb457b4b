"""A press without a scene is a bake in the same place."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.single_touch import STEP
from core.experiment import fingertip, press
from core.pipeline.render import render
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, Finger
from core.skin.model import SkinModel
from core.steps import drain
from core.surface import shapes
from core.surface.gap import Surface

RATE = 240.0
SURFACES = {
    "plate": Surface.block(0.1, 0.1),
    "ball": Surface.sphere(5e-3),
    "edge": Surface.build(*shapes.edge(np.pi / 2, 1e-6, length=0.06, height=0.02)),
    "tip": Surface.build(*shapes.edge(np.pi / 3, 1e-6, length=0.06, height=0.02)),
}
LIMIT = 0.01  # of the force


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip(level="draft")


def baked(surface: Surface, place: np.ndarray, depth: float, friction: float, contact: str) -> np.ndarray:
    """Return the nodal forces at the end of a bake that comes from a step above, by steps as long as a press's."""
    heights = np.concatenate([[depth + STEP], np.arange(round(depth / STEP), -1, -1) * STEP])
    way = [(-place[0], -place[1], float(up) - place[2]) for up in heights]
    own = {"skin_level": "draft", "skin_shown": True, "contact": contact}
    scene = scene_from_poses(
        RATE,
        [(Finger("Index", (), parameters=own), way)],
        [(Body("Body", surface.mesh, {"friction": friction}), (0.0, 0.0, 0.0))],
    )
    return drain(render(scene, Library())).skins["Index"].force_at(len(way) - 1)


@pytest.mark.parametrize("depth", [0.5e-3, 1.5e-3])
@pytest.mark.parametrize("name", sorted(SURFACES))
@pytest.mark.parametrize("contact", ["points", "nodes"])
def test_it_is_a_bake_in_the_same_place(contact: str, name: str, depth: float, skin: SkinModel) -> None:
    if contact == "nodes" and name in ("edge", "tip"):
        pytest.skip("at nodes an edge is told as smaller than the mesh")
    touch = press(skin, SURFACES[name], depth, friction=0.3, contact=contact, at=(0.7e-3, 1.1e-3))
    assert touch.place is not None
    force = baked(SURFACES[name], touch.place, depth, 0.3, contact).sum(axis=0)
    assert np.linalg.norm(force - touch.force.sum(axis=0)) <= LIMIT * np.linalg.norm(force)


def test_nothing_felt_in_the_skin_is_told(skin: SkinModel) -> None:
    """A needle between nodes came with 0 N and without a word."""
    touch = press(skin, Surface.sphere(0.3e-3), 0.3e-3, contact="nodes", at=(0.4e-3, 0.4e-3))
    assert not touch.force.any() and "smaller-than-mesh" in [f.code for f in touch.findings]


def test_what_a_bake_says_of_a_needle_is_said(skin: SkinModel) -> None:
    touch = press(skin, Surface.sphere(0.3e-3), 1.5e-3, friction=0.0)
    assert {f.code for f in touch.findings} & {"slips-in", "passed-through"}
    assert all(f.frame is None for f in touch.findings), "a press has no frames"
