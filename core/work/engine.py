"""Identity of this engine.

It has the properties that must, or should, agree between all processes that run jobs.
"""

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
SAME = ("dermis", "sources", "presets")  # properties that must agree, because other ones give other results
ALIKE = ("python", "numpy", "scipy", "platform", "kernel")  # properties that may change results by about 1e-6


@cache
def engine() -> Mapping[str, str]:
    """Return a description of this engine.

    It has the version, digests of the sources and of the shipped presets, versions of packages, and the platform.
    'kernel' is the variant of numpy's and scipy's BLAS for this processor, such as 'SkylakeX'.
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
    """Check that another process has the same engine.

    Args:
        theirs: engine of the other process, see `engine`.
        where: name of the other process, for errors.

    Raises:
        DermisError: code 'other-version': the version, the sources or the presets differ.
    """
    ours = engine()
    other = [name for name in SAME if theirs.get(name) != ours[name]]
    if other:
        raise DermisError(
            "a worker runs a different engine: results would differ",
            where=where,
            value=", ".join(f"{name} {theirs.get(name, 'unknown')}" for name in other),
            limit=", ".join(f"{name} {ours[name]}" for name in other),
            remedy="Install the same version on every machine, and start its workers again",
            code="other-version",
        )


def unlike(theirs: Mapping[str, str]) -> str:
    """Return differences to another engine that may change last digits.

    They are described in words; '' if there is none.
    """
    ours = engine()
    other = [name for name in ALIKE if theirs.get(name) != ours[name]]
    return ", ".join(f"{name} {theirs.get(name, 'unknown')} (here {ours[name]})" for name in other)


def _digest(folder: Path, *patterns: str) -> str:
    """Return a hash of the contents and names of files.

    It does not depend on line ends.
    """
    sha = hashlib.sha256()
    files = {path.relative_to(folder).as_posix(): path for pattern in patterns for path in folder.glob(pattern)}
    for name in sorted(files):
        if not name.startswith("built_in/"):  # presets in a wheel; they have a digest of their own
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
