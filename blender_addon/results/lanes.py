"""Prepare the series of a bake for the strip.

They are the force of each finger and the state of its devices over the frames.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Array, core
from ..hands import bone_names
from . import stored_skins

Kind = Literal["force", "touch", "mismatch", "limited", "doubt"]

AT_LIMIT = ("at_limit", "clipped")  # signals of limits: above 0 where pins of an array, or a platform, are at a limit
CLOSE = 1e-6  # relative distance within which a value counts as on a limit


class Series(NamedTuple):
    """A quantity at rising frames, both of shape (n,)."""

    frames: Array
    values: Array


@dataclass(frozen=True, eq=False)
class Lane:
    """One finger over the frames.

    Attributes:
        finger: the object's name.
        series: series by kind: force [N], touch (0 or 1), mismatch (relative), limited (0 or 1), doubt (0 or 1). A kind
            has one series for each device or skin.
    """

    finger: str
    series: Mapping[Kind, tuple[Series, ...]] = field(default_factory=dict)

    def most(self, kind: Kind) -> float:
        """Return the largest value of a kind; 0 without one."""
        return max((float(np.nanmax(s.values)) for s in self.series.get(kind, ()) if len(s.values)), default=0.0)

    @property
    def says(self) -> str:
        """Title of the lane."""
        parts = [f"{self.finger}:"]
        if "force" in self.series:
            parts.append(f"force, up to {self.most('force'):.3g} N")
        else:
            parts.append("touch" if self.most("touch") else "no touch")
        if "mismatch" in self.series:
            most = self.most("mismatch")  # relative to the target, which is close to zero where a touch begins
            parts.append(
                f"· mismatch, up to {100.0 * most:.0f} %" if most <= 1.0 else "· mismatch, above 100 % at times"
            )
        if self.most("limited"):
            parts.append("· at a limit")
        if self.most("doubt"):
            parts.append("· not to be trusted where yellow")
        return " ".join(parts)


class Mark(NamedTuple):
    """A finding at its first frame; `finger` is '' if it names no finger."""

    frame: float
    finger: str
    severity: str
    text: str


def lanes_of(result: Any) -> tuple[Lane, ...]:
    """Return a lane for every finger of a stored `Result`, thumb first.

    Objects without the name of a finger follow in the order of the bake.
    """
    found: dict[str, dict[Kind, list[Series]]] = {}

    def add(finger: str, kind: Kind, frames: Array, values: Array) -> None:
        if len(frames):
            found.setdefault(finger, {}).setdefault(kind, []).append(Series(frames, values))

    for output in result.bake.outputs:
        track, finger = output.track, output.finger
        frames = result.clock.frames(track.times)
        add(finger, "touch", frames, np.asarray(output.signals.get("contact", np.zeros(len(frames)))))
        if "mismatch" in output.signals:
            add(finger, "mismatch", frames, np.asarray(output.signals["mismatch"]))
        add(finger, "limited", frames, limited(track, output.signals).astype(np.float64))
    for finger, (times, force) in stored_skins.forces_of(result.bake.skins).items():
        add(finger, "force", result.clock.frames(times), np.asarray(force, np.float64))
    lanes = [Lane(finger, {k: tuple(s) for k, s in kinds.items()}) for finger, kinds in found.items()]
    return tuple(lanes[i] for i in bone_names.order(tuple(found), tuple(found)))


def limited(track: Any, signals: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Return at which samples a device was limited, shape (n,).

    A track has the number of samples that a limiter changed, but not which. If a limiter changed any sample, those that
    lie on its limit count as limited; values at rest do not count as on a range.
    """
    mask = np.zeros(len(track.times), bool)
    for name in AT_LIMIT:
        mask |= np.asarray(signals.get(name, mask)) > 0
    for i, channel in enumerate(track.channels):
        values, at_work = track.values[:, i], {k.rpartition(".")[2] for k in _at_work(track, channel.name)}
        moved = np.abs(values - channel.rest) > CLOSE * max(abs(channel.low or 0.0), abs(channel.high or 0.0))
        if "range" in at_work:
            for limit in (channel.low, channel.high):
                if limit is not None:
                    mask |= moved & (np.abs(values - limit) <= CLOSE * abs(limit))
        if "slew" in at_work and channel.slew is not None and len(values) > 1:
            step, most = np.abs(np.diff(values)), channel.slew * np.diff(track.times)
            mask[1:] |= np.abs(step - most) <= CLOSE * most
    pair = core.devices.spec.range_disc(track.spec)
    at_work = {key.rpartition(".")[2] for key, count in track.limited.items() if count}
    if pair is not None and at_work & {"disc", "slew_of_pair"}:
        i, j, radius = pair
        if "disc" in at_work:
            mask |= np.abs(np.hypot(track.values[:, i], track.values[:, j]) - radius) <= CLOSE * radius
        slew = track.channels[i].slew
        if "slew_of_pair" in at_work and slew is not None and len(mask) > 1:
            most = slew * np.diff(track.times)
            mask[1:] |= np.abs(np.hypot(*np.diff(track.values[:, [i, j]], axis=0).T) - most) <= CLOSE * most
    return mask


def _at_work(track: Any, channel: str) -> list[str]:
    return [key for key, count in track.limited.items() if count and key.rpartition(".")[0] == channel]


def marks_of(findings: Sequence[Any]) -> tuple[Mark, ...]:
    """Return a mark for every finding that has a frame, in order of frames.

    Equal marks are returned once.
    """
    marks = {}
    for finding in findings:
        if finding.frame is not None:
            named = re.search(r"finger '([^']+)'", finding.where)
            mark = Mark(float(finding.frame), named[1] if named else "", finding.severity, str(finding))
            marks[mark] = mark
    return tuple(sorted(marks, key=lambda mark: mark.frame))
