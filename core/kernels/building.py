"""Build of the kernels: sources, their interface, flags, platforms and file names.

This module needs only the standard library. `build_addon.py` (any Python from 3.8 on) and pip (`setuptools_hook.py`)
build with it, `library.py` gets the file's name from it, and `records.py` the fields of the records. The compiler is
that of Zig, from the package `ziglang`: it builds the libraries for all platforms on each of them, so no other compiler
is needed.

A library's name contains a digest of sources and flags, and a digest of its content. So a library of other sources is
never used, and a damaged one is never loaded.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).resolve().parent

# With these flags, each product and sum is rounded on its own, in the order of the source. So results are the same to
# the bit on all platforms.
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fno-fast-math", "-fno-math-errno", "-fvisibility=hidden", "-shared")
# Flags for a library without a C library, which therefore works with every version of the system's.
ALONE = ("-nostdlib", "-DDERMIS_ALONE")


class Target(NamedTuple):
    """A platform for which the kernels are built.

    Attributes:
        triple: Zig's name of the platform.
        processor: Zig's name of the oldest processor that is supported.
        suffix: suffix of libraries.
        flags: additional flags of the compiler.
        tag: platform tag of wheels.
    """

    triple: str
    processor: str
    suffix: str
    flags: tuple[str, ...]
    tag: str


# The keys are Blender's names of platforms. The processors are the oldest on which Blender runs. `ALONE` is missing for
# macOS, which loads no library without the system's own.
TARGETS = {
    "linux-x64": Target("x86_64-linux-gnu.2.17", "x86_64_v2", ".so", (*ALONE, "-fPIC"), "manylinux_2_17_x86_64"),
    "windows-x64": Target("x86_64-windows-gnu", "x86_64_v2", ".dll", ALONE, "win_amd64"),
    "macos-arm64": Target(
        "aarch64-macos.11.0", "apple_m1", ".dylib", ("-Wl,-install_name,@rpath/dermis.dylib",), "macosx_11_0_arm64"
    ),
}


# Forms of what `kernels.h` declares; the parts of an enum are constants, and those of a record are fields.
STATEMENT = re.compile(
    r"\s*(?:enum\s*\{(?P<constants>[^{}]*)\}"
    r"|typedef\s+struct(?:\s+\w+)?\s*\{(?P<fields>[^{}]*)\}\s*dermis_(?P<record>\w+)"
    r"|DERMIS_API\s+[\w\s]+\*?\b(?P<function>dermis_\w+)\((?P<argument>[^()]*)\))\s*;"
)
CONSTANT = re.compile(r"DERMIS_(\w+) = (\d+)")
FIELD = re.compile(
    r"((?:const )?(?:struct )?\w+ \*)(\w+(?:, \*\w+)*)"
    r"|(int64_t|double) (\w+(?:\[\d+\])?(?:, \w+(?:\[\d+\])?)*)"
)


class NotBuilt(Exception):
    """Error: the library was not built. The message is a sentence with the reason."""


class Field(NamedTuple):
    """A field of a record.

    Attributes:
        name: name in C.
        type: 'int64_t', 'double', or the type of a pointer, such as 'const float *'.
        length: length of an array of numbers; 1 for any other field.
    """

    name: str
    type: str
    length: int


class Header(NamedTuple):
    """Content of `kernels.h`.

    Attributes:
        constants: values by their names without the prefix 'DERMIS_'.
        records: fields by the names of the records without the prefix 'dermis_'.
        functions: names of the functions that take a record.
    """

    constants: dict[str, int]
    records: dict[str, list[Field]]
    functions: list[str]


def this_platform() -> str:
    """Return Blender's name of this platform, such as 'linux-x64'."""
    machine = platform.machine().lower()
    cpu = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}.get(machine, machine)
    name = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}.get(platform.system(), platform.system().lower())
    return f"{name}-{cpu}"


def sources() -> list[Path]:
    """Return the C sources and headers, sorted by name."""
    return sorted(path for path in FOLDER.iterdir() if path.suffix in (".c", ".h"))


def digest() -> str:
    """Return the digest of sources, flags and platforms, 16 hexadecimal digits."""
    sha = hashlib.sha256(repr((FLAGS, sorted(TARGETS.items()))).encode())
    for path in sources():
        text = path.read_bytes().replace(b"\r\n", b"\n")
        sha.update(f"{path.name} {len(text)}\n".encode() + text)
    return sha.hexdigest()[:16]


def stem(target: str) -> str:
    """Return the beginning of the file name of a platform's library.

    The digest of the content and the suffix follow it.
    """
    return f"dermis-{target}-{digest()}-"


def of_content(content: bytes) -> str:
    """Return the digest of a library's content, 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:16]


def found(target: str, folder: Path) -> Path | None:
    """Return the path of a platform's library in a folder; None for none.

    A library of other sources or flags does not count.
    """
    return next(iter(sorted(folder.glob(f"{stem(target)}*{TARGETS[target].suffix}"))), None)


def whole(path: Path) -> bool:
    """Return whether a library can be read and is complete.

    Its content must have the digest in its name. Loading an incomplete library would end the process.
    """
    try:
        return path.stem.endswith(f"-{of_content(path.read_bytes())}")
    except OSError:
        return False


def declared() -> Header:
    """Return the content of `kernels.h`.

    Raises:
        NotBuilt: a declaration has an unknown form. The message has its line and its text.
    """
    parts = (part.rpartition("*/") for part in (FOLDER / "kernels.h").read_text(encoding="utf-8").split("/*"))
    text = "".join("\n" * comment.count("\n") + code for comment, _, code in parts)
    text = re.sub(r"^#.*", "", text, flags=re.MULTILINE)
    found, at, end = Header({}, {}, []), 0, len(text.rstrip())
    while at < end:
        statement = STATEMENT.match(text, at)
        if statement is None:
            raise _unknown(text, at, text[at:].partition(";")[0])
        at = statement.end()
        if statement["constants"] is not None:
            constants = _parts(text, statement, "constants", ",", CONSTANT)
            found.constants.update((name, int(value)) for name, value in constants)
        elif statement["record"]:
            fields = found.records[statement["record"]] = []
            for pointer, pointers, number, numbers in _parts(text, statement, "fields", ";", FIELD):
                for name in (pointers or numbers).split(", "):
                    name, _, length = name.lstrip("*").partition("[")
                    fields.append(Field(name, pointer or number, int(length.rstrip("]") or 1)))
        elif statement["argument"] != "void":
            found.functions.append(statement["function"])
    return found


def _parts(text: str, statement: re.Match[str], group: str, end: str, form: re.Pattern[str]) -> Iterator[Sequence[str]]:
    at = statement.start(group)
    for part in statement[group].split(end):
        words = " ".join(part.split())
        match = form.fullmatch(words)
        if match is not None:
            yield match.groups()
        elif words:
            raise _unknown(text, at, part)
        at += len(part) + 1


def _unknown(text: str, at: int, part: str) -> NotBuilt:
    line = 1 + text.count("\n", 0, at + len(part) - len(part.lstrip()))
    return NotBuilt(
        f"kernels.h, line {line}: this declaration has an unknown form: {' '.join(part.split())}; the forms are in "
        "core/kernels/building.py"
    )


def layout(header: Header) -> dict[str, int]:
    """Return the values of constants, sizes and offsets, by their expressions in C.

    Every number and pointer takes 8 bytes, so a record has no gaps.
    """
    values = {f"DERMIS_{name}": value for name, value in header.constants.items()}
    for record, fields in header.records.items():
        at = 0
        for field in fields:
            values[f"offsetof(dermis_{record}, {field.name})"] = at
            at += 8 * field.length
        values[f"sizeof(dermis_{record})"] = at
    return values


def of_layout(values: dict[str, int]) -> str:
    """Return the digest of a layout, 16 hexadecimal digits."""
    return of_content(repr(sorted(values.items())).encode())


def described() -> str:
    """Return the C source that puts both digests into a library.

    The compiler checks that records and constants are as `declared` has read them.

    Raises:
        NotBuilt: see `declared`.
    """
    values = layout(declared())
    lines = ['#include "kernels.h"']
    lines += [f'_Static_assert({name} == {value}, "building.py reads it otherwise");' for name, value in values.items()]
    for name, told in (("sources", digest()), ("layout", of_layout(values))):
        lines.append(f'DERMIS_API const char *dermis_{name}(void) {{ return "{told}"; }}')
    return "\n".join(lines) + "\n"


def build(target: str, folder: Path, zig: list[str], cache: Path | None = None) -> Path:
    """Return the path of a platform's library, compiled if necessary.

    It is compiled if it is missing in the folder, or damaged. All other libraries of the platform are then removed from
    the folder.

    Args:
        target: Blender's name of the platform.
        folder: folder of the library; it is created if it is missing.
        zig: command that runs Zig. cache: Zig's folder for intermediate files; None for a temporary one.

    Raises:
        NotBuilt: the compiler is missing or fails, or the folder cannot be written.
    """
    path = found(target, folder)
    if path is not None and whole(path):
        return path
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path = _compiled(target, folder, zig, cache)
        remove(target, folder, path.name)
    except OSError as error:
        raise NotBuilt(f"the library of the kernels cannot be written: {folder}: {error}") from error
    return path


def remove(target: str, folder: Path, kept: str = "") -> None:
    """Remove a platform's libraries from a folder, except for `kept`."""
    for old in folder.glob(f"dermis-{target}-*{TARGETS[target].suffix}"):
        if old.name != kept:
            old.unlink(missing_ok=True)


def _compiled(target: str, folder: Path, zig: list[str], cache: Path | None) -> Path:
    import subprocess  # imported here, since `library.py` needs only names and should load fast
    import tempfile

    of = TARGETS[target]
    with tempfile.TemporaryDirectory(prefix=".part-", dir=folder) as scratch:
        part = Path(scratch) / f"dermis{of.suffix}"
        made = Path(scratch) / "described.c"
        made.write_text(described(), encoding="utf-8")
        command = [*zig, "cc", "-target", of.triple, f"-mcpu={of.processor}", *FLAGS, *of.flags, "-s", "-I."]
        command += ["-o", str(part), *(source.name for source in sources() if source.suffix == ".c"), str(made)]
        kept = str(cache or scratch)
        variables = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": kept, "ZIG_LOCAL_CACHE_DIR": kept}
        try:
            told = subprocess.run(
                command, cwd=FOLDER, env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
        except OSError as error:
            raise NotBuilt(f"the compiler cannot be started: {' '.join(zig)}: {error}") from error
        if told.returncode or not part.is_file():
            raise NotBuilt(f"the kernels do not compile for {target}:\n  {' '.join(command)}\n{told.stdout[-4000:]}")
        path = folder / f"{stem(target)}{of_content(part.read_bytes())}{of.suffix}"
        os.replace(part, path)
    return path
