"""Trail: the last moments of a scene while it is played, and what the devices do at their end.

Contact of the pads' centres is measured once a sample and kept; tracks are short and computed anew with each, by what
a bake computes them with. Devices that follow a skin are left out: whoever shows skins solves them frame by frame.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..contact.chunk_checks import check_device
from ..contact.pad_sampler import PadSampler
from ..errors import DermisError, Finding
from ..presets import Library
from ..scene.tactile_scene import Chunk, TactileScene
from .bake import Output
from .device_tracks import finished, renderer, usable


class Trail:
    """Devices on the way through samples that come one at a time; the first is taken as rest.

    Args:
        scene: its header. library: the presets; they are read here, and not again.
        longest: so many samples are kept.

    Raises:
        DermisError: the scene cannot be rendered at all (see `TactileScene.validate`).
    """

    def __init__(self, scene: TactileScene, library: Library, longest: int) -> None:
        scene.validate()
        ignored: list[Finding] = []  # whoever bakes is told
        self._uses = [use for use in usable(scene, library, ignored) if not use[2].follows_skin]
        self._scene, self._longest = scene, longest
        self._sampler = PadSampler(scene)
        self._count = 0
        self.first = 0.0  # frame of the tracks' time 0

    @property
    def frames_per_second(self) -> float:
        """The scene's."""
        return float(self._scene.fps)

    def __len__(self) -> int:
        return self._count

    def add(self, chunk: Chunk) -> None:
        """Take one more sample; its time is told by its frame."""
        if not self._uses:
            self._count = min(self._count + 1, self._longest)
            return
        seconds = 1.0 / float(self._scene.fps)
        frames = np.asarray(chunk.frames, dtype=np.float64)
        if self._count == 0:  # it starts one frame earlier, at rest in the first pose
            self._sampler.add(replace(chunk, frames=frames - 1.0, times=(frames - 1.0) * seconds))
        self._sampler.add(replace(chunk, frames=frames, times=frames * seconds))
        self._count += 1
        if self._count > self._longest:
            self._sampler.forget(1)
            self._count -= 1

    def outputs(self) -> tuple[Output, ...]:
        """Return the devices' tracks; they begin where the trail does, at time 0."""
        if not self._uses:
            return ()
        contact = self._sampler.finish()
        self.first = float(contact.frames[0])
        contact = replace(contact, times=contact.times - contact.times[0])
        span = int(np.floor(contact.frames[0])), int(np.ceil(contact.frames[-1]))
        scene = replace(self._scene, frame_range=span)
        found = []
        for finger, use, spec in self._uses:
            try:
                check_device(contact, scene.fingers[finger], finger, use)
                rendered = renderer(spec)(contact, scene, finger, use, spec)
                found.append(finished(rendered, scene, finger, use, ""))
            except DermisError:  # the panel and the bake say why
                continue
        return tuple(found)
