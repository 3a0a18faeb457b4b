"""`build_addon.py dev`: the linked sources work as an extension, and an edit of theirs is what runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def test_linked_sources_enable_and_are_the_sources(fresh_blender: Any, tmp_path: Path) -> None:
    profile = str(tmp_path / "profile")
    command = [sys.executable, str(ROOT / "build_addon.py"), "dev", "--no-wheels", "--profile", profile]
    for _ in range(2):  # linking again over the links is how new files arrive
        subprocess.run(command, check=True, capture_output=True)
    found = fresh_blender(
        "import bpy, addon_utils, walkthrough\n"
        "assert addon_utils.enable(walkthrough.PACKAGE) is not None\n"
        "core = walkthrough.part('_core').core\n"
        "answer = [os.path.realpath(walkthrough.part('_core').__file__), os.path.realpath(core.__file__)]\n"
        "answer.append(walkthrough.policy_warnings())\n"
        "answer.append(walkthrough.part('core.kernels.library').kernels().path.name)\n"
    )
    assert found[:3] == [str(ROOT / "blender_addon" / "_core.py"), str(ROOT / "core" / "__init__.py"), {}]
    assert (ROOT / "core" / "kernels" / found[3]).is_file()
    assert (ROOT / "core" / "__init__.py").is_file()


def test_an_installed_extension_is_not_linked_over(zip_path: Path, tmp_path: Path) -> None:
    package = tmp_path / "extensions" / "user_default" / "dermis"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("kept = True\n")
    command = [sys.executable, str(ROOT / "build_addon.py"), "dev", "--no-wheels", "--profile", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1 and "uninstall it" in done.stderr
    assert (package / "__init__.py").read_text() == "kept = True\n"
