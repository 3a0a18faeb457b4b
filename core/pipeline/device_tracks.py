"""One device on one finger: what drives it, and its track, within its limits and with where it comes from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

from ..devices.mechanism import kind_of
from ..devices.safe_state import safe_findings
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..parameters.skin import SKIN_CONTACT
from ..presets import Library
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..version import version
from .bake import Output

if TYPE_CHECKING:
    from ..matching.rendered import Rendered

Renderer = Callable[..., "Rendered"]


def usable(
    scene: TactileScene, library: Library, findings: list[Finding]
) -> Iterator[tuple[int, DeviceUse, DeviceSpec]]:
    """Pair every finger with the devices that can be driven; say which cannot, and go on."""
    for i, finger in enumerate(scene.fingers):
        if not finger.devices and not SKIN_CONTACT["skin_shown"].of(finger.parameters):
            findings.append(
                Finding(
                    "warning",
                    "no-device",
                    "the finger has no device, so it gives no track",
                    where=f"finger '{finger.name}'",
                    remedy="Add one in the Dermis tab under Devices",
                )
            )
        for use in finger.devices:
            try:
                spec = library.device(use.preset)
                renderer(spec)
            except DermisError as error:
                findings.append(unavailable(finger.name, error))
                continue
            yield i, use, spec


def unavailable(finger: str, error: DermisError) -> Finding:
    """Return the finding that a device of a finger cannot be rendered."""
    return Finding("error", "device-unavailable", str(error).rstrip("."), where=f"finger '{finger}'")


def renderer(spec: DeviceSpec) -> Renderer:
    """Return the method that drives this kind of device; its module loads only now."""
    return import_module(f"..matching.{kind_of(spec).renderer}", __package__).render


def finished(rendered: Rendered, scene: TactileScene, finger: int, use: DeviceUse, content_hash: str) -> Output:
    """Limit the track to what the device can do, check it, and write down where it comes from."""
    name = scene.fingers[finger].name
    limited = rendered.track.within_limits()
    meta = {
        "finger": name,
        "scene": scene.name,
        "frame_range": f"{scene.frame_range[0]} {scene.frame_range[1]}",
        "fps": f"{scene.fps.numerator}/{scene.fps.denominator}",
        "generator": f"dermis {version()}",
        "content_hash": content_hash,
        **limited.meta,
    }
    track = replace(limited, meta=meta)
    findings = tuple(rendered.findings) + tuple(track.check()) + safe_findings(track.spec)
    return Output(name, use.preset, track, rendered.signals, findings)
