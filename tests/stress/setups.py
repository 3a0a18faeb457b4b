"""A touch as a scene tells it, baked; and how far apart two answers are, channel by channel."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cache import Cache
from core.contact.skin_contact import SkinContact
from core.pipeline.bake import Bake
from core.pipeline.kept_shares import KeptShares
from core.pipeline.render import render
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene
from core.skin.model import SkinModel
from core.skin.stimulus import Stimulus
from core.skin.stress import locate, nodal_average
from core.skin.surface_store import smooth_pad
from core.steps import drain
from core.work.processes import ProcessExecutor

from .case import Verdict, apart

Array = NDArray[np.float64]
CONTACT = ("force", "torque", "nodal", "stress")
COMMANDS = {"pin_array_128": "pins", "thimble_3rrs": "thimble"}
CHANNELS = (*CONTACT, *COMMANDS.values())
TICK = 1e-6  # [s]: times that are nearer to each other are the same


@dataclass(frozen=True, eq=False)
class Setup:
    """A touch as a scene tells it; fields are replaced to tell the same touch in other words.

    Attributes:
        rate: of the samples [Hz].
        bodies: each with its poses in the finger's frame, shape (n, 4, 4).
        parameters: of the finger. devices: presets that follow it.
        probes: points in the tissue at which stress is compared [m], shape (k, 3). looked: times of it [s].
        world: the pose of the finger in the world, one or one a sample, shape (4, 4) or (n, 4, 4).
        name: of the finger. before, after: names of fingers alike, in the scene's order. apart: how far they are from
            the finger, in its frame [m], shape (3,).
        chunk: samples of a chunk; all of them where None.
        engine: changes how the engine works while the touch is baked.
        cache, kept: what earlier bakes left. workers: processes that fingers may be spread over.
    """

    rate: float
    bodies: tuple[tuple[Body, Array], ...]
    parameters: Mapping[str, Any]
    devices: tuple[str, ...] = ()
    probes: Array = field(default_factory=lambda: np.zeros((0, 3)))
    looked: Array = field(default_factory=lambda: np.zeros(0))
    world: Array = field(default_factory=lambda: np.eye(4))
    name: str = "finger"
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    apart: Array = field(default_factory=lambda: np.zeros(3))
    chunk: int | None = None
    engine: Callable[[], AbstractContextManager[None]] = nullcontext
    cache: Cache | None = None
    kept: KeptShares | None = None
    workers: int = 0

    @property
    def count(self) -> int:
        """How many samples there are."""
        return len(self.bodies[0][1])

    def scene(self) -> TactileScene:
        """Return the scene."""
        uses = tuple(DeviceUse(device) for device in self.devices)
        told = {"skin_shown": True, **self.parameters}
        world = np.broadcast_to(self.world, (self.count, 4, 4))
        aside = np.eye(4)
        aside[:3, 3] = self.apart
        names = (*self.before, self.name, *self.after)
        fingers = [(Finger(name, uses, told), world if name == self.name else world @ aside) for name in names]
        scene = scene_from_poses(self.rate, fingers, [(body, world @ poses) for body, poses in self.bodies])
        return scene if self.chunk is None else replace(scene, chunks=tuple(cut(scene.chunks, self.chunk)))

    def bake(self) -> Bake:
        """Bake the scene."""
        scene = self.scene()
        executor = ProcessExecutor(self.workers) if self.workers else None
        with self.engine(), executor or nullcontext():
            return drain(render(scene, Library(), cache=self.cache, executor=executor, before=self.kept))


def cut(chunks: Sequence[Chunk] | Any, size: int) -> Iterator[Chunk]:
    """Yield the samples of chunks without surfaces, so many at a time."""
    for chunk in chunks:
        for i in range(0, len(chunk.times), size):
            part = slice(i, i + size)
            poses = (every[:, part] for every in (chunk.fingers, chunk.bodies, chunk.screens))
            yield Chunk(chunk.frames[part], chunk.times[part], *poses, {}, {})


class Series(NamedTuple):
    """Vectors over time: times [s], shape (n,), and values, shape (n, ..., d)."""

    times: Array
    values: Array

    def at(self, times: Array) -> Array:
        """Return the values at some of the series' times."""
        return np.asarray(self.values[np.abs(self.times[None] - times[:, None]).argmin(axis=1)])

    def knows(self, times: Array) -> NDArray[np.bool_]:
        """Return which of some times are of the series."""
        if not len(self.times):
            return np.zeros(len(times), bool)
        return np.asarray(np.abs(self.times[None] - times[:, None]).min(axis=1) < TICK)


@dataclass(frozen=True, eq=False)
class Record:
    """What is compared of a touch.

    Attributes:
        channels: by name; force [N] and torque about the pad's centre [N m], shape (n, 3), force on each node, shape
            (n, m, 3), stress at each probe [Pa], shape (n, k, 6), force of each pin [N], shape (n, 128, 1), and angles
            of the servos [rad] from where they began, shape (n, 3).
        told: codes of the findings that are more than a remark.
        contact: what the finger felt.
    """

    channels: Mapping[str, Series]
    told: frozenset[str]
    contact: SkinContact


def computed(setup: Setup) -> Record:
    """Bake a touch and return what is compared of it."""
    bake = setup.bake()
    felt = bake.skins[setup.name]
    force = np.zeros((len(felt.times), felt.model.pad_count, 3))
    force[felt.contact] = np.asarray(felt.held, np.float64)
    looked = np.flatnonzero(Series(setup.looked, setup.looked).knows(felt.times))
    read = stress_reader(felt.model, setup.probes, felt.points is not None)
    stress = [read(felt.stimulus_at(i)) for i in looked.tolist()]
    channels = {
        "force": Series(felt.times, force.sum(axis=1)),
        "torque": Series(felt.times, np.cross(felt.model.positions, force).sum(axis=1)),
        "nodal": Series(felt.times, force),
        "stress": Series(felt.times[looked], np.array(stress).reshape(len(looked), len(setup.probes), 6)),
    }
    for output in bake.outputs:
        if output.finger == setup.name:
            driven = [k for k, channel in enumerate(output.track.channels) if channel.actuator]
            values = output.track.values[:, driven]
            name = COMMANDS[output.device]
            channels[name] = Series(output.track.times, values[..., None] if name == "pins" else values - values[:1])
    told = frozenset(f.code for f in bake.all_findings if f.severity != "info")
    return Record(channels, told, felt)


def stress_reader(skin: SkinModel, probes: Array, on_points: bool) -> Callable[[Stimulus], Array]:
    """Return what reads the stress of linear skin at points in the tissue [Pa], shape (k, 6).

    Beneath points it is known in closed form; of forces on nodes it is that of the elements, smoothed.

    Args:
        probes: [m], shape (k, 3).
    """
    none, pad = np.zeros((len(probes), 6)), smooth_pad(skin)
    if on_points and pad is not None:
        ready = pad.probes(*pad.chart.project(probes))
        return lambda felt: none if felt.points is None else pad.beneath(ready, felt.points.cells, felt.points.force)[1]
    element, weights = locate(skin.mesh, probes)
    corners = skin.mesh.tetrahedra[element]

    def of_elements(felt: Stimulus) -> Array:
        values = nodal_average(skin.mesh, felt.stress)[corners]
        return np.asarray(np.einsum("kj,kjc->kc", weights, values)) if felt.touching else none

    return of_elements


def compare(
    verdict: Verdict,
    limit: float,
    base: Record,
    other: Record,
    when: tuple[Array, Array] | None = None,
    channels: Collection[str] = CHANNELS,
) -> None:
    """Hold what two answers differ by, over the larger peak, against a limit.

    Args:
        when: times of the first and of the second that are compared [s]; those that both have where None.
        channels: that are compared. What only one of both has, or both have at no time alike, is infinitely far off.
    """
    verdict.told |= base.told | other.told
    for name in channels:
        if name not in base.channels and name not in other.channels:
            continue
        if name not in base.channels or name not in other.channels:
            verdict.hold(name, np.inf, limit)
            continue
        one, two = base.channels[name], other.channels[name]
        here, there = (one.times, one.times) if when is None else when
        both = one.knows(here) & two.knows(there)
        if not both.any():
            verdict.hold(name, np.inf, limit)
        else:
            peak = max(float(np.linalg.norm(each.values, axis=-1).max()) for each in (one, two))
            verdict.hold(name, apart(one.at(here[both]), two.at(there[both]), peak), limit)
