"""What the last bake of each scene gave: kept in memory for the session, stored outside the .blend for the next.

A stored result is one .npz of plain arrays and a JSON text, named by the bake's content hash. `recall` reads it after
a file was opened, its skins when they are first needed; nothing is written then. A loaded result is shown as 'from an
earlier session', never as up to date, since nobody has watched the scene meanwhile.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import changes, scene_time
from .._core import DermisError, Finding, core
from ..preferences import setting, user_folder
from ..properties import skin_properties
from ..sampling.frames import frame_range
from . import stored_skins

RESULT_VERSION = 3
READ = (3, 2, 1)  # versions; in the first skin does not stiffen, in the second it does so by a series
NOTES = {
    "fresh": "from the bake",
    "stale": "from a bake that is out of date",
    "earlier": "from an earlier session's bake",
}
"""What a reader should know about a result, by its `state`."""


@dataclass(frozen=True)
class Result:
    """A bake, and what the scene was when it was made.

    Attributes:
        bake: the engine's `Bake`.
        clock: of the tracks.
        generation: of `changes` when it was made; -1 for one from an earlier session.
        fingerprint: the scene settings that no change handler reports.
        skins: size, material and accuracy of every skin of the bake, from which its model is made again.
    """

    bake: core.pipeline.bake.Bake
    clock: scene_time.Clock
    generation: int
    fingerprint: tuple[Any, ...]
    skins: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


_results: dict[int, Result] = {}


def fingerprint(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return the settings of a scene that a bake depends on and that change without a depsgraph update."""
    units, mine = scene.unit_settings, scene.dermis
    return (
        *scene_time.settings(scene),
        scene.frame_start,
        scene.frame_end,
        scene.use_preview_range,
        scene.frame_preview_start,
        scene.frame_preview_end,
        units.system,
        units.scale_length,
        scene.use_gravity,
        tuple(scene.gravity),
        mine.sample_rate,
        mine.use_range,
        mine.frame_start,
        mine.frame_end,
    )


def keep(scene: bpy.types.Scene, bake: core.pipeline.bake.Bake) -> Result:
    """Take over the result of a bake that has just ended: from here on changes make it out of date."""
    clock = scene_time.clock(scene, frame_range(scene)[0])
    skins = {name: skin_of(scene.objects[name]) for name in bake.skins if name in scene.objects}
    kept = Result(bake, clock, changes.generation(), fingerprint(scene), skins)
    _results[scene.session_uid] = kept
    changes.clear_dirty()
    return kept


def current(scene: bpy.types.Scene) -> Result | None:
    """Return the scene's result, up to date or not."""
    return _results.get(scene.session_uid)


def state(scene: bpy.types.Scene) -> str:
    """Return 'none', 'fresh', 'stale' (the scene changed since) or 'earlier' (from an earlier session)."""
    result = current(scene)
    if result is None:
        return "none"
    if result.generation < 0:
        return "earlier"
    same = result.generation == changes.generation() and not changes.dirty()
    return "fresh" if same and result.fingerprint == fingerprint(scene) else "stale"


def forget() -> None:
    """Drop every result from memory; stored ones stay."""
    _results.clear()


def values_at(result: Result, output: core.pipeline.bake.Output, frame: float) -> np.ndarray | None:
    """Return the values of a track at a frame, linearly between samples; None outside the range."""
    track = output.track
    t = result.clock.seconds(frame)
    if not len(track.times) or t < track.times[0] - 1e-9 or t > track.times[-1] + result.clock.duration(1.0):
        return None
    return np.array([np.interp(t, track.times, column) for column in track.values.T])


def signal_at(result: Result, output: core.pipeline.bake.Output, name: str, frame: float) -> float | None:
    """Return a diagnostic signal at a frame, or None where the bake has none of that name."""
    if name not in output.signals:
        return None
    t = result.clock.seconds(frame)
    return float(np.interp(t, output.track.times, output.signals[name]))


def cache() -> core.cache.Cache:
    """Return the size-capped folder of stored results."""
    return core.cache.Cache(user_folder("results", create=True), int(setting("cache_megabytes")) * 1_000_000)


def store(scene: bpy.types.Scene, result: Result) -> None:
    """Write a result to the user folder and note its key in the scene."""
    bake = result.bake
    cache().put(_key(bake.content_hash), lambda target: _write(Path(target), result))
    scene.dermis.bake_key = bake.content_hash


def load(scene: bpy.types.Scene) -> Result | None:
    """Read the stored result of the scene's last bake; None where it is gone.

    Raises:
        DermisError: the stored file cannot be read.
    """
    key = scene.dermis.bake_key
    # no `cache()`: that would make the folder
    folder = core.cache.Cache(user_folder("results"), int(setting("cache_megabytes")) * 1_000_000)
    found = (folder.get(_key(key, version), use=False) for version in READ) if key else iter(())
    path = next((path for path in found if path is not None), None)
    if path is None:
        return None
    result = _read(path)
    _results[scene.session_uid] = result
    return result


def skin_of(obj: bpy.types.Object) -> dict[str, Any]:
    """Return size, material and accuracy of a finger's skin, as it is now."""
    values = skin_properties.parameters(obj.dermis.finger.skin)
    return {"skin": values["skin"], "level": values["skin_level"]}


def _key(content_hash: str, version: int = RESULT_VERSION) -> str:
    return str(core.cache.cache_key(f"bake {version}", content_hash))


def _write(path: Path, result: Result) -> None:
    bake = result.bake
    arrays: dict[str, Any] = {}
    outputs = []
    for i, output in enumerate(bake.outputs):
        arrays[f"times_{i}"], arrays[f"values_{i}"] = output.track.times, output.track.values
        for name, series in output.signals.items():
            arrays[f"signal_{i}_{name}"] = np.asarray(series, np.float32)
        outputs.append(
            {
                "finger": output.finger,
                "device": output.device,
                "spec": dict(output.track.spec.source),
                "meta": dict(output.track.meta),
                "limited": dict(output.track.limited),
                "signals": sorted(output.signals),
                "findings": [f.as_dict() for f in output.findings],
            }
        )
    skins = stored_skins.pack(bake.skins, result.skins, arrays)
    text = json.dumps(
        {
            "version": RESULT_VERSION,
            "skins": skins,
            "fps": float(result.clock.rate),
            "first": result.clock.first,
            "outputs": outputs,
            "findings": [f.as_dict() for f in bake.findings],
            "skipped": dict(bake.skipped),
            "content_hash": bake.content_hash,
            "stage_seconds": dict(bake.stage_seconds),
        },
        default=str,
    )
    with open(path, "wb") as file:
        np.savez_compressed(file, header=np.frombuffer(text.encode(), np.uint8), **arrays)


def _read(path: Path) -> Result:
    from fractions import Fraction

    from_preset, track = core.devices.spec.from_preset, core.track.command_track.CommandTrack
    with core.foreign.damage_told("the stored result cannot be read", str(path), remedy="Bake again"):
        # trusted: of a device at rest ten thousand samples become ten bytes
        with core.npz.opened_npz(path, kind="a stored result", trusted=True) as archive:
            file = archive.arrays([name for name in archive.names if stored_skins.at_once(name)])
            header = core.foreign.json_of(file["header"].tobytes(), str(path), core.foreign.MAX_TEXT, constants=True)
            if header["version"] not in READ:
                raise DermisError(
                    "made by another version",
                    where=str(path),
                    value=header["version"],
                    limit=", ".join(map(str, READ)),
                    remedy="Bake again",
                )
            outputs = tuple(
                core.pipeline.bake.Output(
                    entry["finger"],
                    entry["device"],
                    track(
                        from_preset(entry["device"], entry["spec"]),
                        file[f"times_{i}"],
                        file[f"values_{i}"],
                        entry["meta"],
                        entry["limited"],
                    ),
                    {name: file[f"signal_{i}_{name}"].astype(float) for name in entry["signals"]},
                    tuple(Finding(**f) for f in entry["findings"]),
                )
                for i, entry in enumerate(header["outputs"])
            )
            skins = stored_skins.StoredSkins(path, header.get("skins", []), file)
        bake = core.pipeline.bake.Bake(
            outputs,
            tuple(Finding(**f) for f in header["findings"]),
            header["skipped"],
            header["content_hash"],
            header["stage_seconds"],
            skins,
        )
        made_of = {e["finger"]: {"skin": e["skin"], "level": e["level"]} for e in header.get("skins", [])}
        clock = scene_time.Clock(Fraction(header["fps"]), float(header["first"]))
        return Result(bake, clock, -1, (), made_of)
