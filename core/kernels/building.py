"""How the kernels are built: sources, flags, platforms, the name of the file. Needs the standard library alone.

`build_addon.py` (any Python from 3.8 on) and pip (`setuptools_hook.py`) build with it; `library.py` asks it for the
file's name. The compiler is Zig's, which the package `ziglang` brings: it makes the libraries of all platforms on any
of them, and nobody needs another one. The name holds a digest of sources and flags, and one of the content: a library
of other sources is never taken, and a damaged one never loaded.
"""

from __future__ import annotations

import hashlib
import os
import platform
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).resolve().parent

# Every compiler gives the same bytes: products and sums are rounded one by one, in the order of the source.
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fno-fast-math", "-fno-math-errno", "-fvisibility=hidden", "-shared")
# A library that no other one is linked to: there is no version of a C library that it could need.
ALONE = ("-nostdlib", "-DDERMIS_ALONE")


class Target(NamedTuple):
    """A platform: Zig's name of it, its oldest processor, how libraries end, its own flags, the tag of its wheels."""

    triple: str
    processor: str
    suffix: str
    flags: tuple[str, ...]
    tag: str


# By Blender's names of platforms. The processors are the oldest that Blender runs on; macOS loads no library alone.
TARGETS = {
    "linux-x64": Target("x86_64-linux-gnu.2.17", "x86_64_v2", ".so", (*ALONE, "-fPIC"), "manylinux_2_17_x86_64"),
    "windows-x64": Target("x86_64-windows-gnu", "x86_64_v2", ".dll", ALONE, "win_amd64"),
    "macos-arm64": Target(
        "aarch64-macos.11.0", "apple_m1", ".dylib", ("-Wl,-install_name,@rpath/dermis.dylib",), "macosx_11_0_arm64"
    ),
}


class NotBuilt(Exception):
    """A sentence that says why there is no library."""


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
    """Return how the name of a platform's library begins: the digest of its content follows."""
    return f"dermis-{target}-{digest()}-"


def of_content(content: bytes) -> str:
    """Return the digest of a library's content, 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:16]


def found(target: str, folder: Path) -> Path | None:
    """Return a platform's library of these sources in a folder; None without."""
    return next(iter(sorted(folder.glob(f"{stem(target)}*{TARGETS[target].suffix}"))), None)


def whole(path: Path) -> bool:
    """Tell whether a library can be read and has the content that its name tells: half of one ends the process."""
    try:
        return path.stem.endswith(f"-{of_content(path.read_bytes())}")
    except OSError:
        return False


def defined() -> str:
    """Return the flag that tells the library its digest."""
    return f'-DDERMIS_SOURCES="{digest()}"'


def build(target: str, folder: Path, zig: list[str], cache: Path | None = None) -> Path:
    """Return a platform's library in a folder; it is compiled where it is not there, and older ones of the platform go.

    Args:
        zig: the command that runs Zig. cache: Zig's folder for intermediate files; a temporary one where None.

    Raises:
        NotBuilt: the compiler fails, or the folder cannot be written.
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
    """Remove a platform's libraries from a folder, but for the one of a name."""
    for old in folder.glob(f"dermis-{target}-*{TARGETS[target].suffix}"):
        if old.name != kept:
            old.unlink(missing_ok=True)


def _compiled(target: str, folder: Path, zig: list[str], cache: Path | None) -> Path:
    import subprocess  # whoever only asks for the name does not wait for it
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
