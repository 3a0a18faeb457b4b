"""One touch of one finger goes through every device preset that fits, and each is judged by its own measures."""

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
    """One device.

    Attributes:
        device, title, kind: the preset's key, its name for people, its kind.
        judged: comparison of the target with the rendered touch.
        method: name of the matching method; '' if the device has only one.
        clipped: share of the samples that a limit of the device changed, of the channel that it changed most.
        findings: findings of the rendering and of the track's check.
        floor: how good any pose of the device could be, where that was asked for.
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
    """What every device makes of one touch.

    Attributes:
        scene, finger: names. duration: of the touch's scene [s]. content_hash: of the rendering.
        rows: devices, the least off in its main measure first among those of one measure. skipped: and why.
        findings: warnings about the touch, and about the skin that all devices are matched on.
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
    """Send a finger's touch through every device preset that fits; yield progress, return a `Comparison`.

    Args:
        finger: its name or number.
        cache: where skins and tables are kept.
        floors: also find how good any pose of a device could be; minutes for a long touch.

    Raises:
        DermisError: no such finger, a scene that cannot be rendered, or no device that fits.
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
        raise DermisError("no device fits this touch", where=f"finger '{name}'", value=why, remedy="Let it touch")
    rows.sort(key=lambda row: (row.judged.measures[0].name != "stress", row.judged.measures[0].off))
    touch = bake.skins[name].findings if name in bake.skins else ()
    told = (*touch, *(f for f in bake.findings if f.where == f"finger '{name}'" and f not in touch))
    warnings = tuple(f for f in told if f.severity != "info")
    return Comparison(scene.name, name, scene.duration, bake.content_hash, tuple(rows), tuple(skipped), warnings)


def floor_in(
    spec: DeviceSpec, skin: SkinContact | None, parameters: Mapping[str, Any]
) -> Generator[Progress, None, Floor | None]:
    """Find the floor of a device for a touch, see `matching.floor`; yield progress.

    Return None for a device that is not matched by a search for its pose. Six legs with a look-up table have the same
    floor as six legs that are searched, so it is computed for these as well.

    Raises:
        DermisError: a device that cannot touch this finger.
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
    """Return the progress within one step among several as that of all."""
    return Progress("judging", PARTS * step + PARTS * now.done // now.total, PARTS * steps)


def row_of(output: Output, judged: Judged) -> Row:
    """Return a device's row: its share of clipped samples is the worst of its track's and its method's own."""
    track = output.track
    changed = max(track.limited.values(), default=0) / max(len(track.times), 1)
    clipped = min(max(changed, judged.limited), 1.0)
    method = str(track.meta.get("method", ""))
    return Row(output.device, track.spec.name, track.spec.kind, method, judged, clipped, output.findings)


def _unused(device: DeviceSpec) -> str:
    """Return why the touch gives a device nothing to do."""
    return "the touch does not press the skin" if device.follows_skin else "the touch does not use it"


def _refusal(bake: Bake, key: str) -> str:
    """Return why a device was not rendered: its own findings, else all findings."""
    said = [f.what for f in bake.findings if f.code == "device-unavailable"]
    return next((s for s in said if key in s), "; ".join(said) or "it could not be rendered")
