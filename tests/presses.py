"""Surfaces that are pressed straight into a fingertip, and the same presses as bakes."""

from __future__ import annotations

import numpy as np

from core.arrays import Array
from core.contact.single_touch import STEP
from core.pipeline.render import render
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, Finger
from core.steps import drain
from core.surface import shapes
from core.surface.gap import Surface

RATE = 240.0  # [Hz]: steps as long as a press's are then 24 mm/s


def edge(degrees: float) -> Surface:
    """Return an edge that points up, as sharp as shapes go."""
    return Surface.build(*shapes.edge(np.radians(degrees), 1e-6, length=0.06, height=0.02))


SURFACES = {
    "plate": Surface.block(0.1, 0.1),
    "ball of 5 mm": Surface.sphere(5e-3),
    "ball of 1 mm": Surface.sphere(1e-3),
    "edge of 120 degrees": edge(120.0),
    "edge of 90 degrees": edge(90.0),
    "edge of 60 degrees": edge(60.0),
    "pillar of 2 mm": Surface.block(2e-3, 2e-3, 0.01),
}


def baked(
    surface: Surface, place: Array, depth: float, friction: float, contact: str = "points", level: str = "draft"
) -> Array:
    """Return the nodal forces [N] of a bake at the end of each step of a straight press, shape (steps + 1, m, 3).

    Args:
        place: of the surface's origin in the finger's axes at the end [m]. depth: beyond first contact there [m].
    """
    heights = np.concatenate([[depth + STEP], np.arange(round(depth / STEP), -1, -1) * STEP])
    way = [(-place[0], -place[1], float(up) - place[2]) for up in heights]
    own = {"skin_level": level, "skin_shown": True, "contact": contact, "solved_at": "samples"}
    body = Body("Body", surface.mesh, {"friction": friction})
    scene = scene_from_poses(RATE, [(Finger("Index", (), parameters=own), way)], [(body, (0.0, 0.0, 0.0))])
    felt = drain(render(scene, Library())).skins["Index"]
    return np.array([felt.force_at(i) for i in range(1, len(way))])
