"""Bake a scene: sample and render it, one sample at a time.

The caller can stop between two samples.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import bpy

from . import reporting
from ._core import DermisError, core
from .devices import platform_devices, skin_models
from .film import film_objects
from .jobs import Steps
from .preferences import setting
from .results import owners, same_inputs, store
from .sampling import scene_sweep

_kept: list[Any] = []  # empty, or one `KeptShares`: the results of fingers in earlier bakes


def forget() -> None:
    """Forget the results of earlier bakes: the next bake renders every finger."""
    _kept.clear()


def bake(
    scene: bpy.types.Scene,
    library: Any,
    *,
    span: tuple[int, int] | None = None,
    cores: int | None = None,
    noted: Callable[[store.Taken], None] | None = None,
) -> Steps:
    """Sample a scene and render it; return the engine's `Bake`.

    The generator yields progress after every sample. It may be closed at any moment, and then restores frame and
    handlers.

    Args:
        cores: number of cores to use; if None, as many as the preferences say.
        noted: called with the state of the scene at sampling, which `store.keep` needs.

    Raises:
        DermisError: the scene cannot be sampled or rendered.
    """
    with film_objects.paused(scene):
        return (yield from _baked(scene, library, span, cores, noted))


def keep(scene: bpy.types.Scene, made: Any, taken: store.Taken) -> list[Any]:
    """Keep a bake in memory and in a file outside the .blend; return findings.

    These are the findings of the bake and, if it could not be stored, the reason.

    Args:
        taken: the state of the scene at sampling.
    """
    kept, found = store.keep(scene, made, taken), list(made.all_findings)
    try:
        store.store(scene, kept)
    except ValueError as error:  # a full disk must not cost the bake
        found.append(reporting.as_finding(error))
    return found


def prepared(scene: bpy.types.Scene, library: Any) -> Steps:
    """Bake a scene if it has no bake or an outdated one.

    The generator yields progress, and returns whether the scene was baked.

    Raises:
        DermisError: the scene cannot be sampled or rendered.
    """
    if store.state(scene, wait=True) not in ("none", "stale"):
        return False
    taken: list[store.Taken] = []
    made = yield from bake(scene, library, noted=taken.append)
    reporting.show(tuple(keep(scene, made, taken[0])), f"Bake of {scene.name}", scene)
    return True


def verified(scene: bpy.types.Scene, library: Any) -> Steps:
    """Sample a scene again, and refuse a bake that other inputs made.

    The generator yields progress. It samples the frames that were baked. If the inputs do not differ from the bake's,
    the bake is confirmed. The comparison finds every change of the inputs, whoever made it. A bake of recordings is
    not checked.

    Raises:
        DermisError: the inputs differ (the message names the differences); there is no bake; or the bake does not name
            its inputs.
    """
    result, where = store.current(scene), f"scene '{scene.name}'"
    if result is None:
        raise DermisError("the scene has no bake", where=where, remedy="Bake first")
    if result.bake.recorded:
        return  # the tracks follow recordings, so the scene does not matter
    if not result.bake.inputs:
        raise DermisError(
            "the bake is of an earlier version of Dermis: changes of the scene since then cannot be detected",
            where=where,
            remedy="Bake again",
            code="bake-unchecked",
        )
    with film_objects.paused(scene):
        tactile = scene_sweep.sample(scene, span=(int(result.clock.first), result.last))
        taken, sweep = store.Taken.of(scene, (yield from same_inputs.reading(scene))), tactile.chunks
        steps = core.pipeline.inputs.sampled(tactile, library)
        try:
            while True:
                if not sweep.advance():
                    yield core.pipeline.bake.Progress("sampling again", sweep.done, sweep.total)
                    continue
                try:
                    next(steps)
                except StopIteration as stop:
                    now = stop.value
                    break
        finally:
            steps.close()
            sweep.close()
    result = store.current(scene)
    if result is None:
        raise DermisError("the bake was removed meanwhile", where=where, remedy="Bake again")
    differ = core.scene.content_hash.differences(owners.inputs_now(result), now)
    if differ:
        store.outdate(scene)
        raise DermisError(
            "the scene has changed since the bake",
            where=where,
            value="; ".join(differ[:4]) + (f"; {len(differ) - 4} more" if differ[4:] else ""),
            remedy="Bake again",
            code="bake-outdated",
        )
    store.confirm(scene, taken)


def _baked(
    scene: bpy.types.Scene,
    library: Any,
    span: tuple[int, int] | None,
    cores: int | None,
    noted: Callable[[store.Taken], None] | None,
) -> Steps:
    yield core.pipeline.bake.Progress("preparing", 0, 1)
    yield from platform_devices.make_missing(scene)
    tactile = scene_sweep.sample(scene, span=span)
    if noted is not None:
        noted(store.Taken.of(scene, (yield from same_inputs.reading(scene))))
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
                # The sweep runs here, so that the job can stop between two samples. The pipeline does not time it.
                seconds = dict(baked.stage_seconds)
                seconds["sampling"] = seconds.get("sampling", 0.0) + sampling_seconds
                return replace(baked, findings=(*baked.findings, *sweep.findings), stage_seconds=seconds)
    finally:
        steps.close()
        sweep.close()
        executor.close()
