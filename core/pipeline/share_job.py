"""Share: results of some fingers' skins and of the devices on them.

A share can be rendered as a job in another process.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache
from ..devices.spec import DeviceSpec, from_preset
from ..errors import DermisError, Finding
from ..presets import Library
from ..recent import Recent
from ..scene import scene_file
from ..scene.tactile_scene import TactileScene
from ..steps import drain
from ..track.command_track import CommandTrack
from ..work.jobs import Report
from .bake import Output, Progress
from .device_tracks import Driven, driven, renderer, usable
from .felt import skin_models, touched
from .stages import Stages

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact
    from ..skin.model import SkinModel


@dataclass(frozen=True)
class Share:
    """Results of some fingers.

    Attributes:
        felt: contact of the skins, by the index of the finger.
        driven: results of the devices that follow the skin, in the scene's order, by the index of the finger. Their
            tracks do not have the hash of the whole scene yet.
        seconds: run time of each stage [s].
    """

    felt: Mapping[int, SkinContact]
    driven: Mapping[int, Sequence[Driven]]
    seconds: Mapping[str, float]

    def packed(self) -> Share:
        """Return the same share with its skin contact in a tenth of the memory.

        Forces are rounded, see `SkinContact.packed`.
        """
        return replace(self, felt={f: touch.packed() for f, touch in self.felt.items()})


class Opened(NamedTuple):
    """A scene, and what its shares have in common.

    Attributes:
        scene: the scene.
        library: the presets.
        cache: cache of condensed skins; None to condense them here.
        alike: skins that a share has made, see `skin_models`.
    """

    scene: TactileScene
    library: Library
    cache: Cache | None
    alike: dict[str, SkinModel]


_opened: Recent[str, Opened] = Recent(1)  # a process usually renders several shares of one scene


def render_share(
    opened: Opened, fingers: Sequence[int], beside: Sequence[int] = ()
) -> Generator[Progress, None, Share]:
    """Render the skins of some fingers and the devices that follow them.

    The generator yields progress.

    Args:
        opened: the scene.
        fingers: indices of the fingers.
        beside: indices of fingers without simulated skin that may hold an object together with `fingers`.
    """
    clock, told = Stages(), list[Finding]()  # findings are dropped: the caller has them for the whole scene
    scene, library, cache, alike = opened
    models = yield from skin_models(scene, fingers, library, cache, clock, told, alike)
    pad_contact, felt = yield from touched(scene, iter(scene.chunks), models, clock, fingers={*models, *beside})
    return Share(felt, (yield from driven_by(scene, library, pad_contact, felt, clock)), clock.seconds)


def driven_by(
    scene: TactileScene, library: Library, pad_contact: PadContact, felt: Mapping[int, SkinContact], clock: Stages
) -> Generator[Progress, None, dict[int, list[Driven]]]:
    """Render the devices that follow some fingers' skins; yield progress.

    The tracks do not have the hash of the whole scene yet.

    Args:
        scene: the scene's header.
        library: the presets.
        pad_contact: contact of the pads.
        felt: contact of the skins, by the index of the finger.
        clock: run times.

    Returns:
        Results of the devices in the scene's order, by the index of the finger.
    """
    told: list[Finding] = []  # findings are dropped: `render` has them for the whole scene
    uses = [(f, use, spec) for f, use, spec in usable(scene, library, told) if f in felt and spec.follows_skin]
    made: dict[int, list[Driven]] = {f: [] for f in felt}
    for step, (f, use, spec) in enumerate(uses):
        yield Progress("devices", step, len(uses))
        with clock.stage("devices"):
            made[f].append(driven(pad_contact, scene, f, use, spec, felt[f], ""))
    return made


def asked(
    scene: Path, library: Library, cache: Cache | None, fingers: Sequence[int], beside: Sequence[int]
) -> dict[str, Any]:
    """Return the parameters of the job 'share', see `work`."""
    return {
        "scene": str(scene),
        "presets": [str(folder) for folder in library.folders],
        "cache": None if cache is None else [str(cache.folder), cache.limit_bytes],
        "fingers": [*fingers],
        "beside": [*beside],
    }


def work(_arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report) -> dict[str, NDArray[Any]]:
    """Render one share of the scene in a file, as the job 'share'.

    Args:
        _arrays: none.
        parameters: see `asked`.
        report: function that receives the progress.

    Returns:
        The share as arrays, see `arrays_of`.

    Raises:
        DermisError: the file cannot be read, or see `render_share`.
    """
    key = json.dumps([parameters[name] for name in ("scene", "presets", "cache")])
    opened = _opened.make(key, lambda: _open(parameters))
    steps, samples = render_share(opened, parameters["fingers"], parameters["beside"]), opened.scene.sample_count
    return arrays_of(drain(steps, lambda step: report(done_of(step, samples), size_of(samples))))


def begin(
    _arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], _report: Report
) -> dict[str, NDArray[Any]]:
    """Import what shares of a scene need, as the job 'share-begin'.

    Args:
        _arrays: none.
        parameters: folders of the presets, see `asked`, and keys of the device presets.
        _report: not called.

    Returns:
        Nothing.
    """
    from ..contact import pad_sampler, skin_sampler  # noqa: F401

    library = _library(parameters["presets"])
    for name in parameters["devices"]:
        with suppress(DermisError):  # the bake tells it
            renderer(library.device(name))
    return {}


def _library(folders: Sequence[str]) -> Library:
    built_in, *own = map(Path, folders)
    return Library(own[0] if own else None, built_in)


def _open(parameters: Mapping[str, Any]) -> Opened:
    cache = None if parameters["cache"] is None else Cache(Path(parameters["cache"][0]), int(parameters["cache"][1]))
    return Opened(scene_file.load(Path(parameters["scene"])), _library(parameters["presets"]), cache, {})


def size_of(samples: int) -> int:
    """Return the total of a share's progress.

    Contact and devices take about the same time, so each of the two counts as one step per sample.
    """
    return 2 * samples


def done_of(step: Progress, samples: int) -> int:
    """Return how much of `size_of` is done; 0 for stages that do not count."""
    if step.stage in ("sampling", "skin contact"):
        return min(step.done, samples)
    return samples + samples * step.done // max(1, step.total) if step.stage == "devices" else 0


def arrays_of(share: Share) -> dict[str, NDArray[Any]]:
    """Return a share as arrays, from which `made_of` restores it."""
    from ..contact import skin_arrays

    arrays: dict[str, NDArray[Any]] = {}
    head: dict[str, Any] = {"seconds": dict(share.seconds), "fingers": {}}
    for f, touch in share.felt.items():
        arrays |= {f"{f}/skin/{name}": array for name, array in skin_arrays.arrays_of(touch).items()}
        head["fingers"][str(f)] = {
            "findings": plain_findings(touch.findings),
            "skipped": dict(touch.skipped),
            "devices": [_entry(f"{f}/{n}", one, arrays) for n, one in enumerate(share.driven[f])],
        }
    return {"head": np.frombuffer(json.dumps(head).encode(), np.uint8), **arrays}


def made_of(
    arrays: Mapping[str, NDArray[Any]], scene: TactileScene, models: Mapping[int, SkinModel], library: Library
) -> Share:
    """Restore a share from the result of `arrays_of`."""
    from ..contact import skin_arrays

    head = json.loads(arrays["head"].tobytes())
    felt, made = {}, {}
    for name, entry in head["fingers"].items():
        f, prefix = int(name), f"{name}/skin/"
        own = {key.removeprefix(prefix): array for key, array in arrays.items() if key.startswith(prefix)}
        felt[f] = skin_arrays.touch_of(models[f], own, findings_of(entry["findings"]), entry["skipped"])
        made[f] = [_driven(f"{name}/{n}", one, arrays, library) for n, one in enumerate(entry["devices"])]
    return Share(felt, made, head["seconds"])


def _entry(place: str, one: Driven, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    entry: dict[str, Any] = {"findings": plain_findings(one.findings), "skipped": dict(one.skipped), "output": None}
    if one.output is not None:
        output, track = one.output, one.output.track
        arrays |= {f"{place}/times": track.times, f"{place}/values": track.values}
        arrays |= {f"{place}/signal/{name}": np.asarray(series) for name, series in output.signals.items()}
        entry["output"] = {
            "finger": output.finger,
            "device": output.device,
            "spec": dict(track.spec.source),
            "meta": dict(track.meta),
            "limited": dict(track.limited),
            "signals": list(output.signals),
            "findings": plain_findings(output.findings),
        }
    return entry


def _driven(place: str, entry: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], library: Library) -> Driven:
    told, skipped, out = findings_of(entry["findings"]), entry["skipped"], entry["output"]
    if out is None:
        return Driven(None, told, skipped)
    track = CommandTrack(
        _spec(out["device"], out["spec"], library),
        arrays[f"{place}/times"],
        arrays[f"{place}/values"],
        out["meta"],
        out["limited"],
    )
    signals = {name: arrays[f"{place}/signal/{name}"] for name in out["signals"]}
    return Driven(Output(out["finger"], out["device"], track, signals, findings_of(out["findings"])), told, skipped)


def _spec(device: str, source: Mapping[str, Any], library: Library) -> DeviceSpec:
    known = library.device(device)
    return known if known.source == source else from_preset(device, source)


def plain_findings(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return findings as dictionaries for JSON; other values become text."""
    entries = [finding.as_dict() for finding in findings]
    for entry in entries:
        if not isinstance(entry["value"], str | int | float | bool | None):
            entry["value"] = str(entry["value"])
    return entries


def findings_of(entries: Sequence[Mapping[str, Any]]) -> tuple[Finding, ...]:
    return tuple(Finding(**entry) for entry in entries)
