"""The bake: a scene is sampled and rendered, a sample at a time, so that whoever asked can stop between two."""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import bpy

from ._core import core
from .devices import platform_devices, skin_models
from .film import film_objects
from .jobs import Steps
from .preferences import setting
from .sampling import scene_sweep

_kept: list[Any] = []  # what came of fingers in earlier bakes, once there was one


def forget() -> None:
    """Forget what came of earlier bakes: the next renders every finger."""
    _kept.clear()


def bake(
    scene: bpy.types.Scene, library: Any, *, span: tuple[int, int] | None = None, cores: int | None = None
) -> Steps:
    """Sample a scene and render it; yield progress after every sample, return the engine's `Bake`.

    The generator may be closed at any moment: frame and handlers are then as they were.

    Args:
        cores: to use; as the preferences say where None.

    Raises:
        DermisError: the scene cannot be sampled or rendered.
    """
    with film_objects.paused(scene):
        return (yield from _baked(scene, library, span, cores))


def _baked(scene: bpy.types.Scene, library: Any, span: tuple[int, int] | None, cores: int | None) -> Steps:
    yield core.pipeline.bake.Progress("preparing", 0, 1)
    yield from platform_devices.make_missing(scene)
    tactile = scene_sweep.sample(scene, span=span)
    sweep = tactile.chunks
    yield from skin_models.make_tables(tactile, library)
    skins = skin_models.solved_in(tactile, library)
    executor = core.work.processes.ProcessExecutor(cores or setting("bake_cores") or core.work.processes.cores())
    if not _kept:
        _kept.append(core.pipeline.kept_shares.KeptShares())
    render = core.pipeline.render.render
    steps = render(tactile, library, cache=skin_models.cache(), executor=executor, before=_kept[0])
    sampling_seconds = 0.0
    try:
        while True:
            start = time.perf_counter()
            ready = sweep.advance()
            sampling_seconds += time.perf_counter() - start
            if not ready:
                yield core.pipeline.bake.Progress("sampling", sweep.done, sweep.total)
                continue
            try:
                with skin_models.one_thread() if skins else nullcontext():
                    progress = next(steps)
                yield progress
            except StopIteration as stop:
                baked = stop.value
                # the sweep runs ahead of the pipeline's own clock, so that the job can stop between two samples
                seconds = dict(baked.stage_seconds)
                seconds["sampling"] = seconds.get("sampling", 0.0) + sampling_seconds
                return replace(baked, findings=(*baked.findings, *sweep.findings), stage_seconds=seconds)
    finally:
        steps.close()
        sweep.close()
        executor.close()
