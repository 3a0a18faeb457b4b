"""Where the files lie that ship with the package: presets, and tables that took long to make."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parent
# a wheel has them within the package, a checkout and the extension beside it
BUILT_IN = _HERE / "built_in" if (_HERE / "built_in").is_dir() else _HERE.parent / "presets"
