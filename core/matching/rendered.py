"""Rendered: result of a matching method for one device on one finger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..arrays import Array
from ..errors import Finding
from ..track.command_track import CommandTrack


@dataclass(frozen=True)
class Rendered:
    """Commands of one device, with diagnostics.

    Attributes:
        track: commands at the device's rate, within its range; the pipeline checks every limit again.
        signals: diagnostic series at the track's times, such as 'contact' (0 or 1), shape (n,) each.
        findings: findings to show to a person.
        skipped: results not computed because the scene did not need them, by name.
    """

    track: CommandTrack
    signals: Mapping[str, Array] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    skipped: Mapping[str, int] = field(default_factory=dict)
