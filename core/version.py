"""Version of the product and number of the engine.

The version is read from the add-on's manifest.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

# Number of the engine, which is raised whenever the commands for a scene change by more than rounding.
# `tests/unit/test_engine.py` notices such a change. A cached bake of another engine is not used, and tracks name the
# engine that made them.
ENGINE = 15


@cache
def version() -> str:
    """Return the version of this copy of Dermis.

    The copy may be a source tree, an installed extension or an installed wheel. When pip builds a wheel, it calls this
    function and writes the version into the wheel's metadata.
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
    """Return the version and engine that tracks and bakes store, as text.

    >>> made_by().startswith("dermis ") and made_by().endswith(f" engine {ENGINE}")
    True
    """
    return f"dermis {version()} engine {ENGINE}"
