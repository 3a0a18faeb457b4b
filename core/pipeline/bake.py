"""Results of rendering a scene: tracks, skins and findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..arrays import Array
from ..errors import Finding
from ..track.command_track import RECORDED, CommandTrack

if TYPE_CHECKING:
    from ..contact.skin_contact import SkinContact


@dataclass(frozen=True)
class Progress:
    """Progress of a rendering: `done` of `total` steps of a stage."""

    stage: str
    done: int
    total: int


@dataclass(frozen=True)
class Output:
    """The track of one device on one finger.

    Attributes:
        finger, device: the finger's name and the preset's key.
        track: commands of the device, limited to its abilities.
        signals: diagnostic series at the track's times, such as 'contact'.
        findings: findings of the method and of the track's own check.
    """

    finger: str
    device: str
    track: CommandTrack
    signals: Mapping[str, Array]
    findings: tuple[Finding, ...]

    def __repr__(self) -> str:
        size = f"{len(self.track.times)} samples, {self.track.duration:g} s"
        return f"Output({self.finger!r}, {self.device}, {size}, {len(self.findings)} findings)"


@dataclass(frozen=True)
class Bake:
    """The result of one rendering of a scene.

    Attributes:
        outputs: one for each device of each finger that could be rendered, in the scene's order.
        findings: findings about the scene as a whole; `all_findings` also has those of the outputs.
        skipped: counts of work that the scene did not need, by name.
        content_hash: hash of the scene, of the presets of its devices, of the version of Dermis and its engine, and of
            the names of the fingers whose contact is solved at points.
        stage_seconds: run time of each stage [s].
        skins: contact of each simulated skin, by the name of the finger.
        inputs: hashes of all inputs of the bake, by object, see `inputs.inputs_of`.
    """

    outputs: tuple[Output, ...]
    findings: tuple[Finding, ...]
    skipped: Mapping[str, int]
    content_hash: str
    stage_seconds: Mapping[str, float] = field(default_factory=dict)
    skins: Mapping[str, SkinContact] = field(default_factory=dict)
    inputs: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def __repr__(self) -> str:
        names = ", ".join(f"{output.finger}: {output.device}" for output in self.outputs)
        return f"Bake({names or 'no outputs'}; {len(self.skins)} skins, {len(self.all_findings)} findings)"

    @property
    def recorded(self) -> bool:
        """Whether all tracks follow recordings of sensors, and none the scene."""
        sensors = [str(output.track.meta.get("sensor", "")) for output in self.outputs]
        return bool(sensors) and all(sensor.startswith(RECORDED) for sensor in sensors)

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """Findings of the scene and of every output."""
        return self.findings + tuple(f for output in self.outputs for f in output.findings)
