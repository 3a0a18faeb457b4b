"""Comparison of devices for one touch of one finger.

The touch is rendered by every device preset that fits. Each device is judged by its own measures, see `measures`.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ..contact.skin_contact import SkinContact
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..matching.floor import Floor, floor_of, looked_at
from ..matching.thimble import amounts_at, forces_at
from ..matching.thimble_use import by_stress, method_name, prepare
from ..pipeline.bake import Bake, Output, Progress
from ..pipeline.render import render
from ..presets import Library
from ..scene.tactile_scene import TactileScene
from ..steps import in_words
from .measures import Judged, judge
from .wearing import Skipped, finger_index, wearing_all

if TYPE_CHECKING:
    from ..cache import Cache

PARTS = 1000  # steps of progress for each device
SEARCHED = ("thimble", "hexapod")  # kinds of devices with a floor


@dataclass(frozen=True, eq=False)
class Row:
    """Result for one device.

    Attributes:
        device, title, kind: key, name and kind of the device preset.
        judged: comparison of the target with the rendered touch.
        method: name of the matching method; '' if the device has only one.
        clipped: share of the samples that a limit changed, for the channel that was changed most; or the share at which
            the matching method was at a limit, if that is larger.
        findings: findings of the rendering, of the track's check, and of playing the track.
        floor: least error of any pose of the device; None if it was not requested or does not exist.
    """

    device: str
    title: str
    kind: str
    method: str
    judged: Judged
    clipped: float
    findings: tuple[Finding, ...]
    floor: Floor | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """Results of all devices for one touch.

    Attributes:
        scene, finger: names of the scene and the finger.
        duration: duration of the scene [s].
        content_hash: content hash of the rendering.
        rows: results of the devices. Devices judged by stress come first; within each group, the error of the main
            measure rises.
        skipped: devices that were left out, with the reasons.
        findings: warnings about the touch, about the skin for which all devices are matched, and about playing tracks.
    """

    scene: str
    finger: str
    duration: float
    content_hash: str
    rows: tuple[Row, ...]
    skipped: tuple[Skipped, ...]
    findings: tuple[Finding, ...] = ()


def compare_devices(
    scene: TactileScene, library: Library, finger: str | int = 0, *, cache: Cache | None = None, floors: bool = False
) -> Generator[Progress, None, Comparison]:
    """Render a finger's touch with every device that fits, and judge it.

    Progress is yielded, and a `Comparison` is returned.

    Args:
        finger: name or index of the finger.
        cache: cache of skins and tables.
        floors: whether to find the least error of any pose of each device. For a long touch this takes minutes.

    Raises:
        DermisError: there is no such finger, the scene cannot be rendered, or no device fits.
    """
    number = finger_index(scene, finger)
    name = scene.fingers[number].name
    worn, fit, skipped = wearing_all(scene, library, number)
    bake = yield from render(worn, library, cache=cache)
    uses = {use.preset: use for use in reversed(worn.fingers[number].devices)}
    outputs = {o.device: o for o in reversed(bake.outputs) if o.finger == name}
    felt = bake.skins.get(name)
    rows = []
    for step, key in enumerate(fit):
        yield Progress("judging", PARTS * step, PARTS * len(fit))
        title = library.device(key).name
        output = outputs.get(key)
        if output is None:
            skipped.append(Skipped(key, title, _refusal(bake, key)))
            continue
        try:
            judged = judge(output, felt, uses[key].parameters)
        except DermisError as error:
            skipped.append(Skipped(key, title, str(error).rstrip(".")))
            continue
        if judged is None:
            skipped.append(Skipped(key, title, _unused(library.device(key))))
        else:
            row = row_of(output, judged)
            if floors:
                searched = floor_in(output.track.spec, felt, uses[key].parameters)
                found = yield from in_words(searched, partial(_share, step, len(fit)))
                said = () if found is None else found.findings(f"finger '{name}', {key}")
                row = replace(row, floor=found, findings=(*row.findings, *said))
            rows.append(row)
    if not rows:
        why = "; ".join(f"{s.title}: {s.why}" for s in skipped)
        raise DermisError(
            "no device fits this touch", where=f"finger '{name}'", value=why, remedy="Let the finger touch an object"
        )
    rows.sort(key=lambda row: (row.judged.measures[0].name != "stress", row.judged.measures[0].off))
    touch = bake.skins[name].findings if name in bake.skins else ()
    told = [*touch, *(f for f in bake.findings if f.where == f"finger '{name}'" and f not in touch)]
    told += [f for row in rows for f in row.judged.findings]
    warnings = tuple(f for f in told if f.severity != "info")
    return Comparison(scene.name, name, scene.duration, bake.content_hash, tuple(rows), tuple(skipped), warnings)


def floor_in(
    spec: DeviceSpec, skin: SkinContact | None, parameters: Mapping[str, Any]
) -> Generator[Progress, None, Floor | None]:
    """Find the floor of a device for a touch; yields progress.

    The floor is the least error of any pose of the device, see `matching.floor`. None is returned for a device of a
    kind without a floor, see `SEARCHED`, and if nothing is touched. The floor of a hexapod does not depend on its
    matching method, so it is also computed for one that uses a look-up table.

    Raises:
        DermisError: the device cannot touch this finger.
    """
    if skin is None or spec.kind not in SEARCHED or not len(skin.contact):
        return None
    given = dict(parameters)
    if not by_stress(spec, given):
        given[method_name(spec)] = "stress"
    times = skin.times[looked_at(len(skin.times))]
    forces = forces_at(skin, times)
    if not forces.any():
        return None
    steps = floor_of(prepare(spec, skin.pressed, given), forces, amounts_at(skin, times))
    return (yield from in_words(steps, lambda step: Progress(f"{spec.key}, {step.stage}", step.done, step.total)))


def _share(step: int, steps: int, now: Progress) -> Progress:
    """Convert the progress within one step to that of all steps."""
    return Progress("judging", PARTS * step + PARTS * now.done // now.total, PARTS * steps)


def row_of(output: Output, judged: Judged) -> Row:
    """Return the row of a device, see `Row`."""
    track = output.track
    changed = max(track.limited.values(), default=0) / max(len(track.times), 1)
    clipped = min(max(changed, judged.limited), 1.0)
    method = str(track.meta.get("method", ""))
    return Row(
        output.device, track.spec.name, track.spec.kind, method, judged, clipped, (*output.findings, *judged.findings)
    )


def _unused(device: DeviceSpec) -> str:
    """Return the reason why a touch does not use a device."""
    return "the pad does not press into any object" if device.follows_skin else "this touch gives it nothing to render"


def _refusal(bake: Bake, key: str) -> str:
    """Return the reason why a device was not rendered.

    It is the device's own finding, else the findings of all devices that could not be rendered.
    """
    said = [f.what for f in bake.findings if f.code == "device-unavailable"]
    return next((s for s in said if key in s), "; ".join(said) or "it could not be rendered")
