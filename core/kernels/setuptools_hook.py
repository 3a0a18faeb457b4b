"""Commands for `pip install .`, which compile the kernels for the wheel.

`pyproject.toml` names both classes. pip installs the compiler, the package `ziglang`, for the build. In an editable
install, the library is beside this file, as in a checkout.
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
    """Copy the package to the build folder, with the library."""

    def run(self) -> None:
        """Build the package and the library."""
        super().run()
        target = building.this_platform()
        if target not in building.TARGETS:
            self.warn(f"there are no compiled kernels for {target}: skins will not work; devices without a skin will")
            return
        library = building.build(target, building.FOLDER, [sys.executable, "-m", "ziglang"])
        if not self.editable_mode:
            folder = Path(self.build_lib) / "dermis" / "kernels"
            building.remove(target, folder, library.name)  # the folder may have libraries of earlier builds
            self.copy_file(str(library), str(folder / library.name))


class WheelOfPlatform(bdist_wheel):
    """Tag the wheel for its platform and any version of Python 3.

    The library does not depend on the version.
    """

    def get_tag(self) -> tuple[str, str, str]:
        """Return the wheel's tags for Python, ABI and platform."""
        target = building.TARGETS.get(building.this_platform())
        return ("py3", "none", target.tag) if target else super().get_tag()
