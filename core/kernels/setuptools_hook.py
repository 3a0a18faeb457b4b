"""`pip install .`: the package `ziglang`, which pip brings for the build, compiles the library, and the wheel has it.

`pyproject.toml` names both classes. An editable install has the library beside this file, as a checkout has.
"""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

_spec = spec_from_file_location("dermis_building", Path(__file__).with_name("building.py"))
assert _spec is not None and _spec.loader is not None
building: Any = module_from_spec(_spec)
_spec.loader.exec_module(building)


class BuildWithKernels(build_py):
    """Copy the package, and the library into it."""

    def run(self) -> None:
        """Build."""
        super().run()
        target = building.this_platform()
        if target not in building.TARGETS:
            self.warn(f"there are no compiled kernels for {target}: skins will refuse to work, other devices will not")
            return
        library = building.build(target, building.FOLDER, [sys.executable, "-m", "ziglang"])
        if not self.editable_mode:
            folder = Path(self.build_lib) / "dermis" / "kernels"
            building.remove(target, folder, library.name)  # setuptools keeps the folder from one build to the next
            self.copy_file(str(library), str(folder / library.name))


class WheelOfPlatform(bdist_wheel):
    """Name the wheel by its platform, and by no version of Python: the library knows none."""

    def get_tag(self) -> tuple[str, str, str]:
        """Return the three parts of the wheel's tag."""
        target = building.TARGETS.get(building.this_platform())
        return ("py3", "none", target.tag) if target else super().get_tag()
