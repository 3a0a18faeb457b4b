"""Build of the kernels: sources, flags, platforms and file names.

This module needs only the standard library. `build_addon.py` (any Python from 3.8 on) and pip (`setuptools_hook.py`)
build with it, and `library.py` gets the file's name from it. The compiler is that of Zig, from the package `ziglang`:
it builds the libraries for all platforms on each of them, so no other compiler is needed.

A library's name contains a digest of sources and flags, and a digest of its content. So a library of other sources is
never used, and a damaged one is never loaded.
"""

from __future__ import annotations

import hashlib
import os
import platform
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


class NotBuilt(Exception):
    """Error: the library was not built. The message is a sentence with the reason."""


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


def defined() -> str:
    """Return the compiler flag that puts the digest into the library."""
    return f'-DDERMIS_SOURCES="{digest()}"'


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
        command = [*zig, "cc", "-target", of.triple, f"-mcpu={of.processor}", *FLAGS, *of.flags, "-s", defined()]
        command += ["-o", str(part), *(source.name for source in sources() if source.suffix == ".c")]
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
