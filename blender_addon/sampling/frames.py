"""Which frames of a scene are sampled, and when they are."""

from __future__ import annotations

import bpy
import numpy as np

from .. import scene_time
from .._core import Array, core


def frame_range(scene: bpy.types.Scene) -> tuple[int, int]:
    """Return the range to bake: Dermis' own, else the preview range where it is on, else the scene's."""
    settings = scene.dermis
    if settings.use_range:
        return settings.frame_start, settings.frame_end
    if scene.use_preview_range:
        return scene.frame_preview_start, scene.frame_preview_end
    return scene.frame_start, scene.frame_end


def sweep_frames(scene: bpy.types.Scene, span: tuple[int, int], rate: float) -> tuple[Array, Array]:
    """Return the frames that Blender can evaluate nearest to a steady rate, and their times [s] from the first."""
    clock = scene_time.clock(scene, span[0])
    frames, _ = core.scene.tactile_scene.sample_frames(clock.rate, span, rate)
    frames = frames.astype(np.float32).astype(np.float64)
    return frames, clock.seconds(frames)
