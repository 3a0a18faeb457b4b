"""Build the example for pins: the experiment of [S1] as an animation.

A plane is pressed into the pad and slides along it.
"""

from __future__ import annotations

import bpy
import numpy as np

from .. import scene_time
from .._core import core
from . import demo_shapes, demo_stage

NAME = "Dermis Pin Array Demo"
DEVICE = "pin_array_128"
SIZE = (0.09, 0.09, 0.004)  # [m] size of the plane; its stroke is 20 mm in any direction


def build(depth: float = 2e-3, friction: float = 0.6, direction: float = 0.0) -> bpy.types.Scene:
    """Return a new scene.

    Args:
        depth: depth of the press [m]. friction: coefficient of friction. direction: direction of the slide [rad].
    """
    sliding = core.scene.sliding
    clock = scene_time.Clock(sliding.FPS, 1.0)
    frames = np.arange(1, 1 + round(clock.frames(sliding.SETTLE + sliding.SLIDE))).astype(np.float64)
    scene = demo_stage.begin(NAME, int(clock.rate), int(frames[-1]))
    demo_stage.finger_with_skin(scene, "Index", DEVICE)
    plane = demo_stage.touchable(demo_stage.add(scene, "Plane", demo_shapes.block(*SIZE)), friction)
    places = sliding.plane_offset(clock.seconds(frames), depth, direction)
    demo_stage.key(plane, "location", np.column_stack([frames, places]), "LINEAR")
    return demo_stage.finish(scene, (-0.05, 0.09, 0.05), (0.0, 0.0, 0.004))
