"""The device to stream to and its track, as the settings name them.

The track is from the bake or from a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from .. import changes, identity, scene_time
from .._core import DermisError, core
from ..choices import title
from ..identity import Device, Place
from ..preferences import library
from ..preview.rows import Row
from ..results import store
from ..sampling.frames import frame_range_now
from . import agreed_paths
from .calibration_rows import quietly


class _Sent(NamedTuple):
    """The baked track that the sender has, with the clock of its own bake.

    A later bake does not change this clock.
    """

    track: Any
    scene: int  # session uid
    name: str
    clock: scene_time.Clock


class Choice(NamedTuple):
    """A device that can be streamed to.

    Attributes:
        device: identities of the finger and of the device, '' if not given yet.
        place: last known name and session uid of the finger, by which it is found again.
        finger, preset: name of the finger, and key of the preset.
        label: unique text for people, 'finger: device'.
        nth: index among the devices of this preset on this finger.
        output: its output in the bake, None without one.
    """

    device: Device
    place: Place
    finger: str
    preset: str
    label: str
    nth: int
    output: Any


class _Pinned(NamedTuple):
    """The device that is connected."""

    scene: int  # session uid
    choice: Choice


# The result and the state of the scene from which the choices were made, and the choices.
_choices: tuple[Any, Any, tuple[Choice, ...]] = (None, (), ())
_pinned: _Pinned | None = None
_files: list[Path] = []
_file_track: Any = None  # the track of `track_file`: ((path, time of its change [ns]), CommandTrack)
_sent: _Sent | None = None
_judged: tuple[Any, str] = (None, "")  # a track, and in words how it disagrees with its preset


def choices(scene: bpy.types.Scene) -> tuple[Choice, ...]:
    """Return every device that can be streamed to.

    Devices with a baked track come first, in the order of the bake.
    """
    global _choices
    result = store.current(scene)
    key = (scene.session_uid, changes.ticks(), changes.edits(), identity.revision(), len(bpy.data.objects))
    if _choices[0] is not result or _choices[1] != key:
        _choices = result, key, _listed(scene, result)
    return _choices[2]


def chosen(scene: bpy.types.Scene) -> Choice | None:
    """Return the device that the settings name, None if it is gone.

    A device with an identity is found even if its finger was renamed. If the settings name no device, the connected
    one is returned, or the first one if none is connected.
    """
    settings, there = scene.dermis_stream, choices(scene)
    own = _chosen_key(settings)
    if own is not None:
        return next((choice for choice in there if choice.device == own), None)
    if settings.output:
        return next((choice for choice in there if choice.label == settings.output), None)
    if _pinned is not None and _pinned.scene == scene.session_uid:
        return next((choice for choice in there if choice.device == _pinned.choice.device), None)
    return there[0] if there else None


def choose(scene: bpy.types.Scene) -> None:
    """Store the identity of the device whose label the settings hold.

    The settings then still name this device when its finger is renamed.
    """
    settings = scene.dermis_stream
    choice = next((c for c in choices(scene) if c.label == settings.output), None)
    settings.output_of = ""
    if choice is not None:
        _hold(settings, _known(scene, choice))


def relabel(scene: bpy.types.Scene) -> None:
    """Update the settings' label to the current name of the device's finger."""
    choice = chosen(scene) if scene.dermis_stream.output else None
    if choice is not None and choice.label != scene.dermis_stream.output:
        with quietly(scene):
            scene.dermis_stream.output = choice.label
            _hold(scene.dermis_stream, choice)


def pin(scene: bpy.types.Scene) -> None:
    """Note which device is connected, so that `gone` can watch it.

    For a track file nothing is noted.
    """
    global _pinned
    settings = scene.dermis_stream
    if settings.track_file:
        _pinned = None
        return
    if settings.output and _chosen_key(settings) is None:
        choose(scene)
    choice = chosen(scene)
    if choice is not None:
        _pinned = _Pinned(scene.session_uid, _known(scene, choice))


def unpin() -> None:
    """Note that nothing is connected."""
    global _pinned
    _pinned = None


def gone(scene: bpy.types.Scene) -> str:
    """Return why the connected device is gone from the scene, '' if it is there."""
    global _pinned
    if _pinned is None:
        return ""
    choice = _pinned.choice
    finger = choice.place.finger(scene)
    if finger is None:
        return f"finger '{choice.finger}' is not in the scene any more"
    if not any(d == choice.device and item.preset == choice.preset for d, item in identity.worn(finger)):
        return (
            f"finger '{finger.name_full}' does not wear an enabled device '{title('devices', choice.preset)}' any more"
        )
    if finger.name_full != choice.place.name:
        _pinned = _pinned._replace(choice=choice._replace(place=Place.of(finger), finger=finger.name_full))
    return ""


def chosen_output(scene: bpy.types.Scene) -> Any:
    """Return the output that is to be played, or None."""
    choice = chosen(scene)
    return choice.output if choice is not None else None


def device(scene: bpy.types.Scene) -> Choice:
    """Return the device of the scene that the settings name, see `chosen`.

    Raises:
        DermisError: there is none.
    """
    choice, wanted = chosen(scene), scene.dermis_stream.output
    if choice is not None:
        return choice
    labels = ", ".join(c.label for c in choices(scene))
    if not wanted or not labels:
        raise DermisError(
            "no device to stream to",
            where=scene.name,
            limit=labels,
            remedy="Give a finger a device, or choose a track file",
        )
    raise DermisError(
        "there is no such finger with this device",
        where="Track",
        value=wanted,
        limit=labels,
        remedy="Choose one of these, or give the finger this device",
    )


def device_key(scene: bpy.types.Scene) -> str:
    """Return the key of the preset of the device to stream to.

    It is that of the track file, if the settings name one.

    Raises:
        DermisError: there is no device, or the file cannot be used, see `load_file`.
    """
    return str(load_file(scene).spec.key) if scene.dermis_stream.track_file else device(scene).preset


def row_of(choice: Choice | None, rows: Sequence[Row]) -> Row | None:
    """Return a device's row of a preview, None if it has none."""
    same = [r for r in rows if choice is not None and (r.finger, r.device) == (choice.finger, choice.preset)]
    return same[choice.nth] if choice is not None and choice.nth < len(same) else None


def load_file(scene: bpy.types.Scene) -> Any:
    """Return the command track of the settings' file.

    Raises:
        DermisError: the path was not confirmed, or the file cannot be read.
    """
    global _file_track
    agreed_paths.check(scene.dermis_stream, "track_file")
    path = Path(bpy.path.abspath(scene.dermis_stream.track_file))
    key = (str(path), path.stat().st_mtime_ns if path.is_file() else 0)
    if _file_track is None or _file_track[0] != key:
        _file_track = (key, core.track.export.read(path))
    return _file_track[1]


def track_path(scene: bpy.types.Scene) -> str:
    """Return the path of a file with the track to be played, '' for none.

    A baked track is written to a new file when it has changed.
    """
    global _sent
    if scene.dermis_stream.track_file:
        load_file(scene)
        return str(Path(bpy.path.abspath(scene.dermis_stream.track_file)))
    output = chosen_output(scene)
    result = store.current(scene)
    if output is None or result is None:
        _sent = None
        return ""
    if _sent is None or _sent.track is not output.track or _sent.scene != scene.session_uid:
        from tempfile import mkstemp

        handle, name = mkstemp(prefix="dermis-stream-", suffix=".dtrack")
        with open(handle, "wb") as file:
            file.write(core.track.binary.dumps(output.track))
        _files.append(Path(name))
        _sent = _Sent(output.track, scene.session_uid, name, result.clock)
    return _sent.name


def outdated(scene: bpy.types.Scene) -> bool:
    """Return whether the sender's baked track is not the one to be played.

    This is so, for example, after a new bake, when a bake was forgotten, or when a device with another baked track was
    chosen.
    """
    if scene.dermis_stream.track_file:
        return False
    mine, output = _sent is not None and _sent.scene == scene.session_uid, chosen_output(scene)
    sent = _sent.track if _sent is not None and mine else None
    return (output.track if output is not None else None) is not sent


def origin(scene: bpy.types.Scene) -> scene_time.Clock:
    """Return the clock of the track that is played."""
    if not scene.dermis_stream.track_file:
        started = _sent if _sent is not None and _sent.scene == scene.session_uid else store.current(scene)
        if started is not None:
            return started.clock
    return scene_time.clock(scene, frame_range_now(scene)[0])


def loaded() -> Any:
    """Return the track that was loaded from a file last, or None."""
    return _file_track[1] if _file_track is not None else None


def doubts(scene: bpy.types.Scene) -> str:
    """Return in words how the track to be played disagrees with its preset.

    The text is '' if they agree. It is kept until the track changes or `judge_anew` is called, because panels call this
    function at every redraw.
    """
    global _judged
    if scene.dermis_stream.track_file:
        track = loaded()
    else:
        output = chosen_output(scene) if store.current(scene) is not None else None
        track = output.track if output is not None else None
    if track is not _judged[0]:
        found = core.track.check.preset_findings(track, library()) if track is not None else ()
        serious = [finding for finding in found if finding.severity != "info"]
        said = [f"{f.what[0].upper()}{f.what[1:]}. {f.remedy}".rstrip(" .") + "." for f in serious[:1]]
        others = len(serious) - 1
        more = [f"{others} {'limit or channel differs' if others == 1 else 'limits or channels differ'}."] * (
            others > 0
        )
        _judged = track, " ".join(said + more)
    return _judged[1]


def judge_anew() -> None:
    """Forget the last result of `doubts`: the preset may have been edited."""
    global _judged
    _judged = None, ""


def forget(*, files: bool = False) -> None:
    """Remove the files written for the sender.

    Args:
        files: whether the track that was loaded from a file is forgotten, too.
    """
    global _file_track, _sent
    _sent = None
    while _files:
        _files.pop().unlink(missing_ok=True)
    if files:
        _file_track = None


def _listed(scene: bpy.types.Scene, result: Any) -> tuple[Choice, ...]:
    there = []
    for obj in identity.fingers(scene):
        seen: list[str] = []
        for own, item in identity.worn(obj):
            label = f"{obj.name_full}: {item.preset}"
            there.append(Choice(own, Place.of(obj), obj.name_full, item.preset, label, seen.count(item.preset), None))
            seen.append(item.preset)
    baked: list[Choice] = []
    for whose, output in zip(result.whose, result.bake.outputs, strict=True) if result is not None else ():
        fits = (c for c in there if (c.device.finger, c.preset) == (whose.finger, output.device))
        choice = next((c for c in fits if whose.device in ("", c.device.device)), None)
        if choice is not None:
            there.remove(choice)
            baked.append(choice._replace(output=output))
    found = (*baked, *there)
    labels = [choice.label for choice in found]
    if len({label.casefold() for label in labels}) < len(labels):
        labels = core.track.file_names.numbered(labels)
    return tuple(choice._replace(label=label) for choice, label in zip(found, labels, strict=True))


def _known(scene: bpy.types.Scene, choice: Choice) -> Choice:
    """Return a choice, with identities given to its finger and device."""
    finger = choice.place.finger(scene)
    if finger is None or all(choice.device):
        return choice
    identity.give(finger)
    same = [own for own, item in identity.worn(finger) if item.preset == choice.preset]
    return choice._replace(device=same[choice.nth]) if choice.nth < len(same) else choice


def _hold(settings: Any, choice: Choice) -> None:
    settings.output_of = " ".join((*choice.device, choice.label))


def _chosen_key(settings: Any) -> Device | None:
    """Return the identities of the device that the settings' label means.

    None if no identities are stored for this label, see `choose`.
    """
    finger, _, rest = settings.output_of.partition(" ")
    own, _, label = rest.partition(" ")
    return Device(finger, own) if own and label == settings.output else None
