"""Which frames of a scene are sampled, and when they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from .._core import Array, core

if TYPE_CHECKING:
    from fractions import Fraction


def frames_per_second(scene: bpy.types.Scene) -> Fraction:
    """Return fps / fps_base as the simplest fraction that Blender's single precision stands for (30000/1001)."""
    from fractions import Fraction

    base = scene.render.fps_base
    denominator = 1
    while True:
        fraction = Fraction(base).limit_denominator(denominator)
        if fraction > 0 and np.float32(float(fraction)) == np.float32(base):
            return Fraction(scene.render.fps) / fraction
        denominator *= 10


def frame_range(scene: bpy.types.Scene) -> tuple[int, int]:
    """Return the range to bake: Dermis' own, else the preview range where it is on, else the scene's."""
    settings = scene.dermis
    if settings.use_range:
        return settings.frame_start, settings.frame_end
    if scene.use_preview_range:
        return scene.frame_preview_start, scene.frame_preview_end
    return scene.frame_start, scene.frame_end


def sweep_frames(fps: Fraction, span: tuple[int, int], rate: float) -> tuple[Array, Array]:
    """Return the frames that Blender can evaluate nearest to a steady rate, and their times [s] from the first."""
    frames, _ = core.scene.tactile_scene.sample_frames(fps, span, rate)
    frames = frames.astype(np.float32).astype(np.float64)
    return frames, (frames - span[0]) * fps.denominator / fps.numerator
