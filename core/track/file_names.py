"""Names of the files of one export: safe on every file system, and never two that some file system takes for one."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path

from .c_header import identifier

_DEVICE = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9\u00b9\u00b2\u00b3]", re.IGNORECASE)


class FileNames:
    """The names that one export has given away so far; names come numbered -2, -3 where they would meet.

    The same requests in the same order give the same names.
    """

    def __init__(self) -> None:
        self._taken: set[tuple[str, ...]] = set()

    def take(self, stem: str, suffix: str = "", folder: Path | None = None) -> str:
        """Return a name that was not given away before in this folder, and take it; a number stands before the suffix.

        Args:
            stem: see `safe`. suffix: with its dot, or none.
        """
        number, place = 1, _place(folder)
        while True:
            name = (stem if number == 1 else f"{stem}-{number}") + suffix
            keys: set[tuple[str, ...]] = {(place, folded(name))}
            if suffix == ".h":  # headers of one sketch must differ in what everything in them begins with
                keys.add((place, "identifier", identifier(name.removesuffix(suffix))))
            if not keys & self._taken:
                self._taken |= keys
                return name
            number += 1

    def reserve(self, path: Path) -> None:
        """Keep a file that is there already, such as one that is still to be read, from being overwritten."""
        self._taken.add((_place(path.parent), folded(path.name)))


def safe(name: str) -> str:
    """Return a name that every file system takes: letters and digits of any language, '-' and '_'.

    Names that Windows keeps for its devices, whatever suffix follows, get a '_'.
    """
    plain = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
    return f"{plain}_" if _DEVICE.fullmatch(plain) else plain


def folded(name: str) -> str:
    """Return what two names share that a file system may take for one: neither case nor composition counts."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())


def numbered(names: Sequence[str]) -> list[str]:
    """Return names of which none is there twice: the second 'a' is 'a-2', unless that is there too."""
    taken = set(names)
    out: list[str] = []
    for name in names:
        number, new = 1, name
        while new in out or (number > 1 and new in taken):
            number += 1
            new = f"{name}-{number}"
        out.append(new)
    return out


def _place(folder: Path | None) -> str:
    return str(Path(folder).resolve()) if folder is not None else ""
