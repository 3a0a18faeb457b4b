"""The product's version, read from the one place that states it: the add-on's manifest; and the engine's number."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

# Raised wherever the same scene gives other commands than before, beyond rounding: `tests/unit/test_engine.py` notices.
# Bakes of another engine are kept by nobody's cache, and their tracks say which engine made them.
ENGINE = 3


@cache
def version() -> str:
    """Return the version of this copy of Dermis: in the source tree, in the installed extension, and from a wheel.

    pip asks here too when it builds one, and writes the answer into the wheel's metadata.
    """
    above = Path(__file__).resolve().parents[1]
    for manifest in (above / "blender_manifest.toml", above / "blender_addon" / "blender_manifest.toml"):
        if manifest.is_file():
            return str(tomllib.loads(manifest.read_text(encoding="utf-8"))["version"])
    from importlib import metadata

    try:
        return metadata.version("dermis")
    except metadata.PackageNotFoundError:
        return "0.0.0+unknown"


def made_by() -> str:
    """Return the maker that tracks and bakes name: version and engine.

    >>> made_by().startswith("dermis ") and made_by().endswith(f" engine {ENGINE}")
    True
    """
    return f"dermis {version()} engine {ENGINE}"
