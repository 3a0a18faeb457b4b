"""Names of the files of one export: safe on every file system, and never two that some file system takes for one."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from ..errors import Finding
from .c_header import identifier

_DEVICE = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9\u00b9\u00b2\u00b3]", re.IGNORECASE)
LONGEST = 200  # bytes of a stem: file systems take 255, and a number, a suffix and the ending of a part file follow it
_SHORTEST = 16  # bytes that are kept of a part, so that people recognize it
_DIGITS = 8  # of a hash at the end of a shortened name: 16 million names before two of them are likely to share one


class FileNames:
    """The names that one export has given away so far; names come numbered -2, -3 where they would meet.

    Names that are too long for a file are cut, and end in a hash of the whole. The same requests in the same order give
    the same names.
    """

    def __init__(self) -> None:
        self._taken: set[tuple[str, ...]] = set()
        self._cut: dict[str, str] = {}

    def take(self, stem: str, suffix: str = "", folder: Path | None = None) -> str:
        """Return a name that was not given away before in this folder, and take it; a number stands before the suffix.

        Args:
            stem: parts made by `safe`, with dots between. suffix: with its dot, or none.
        """
        number, place, short = 1, _place(folder), shortened(stem)
        while True:
            name = (short if number == 1 else f"{short}-{number}") + suffix
            keys: set[tuple[str, ...]] = {(place, folded(name))}
            if suffix == ".h":  # headers of one sketch must differ in what everything in them begins with
                keys.add((place, "identifier", identifier(name.removesuffix(suffix))))
            if not keys & self._taken:
                self._taken |= keys
                if short != stem:
                    self._cut[stem] = name
                return name
            number += 1

    def findings(self) -> tuple[Finding, ...]:
        """Return one finding for each name that was cut."""
        return tuple(
            Finding(
                "info",
                "name-shortened",
                "the name is too long for a file and was shortened",
                where=stem,
                value=name,
                limit=f"{LONGEST} bytes",
            )
            for stem, name in self._cut.items()
        )

    def reserve(self, path: Path) -> None:
        """Keep a file that is there already, such as one that is still to be read, from being overwritten."""
        self._taken.add((_place(path.parent), folded(path.name)))


def safe(name: str) -> str:
    """Return a name that every file system takes: letters and digits of any language, '-' and '_'.

    Names that Windows keeps for its devices, whatever suffix follows, get a '_'.
    """
    plain = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
    return f"{plain}_" if _DEVICE.fullmatch(plain) else plain


def shortened(stem: str) -> str:
    """Return a stem of `LONGEST` bytes at most: its longest part is cut first, and ends in a hash of the whole stem."""
    tail = "-" + sha256(stem.encode()).hexdigest()[:_DIGITS]
    parts = [part.encode() for part in stem.split(".")]
    while (over := len(b".".join(parts)) - LONGEST) > 0:
        i = max(range(len(parts)), key=lambda k: len(parts[k]))
        kept = max(len(parts[i]) - over - len(tail), _SHORTEST)
        if kept + len(tail) >= len(parts[i]):  # many short parts
            return b".".join(parts)[: LONGEST - len(tail)].decode(errors="ignore") + tail
        parts[i] = parts[i][:kept].decode(errors="ignore").encode() + tail.encode()
    return b".".join(parts).decode()


def folded(name: str) -> str:
    """Return a name's form for comparison, since file systems may ignore case and Unicode composition."""
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
