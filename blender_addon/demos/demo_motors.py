"""Build the examples for platforms: the six interactions of [S2].

They are keyed animations, with wobble and repetitions.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from .._core import core
from ..devices import skin_models
from . import demo_shapes, demo_stage, touches

NAME = "Dermis Motors"


def build(which: str, device: str = touches.PLATFORM, seed: int = 0) -> bpy.types.Scene:
    """Return a new scene with one of the six interactions.

    Args:
        which: 'flat', 'back', 'tip', 'left', 'right' or 'complex'. seed: seed of the hand's wobble.

    Raises:
        DermisError: there is no such interaction.
    """
    interactions = core.design.interactions
    model: Any = skin_models.get({}, "draft", wait=True)
    touch = interactions.interaction(which, felt_at(model), seed=seed)
    scene = demo_stage.begin(f"{NAME}: {touches.MOTORS[which][0]}", int(interactions.FPS), touch.frame_range[1])
    finger = demo_stage.finger_with_skin(scene, "Index", device, level="draft")
    finger.dermis.finger.skin.contact = core.parameters.skin.CONTACT  # as in the look-up table, even for a draft
    scene.dermis.sample_rate = interactions.RATE
    scene.dermis_design.device = device
    slab = interactions.slab()
    surface = demo_stage.add(scene, "Surface", demo_shapes.mesh("Surface", slab.vertices, slab.triangles.tolist()))
    demo_stage.touchable(surface, interactions.FRICTION)
    surface.display_type = "BOUNDS"  # so that the finger is visible
    (chunk,) = touch.chunks
    _key(surface, chunk.frames, chunk.bodies[0])
    return demo_stage.finish(scene, (-0.09, 0.17, 0.05), (0.0, 0.0, 0.002))


def felt_at(model: Any) -> Any:
    """Return the points from which depth is measured [m].

    They are those on which contact is solved; from others, presses of an edge would be too deep.
    """
    pad = core.skin.surface_store.smooth_pad(model)
    return model.positions if pad is None else pad.cells.positions


def _key(obj: bpy.types.Object, frames: np.ndarray, poses: np.ndarray) -> None:
    """Key location and rotation at every sample, between whole frames too.

    The wobble is part of the touch.
    """
    obj.rotation_mode = "QUATERNION"
    turns = [Matrix(pose[:3, :3].tolist()).to_quaternion() for pose in poses]
    demo_stage.key(obj, "location", np.column_stack([frames, poses[:, :3, 3]]), "LINEAR")
    demo_stage.key(obj, "rotation_quaternion", np.column_stack([frames, turns]), "LINEAR")
