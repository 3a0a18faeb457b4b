"""Tracks of single devices: renderer, limits, checks and origin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING

from ..contact.chunk_checks import check_device
from ..devices.mechanism import kind_of
from ..devices.safe_state import safe_findings
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..parameters.skin import SKIN_CONTACT
from ..presets import Library
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..version import made_by
from .bake import Output

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact
    from ..matching.rendered import Rendered

Renderer = Callable[..., "Rendered"]


@dataclass(frozen=True)
class Driven:
    """Results of one device on one finger.

    Attributes:
        output: the track; None if the device could not be rendered, and then a finding gives the reason.
        findings: findings about the scene.
        skipped: amounts of work that the scene did not need, by name.
    """

    output: Output | None
    findings: tuple[Finding, ...] = ()
    skipped: Mapping[str, int] = field(default_factory=dict)

    def stamped(self, content_hash: str) -> Driven:
        """Return the same results, with the hash of the scene in the track."""
        if self.output is None:
            return self
        track = self.output.track
        track = replace(track, meta={**track.meta, "content_hash": content_hash})
        return replace(self, output=replace(self.output, track=track))


def driven(
    pad_contact: PadContact,
    scene: TactileScene,
    finger: int,
    use: DeviceUse,
    spec: DeviceSpec,
    felt: SkinContact | None,
    content_hash: str,
) -> Driven:
    """Render one device of one finger.

    An error becomes a finding, so that the other devices are still rendered.

    Args:
        pad_contact: contact of the pads over the scene.
        scene: the scene's header.
        finger: index of the finger.
        use: the device on the finger.
        spec: preset of the device.
        felt: contact of the finger's skin; needed only by devices that follow the skin.
        content_hash: hash of the scene for the track.
    """
    try:
        check_device(pad_contact, scene.fingers[finger], finger, use)
        more = (felt,) if spec.follows_skin else ()
        rendered = renderer(spec)(pad_contact, scene, finger, use, spec, *more)
        output = finished(rendered, scene, finger, use, content_hash)
    except DermisError as error:
        return Driven(None, (unavailable(scene.fingers[finger].name, error),))
    return Driven(output, (), rendered.skipped)


def usable(
    scene: TactileScene, library: Library, findings: list[Finding]
) -> Iterator[tuple[int, DeviceUse, DeviceSpec]]:
    """Yield finger, use and preset of each device that can be driven.

    Args:
        scene: the scene's header.
        library: the presets.
        findings: list to which findings are appended: devices that cannot be driven, and fingers that have no device
            and whose skin is not shown.
    """
    specs: dict[str, DeviceSpec] = {}  # each preset is read once
    for i, finger in enumerate(scene.fingers):
        if not finger.devices and not SKIN_CONTACT["skin_shown"].of(finger.parameters):
            findings.append(
                Finding(
                    "warning",
                    "no-device",
                    "the finger has no device, so it gives no track",
                    where=f"finger '{finger.name}'",
                    remedy="Add one in the Dermis tab under Wear",
                )
            )
        for use in finger.devices:
            try:
                if use.preset not in specs:
                    specs[use.preset] = library.device(use.preset)
                spec = specs[use.preset]
                renderer(spec)
            except DermisError as error:
                findings.append(unavailable(finger.name, error))
                continue
            yield i, use, spec


def unavailable(finger: str, error: DermisError) -> Finding:
    """Return the finding that a device of a finger cannot be rendered."""
    return Finding("error", "device-unavailable", str(error).rstrip("."), where=f"finger '{finger}'")


def renderer(spec: DeviceSpec) -> Renderer:
    """Return the renderer of a kind of device; its module is imported here."""
    return import_module(f"..matching.{kind_of(spec).renderer}", __package__).render


def finished(rendered: Rendered, scene: TactileScene, finger: int, use: DeviceUse, content_hash: str) -> Output:
    """Limit a track to the device's abilities, check it, and add its origin."""
    name = scene.fingers[finger].name
    limited = rendered.track.within_limits()
    meta = {
        "finger": name,
        "scene": scene.name,
        "frame_range": f"{scene.frame_range[0]} {scene.frame_range[1]}",
        "fps": f"{scene.fps.numerator}/{scene.fps.denominator}",
        "generator": made_by(),
        "content_hash": content_hash,
        **limited.meta,
    }
    track = replace(limited, meta=meta)
    findings = tuple(rendered.findings) + tuple(track.check()) + safe_findings(track.spec)
    return Output(name, use.preset, track, rendered.signals, findings)
