"""Device presets that fit a finger, and a scene with all of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ..devices.kinds import KINDS
from ..errors import DermisError
from ..parameters.skin import SKIN_CONTACT
from ..presets import Library
from ..scene.tactile_scene import DeviceUse, Finger, TactileScene


@dataclass(frozen=True)
class Skipped:
    """A device that was left out: key and name of its preset, and the reason."""

    device: str
    title: str
    why: str


def finger_index(scene: TactileScene, name: str | int) -> int:
    """Return the index of a finger of a scene, from its name or index.

    Raises:
        DermisError: the scene has no such finger.
    """
    names = [finger.name for finger in scene.fingers]
    if isinstance(name, str) and name in names:
        return names.index(name)
    if isinstance(name, int) and 0 <= name < len(names):
        return name
    raise DermisError("no such finger", where=f"scene '{scene.name}'", value=name, limit=", ".join(names))


def wearing_all(scene: TactileScene, library: Library, finger: int) -> tuple[TactileScene, list[str], list[Skipped]]:
    """Put every device that fits on one finger of a scene.

    A device that the finger already wears keeps its settings and its position in the list, by which animated settings
    are found. Added devices have default settings. Other fingers lose their devices, but their skin is still solved if
    it was before, because several fingers may hold one object.

    Returns:
        The scene, the keys of the devices that fit, and the devices left out.
    """
    worn = scene.fingers[finger]
    keys = [use.preset for use in worn.devices]
    fit, skipped = [], []
    for entry in library.list("devices"):
        why = str(entry.error).rstrip(".") if entry.error is not None else _misfit(entry.kind, scene)
        if why:
            skipped.append(Skipped(entry.key, entry.name or entry.key, why))
        else:
            fit.append(entry.key)
    added = tuple(DeviceUse(key) for key in fit if key not in keys)
    fingers = list(alone(scene, library))
    fingers[finger] = replace(worn, devices=worn.devices + added)
    return replace(scene, fingers=tuple(fingers)), fit, skipped


def _misfit(kind: str, scene: TactileScene) -> str:
    if KINDS[kind].drawn == "screen" and not scene.screens:
        return "the scene has no touch screen"
    return ""


def alone(scene: TactileScene, library: Library) -> Iterator[Finger]:
    """Yield the fingers of a scene without their devices.

    A skin that was solved is still solved.
    """
    for finger in scene.fingers:
        shown = SKIN_CONTACT["skin_shown"].of(finger.parameters) or any(
            _follows(library, use.preset) for use in finger.devices
        )
        yield replace(finger, devices=(), parameters={**finger.parameters, "skin_shown": bool(shown)})


def _follows(library: Library, key: str) -> bool:
    try:
        return library.device(key).follows_skin
    except DermisError:
        return False  # rendering skips a broken preset as well
