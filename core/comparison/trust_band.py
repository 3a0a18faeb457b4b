"""Trust band: sensitivity of forces and commands to negligible changes.

The scene is rendered again in three variants: shifted by 0.1 um, with half the step between samples, and mirrored. A
difference between the results is no property of the scene. It shows where a sharp edge or a slip makes a track
arbitrary.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..cache import Cache
from ..devices.spec import Channel
from ..errors import Finding
from ..files import write_bytes
from ..pipeline.bake import Bake, Progress
from ..pipeline.outputs import file_names
from ..pipeline.render import render
from ..presets import Library
from ..scene.tactile_scene import TactileScene
from ..track.command_track import CommandTrack
from ..track.file_names import safe
from .aligned import aligned
from .scene_variants import denser, mirrored, shifted

DOUBT = 0.05  # a change above this share of the largest departure from rest is reported by a finding
# Share of a channel's range. A departure from rest below it is not felt; changes are then compared with this share of
# the range instead.
FELT = 1e-3
SKIN = "skin"
FORCES = (Channel("normal_force", "N"), Channel("tangential_force", "N"))
# Each variant: the function that makes it, its description, and whether commands can be compared. For the mirrored
# scene only forces can.
VARIANTS: Mapping[str, tuple[Callable[[TactileScene], TactileScene], str, bool]] = {
    "shifted": (shifted, "shifted by 0.1 um", True),
    "denser": (denser, "sampled at twice the rate", True),
    "mirrored": (mirrored, "mirrored", False),
}


@dataclass(frozen=True, eq=False)
class Band:
    """Changes of the channels of one device, or of the forces on one skin.

    Attributes:
        finger: name of the finger.
        device: key of the device preset; 'skin' for the forces on the skin.
        name: stem of the names of the band's files.
        channels: the channels, with their units.
        times: time of each sample [s], shape (n,).
        values: values of the unchanged scene, shape (n, c).
        spread: largest change caused by any variant, shape (n, c).
        worst: for each channel, the variant that causes the largest change.
        track: track of the device; None for a skin.
    """

    finger: str
    device: str
    name: str
    channels: tuple[Channel, ...]
    times: Array
    values: Array
    spread: Array
    worst: tuple[str, ...]
    track: CommandTrack | None = None

    @cached_property
    def felt(self) -> Array:
        """The size that changes are compared with, shape (c,).

        It is the largest departure from rest of any channel with the same unit, but at least the share `FELT` of the
        channel's range.
        """
        far = np.abs(self.values - [c.rest for c in self.channels]).max(axis=0, initial=0.0)
        units = np.array([c.unit for c in self.channels])
        peaks = np.array([far[units == unit].max() for unit in units])
        spans = [c.high - c.low if c.high is not None and c.low is not None else 0.0 for c in self.channels]
        return np.maximum(peaks, np.maximum(FELT * np.array(spans), 1e-12))

    @cached_property
    def share(self) -> Array:
        """The largest change of each channel, divided by `felt` [1], shape (c,)."""
        return self.spread.max(axis=0, initial=0.0) / self.felt

    @property
    def worst_channel(self) -> int:
        """Index of the channel with the largest `share`."""
        return int(self.share.argmax())

    @property
    def worst_time(self) -> float:
        """Time of the largest change of the worst channel [s]."""
        return float(self.times[self.spread[:, self.worst_channel].argmax()])

    @property
    def finding(self) -> Finding | None:
        """A warning about the worst channel; None if no change exceeds `DOUBT`."""
        c = self.worst_channel
        if not self.share[c] > DOUBT:
            return None
        device = self.device if self.track is None else self.track.spec.name
        faster = "bake at a higher sample rate, " if self.worst[c] == "denser" else ""
        return Finding(
            "warning",
            "not-reproduced",
            f"{self.channels[c].name} changes if the scene is {VARIANTS[self.worst[c]][1]}",
            f"finger '{self.finger}', {device}",
            f"{self.share[c]:.0%} of its peak, at {self.worst_time:.3f} s",
            f"<= {DOUBT:.0%}",
            f"Do not trust this part of the track: {faster}round sharp edges, or raise the friction",
        )

    def csv(self) -> str:
        """Return values and changes as a table."""
        heads = ["t_s"]
        for channel in self.channels:
            heads += [f"{channel.name}[{channel.unit}]", f"{channel.name}_spread[{channel.unit}]"]
        rows = np.concatenate(
            [self.times[:, None], np.stack([self.values, self.spread], axis=2).reshape(len(self.times), -1)], axis=1
        )
        head = ["# dermis-trust-band 1", f"# finger: {self.finger}", f"# device: {self.device}", ",".join(heads)]
        return "\n".join([*head, *(",".join(format(v, ".9g") for v in row) for row in rows.tolist())]) + "\n"


def trust_bands(
    scene: TactileScene, library: Library, *, cache: Cache | None = None
) -> Generator[Progress, None, tuple[Bake, tuple[Band, ...]]]:
    """Render a scene and its variants, and compare the results.

    Progress is yielded. The bake of the unchanged scene is returned, with a band for each device and each skin.

    Args:
        scene: the scene; its chunks are iterated several times.

    Raises:
        DermisError: the scene cannot be rendered.
    """
    own = yield from _rendered(scene, library, cache, "unchanged")
    found = {}
    for name, (make, words, _) in VARIANTS.items():
        if name != "mirrored" or own.skins:
            found[name] = yield from _rendered(make(scene), library, cache, words)
    bands = [
        _band_of_track(own, k, {name: bake for name, bake in found.items() if VARIANTS[name][2]}, file)
        for k, file in enumerate(file_names(own))
    ]
    times = next(iter(own.skins.values())).times if own.skins else np.zeros(0)
    return own, (*bands, *(_band_of_skin(own, finger, found, times) for finger in own.skins))


def _rendered(
    scene: TactileScene, library: Library, cache: Cache | None, words: str
) -> Generator[Progress, None, Bake]:
    steps = render(scene, library, cache=cache)
    while True:
        try:
            step = next(steps)
        except StopIteration as done:
            return done.value
        yield Progress(f"{words}, {step.stage}", step.done, step.total)


def _band_of_track(own: Bake, k: int, found: Mapping[str, Bake], file: str) -> Band:
    output = own.outputs[k]
    others = {}
    for name, bake in found.items():
        same = [o for o in bake.outputs if (o.finger, o.device) == (output.finger, output.device)]
        alike = sum((o.finger, o.device) == (output.finger, output.device) for o in own.outputs[:k])
        if alike < len(same):
            others[name] = same[alike].track.values
    track = output.track
    values = np.asarray(track.values, np.float64)
    rest = np.array([c.rest for c in track.channels])
    spread, worst = _spread(values, {name: others.get(name, np.tile(rest, (len(values), 1))) for name in found})
    return Band(output.finger, output.device, file, track.channels, track.times, values, spread, worst, track)


def _band_of_skin(own: Bake, finger: str, found: Mapping[str, Bake], times: Array) -> Band:
    def forces(bake: Bake, step: int) -> Array:
        skin = bake.skins[finger]
        return np.stack([skin.normal_force[::step], skin.tangential_force[::step]], axis=1)

    values = forces(own, 1)
    others = {name: forces(bake, 2 if name == "denser" else 1) for name, bake in found.items() if finger in bake.skins}
    spread, worst = _spread(values, others)
    return Band(finger, SKIN, f"{safe(finger)}.{SKIN}", FORCES, times, values, spread, worst)


def _spread(values: Array, others: Mapping[str, Array]) -> tuple[Array, tuple[str, ...]]:
    """Return the largest change of each value.

    The second result is, for each channel, the variant that causes the largest change.
    """
    changes = []
    for other in others.values():
        count = min(len(other), len(values))
        change = np.zeros_like(values)
        change[:count] = np.nan_to_num(np.abs(other[:count] - values[:count]), nan=np.inf)
        changes.append(change)
    all_of = np.array(changes).reshape(len(others), *values.shape)
    which = all_of.max(axis=1, initial=0.0).argmax(axis=0)
    names = list(others)
    return all_of.max(axis=0, initial=0.0), tuple(names[w] for w in which.tolist())


def table(bands: tuple[Band, ...]) -> str:
    """Return the worst channel of each band, as a table for a terminal."""
    rows = [("finger", "device", "channel", "peak", "change", "of peak", "worst where")]
    for band in bands:
        c = band.worst_channel
        unit, change = band.channels[c].unit, float(band.spread[:, c].max(initial=0.0))
        sizes = f"{band.felt[c]:.3g} {unit}", f"{change:.2g} {unit}", f"{band.share[c]:.1%}"
        rows.append((band.finger, band.device, band.channels[c].name, *sizes, VARIANTS[band.worst[c]][1]))
    return "\n".join(aligned(rows))


def write(bands: tuple[Band, ...], folder: Path, *, plots: bool = False) -> tuple[Path, ...]:
    """Write each band as a CSV file and return the paths.

    Args:
        plots: whether each device's track is also drawn, with its band.

    Raises:
        DermisError: the folder cannot be written.
    """
    written = []
    for band in bands:
        written.append(folder / f"{band.name}_trust.csv")
        write_bytes(written[-1], band.csv().encode())
        if plots and band.track is not None:
            from ..plot.track import png

            written.append(folder / f"{band.name}_trust.png")
            write_bytes(written[-1], png(band.track, spread=band.spread))
    return tuple(written)
