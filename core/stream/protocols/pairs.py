"""Keys of the boards that were paired with this computer, in a file that only its user can read."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from ...errors import DermisError
from ...files import read_text
from ...foreign import json_of
from .sealed import KEY

FILE = "DERMIS_PAIRS"  # environment variable: the file, where it shall be another
VIRTUAL = "VIRTUAL1"  # the simulated board, whose key everybody knows
VIRTUAL_KEY = bytes(range(KEY))


def path() -> Path:
    """Return where the keys are."""
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
        DermisError: this computer has paired no board of this name, or the file is none of keys.
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
    return keys[board]


def keep(board: str, key: bytes) -> Path:
    """Keep a board's key, in place of an earlier one; return the file.

    Raises:
        DermisError: the name is the simulated board's, or the file cannot be written or is none of keys.
    """
    if board == VIRTUAL:
        raise DermisError("a board may not have the simulated one's name", value=board, remedy="Change DERMIS_ID")
    keys = {**_read(), board: key}
    file = path()
    text = json.dumps({name: value.hex() for name, value in sorted(keys.items())}, indent=1)
    fresh = file.with_name(f"{file.name}.{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with open(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as out:
            out.write(text)
        os.replace(fresh, file)
    except OSError as error:
        raise DermisError("the keys cannot be written", where=str(file), value=error.strerror) from error
    return file


def load(file: Path) -> Mapping[str, bytes]:
    """Return the keys in a file, by the boards' names.

    Raises:
        DermisError: it cannot be read, or holds no keys.
    """
    found = json_of(read_text(file), str(file))
    try:
        keys = {str(name): bytes.fromhex(value) for name, value in found.items()}
    except (ValueError, TypeError, AttributeError):
        keys = {"": b""}
    if any(len(key) != KEY for key in keys.values()):
        raise DermisError(
            "the file holds no keys of boards", where=str(file), remedy="Remove it, and pair the boards again"
        )
    return keys


def _read() -> Mapping[str, bytes]:
    return load(path()) if path().exists() else {}
