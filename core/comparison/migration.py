"""Migration report: differences from the commands of an earlier engine.

It shows whether a published track would be different today. A stored track is compared with the track that the same
finger and device get from this engine, at the times of the stored track.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..errors import DermisError, Finding
from ..interpolate import interpolate
from ..pipeline.bake import Bake, Output
from ..track import export as formats
from ..track.command_track import CommandTrack
from ..version import made_by
from .aligned import aligned

# Commands count as changed if they differ by more than this share of a channel's range. No device renders a smaller
# difference.
CHANGED = 1e-3
UNKNOWN = "an unknown program"
SUFFIXES = (".csv", ".json", ".dtrack")  # suffixes of files that hold a whole track


@dataclass(frozen=True, eq=False)
class Migration:
    """A stored track, and the present engine's track in its place.

    Attributes:
        file: file of the stored track.
        finger, device: finger and device of both tracks.
        before: the stored track.
        now: the track of the present engine, at the times of the stored one.
        fps: scene frames per second.
        first: scene frame at time 0.
        other_preset: whether the device's preset has changed since. Then a difference may come from the preset instead
            of the engine.
    """

    file: str
    finger: str
    device: str
    before: CommandTrack
    now: CommandTrack
    fps: float
    first: int
    other_preset: bool

    @property
    def maker(self) -> str:
        """The program that made the stored track, as its metadata name it."""
        return str(self.before.meta.get("generator", UNKNOWN))

    @cached_property
    def difference(self) -> Array:
        """Values now minus values before, in the channels' units, shape (n, c)."""
        return np.asarray(self.now.values - self.before.values)

    @cached_property
    def ranges(self) -> Array:
        """The size that differences are compared with, shape (c,).

        It is the channel's range, or the largest stored command of a channel without a range.
        """
        limits = [(c.low, c.high) for c in self.before.channels]
        most = np.abs(self.before.values).max(axis=0, initial=0.0)
        ranges = [high - low if low is not None and high is not None else 0.0 for low, high in limits]
        return np.where(np.array(ranges) > 0.0, ranges, np.maximum(most, 1e-12))

    @cached_property
    def share(self) -> Array:
        """The largest difference of each channel, relative to `ranges`.

        The shares [1] have the shape (c,).
        """
        return np.abs(self.difference).max(axis=0, initial=0.0) / self.ranges

    def frame_of(self, sample: int) -> float:
        """Return the scene frame of a sample."""
        return self.first + float(self.before.times[sample]) * self.fps

    @property
    def changed_frames(self) -> tuple[int, int]:
        """Number of changed scene frames, and number of all scene frames.

        A frame counts as changed if a command in it differs by more than the share `CHANGED` of its range.
        """
        frames = np.floor(self.first + self.before.times * self.fps + 1e-9)
        far = (np.abs(self.difference) > CHANGED * self.ranges).any(axis=1)
        return len(np.unique(frames[far])), len(np.unique(frames))

    def finding(self, allowed: float) -> Finding | None:
        """Return a warning if a command changed too much, else None.

        The limit `allowed` is a share of the channel's range.
        """
        c = int(self.share.argmax())
        if not self.share[c] > allowed:
            return None
        at = self.frame_of(int(np.abs(self.difference[:, c]).argmax()))
        return Finding(
            "warning",
            "other-commands",
            f"{self.before.channels[c].name} differs from that of the stored track",
            f"finger '{self.finger}', {self.device}",
            f"{self.share[c]:.2%} of its range, at frame {at:.6g}",
            f"<= {allowed:.2%}",
            f"Keep the file made by {self.maker} if published results depend on it, or export again and state it",
        )


def stored_tracks(paths: Sequence[Path]) -> tuple[dict[str, CommandTrack], list[Finding]]:
    """Read tracks from files and folders.

    Returns:
        The tracks by their paths, and a finding for each file of a folder that could not be read as a track.

    Raises:
        DermisError: a file named in `paths` cannot be read, or there are no tracks.
    """
    tracks: dict[str, CommandTrack] = {}
    unread = []
    for path in paths:
        if not path.is_dir():
            tracks[str(path)] = formats.read(path)
            continue
        for file in sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES):
            try:
                tracks[str(file)] = formats.read(file)
            except DermisError as error:
                unread.append(Finding("info", "no-track", "a file of the folder is no track", str(file), str(error)))
    if not tracks:
        raise DermisError(
            "no tracks to compare with",
            value=", ".join(map(str, paths)),
            limit=f"files that end in {', '.join(SUFFIXES)}",
            remedy="Name tracks, or a folder that they were exported to",
        )
    return tracks, unread


def migrations(bake: Bake, stored: Mapping[str, CommandTrack]) -> tuple[tuple[Migration, ...], tuple[Finding, ...]]:
    """Compare stored tracks with those of a new bake.

    Args:
        bake: bake of the same scene by this engine.
        stored: tracks of an earlier engine, by the paths of their files.

    Returns:
        A comparison for each stored track whose finger and device occur in the bake. Findings about stored tracks
        without a counterpart in the bake, and about outputs of the bake without a stored track.

    Raises:
        DermisError: none of the tracks belongs to the bake, a device has other channels now, or a stored track extends
            beyond the times of the scene.
    """
    ours: dict[tuple[str, str], list[Output]] = {}
    for output in bake.outputs:
        ours.setdefault((output.finger, output.track.spec.key), []).append(output)
    found: list[Migration] = []
    doubts: list[Finding] = []
    for file, track in stored.items():
        key = str(track.meta.get("finger", "")), track.spec.key
        alike = ours.get(key, [])
        if not alike or alike[0].track.spec.kind != track.spec.kind:
            where, value = Path(file).name, f"finger '{key[0]}', {key[1]}"
            remedy = "Compare it with the scene that it was made from"
            doubts.append(
                Finding(
                    "warning", "not-of-this-scene", "the scene has no such finger and device", where, value, "", remedy
                )
            )
            continue
        found.append(_migration(file, track, alike.pop(0)))
    if not found:
        raise DermisError(
            "no stored track belongs to this scene",
            value=", ".join(Path(file).name for file in stored) or "no tracks",
            limit=", ".join(f"finger '{o.finger}', {o.track.spec.key}" for o in bake.outputs) or "no outputs",
            remedy="Choose the folder that this scene's tracks were exported to",
        )
    for (finger, device), left in ours.items():
        if left:
            what = "the stored tracks have none of this finger and device"
            doubts.append(Finding("info", "not-stored", what, f"finger '{finger}', {device}"))
    return tuple(found), tuple(doubts)


def _migration(file: str, before: CommandTrack, output: Output) -> Migration:
    now, where = output.track, Path(file).name
    names = [[c.name for c in track.channels] for track in (before, now)]
    if names[0] != names[1]:
        raise DermisError(
            "the device has other channels now", where=where, value=", ".join(names[0]), limit=", ".join(names[1])
        )
    low, high = (float(now.times[k]) if len(now.times) else 0.0 for k in (0, -1))
    slack = 0.5 / now.spec.rate
    if not len(before.times) or before.times[0] < low - slack or before.times[-1] > high + slack:
        raise DermisError(
            "the stored track is longer than the scene",
            where=where,
            value=f"{before.times[0]:.6g} to {before.times[-1]:.6g} s" if len(before.times) else "no samples",
            limit=f"{low:.6g} to {high:.6g} s",
            remedy="Compare it with a scene of the same frames",
        )
    values = now.values
    if not np.array_equal(before.times, now.times):
        values = interpolate(now.times, now.values, before.times)
    return Migration(
        file,
        output.finger,
        output.device,
        before,
        CommandTrack(now.spec, before.times, values, now.meta),
        float(Fraction(str(now.meta["fps"]))),
        int(str(now.meta["frame_range"]).split()[0]),
        before.spec.hash != now.spec.hash,
    )


def table(found: Iterable[Migration]) -> str:
    """Return the changes as a table for a terminal.

    There is a line for each channel.
    """
    rows = [("finger", "device", "channel", "largest change", "of range", "at frame", "frames changed", "made by")]
    for one in found:
        frames = "{} of {}".format(*one.changed_frames)
        for c, channel in enumerate(one.before.channels):
            far = np.abs(one.difference[:, c])
            at = int(far.argmax()) if len(far) else 0
            rows.append(
                (
                    one.finger,
                    one.device,
                    channel.name,
                    f"{float(far[at]):.3g} {channel.unit}",
                    f"{one.share[c]:.3%}",
                    f"{one.frame_of(at):.6g}",
                    frames,
                    one.maker + (", another preset" if one.other_preset else ""),
                )
            )
    return "\n".join([*aligned(rows), f"now: {made_by()}"])


def text(found: Iterable[Migration]) -> str:
    """Return all changed commands as CSV.

    A command counts as changed if it differs by more than the share `CHANGED` of its range.
    """
    out = io.StringIO()
    out.write(f"# dermis-migration 1\n# now: {made_by()}\n")
    write = csv.writer(out, lineterminator="\n").writerow
    write(("finger", "device", "frame", "t_s", "channel", "unit", "before", "now", "share_of_range"))
    for one in found:
        far = np.abs(one.difference) / one.ranges
        for i, c in zip(*np.nonzero(far > CHANGED), strict=True):
            channel, pair = one.before.channels[c], (one.before.values[i, c], one.now.values[i, c])
            numbers = [format(v, ".9g") for v in (*pair, far[i, c])]
            where = one.finger, one.device, format(one.frame_of(i), ".9g"), format(one.before.times[i], ".9g")
            write((*where, channel.name, channel.unit, *numbers))
    return out.getvalue()
