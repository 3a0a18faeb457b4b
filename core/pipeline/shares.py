"""Shares of a bake, which other processes may render.

Fingers that hold no object together are independent of each other, so they may be in different shares. Every process
runs the same wheels with one BLAS thread, and gets the same samples. Its results are therefore the same to the byte as
those of a single process. With other wheels or on another processor, the results agree to some 1e-6.
"""

from __future__ import annotations

import tempfile
import threading
from collections import deque
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import DermisError
from ..presets import Library
from ..scene import scene_file
from ..scene.tactile_scene import Chunk, TactileScene
from .bake import Progress
from .device_tracks import Driven
from .felt import felt_by, touched
from .kept_shares import KeptShares, keys_of
from .share_job import Opened, Share, asked, done_of, driven_by, made_of, render_share, size_of
from .stages import Stages

if TYPE_CHECKING:
    from ..cache import Cache
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact
    from ..skin.model import SkinModel
    from ..work.executor import JobExecutor, JobFuture

# [samples] Other processes render the shares only if they shorten the work by at least this many samples at which an
# object is near a finger. The start of a process takes as long as some 150 such samples.
SAVED = 300
LOOK = 0.02  # [s] longest interval between two queries of the running jobs
# [workers], [samples] With at most FEW workers and at most SHORT samples, this process renders shares in place of one
# worker, because the start of a worker takes a third of a second. Otherwise this process only waits, so that its window
# responds: the rendering of a device is a step that cannot be interrupted.
FEW, SHORT = 2, 1200


class Touched(NamedTuple):
    """Contact of the pads and the skins over a scene, and results of devices.

    Attributes:
        pad_contact: contact of the pads.
        felt: contact of the skins, by the index of the finger.
        ready: results of the devices that follow the skin, in the scene's order, by the index of the finger.
        unchanged: number of fingers whose results are those of an earlier bake.
    """

    pad_contact: PadContact
    felt: dict[int, SkinContact]
    ready: dict[int, Iterator[Driven]]
    unchanged: int


def touched_in_shares(
    scene: TactileScene,
    chunks: Iterator[Chunk],
    models: Mapping[int, SkinModel],
    library: Library,
    cache: Cache | None,
    clock: Stages,
    executor: JobExecutor | None,
    before: KeptShares | None = None,
) -> Generator[Progress, None, Touched]:
    """Compute the contact of pads and skins, and render devices, in shares.

    Shares with unchanged inputs are taken from earlier bakes. The other shares are rendered by other processes if that
    saves time, else by this process.

    Args:
        scene: the scene's header.
        chunks: chunks of the scene.
        models: skin models of the fingers whose skin is simulated, by the index of the finger.
        library: the presets.
        cache: cache of condensed skins, for the other processes; None without one.
        clock: run times.
        executor: executor of the other processes; None to render all shares in this process.
        before: shares of earlier bakes, to which new shares are added; None to render all shares.

    Raises:
        DermisError: another process refused its share.
    """
    if executor is not None:
        _begin(scene, models, library, executor)
    kept: list[Chunk] = []
    pad_contact, _ = yield from touched(scene, chunks, {}, clock, kept)
    whole = replace(scene, chunks=kept)
    shares, made = shares_of(scene, pad_contact, models), dict[tuple[int, ...], Share]()
    keys: dict[tuple[int, ...], str] = {}
    if before is not None:
        with clock.stage("earlier bakes"):
            keys = keys_of(whole, kept, pad_contact, shares, models, library)
            known = {lot: before.get(key) for lot, key in keys.items()}
        made = {lot: share for lot, share in known.items() if share is not None}
    left = {lot: load for lot, load in shares.items() if lot not in made}
    if executor is not None and saved(left, executor.workers) >= SAVED:
        rendered = yield from _rendered(whole, list(left), models, library, cache, executor, pad_contact, clock)
    elif left:
        rendered = yield from _rendered_here(whole, list(left), models, library, pad_contact, clock)
    else:
        rendered = []
    for lot, share in zip(left, rendered, strict=True):
        clock.add(share.seconds)
        made[lot] = share = share.packed()
        if before is not None:
            before.put(keys[lot], share)
    felt = {f: touch for share in made.values() for f, touch in share.felt.items()}
    ready = {f: iter(devices) for share in made.values() for f, devices in share.driven.items()}
    return Touched(
        pad_contact, dict(sorted(felt.items())), ready, sum(len(made[lot].felt) for lot in shares.keys() - left)
    )


def _begin(scene: TactileScene, models: Mapping[int, SkinModel], library: Library, executor: JobExecutor) -> None:
    """Start the other processes, which import what they need while this one samples the scene.

    They are started only if they may shorten the work.
    """
    if saved({(f,): scene.sample_count for f in models}, executor.workers) >= SAVED:
        devices = sorted({use.preset for f in models for use in scene.fingers[f].devices})
        needs = {"presets": [str(folder) for folder in library.folders], "devices": devices}
        executor.begin(min(_others(scene, executor), len(models)), "share-begin", needs)


def _others(scene: TactileScene, executor: JobExecutor) -> int:
    """Return how many shares other processes render at once, see `FEW` and `SHORT`."""
    return executor.workers - (executor.workers <= FEW and scene.sample_count <= SHORT)


def _rendered_here(
    scene: TactileScene,
    lots: Sequence[tuple[int, ...]],
    models: Mapping[int, SkinModel],
    library: Library,
    pad_contact: PadContact,
    clock: Stages,
) -> Generator[Progress, None, list[Share]]:
    """Render shares in this process, all skins together, chunk by chunk.

    The run times are added to `clock`, so the shares have none.
    """
    wanted = {f: models[f] for f in sorted(f for lot in lots for f in lot) if f in models}
    felt = yield from felt_by(scene, scene.chunks, wanted, pad_contact, clock)
    driven = yield from driven_by(scene, library, pad_contact, felt, clock)
    return [Share({f: felt[f] for f in lot if f in felt}, {f: driven[f] for f in lot if f in felt}, {}) for lot in lots]


def shares_of(scene: TactileScene, pad_contact: PadContact, skins: Collection[int]) -> dict[tuple[int, ...], int]:
    """Return the load of each lot of fingers, in falling order of load.

    Fingers that ever come near the same object are in one lot if the object may be held, because they balance it
    together. The load is the number of samples at which an object is within the search radius of a finger, added up
    over the fingers of the lot with simulated skin.

    Args:
        scene: the scene's header.
        pad_contact: contact of the pads over the scene.
        skins: fingers whose skin is simulated. Every lot has at least one of them.
    """
    from ..contact.held_body import can_be_held, lots_of

    holdable = {b for b in range(len(scene.bodies)) if can_be_held(scene, b, pad_contact.animated)}
    near = {f: np.zeros(len(pad_contact.times), bool) for f in skins}
    for (f, _), pair in pad_contact.pairs.items():
        if f in near:
            near[f] |= np.isfinite(pair.gap)
    lots = lots_of(pad_contact.pairs, holdable, range(len(scene.fingers)))
    loads = {lot: sum(int(near[f].sum()) for f in lot if f in near) for lot in lots if near.keys() & set(lot)}
    return dict(sorted(loads.items(), key=lambda item: (-item[1], item[0])))


def saved(shares: Mapping[tuple[int, ...], int], workers: int) -> int:
    """Return by how many samples parallel workers shorten the work.

    A single worker would need as many samples as all loads together.

    Args:
        shares: load of each share [samples]. A worker takes the next share when it is free.
        workers: number of workers.
    """
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
    pad_contact: PadContact,
    clock: Stages,
) -> Generator[Progress, None, list[Share]]:
    """Let other processes render shares.

    This process renders some of the shares itself if there are few workers and samples, see `FEW` and `SHORT`. Closing
    the generator early ends the jobs.
    """
    with tempfile.TemporaryDirectory(prefix="dermis-shares-", ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "scene.npz"
        scene_file.save(scene, path)
        jobs: dict[JobFuture, int] = {}  # running jobs, and the index of each job's share
        try:
            # `concurrent.futures.wait` would prepare all futures anew at every query, which takes a thirtieth of the
            # time of a processor. An event needs no such preparation.
            ended = threading.Event()
            parts = [([f for f in lot if f in models], [f for f in lot if f not in models]) for lot in shares]
            told, each, made = [0] * len(parts), size_of(scene.sample_count), dict[int, Share]()
            others = _others(scene, executor)
            left, own = deque(range(len(parts))), -1
            here: Generator[Progress, None, list[Share]] | None = None
            while left or jobs or here is not None:
                while left and len(jobs) < others:
                    job = executor.submit("share", {}, asked(path, library, cache, *parts[left[0]]))
                    job.add_done_callback(lambda _job: ended.set())
                    jobs[job] = left.popleft()
                if here is None and left and others < executor.workers:
                    own = left.popleft()
                    here = _rendered_here(scene, [shares[own]], models, library, pad_contact, clock)
                if here is None:
                    ended.wait(LOOK)
                else:
                    try:
                        told[own] = max(told[own], done_of(next(here), scene.sample_count))
                    except StopIteration as stop:
                        made[own], here, told[own] = stop.value[0].packed(), None, each
                ended.clear()
                _raise_if_refused(jobs)
                for job, k in jobs.items():
                    told[k] = max(told[k], job.progress()[0], each * job.done())
                yield Progress("fingers", sum(told), max(1, each * len(told)))
                for job in [job for job in jobs if job.done()]:  # results are packed while other jobs run
                    k = jobs.pop(job)
                    if job.exception() is None:
                        made[k] = made_of(job.result(), scene, models, library).packed()
            for k in range(len(parts)):
                if k not in made:  # The process of this share has died, so the share is rendered here.
                    made[k] = yield from render_share(Opened(scene, library, cache, {}), *parts[k])
            return [made[k] for k in range(len(parts))]
        finally:
            for job in jobs:
                job.cancel()


def _raise_if_refused(jobs: Collection[JobFuture]) -> None:
    for job in jobs:
        error = job.exception() if job.done() else None
        if error is not None and not (isinstance(error, DermisError) and error.code == "job-crashed"):
            raise error
