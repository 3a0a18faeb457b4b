"""Keys of the boards that are paired with this computer.

They are stored in a file that only its user can read.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...errors import DermisError
from ...files import read_text
from ...foreign import json_of
from .sealed import KEY

FILE = "DERMIS_PAIRS"  # environment variable with the path of another file
VIRTUAL = "VIRTUAL1"  # name of the simulated board, whose key is public
VIRTUAL_KEY = bytes(range(KEY))


class Pair(NamedTuple):
    """A board's key, and its network address at the time of pairing.

    The address is '' if it had none.
    """

    key: bytes
    address: str = ""


def path() -> Path:
    """Return the path of the file with the keys."""
    if given := os.environ.get(FILE):
        return Path(given)
    if sys.platform == "win32":
        base = Path(os.environ.get("APPDATA", Path.home()))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Application Support"
    else:
        base = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    return base / "dermis" / "pairs.json"


def key_of(board: str) -> bytes:
    """Return the key of a paired board.

    Raises:
        DermisError: no board of this name is paired, or the file is invalid.
    """
    if board == VIRTUAL:
        return VIRTUAL_KEY
    keys = _read()
    if board not in keys:
        raise DermisError(
            "this computer has paired no board of this name",
            where="board",
            value=board,
            limit=", ".join(sorted(keys)) or "none is paired",
            remedy="Plug it in by USB, and press Pair over USB or run 'stream pair'",
        )
    return keys[board].key


def addresses() -> dict[str, str]:
    """Return the known addresses of paired boards, by the boards' names.

    Raises:
        DermisError: the file is invalid.
    """
    return {board: pair.address for board, pair in sorted(_read().items()) if pair.address}


def keep(board: str, key: bytes, address: str = "") -> Path:
    """Store a board's key and address; return the path of the file.

    They replace earlier ones of this board.

    Raises:
        DermisError: the name is that of the simulated board, or the file is invalid or cannot be written.
    """
    if board == VIRTUAL:
        raise DermisError("a board may not have the simulated one's name", value=board, remedy="Change DERMIS_ID")
    keys = {**_read(), board: Pair(key, address)}
    file = path()
    plain = {name: {"key": pair.key.hex(), "address": pair.address} for name, pair in sorted(keys.items())}
    text = json.dumps(plain, indent=1)
    fresh = file.with_name(f"{file.name}.{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with open(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as out:
            out.write(text)
        os.replace(fresh, file)
    except OSError as error:
        raise DermisError("the keys cannot be written", where=str(file), value=error.strerror) from error
    return file


def load(file: Path) -> Mapping[str, Pair]:
    """Return the pairs in a file, by the boards' names.

    Older files contain keys without addresses.

    Raises:
        DermisError: the file cannot be read, or is invalid.
    """
    found = json_of(read_text(file), str(file))
    try:
        keys = {str(name): _pair(value) for name, value in found.items()}
    except (ValueError, TypeError, AttributeError, KeyError):
        keys = {"": Pair(b"")}
    if any(len(pair.key) != KEY for pair in keys.values()):
        raise DermisError(
            "the file holds no keys of boards", where=str(file), remedy="Remove it, and pair the boards again"
        )
    return keys


def _pair(value: Any) -> Pair:
    if isinstance(value, str):
        return Pair(bytes.fromhex(value))
    if set(value) != {"key", "address"} or not isinstance(value["address"], str):
        raise ValueError
    return Pair(bytes.fromhex(value["key"]), value["address"])


def _read() -> Mapping[str, Pair]:
    return load(path()) if path().exists() else {}
