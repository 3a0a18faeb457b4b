"""Which engine this process is: what must be the same wherever jobs of one piece of work run, and what should."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from ..errors import DermisError
from ..shipped import BUILT_IN
from ..version import version

CORE = Path(__file__).resolve().parents[1]
SAME = ("dermis", "sources", "presets")  # other ones give other results, and are refused
ALIKE = ("python", "numpy", "scipy", "platform", "kernel")  # other ones give results that agree to some 1e-6


@cache
def engine() -> Mapping[str, str]:
    """Return a description of this engine: version, digests of its sources and of the shipped presets, and platform.

    'kernel' is the choice of numpy's and scipy's BLAS for this processor, such as 'SkylakeX'.
    """
    return {
        "dermis": version(),
        "sources": _digest(CORE, "**/*.py", "kernels/*.[ch]"),
        "presets": _digest(BUILT_IN, "*/*.json", "skins/*.npz"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": _installed("scipy"),
        "platform": f"{platform.system()} {platform.machine()}",
        "kernel": _kernel(),
    }


def check_same(theirs: Mapping[str, str], where: str) -> None:
    """Refuse an engine that is not this one.

    Args:
        theirs: of another process, see `engine`. where: which process that is.

    Raises:
        DermisError: code 'other-version': another version, other sources or presets; both are named.
    """
    ours = engine()
    other = [name for name in SAME if theirs.get(name) != ours[name]]
    if other:
        raise DermisError(
            "another engine than this one: results would differ",
            where=where,
            value=", ".join(f"{name} {theirs.get(name, 'unknown')}" for name in other),
            limit=", ".join(f"{name} {ours[name]}" for name in other),
            remedy="Install the same version on every machine, and start its workers again",
            code="other-version",
        )


def unlike(theirs: Mapping[str, str]) -> str:
    """Return the differences to another engine that may change a result's last digits, in words; '' if none."""
    ours = engine()
    other = [name for name in ALIKE if theirs.get(name) != ours[name]]
    return ", ".join(f"{name} {theirs.get(name, 'unknown')} (here {ours[name]})" for name in other)


def _digest(folder: Path, *patterns: str) -> str:
    """Return a hash of files' contents and names; line ends do not count."""
    sha = hashlib.sha256()
    files = {path.relative_to(folder).as_posix(): path for pattern in patterns for path in folder.glob(pattern)}
    for name in sorted(files):
        if not name.startswith("built_in/"):  # of a wheel: the presets, which have a digest of their own
            data = files[name].read_bytes()
            data = data if name.endswith(".npz") else data.replace(b"\r\n", b"\n")
            sha.update(f"{name} {len(data)}\n".encode())
            sha.update(data)
    return sha.hexdigest()[:12]


def _installed(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"


def _kernel() -> str:
    try:
        import scipy.linalg  # noqa: F401  (so that its BLAS is there to be asked)
        from threadpoolctl import threadpool_info
    except ModuleNotFoundError:
        return "unknown"
    return "+".join(sorted({str(i.get("architecture")) for i in threadpool_info() if i["user_api"] == "blas"}))
