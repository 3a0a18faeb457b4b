"""Shares of a bake: fingers that hold nothing together are independent, so processes of their own may render them.

Every process runs the same wheels with one BLAS thread and is given the same samples, so the bytes are those of one
process; with other wheels or on another processor results agree to some 1e-6.
"""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from concurrent.futures import wait
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import DermisError
from ..presets import Library
from ..scene import scene_file
from ..scene.tactile_scene import Chunk, TactileScene
from .bake import Progress
from .device_tracks import Driven
from .felt import touched
from .share_job import Share, asked, made_of, render_share
from .stages import Stages

if TYPE_CHECKING:
    from ..cache import Cache
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact
    from ..skin.model import SkinModel
    from ..work.executor import JobExecutor, JobFuture

SAVED = (
    600  # samples of a finger in reach of something that must be saved: a process takes as long to begin as some 300
)
LOOK = 0.02  # seconds between two looks at what is under way

Touched = tuple["PadContact", dict[int, "SkinContact"], dict[int, Iterator[Driven]]]


def touched_in_shares(
    scene: TactileScene,
    chunks: Iterator[Chunk],
    models: Mapping[int, SkinModel],
    library: Library,
    cache: Cache | None,
    clock: Stages,
    executor: JobExecutor,
) -> Generator[Progress, None, Touched]:
    """Return contact of the pads, of the skins, and what came of the devices that follow these, by finger.

    The last is empty where other processes would not have saved time: then none was asked.

    Raises:
        DermisError: what a process refuses.
    """
    kept: list[Chunk] = []
    pad_contact, _ = yield from touched(scene, chunks, {}, clock, kept)
    whole = replace(scene, chunks=kept)
    shares = shares_of(scene, pad_contact, models)
    if saved(shares, executor.workers) < SAVED:
        _, felt = yield from touched(whole, iter(kept), models, clock)
        return pad_contact, felt, {}
    made = yield from _rendered(whole, list(shares), models, library, cache, executor)
    for share in made:
        clock.add(share.seconds)
    felt = {f: touch for share in made for f, touch in share.felt.items()}
    ready = {f: iter(devices) for share in made for f, devices in share.driven.items()}
    return pad_contact, dict(sorted(felt.items())), ready


def shares_of(scene: TactileScene, pad_contact: PadContact, skins: Collection[int]) -> dict[tuple[int, ...], int]:
    """Return which fingers go together, and in how many samples each lot is in reach of something; most comes first.

    Those that ever come near the same thing, if it may be held, stay together: they balance it.

    Args:
        skins: fingers whose skin is simulated. Others are in a lot where they may hold something with one of these.
    """
    from ..contact.held_body import can_be_held
    from ..contact.lots import lots_of

    holdable = {b for b in range(len(scene.bodies)) if can_be_held(scene, b, pad_contact.animated)}
    near = {f: np.zeros(len(pad_contact.times), bool) for f in skins}
    for (f, _), pair in pad_contact.pairs.items():
        if f in near:
            near[f] |= np.isfinite(pair.gap)
    lots = lots_of(pad_contact.pairs, holdable, range(len(scene.fingers)))
    loads = {lot: sum(int(near[f].sum()) for f in lot if f in near) for lot in lots if near.keys() & set(lot)}
    return dict(sorted(loads.items(), key=lambda item: (-item[1], item[0])))


def saved(shares: Mapping[tuple[int, ...], int], workers: int) -> int:
    """Return by how many samples several processes are done earlier than one, each taking the next share."""
    busy = [0] * workers
    for load in shares.values():
        busy[busy.index(min(busy))] += load
    return sum(busy) - max(busy)


def _rendered(
    scene: TactileScene,
    shares: Sequence[tuple[int, ...]],
    models: Mapping[int, SkinModel],
    library: Library,
    cache: Cache | None,
    executor: JobExecutor,
) -> Generator[Progress, None, list[Share]]:
    """Let the shares be rendered; leaving early ends them."""
    with tempfile.TemporaryDirectory(prefix="dermis-shares-", ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "scene.npz"
        scene_file.save(scene, path)
        jobs: list[JobFuture] = []
        try:
            parts = [([f for f in lot if f in models], [f for f in lot if f not in models]) for lot in shares]
            jobs += [executor.submit("share", {}, asked(path, library, cache, *part)) for part in parts]
            while not all(job.done() for job in jobs):
                wait([job for job in jobs if not job.done()], LOOK)
                _raise_if_refused(jobs)
                told = [job.progress() for job in jobs]
                yield Progress("fingers", sum(done for done, _ in told), max(1, sum(total for _, total in told)))
            made = []
            for (fingers, beside), job in zip(parts, jobs, strict=True):
                if job.exception() is None:
                    made.append(made_of(job.result(), scene, models, library))
                else:  # its process died: what it was to do is done here
                    made.append((yield from render_share(scene, library, fingers, cache, beside)))
            return made
        finally:
            for job in jobs:
                job.cancel()


def _raise_if_refused(jobs: Sequence[JobFuture]) -> None:
    for job in jobs:
        error = job.exception() if job.done() else None
        if error is not None and not (isinstance(error, DermisError) and error.code == "job-crashed"):
            raise error
