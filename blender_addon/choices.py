"""The presets that menus offer, read when a menu is opened or a finger is first shown, and never while drawing."""

from typing import Any

from .preferences import library

_cache: dict[str, tuple[Any, ...]] = {}
_kinds: dict[str, str] = {}
_target = ""


def refresh() -> None:
    """Read the folders again."""
    presets = library()
    for group in ("devices", "materials", "skins"):
        _cache[group] = presets.list(group)
    _kinds.clear()
    for entry in _cache["devices"]:
        if entry.error is None:
            _kinds[entry.key] = presets.device(entry.key).kind


def devices() -> tuple[Any, ...]:
    """Return the device presets, broken ones too; empty before the first `refresh`."""
    return _cache.get("devices", ())


def materials() -> tuple[Any, ...]:
    """Return the haptic materials, broken ones too; empty before the first `refresh`."""
    return _cache.get("materials", ())


def skins() -> tuple[Any, ...]:
    """Return the fingertip presets, broken ones too; empty before the first `refresh`."""
    return _cache.get("skins", ())


def known() -> bool:
    """Tell whether the folders have been read."""
    return bool(_cache)


def device_entry(key: str) -> Any:
    """Return the entry of a device preset, or None."""
    return next((entry for entry in devices() if entry.key == key), None)


def device_title(key: str) -> str:
    """Return a device's name for people; its key where that is not known."""
    entry = device_entry(key)
    return str(entry.name) if entry is not None else key


def kind_of(key: str) -> str:
    """Return 'shear_tactor', 'friction_screen' or '' where that is not known."""
    return _kinds.get(key, "")


def first_of_kind(kind: str) -> str:
    """Return the key of the first usable device of a kind, or ''."""
    if not known():
        refresh()
    return next((key for key in sorted(_kinds) if _kinds[key] == kind), "")


def aim(finger: str) -> None:
    """Note for which finger the device menu opens; '' for the active object."""
    global _target
    _target = finger


def target() -> str:
    """Return the finger that the device menu is about."""
    return _target


def forget() -> None:
    """Drop what was read."""
    _cache.clear()
    _kinds.clear()
