"""Guards for files from other programs; strict readers of JSON and TOML.

The guards are limits of size, and a conversion of the errors that parsers raise. Every reader of files uses these
guards. Each problem of a file becomes one `DermisError`, and nothing is unpacked or allocated before its size has been
checked.
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

# Limits, each with its reason.
# [bytes] Largest file, and largest unpacked contents of an archive. An hour of 60 channels at 1 kHz has 1.7 GB.
MAX_BYTES = 1 << 31
# [bytes] Largest text file. Reading needs ten times as much memory. Half an hour of 128 pins at 240 Hz has this size.
MAX_TEXT = 1 << 29
# [bytes] Largest preset, calibration or header. People write these by hand; a preset of 128 pins has 30 kB.
MAX_SETTINGS = 1 << 24
# [bytes] Data may unpack to this size, however small they are packed: a picture of 8,192 x 8,192 pixels of one colour.
FREELY = 1 << 26
# Data that unpack to more than `FREELY` may unpack to this many times their packed size. Measured data stay below 20.
EXPANDS = 100
# [characters] Largest TOML text. The parser takes up to 1 us per byte; a sweep of 100,000 values has 0.7 MB.
MAX_TOML = 1 << 20
LONGEST_INTEGER = 300  # [digits] longest whole number; from 310 digits on, no double can hold it
DEEPEST = 32  # [levels] deepest nesting of objects and lists; presets have 6

# The strings and comments of TOML. No character is tried twice, so the search takes linear time. A string that is not
# closed ends with its line; with three quotes, it ends with the text.
_TOML_QUOTED = re.compile(
    r""""{3}(?:[^"\\]|\\.|"{1,2}+(?!"))*+(?:"{3,5}|\Z)|'{3}(?:[^']|'{1,2}+(?!'))*+(?:'{3,5}|\Z)"""
    r"""|"(?:[^"\\\n]|\\.)*+"?|'[^'\n]*+'?|\#[^\n]*+""",
    re.DOTALL,
)
# A dotted key with more than `DEEPEST` parts.
_TOML_DEEP = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}")

# Exceptions that the parsers of Python, numpy and zlib raise for damaged files. `TokenError` is one of them, because
# numpy reads headers with Python's tokenizer.
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
    """Return whether a schema is a later version of the known schema.

    Args:
        schema: the schema in a file, such as 'dermis-skin 2'.
        known: the schema that is read here, such as 'dermis-skin 1'.
    """
    kind, _, number = schema.rpartition(" ") if isinstance(schema, str) else ("", "", "")
    own, _, version = known.rpartition(" ")
    return kind == own and number.isdecimal() and len(number) < 10 and int(number) > int(version)


@contextmanager
def damage_told(what: str, where: str, *, limit: str = "", remedy: str = "") -> Iterator[None]:
    """Convert exceptions that a parser raises in the block into `DermisError`.

    Exceptions that are not listed in `DAMAGE` pass.

    Args:
        what: the problem, for the message.
        where: name of the file, for the message.
        limit: the accepted values, for the message.
        remedy: a way to solve the problem, for the message.

    Raises:
        DermisError: the parser raised an exception; the message quotes the text of the exception.
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
    """Refuse data that are too large, or too large for their packed size.

    Args:
        size: bytes to be read or allocated.
        where: name of the file, for the message.
        most: largest number of bytes.
        packed: size of the packed data [bytes]; None if they are not packed.

    Raises:
        DermisError: `size` exceeds `most`, or exceeds both `FREELY` and `EXPANDS` times `packed`.
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
            "the unpacked data are too large for their packed size",
            where=where,
            value=f"{size} bytes out of {packed}",
            limit=f"{FREELY} bytes, or {EXPANDS} times the packed size",
            remedy="Save it without compression if it is meant so",
        )


def text_of(data: bytes, where: str, encoding: str = "utf-8") -> str:
    """Decode UTF-8 text.

    Args:
        data: the encoded text.
        where: name of the file, for the message.
        encoding: 'utf-8', or 'utf-8-sig' to remove a byte order mark.

    Raises:
        DermisError: the data are not UTF-8; the message gives the first wrong byte.
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
    """Read JSON by strict rules.

    Keys must be unique within an object, and characters whole. The constants NaN, Infinity and -Infinity are refused.
    Nesting is limited to `DEEPEST` levels, and whole numbers to `LONGEST_INTEGER` digits.

    Args:
        data: the text, or the bytes of UTF-8 text.
        where: name of the file, for the message.
        most: largest length of the data, in bytes, or in characters for a text.
        constants: True to accept these three constants, which Python's own writer of JSON writes.

    Raises:
        DermisError: the data break one of these rules or are too long; for a syntax error the message gives the line.
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
                "the whole number has too many digits",
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
    if "\\u" in text:  # only an escape can give half a character, which cannot be encoded
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
    """Read TOML with limits on its length, its nesting and its whole numbers.

    The parser's time grows with the square of the number of parts of a dotted key. This number is therefore checked in
    the text, before the parser reads it.

    Raises:
        DermisError: the text is not TOML, longer than `MAX_TOML`, nested deeper than `DEEPEST`, or has a whole number
            of more than `LONGEST_INTEGER` digits.
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
    """Refuse whole numbers of more than `LONGEST_INTEGER` digits.

    Python itself limits the length of decimal numbers, but not of hexadecimal ones.
    """
    if isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            _check_whole(inner, where)
    elif isinstance(value, int) and abs(value) >= 10**LONGEST_INTEGER:
        raise DermisError("the whole number has too many digits", where=where, limit=f"{LONGEST_INTEGER} digits")


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
