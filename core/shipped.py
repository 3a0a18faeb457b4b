"""Folder of the files that ship with the package.

They are the presets, and tables that took long to compute.
"""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parent
# A wheel has the folder inside the package; a checkout and the extension have it beside the package.
BUILT_IN = _HERE / "built_in" if (_HERE / "built_in").is_dir() else _HERE.parent / "presets"
