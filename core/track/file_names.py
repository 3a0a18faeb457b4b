"""Names of the files of one export, valid and distinct everywhere.

Every name is valid on every file system, and no file system takes two of them for the same name.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from ..errors import Finding
from .c_header import identifier

_DEVICE = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9\u00b9\u00b2\u00b3]", re.IGNORECASE)
# [bytes] longest stem. File systems take 255, but a number, a suffix and the ending of an unfinished file follow.
LONGEST = 200
_SHORTEST = 16  # [bytes] shortest length to which a part is cut, without its hash, so that people recognize it
_DIGITS = 8  # hexadecimal digits of the hash at the end of a shortened name


class FileNames:
    """Names that one export has used so far.

    A name that is used already gets a number: -2, -3 and so on. A name that is too long for a file is shortened and
    ends in a hash of the whole name. The same requests in the same order give the same names.
    """

    def __init__(self) -> None:
        self._taken: set[tuple[str, ...]] = set()
        self._cut: dict[str, str] = {}

    def take(self, stem: str, suffix: str = "", folder: Path | None = None) -> str:
        """Return a name that is not used yet in a folder, and mark it as used.

        Args:
            stem: name without suffix: parts from `safe`, separated by dots.
            suffix: suffix with its dot, or empty. A number is put before it.
            folder: folder of the file; None if all files are in one folder.
        """
        number, place, short = 1, _place(folder), shortened(stem)
        while True:
            name = (short if number == 1 else f"{short}-{number}") + suffix
            keys: set[tuple[str, ...]] = {(place, folded(name))}
            if suffix == ".h":  # names in the headers of one sketch must begin differently
                keys.add((place, "identifier", identifier(name.removesuffix(suffix))))
            if not keys & self._taken:
                self._taken |= keys
                if short != stem:
                    self._cut[stem] = name
                return name
            number += 1

    def findings(self) -> tuple[Finding, ...]:
        """Return one finding for each name that was shortened."""
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
        """Mark the name of an existing file as used, so that it is kept."""
        self._taken.add((_place(path.parent), folded(path.name)))


def safe(name: str) -> str:
    """Return a name that is valid on every file system.

    It has letters and digits of any language, '-' and '_'. Other characters become '_'. Windows reserves some names for
    devices, with any suffix. A '_' is added to such a name.
    """
    plain = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
    return f"{plain}_" if _DEVICE.fullmatch(plain) else plain


def shortened(stem: str) -> str:
    """Return a stem with at most `LONGEST` bytes.

    The longest part is shortened first, and ends in a hash of the whole stem.
    """
    tail = "-" + sha256(stem.encode()).hexdigest()[:_DIGITS]
    parts = [part.encode() for part in stem.split(".")]
    while (over := len(b".".join(parts)) - LONGEST) > 0:
        i = max(range(len(parts)), key=lambda k: len(parts[k]))
        kept = max(len(parts[i]) - over - len(tail), _SHORTEST)
        if kept + len(tail) >= len(parts[i]):  # many short parts: cut the end
            return b".".join(parts)[: LONGEST - len(tail)].decode(errors="ignore") + tail
        parts[i] = parts[i][:kept].decode(errors="ignore").encode() + tail.encode()
    return b".".join(parts).decode()


def folded(name: str) -> str:
    """Return the form of a name with which names are compared.

    File systems may ignore case and the composition of Unicode characters.
    """
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())


def numbered(names: Sequence[str]) -> list[str]:
    """Return distinct names: the second 'a' becomes 'a-2'.

    If there is a name 'a-2' already, it becomes 'a-3', and so on.
    """
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
