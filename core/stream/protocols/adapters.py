"""Adapters by protocol: those of this folder, and external ones.

An external adapter is a file in a folder of the user, or an entry point of an installed package. With the protocol
'other', an address names it by `?adapter=NAME`. It is the file `NAME.py` in a folder of the environment variable
`DERMIS_ADAPTERS`; if there is none, the entry point NAME of the group `dermis.adapters`. Both define a function
`adapter(api)` that returns a class derived from `api.Adapter`. An address cannot contain a path, so a file from
somebody else cannot make code of its own run.
"""

from __future__ import annotations

import os
import re
import runpy
from collections.abc import Callable, Mapping
from importlib import import_module, metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from ...errors import DermisError
from .adapter import Adapter, Touch
from .packets import DeviceState, Reach
from .silence import Does, Silence
from .wire import Wire

FOLDERS = "DERMIS_ADAPTERS"  # environment variable with folders, separated as in PATH
GROUP = "dermis.adapters"  # group of entry points
NAME = re.compile(r"[a-z][a-z0-9_]*")
API = SimpleNamespace(
    Adapter=Adapter,
    DermisError=DermisError,
    DeviceState=DeviceState,
    Does=Does,
    Reach=Reach,
    Silence=Silence,
    Touch=Touch,
    Wire=Wire,
)

# Method of an adapter -> its result if it raises an error, so that the device still gets to its safe state.
FALLBACKS: Mapping[str, tuple[bytes, ...] | None] = {
    "opened": None,
    "receive": None,
    "poll": (),
    "arm": None,
    "command": (),
    "forget": None,
    "ask_pose": (),
    "sign_of_life": (),
    "retract": None,
    "safe": (),
}

_loaded: dict[tuple[str, int], type[Adapter]] = {}


# Protocol -> module of this package, and the class in it.
NAMES: Mapping[str, tuple[str, str]] = {
    "native": ("native", "Native"),
    "native-wifi": ("native_wifi", "NativeWifi"),
    "maestro": ("maestro", "Maestro"),
    "servo-animation": ("servo_animation", "ServoAnimation"),
    "dynamixel": ("bus.dynamixel", "Dynamixel"),
    "feetech": ("bus.feetech", "Feetech"),
    "torque": ("torque", "Torque"),
    "osc": ("osc", "Osc"),
}


OTHER = "other"  # protocol of external adapters: the option `adapter` names one of them


def adapter_of(protocol: str, options: Mapping[str, str] | None = None) -> type[Adapter]:
    """Return the adapter class of a protocol.

    Args:
        protocol: name of the protocol. options: options of the address, which name an external adapter.

    Raises:
        DermisError: no such protocol or adapter.
    """
    if protocol == OTHER:
        return adapter_named((options or {}).get("adapter", ""))
    if protocol not in NAMES:
        raise DermisError("no such protocol", value=protocol, limit=", ".join((*NAMES, OTHER)))
    module, name = NAMES[protocol]
    return getattr(import_module(f".{module}", __package__), name)


def make(protocol: str, wire: Wire, options: Mapping[str, str]) -> Adapter:
    """Make the adapter of a protocol for a device.

    Raises:
        DermisError: no such protocol, an unknown option, or a device that the protocol cannot carry.
    """
    given = {name: value for name, value in options.items() if (protocol, name) != (OTHER, "adapter")}
    made = adapter_of(protocol, options)(wire, given)
    made.options = dict(options)  # another process makes the same adapter from these
    for name, otherwise in FALLBACKS.items():
        setattr(made, name, _guarded(made, name, otherwise))
    return made


def _messages(value: object, *, optional: str) -> bool:
    """Return whether a method's result is valid: a list of messages.

    Every result of a method that has no result is valid.
    """
    if FALLBACKS[optional] is None and optional != "retract":
        return True
    return isinstance(value, list) and all(isinstance(one, bytes) for one in value)


def _guarded(made: Adapter, name: str, otherwise: Any) -> Callable[..., Any]:
    """Return a method of an adapter whose errors become a fault.

    After an error the result is `otherwise`, so that the device still gets to its safe state.
    """
    method = getattr(made, name)

    def guarded(*arguments: Any, **named: Any) -> Any:
        if name == "command":
            made.broken = False
        try:
            made_of_it = method(*arguments, **named)
            if (otherwise is not None or made_of_it is not None) and not _messages(made_of_it, optional=name):
                raise TypeError(f"returned {made_of_it!r:.80}, not a list of bytes")
            return made_of_it
        except Exception as error:  # a defect of this adapter, which may be an external one
            made.fault = made.fault or f"the protocol's program failed in '{name}': {type(error).__name__}: {error}"
            made.broken |= name == "command"
            return otherwise if otherwise is None else list(otherwise)

    return guarded


def names() -> list[str]:
    """Return the names of all external adapters that are found."""
    files = [path.stem for folder in _folders() for path in folder.glob("*.py") if NAME.fullmatch(path.stem)]
    return sorted({*files, *(point.name for point in metadata.entry_points(group=GROUP))})


def adapter_named(name: str) -> type[Adapter]:
    """Return the external adapter of a name.

    Raises:
        DermisError: no adapter has this name, or it does not keep the contract.
    """
    if not NAME.fullmatch(name):
        raise DermisError(
            "the address names no adapter",
            where="protocol 'other', adapter",
            value=name or "nothing",
            limit="lower-case letters, digits and underscores",
            remedy=f"Add ?adapter=NAME to the address. {_at_hand()}",
        )
    for folder in _folders():
        if (path := folder / f"{name}.py").is_file():
            return _of_file(path)
    if point := next(iter(metadata.entry_points(group=GROUP, name=name)), None):
        return _made(lambda: point.load()(API), f"entry point {point.value}")
    places = ", ".join(map(str, _folders())) or f"a folder that {FOLDERS} names"
    raise DermisError("no such adapter", value=name, limit=_at_hand(), remedy=f"Put {name}.py into {places}")


def _of_file(path: Path) -> type[Adapter]:
    """Return the adapter that a file defines.

    A file is run once, and again after it has changed.
    """
    key = str(path), path.stat().st_mtime_ns
    if key not in _loaded:
        _loaded[key] = _made(lambda: _function_of(path)(API), str(path))
    return _loaded[key]


def _function_of(path: Path) -> Any:
    """Run a file and return its function `adapter`."""
    defined = runpy.run_path(str(path))
    if "adapter" not in defined:
        raise DermisError("the file defines no function adapter(api)")
    return defined["adapter"]


def _made(make: Callable[[], Any], where: str) -> type[Adapter]:
    """Return the result of an adapter's function, if it is an adapter class.

    Raises:
        DermisError: the function raised an error, or returned something else.
    """
    try:
        made = make()
    except Exception as error:  # external code may raise any error
        value = str(error) if isinstance(error, DermisError) else f"{type(error).__name__}: {error}"
        raise DermisError("the adapter cannot be loaded", where=where, value=value) from error
    if not (isinstance(made, type) and issubclass(made, Adapter) and made is not Adapter):
        raise DermisError("not an adapter", where=where, value=repr(made), limit="a class derived from api.Adapter")
    return made


def _folders() -> list[Path]:
    return [Path(text) for text in os.environ.get(FOLDERS, "").split(os.pathsep) if text]


def _at_hand() -> str:
    return f"At hand: {', '.join(names()) or 'none'}"
