"""Files from elsewhere: limits of their sizes, one guard around parsers, JSON and TOML without surprises.

Every reader of files goes through here, `files.read_bytes` and `npz`: a problem of a file becomes one
`DermisError`, and nothing is unpacked or allocated before its size was judged.
"""

from __future__ import annotations

import json
import lzma
import re
import struct
import tomllib
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from tokenize import TokenError
from typing import Any

from .errors import DermisError

# The limits, each with its reason.
MAX_BYTES = 1 << 31  # of a file, and of all that an archive unpacks: a lab's hour at 1 kHz of 60 channels is 1.7 GB
MAX_TEXT = 1 << 29  # of text, which takes ten times as much while it is read: 128 pins at 240 Hz for half an hour
MAX_SETTINGS = 1 << 24  # of presets, calibrations, headers: people write these, and 128 pins take 30 kB
FREELY = 1 << 26  # bytes that may come out of however little: 8,192 x 8,192 flat pixels
EXPANDS = 100  # times its packed size that anything larger may unpack to; measured data stay below 20
MAX_TOML = 1 << 20  # of TOML: its parser takes up to 1 us a byte, and a sweep of 100,000 values takes 0.7 MB
LONGEST_INTEGER = 300  # digits: a longer one is no double any more
DEEPEST = 32  # objects and lists in one another; presets have 6

# The strings and comments of TOML, each character in one match only; a string that is not closed is taken to its end.
_TOML_QUOTED = re.compile(
    r""""{3}(?:[^"\\]|\\.|"{1,2}+(?!"))*+(?:"{3,5}|\Z)|'{3}(?:[^']|'{1,2}+(?!'))*+(?:'{3,5}|\Z)"""
    r"""|"(?:[^"\\\n]|\\.)*+"?|'[^'\n]*+'?|\#[^\n]*+""",
    re.DOTALL,
)
_TOML_DEEP = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}")

# Exceptions of Python's, numpy's and zlib's parsers for damaged files; numpy reads headers with Python's own tokenizer.
DAMAGE: tuple[type[Exception], ...] = (
    OSError,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    EOFError,
    MemoryError,
    ArithmeticError,
    RuntimeError,
    SyntaxError,
    SystemError,
    TokenError,
    struct.error,
    zlib.error,
    lzma.LZMAError,
    zipfile.BadZipFile,
)


def is_newer(schema: Any, known: str) -> bool:
    """Return whether a schema, such as 'dermis-skin 2', is the known one of a later version."""
    kind, _, number = schema.rpartition(" ") if isinstance(schema, str) else ("", "", "")
    own, _, version = known.rpartition(" ")
    return kind == own and number.isdecimal() and len(number) < 10 and int(number) > int(version)


@contextmanager
def damage_told(what: str, where: str, *, limit: str = "", remedy: str = "") -> Iterator[None]:
    """Turn whatever a parser of foreign bytes throws inside the block into one refusal, the cause chained to it.

    Raises:
        DermisError: `what`, with the parser's own words as the value.
    """
    try:
        yield
    except DermisError:
        raise
    except DAMAGE as error:
        said = " ".join(str(error).split())[:160]
        value = said if " " in said else f"{type(error).__name__} {said}".strip()
        raise DermisError(what, where=where, value=value, limit=limit, remedy=remedy) from error


def check_size(size: int, where: str, most: int = MAX_BYTES, *, packed: int | None = None) -> None:
    """Refuse more bytes than are read, or unpacked out of few.

    Args:
        size: bytes to be read or allocated. packed: bytes that they come out of, where they are packed.

    Raises:
        DermisError: more than `most`; or more than `FREELY` and more than `EXPANDS` times their packed size.
    """
    if size > most:
        raise DermisError(
            "too large to be read",
            where=where,
            value=f"{size} bytes",
            limit=f"{most} bytes",
            remedy="Split it, or reduce its resolution",
        )
    if packed is not None and size > max(FREELY, EXPANDS * packed):
        raise DermisError(
            "unpacks to far more than it holds",
            where=where,
            value=f"{size} bytes out of {packed}",
            limit=f"{FREELY} bytes, or {EXPANDS} times the packed size",
            remedy="Save it without compression if it is meant so",
        )


def text_of(data: bytes, where: str, encoding: str = "utf-8") -> str:
    """Decode text.

    Raises:
        DermisError: not UTF-8; says at which byte.
    """
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise DermisError(
            "not UTF-8 text",
            where=f"{where}, byte {error.start}",
            value=f"0x{data[error.start]:02x}",
            limit="UTF-8",
            remedy="Save the file as UTF-8",
        ) from error


def json_of(data: bytes | str, where: str, most: int = MAX_SETTINGS, *, constants: bool = False) -> Any:
    """Read JSON: no key twice, no constants beside true, false and null, not nested without end, whole characters.

    Args:
        most: bytes. constants: NaN and the infinities are taken, which Python writes of its own accord.

    Raises:
        DermisError: it is none of that; says at which line where it can.
    """
    check_size(len(data), where, most)
    text = data if isinstance(data, str) else text_of(data, where)

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) != len(pairs):
            seen: set[str] = set()
            twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
            raise DermisError("a key appears twice in one object", where=where, value=twice[:80])
        return found

    def refuse(name: str) -> Any:
        raise DermisError("not a finite number", where=where, value=name)

    def whole(digits: str) -> int:
        if len(digits) > LONGEST_INTEGER:
            raise DermisError(
                "not a number that can be used",
                where=where,
                value=f"{digits[:12]}...",
                limit=f"{LONGEST_INTEGER} digits",
            )
        return int(digits)

    try:
        value = json.loads(text, parse_constant=None if constants else refuse, parse_int=whole, object_pairs_hook=once)
    except json.JSONDecodeError as error:
        raise DermisError(
            "not JSON", where=f"{where}, line {error.lineno}, column {error.colno}", value=error.msg, code="not-json"
        ) from error
    except RecursionError as error:
        raise DermisError("nested too deeply", where=where, limit=f"{DEEPEST} levels") from error
    except DermisError:
        raise
    except (ValueError, MemoryError) as error:
        raise DermisError("not JSON", where=where, value=str(error)[:80]) from error
    _check_depth(value, where)
    if "\\u" in text:  # the only way to half a character; it could not be written or printed
        try:
            json.dumps(value, ensure_ascii=False).encode("utf-8")
        except UnicodeEncodeError as error:
            raise DermisError(
                "half a character (a lone surrogate)",
                where=where,
                value=ascii(error.object)[:80],
                remedy="Write the whole character, or its two halves together",
            ) from error
    return value


def toml_of(text: str, where: str) -> dict[str, Any]:
    """Read TOML of keys that are not nested without end, and of whole numbers that can be used.

    The parser's time grows with the square of a key's depth, so the depth is judged on the text before.

    Raises:
        DermisError: too large, too deep, a whole number that is no double any more, or not TOML.
    """
    check_size(len(text), where, MAX_TOML)
    if _TOML_DEEP.search(_TOML_QUOTED.sub("_", text)):
        raise DermisError("nested too deeply", where=where, limit=f"{DEEPEST} levels")
    with damage_told("not TOML", where):
        value = tomllib.loads(text)
    _check_depth(value, where)
    _check_whole(value, where)
    return value


def _check_whole(value: Any, where: str) -> None:
    """Refuse whole numbers that are no double any more; hexadecimal ones can be of any length."""
    if isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            _check_whole(inner, where)
    elif isinstance(value, int) and abs(value) >= 10**LONGEST_INTEGER:
        raise DermisError("not a number that can be used", where=where, limit=f"{LONGEST_INTEGER} digits")


def _check_depth(value: Any, where: str) -> None:
    level = [value]
    for _ in range(DEEPEST + 1):
        level = [
            inner
            for outer in level
            if isinstance(outer, dict | list)
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, dict | list)
        ]
        if not level:
            return
    raise DermisError("nested too deeply", where=where, limit=f"{DEEPEST} levels")
