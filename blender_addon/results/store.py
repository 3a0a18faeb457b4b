"""Keep the result of each scene's last bake, in memory and on disk.

A result stays in memory for the session, and is stored outside the .blend for the next one. A stored result is one
.npz of plain arrays and a JSON text. Its name is a hash of its version and the bake's content hash. `recall` reads
it after a file was opened, and its skins when they are first needed; nothing is written then. A loaded result is shown
as 'from an earlier session', never as up to date, because the scene may have changed without being watched.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import action_content, changes, identity, scene_time
from .._core import DermisError, Finding, core
from ..identity import Device
from ..preferences import setting, user_folder
from ..properties import skin_properties
from ..sampling import script_changes
from ..sampling.frames import frame_range
from . import owners, same_inputs, stored_skins

RESULT_VERSION = 3
READ = (3, 2, 1)  # versions that can be read; in version 1 skin does not stiffen, in version 2 it does so by a series
NOTES = {
    "fresh": "from the bake",
    "stale": "from a bake that is out of date",
    "earlier": "from an earlier session's bake",
}
"""Notes about a result that its reader sees, by its `state`."""


@dataclass(frozen=True)
class Result:
    """A bake, and the scene's state when it was made.

    Attributes:
        bake: the engine's `Bake`.
        clock: clock of the tracks.
        inputs: the contents of the scene when it was sampled; None for a result of an earlier session.
        fingerprint: the scene settings that no change handler reports.
        skins: size, material and accuracy of every skin of the bake; its model is made from these again.
        owners: the fingers of the bake, by their names at that time.
        whose: the device that each output belongs to.
        names: the present names of fingers, by their names in the bake; empty if all names are unchanged.
        last: the last frame of the range that was baked.
    """

    bake: core.pipeline.bake.Bake
    clock: scene_time.Clock
    inputs: same_inputs.Inputs | None
    fingerprint: tuple[Any, ...]
    skins: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    owners: owners.Owners = field(default_factory=dict)
    whose: tuple[Device, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    last: int = 0


@dataclass(frozen=True)
class Taken:
    """The state of a scene when it was sampled, before any later change."""

    owners: owners.Owners
    clock: scene_time.Clock
    span: tuple[int, int]
    inputs: same_inputs.Inputs
    fingerprint: tuple[Any, ...]
    skins: Mapping[str, Mapping[str, Any]]

    @classmethod
    def of(cls, scene: bpy.types.Scene, read: same_inputs.Inputs | None = None) -> Taken:
        """Note the state of a scene; give its fingers and devices identities.

        Args:
            read: the contents of the scene, if they have just been read; otherwise they are read at once.
        """
        span = frame_range(scene)
        action_content.look()
        skins = {obj.name_full: skin_of(obj) for obj in identity.fingers(scene)}
        clock, told = scene_time.clock(scene, span[0]), owners.of(scene)
        if read is None or read.edits != changes.edits():
            read = same_inputs.of(scene)
        return cls(told, clock, span, read, fingerprint(scene), skins)

    def holds(self, scene: bpy.types.Scene) -> bool:
        """Return whether the scene is in this state, see `same_inputs.hold`."""
        return self.fingerprint == fingerprint(scene) and same_inputs.hold(scene, self.inputs)


_results: dict[int, Result] = {}


def fingerprint(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return settings of a bake that change without a depsgraph update.

    The scripts that run when the frame changes are among them.
    """
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
        mine.bake_range,
        mine.frame_start,
        mine.frame_end,
        *script_changes.functions(),
    )


def keep(scene: bpy.types.Scene, bake: core.pipeline.bake.Bake, taken: Taken | None = None) -> Result:
    """Keep the result of a bake that has just ended.

    It is out of date if the scene has changed since it was sampled.

    Args:
        taken: the scene's state when it was sampled; its present state where None.
    """
    was = taken or Taken.of(scene)
    skins = {name: was.skins[name] for name in bake.skins if name in was.skins}
    whose = owners.whose(was.owners, bake.outputs)
    kept = Result(bake, was.clock, was.inputs, was.fingerprint, skins, was.owners, whose, {}, was.span[1])
    _results[scene.session_uid] = kept
    if was.inputs.edits == changes.edits():
        changes.clear_dirty()
    return kept


def current(scene: bpy.types.Scene) -> Result | None:
    """Return the scene's result, with the present names of its fingers.

    The result may be out of date.
    """
    kept = _results.get(scene.session_uid)
    return None if kept is None else owners.as_now(scene, kept)


def state(scene: bpy.types.Scene, *, wait: bool = False) -> str:
    """Return the state of a scene's result.

    It is 'none', 'fresh', 'stale' or 'earlier'. 'stale' means that the scene has changed since, or that this is not
    known yet; 'earlier' that the result is from an earlier session.

    Args:
        wait: find out at once whether the scene has changed, however long that takes.
    """
    result = _results.get(scene.session_uid)
    if result is None:
        return "none"
    if result.inputs is None:
        return "earlier"
    if result.fingerprint != fingerprint(scene):
        return "stale"
    return "fresh" if result.bake.recorded or same_inputs.hold(scene, result.inputs, wait=wait) else "stale"


def changed(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Return the names of data that have changed since the bake, and 'settings' for the scene's own settings."""
    result = _results.get(scene.session_uid)
    if result is None or result.inputs is None:
        return ()
    own = ("settings",) if result.fingerprint != fingerprint(scene) else ()
    return (*own, *same_inputs.changed(result.inputs))


def outdate(scene: bpy.types.Scene) -> None:
    """Mark the result as out of date until the next bake, because a new sampling gave another input."""
    kept = _results.get(scene.session_uid)
    if kept is not None:
        _results[scene.session_uid] = replace(kept, inputs=same_inputs.Inputs(-1, None))


def confirm(scene: bpy.types.Scene, taken: Taken) -> None:
    """Mark the result as up to date after a new sampling gave the same input.

    The result stays out of date if the sampled range is not the one that was baked.
    """
    kept = _results.get(scene.session_uid)
    if kept is not None and taken.span == (int(kept.clock.first), kept.last):
        _results[scene.session_uid] = replace(kept, inputs=taken.inputs, fingerprint=taken.fingerprint)
        if taken.inputs.edits == changes.edits():
            changes.clear_dirty()


def forget() -> None:
    """Drop every result from memory; stored ones stay."""
    _results.clear()
    same_inputs.forget()
    owners.forget()


def values_at(result: Result, output: core.pipeline.bake.Output, frame: float) -> np.ndarray | None:
    """Return the values of a track's channels at a frame, shape (channels,).

    Values are linear between samples. The last sample holds for up to one more frame. Outside, the result is None.
    """
    track = output.track
    t = result.clock.seconds(frame)
    if not len(track.times) or t < track.times[0] - 1e-9 or t > track.times[-1] + result.clock.duration(1.0):
        return None
    return np.array([np.interp(t, track.times, column) for column in track.values.T])


def signal_at(result: Result, output: core.pipeline.bake.Output, name: str, frame: float) -> float | None:
    """Return a diagnostic signal at a frame; None if there is none."""
    if name not in output.signals:
        return None
    t = result.clock.seconds(frame)
    return float(np.interp(t, output.track.times, output.signals[name]))


def cache() -> core.cache.Cache:
    """Return the size-capped folder of stored results."""
    return core.cache.Cache(user_folder("results", create=True), int(setting("cache_megabytes")) * 1_000_000)


def store(scene: bpy.types.Scene, result: Result) -> None:
    """Write a result to the user folder; note its hash and owners."""
    bake = result.bake
    cache().put(_key(bake.content_hash), lambda target: _write(Path(target), result))
    scene.dermis.bake_key = bake.content_hash
    scene.dermis.bake_owners = owners.dumps(result.owners)


def load(scene: bpy.types.Scene) -> Result | None:
    """Read the stored result of the scene's last bake; None if it is gone.

    The scene may not know the owners of the bake, as with a bake of an earlier version. Then its owners are the fingers
    that have the names in the bake, and the scene notes them.

    Raises:
        DermisError: the stored file cannot be read, or none of its fingers is in this scene.
    """
    key = scene.dermis.bake_key
    # `cache()` would create the folder.
    folder = core.cache.Cache(user_folder("results"), int(setting("cache_megabytes")) * 1_000_000)
    found = (folder.get(_key(key, version), use=False) for version in READ) if key else iter(())
    path = next((path for path in found if path is not None), None)
    if path is None:
        return None
    result = _read(path)
    told = owners.loads(scene.dermis.bake_owners)
    bake = result.bake
    if not told:
        names = {output.finger for output in bake.outputs} | set(stored_skins.forces_of(bake.skins))
        told = owners.of(scene, tuple(names))
        scene.dermis.bake_owners = owners.dumps(told)
        bake = replace(bake, findings=(*bake.findings, _by_name(scene, sorted(names), told)))
    elif not has_owner(scene):
        raise DermisError(
            "the stored bake is of fingers that are not in this scene: a copied finger has none",
            where=f"scene '{scene.name}'",
            value=", ".join(told),
            remedy="Bake this scene",
        )
    result = replace(result, bake=bake, owners=told, whose=owners.whose(told, bake.outputs))
    _results[scene.session_uid] = result
    return result


def baked() -> dict[str, str]:
    """Return the fingers' names in all scenes' stored bakes, by identity."""
    found = {}
    for scene in bpy.data.scenes:
        with suppress(DermisError):  # loading that bake reports the error
            told = owners.loads(scene.dermis.bake_owners)
            found.update({owner.identity: name for name, owner in told.items()})
    return found


def has_owner(scene: bpy.types.Scene) -> bool:
    """Return whether a scene may own its stored bake.

    It may if it has a finger of that bake, or if the owners are not known. The fingers of a copied scene are others.

    Raises:
        DermisError: the owners that the file names cannot be read.
    """
    told = owners.loads(scene.dermis.bake_owners)
    return not told or any(identity.finger_with(owner.identity, scene) for owner in told.values())


def _by_name(scene: bpy.types.Scene, names: Sequence[str], told: owners.Owners) -> Finding:
    """Return the finding that a stored bake knows fingers only by name."""
    lost = [name for name in names if name not in told]
    return Finding(
        "warning" if lost else "info",
        "bake-by-name",
        "the stored bake is of an earlier version, which identified fingers by name: fingers with these names have it "
        "now",
        where=f"scene '{scene.name}'",
        value=f"not in the scene: {', '.join(lost)}" if lost else ", ".join(names),
        remedy="Bake again if a finger was renamed since",
    )


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
            "last": result.last,
            "outputs": outputs,
            "findings": [f.as_dict() for f in bake.findings],
            "skipped": dict(bake.skipped),
            "content_hash": bake.content_hash,
            "stage_seconds": dict(bake.stage_seconds),
            "inputs": {name: dict(aspects) for name, aspects in bake.inputs.items()},
        },
        default=str,
    )
    with open(path, "wb") as file:
        np.savez_compressed(file, header=np.frombuffer(text.encode(), np.uint8), **arrays)


def _read(path: Path) -> Result:
    from fractions import Fraction

    from_preset, track = core.devices.spec.from_preset, core.track.command_track.CommandTrack
    with core.foreign.damage_told("the stored result cannot be read", str(path), remedy="Bake again"):
        # trusted: the compression has no limit, because ten thousand samples of a device at rest become ten bytes
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
            {str(n): {str(a): str(h) for a, h in own.items()} for n, own in header.get("inputs", {}).items()},
        )
        made_of = {e["finger"]: {"skin": e["skin"], "level": e["level"]} for e in header.get("skins", [])}
        clock = scene_time.Clock(Fraction(header["fps"]), float(header["first"]))
        return replace(Result(bake, clock, None, (), made_of), last=int(header.get("last", 0)))
