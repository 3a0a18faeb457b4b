"""Trail: the last samples of a scene during playback, and the devices' commands up to the newest of them.

Contact of the pads' centres is measured once per sample, and kept. Every new sample changes the splines through the
poses, but only near their end; before that they are settled. The devices' state is stored at the last settled sample.
From it the later commands are computed anew with each sample, by the same code as in a bake. Devices that follow a
simulated skin are left out; the skin preview computes them frame by frame.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..contact.chunk_checks import check_device
from ..contact.pad_contact import PadContact
from ..contact.pad_sampler import PadSampler
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..memory import Memory
from ..motion import Motion
from ..presets import Library
from ..scene.tactile_scene import Chunk, DeviceUse, TactileScene
from .bake import Output
from .device_tracks import Renderer, renderer, usable

# A new sample changes the path most at its end, and the change shrinks to about a quarter at every knot. So this many
# samples before the end it is less than 1 % of the change at the end.
SETTLED = 4
SHOWN = 0.13  # [s] the view draws at most this much of a track's end; by default the trail keeps at least as much
State = tuple[float, Mapping[Hashable, Any]]


class Kept(NamedTuple):
    """The end of a trail.

    Attributes:
        chunks: the last samples. state: time at which the next window begins, and the devices' state there. A window is
            the time for which one call of `Trail.add` computes the commands.
        taken: number of samples up to here.
    """

    chunks: tuple[Chunk, ...]
    state: State
    taken: int


class Trail:
    """The commands of devices for samples that arrive one at a time; before the first, everything is at rest.

    Args:
        scene: header of the scene. library: the presets; they are read here and by `renew`.
        settled: number of samples before the end at which the state is stored; None: the larger of `SETTLED` and
            the number of samples within `SHOWN`.

    Attributes:
        taken: how many samples were taken.

    Raises:
        DermisError: the scene cannot be rendered at all (see `TactileScene.validate`).
    """

    def __init__(self, scene: TactileScene, library: Library, settled: int | None = None) -> None:
        scene.validate()
        self._scene, self._library = scene, library
        self._uses = self._used()
        self._settled = max(SETTLED, math.ceil(SHOWN * scene.fps)) if settled is None else settled
        self._sampler = PadSampler(scene)
        self._chunks: list[Chunk] = []  # the samples that are kept
        # start of the next window and the state there; `_before`: `_state` before the last sample was added
        self._state: State = (-math.inf, {})
        self._before: State = self._state
        self._lasting: dict[Hashable, Any] = {}
        self.taken = 0

    @property
    def first(self) -> float:
        """First frame of the scene's range, which is the tracks' time 0."""
        return float(self._scene.frame_range[0])

    @property
    def frames_per_second(self) -> float:
        """Frame rate of the scene [1/s]."""
        return float(self._scene.fps)

    def add(self, chunk: Chunk) -> tuple[Output, ...]:
        """Take one more sample, at the time of its frame; return the tracks up to it.

        They begin where the devices' state was stored last. Their time 0 is the first frame of the scene's range.
        """
        self.taken += 1
        if not self._uses:
            return ()
        frames = np.asarray(chunk.frames, dtype=np.float64)
        for one in (frames - 1.0, frames) if self.taken == 1 else (frames,):  # it starts a frame earlier, at rest
            times = (one - self.first) / self.frames_per_second
            self._chunks.append(replace(chunk, frames=one, times=times))
            self._sampler.add(self._chunks[-1])
        if len(self._chunks) > 2 * self._settled:  # twice as many, so that splines are settled where the window begins
            self._sampler.forget(1)
            del self._chunks[0]
        return self._outputs()

    def again(self, scene: TactileScene, chunk: Chunk) -> tuple[Output, ...]:
        """Take the last sample anew, since something has changed; return the tracks up to it."""
        chunks = self._chunks[:-1] if self.taken > 1 else []
        self._scene = scene
        self.restore(Kept(tuple(chunks), self._before, self.taken - 1))
        self.renew(scene)
        return self.add(chunk)

    def save(self) -> Kept:
        """Return the trail's end, for `restore`."""
        return Kept(tuple(self._chunks), self._state, self.taken)

    def restore(self, kept: Kept) -> None:
        """Go back to where `save` was called; the samples that are kept are measured once more."""
        self._chunks, self._state, self.taken = list(kept.chunks), kept.state, kept.taken
        self._sampler = PadSampler(self._scene)
        for chunk in self._chunks:
            self._sampler.add(chunk)

    def renew(self, scene: TactileScene) -> None:
        """Go on with other settings of the same fingers, devices, objects and screens."""
        scene.validate()
        self._scene, self._lasting = scene, {}
        self._sampler.renew(scene)
        self._uses = self._used()

    def _used(self) -> list[tuple[int, DeviceUse, DeviceSpec, Renderer]]:
        ignored: list[Finding] = []  # the bake reports these findings
        used = (use for use in usable(self._scene, self._library, ignored) if not use[2].follows_skin)
        return [(*use, renderer(use[2])) for use in used]

    def _outputs(self) -> tuple[Output, ...]:
        times = [float(chunk.times[0]) for chunk in self._chunks]
        now, until = times[-1], times[max(len(times) - 1 - self._settled, 0)]
        self._before = self._state
        start, noted = self._before
        start = max(start, times[0])
        memory = Memory(start, max(until, start), now, noted, self._lasting)
        contact = self._sampler.finish(memory)
        _solve_motions(contact)
        end = math.ceil(self.first + now * self.frames_per_second)
        scene = replace(self._scene, frame_range=(self._scene.frame_range[0], max(end, self._scene.frame_range[0])))
        found = []
        for n, (finger, use, spec, render) in enumerate(self._uses):
            try:
                check_device(contact, scene.fingers[finger], finger, use)
                rendered = render(contact, scene, finger, use, spec)
            except DermisError:  # the panel and the bake say why
                continue
            track = rendered.track
            with contact.carry(("track", finger, n), track.times) as carry:
                if carry.start is not None:
                    track = replace(track, values=track.values.copy())
                    track.values[0] = carry.start
                track = track.within_limits()
                carry.found = track.values[carry.index]
            found.append(Output(scene.fingers[finger].name, use.preset, track, rendered.signals, ()))
        self._state = max(until, start), memory.noted
        return tuple(found)


def _solve_motions(contact: PadContact) -> None:
    """Solve the motions of all fingers and bodies that come near each other, all at once: this is faster."""
    fingers, bodies = sorted({f for f, _ in contact.pairs}), sorted({b for _, b in contact.pairs})
    keys = [*(("finger", f) for f in fingers), *(("body", b) for b in bodies)]
    if keys:
        made = Motion.several(contact.knots, np.concatenate([contact.fingers[fingers], contact.bodies[bodies]]))
        contact.kept.update((key, motion) for key, motion in zip(keys, made, strict=True) if motion is not None)
