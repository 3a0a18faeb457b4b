"""The presets that menus offer.

They are read when a menu is opened or a finger is first shown, and never while drawing.
"""

import re
from collections.abc import Callable
from typing import Any

from . import preferences
from ._core import core

# Icons, by the style in which a kind of device is drawn.
ICONS = {
    "tactor": "MOD_WARP",
    "screen": "DESKTOP",
    "coil": "OUTPUT",
    "pins": "LIGHTPROBE_VOLUME",
    "thimble": "CON_ARMATURE",
    "platform": "CON_KINEMATIC",
}

GROUPS = ("devices", "materials", "skins")
_PAGE = re.compile(r"\s*See \S+\.md\.?")  # reference to a page beside the preset's file, which menus leave out
_cache: dict[str, tuple[Any, ...]] = {}
_target = ""


def refresh() -> None:
    """Read the folders again."""
    reader()()


def reader() -> Callable[[], None]:
    """Return a function that reads the folders again; any thread may call it."""
    folder = preferences.presets_folder()

    def read() -> None:
        presets = preferences.library_of(folder)
        # An entry has all that menus show, since its file may be deleted.
        _cache.update({group: presets.list(group) for group in GROUPS})

    return read


def entries(group: str) -> tuple[Any, ...]:
    """Return the presets of 'devices', 'materials' or 'skins', broken ones too.

    There are none before the first `refresh`.
    """
    return _cache.get(group, ())


def entry(group: str, key: str) -> Any:
    """Return a preset's entry, or None."""
    return next((entry for entry in entries(group) if entry.key == key), None)


def title(group: str, key: str) -> str:
    """Return a preset's name for people.

    If no preset has the key, the key is returned. Before presets have been read, the name is made from the key.
    """
    found = entry(group, key)
    return str(found.name) if found is not None else key if known() else key.replace("_", " ").title()


def label(group: str, key: str) -> str:
    """Return a preset's name for people, with its key if several presets have this name."""
    name = title(group, key)
    alike = [entry for entry in entries(group) if entry.name == name]
    return f"{name} ({key})" if len(alike) > 1 else name


def key_of(group: str, text: str) -> str:
    """Return the key of the preset that has a `label`; a text that is no label is returned as it is."""
    if not known():
        refresh()
    return next((entry.key for entry in entries(group) if label(group, entry.key) == text), text)


def worn(label: str) -> str:
    """Return 'finger: preset' with the device's name in place of its key.

    Args:
        label: 'finger: preset', as settings name a device on a finger.
    """
    finger, colon, key = label.rpartition(": ")
    own, dash, number = key.rpartition("-")  # the number of a further device of the same preset
    if dash and number.isdigit() and entry("devices", key) is None:
        return f"{finger}{colon}{title('devices', own)}, {number}"
    return f"{finger}{colon}{title('devices', key)}" if colon else label


def description(group: str, key: str) -> str:
    """Return the description of a preset; '' without one."""
    found = entry(group, key)
    return _PAGE.sub("", found.description) if found is not None else ""


def search(group: str, text: str) -> list[str]:
    """Return the keys of presets whose key or name contains a text.

    For fields that offer presets while a person types.
    """
    if not known():
        refresh()
    return [entry.key for entry in entries(group) if text.lower() in f"{entry.key} {entry.name}".lower()]


def known() -> bool:
    """Return whether the folders have been read."""
    return bool(_cache)


def kind_of(key: str) -> str:
    """Return the kind of a device preset, such as 'shear_tactor'; '' if unknown."""
    found = entry("devices", key)
    return str(found.kind) if found is not None else ""


def icon(kind: str) -> str:
    """Return the icon of a kind of device."""
    row = core.devices.kinds.KINDS.get(kind)
    return ICONS.get(row.drawn if row is not None else "", "ANIM")


def first_of_kind(kind: str) -> str:
    """Return the key of the first usable device of a kind, or ''."""
    if not known():
        refresh()
    return next((entry.key for entry in entries("devices") if entry.kind == kind), "")


def aim(finger: str) -> None:
    """Note for which finger the device menu opens; '' for the active object."""
    global _target
    _target = finger


def target() -> str:
    """Return the finger for which the device menu opens, see `aim`."""
    return _target


def forget() -> None:
    """Drop the lists."""
    _cache.clear()
