"""`import dermis`: whole, working and under one name, however pip installed it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

import build_addon

from .conftest import OFFLINE, ROOT, Installed

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_every_folder_of_the_engine_is_a_package_that_pip_installs() -> None:
    folders = {p.parent.relative_to(ROOT / "core").parts for p in (ROOT / "core").rglob("*.py")}
    packages = PROJECT["tool"]["setuptools"]["packages"]
    assert sorted(packages) == sorted([".".join(("dermis", *parts)) for parts in folders] + ["dermis.built_in"])


def test_what_it_depends_on_is_what_the_tests_run_on() -> None:
    """Every wheel of the extension is a dependency or an extra, and no version is promised that nobody tried."""
    project = PROJECT["project"]
    wanted = [*project["dependencies"], *(r for extra in project["optional-dependencies"].values() for r in extra)]
    stated = dict(requirement.split(">=") for requirement in wanted)
    tried = {}
    for lock in (
        "dask.txt",
        "environment-cp313.txt",
        "environment-cp311.txt",
        "wheels.txt",
    ):  # the older numpy is the lower bound
        tried |= dict(re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / ".ci" / lock).read_text(encoding="utf-8"), re.M))
    wheels = re.findall(r"^([\w.-]+)==", (ROOT / ".ci" / "wheels.txt").read_text(encoding="utf-8"), re.M)
    assert set(stated) == {"numpy", "distributed", *wheels}
    for name, least in stated.items():
        assert f"{tried[name]}.".startswith(f"{least}."), f"{name} >= {least}, tried with {tried[name]}"
    assert project["requires-python"] == ">=3.11"


def test_a_wheel_holds_the_engine_the_presets_and_the_licence(wheel: Path) -> None:
    core, presets = ROOT / "core", ROOT / "presets"
    wanted = {f"dermis/{p.relative_to(core).as_posix()}" for p in core.rglob("*.py")} | {"dermis/py.typed"}
    wanted |= {f"dermis/built_in/{p.relative_to(presets).as_posix()}" for p in presets.glob("*/*.json")}
    wanted |= {f"dermis/built_in/{p.relative_to(presets).as_posix()}" for p in presets.glob("skins/*.npz")}
    wanted |= {f"dermis/kernels/{p.name}" for p in (core / "kernels").iterdir() if p.suffix in (".c", ".h")}
    library = build_addon.library(build_addon.this_platform(), Path(sys.executable))
    wanted.add(f"dermis/kernels/{library.name}")
    tag = build_addon.building.TARGETS[build_addon.this_platform()].tag
    assert wheel.name.endswith(f"-py3-none-{tag}.whl"), "for every Python, and this platform"
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        about = archive.read(next(n for n in names if n.endswith(".dist-info/METADATA"))).decode()
        assert archive.read(f"dermis/kernels/{library.name}") == library.read_bytes()
        assert archive.read("dermis/built_in/devices/haptip.json") == (presets / "devices/haptip.json").read_bytes()
    assert {n for n in names if n.startswith("dermis/")} == wanted
    assert any(n.endswith("/LICENSE") for n in names)
    assert f"\nVersion: {build_addon.zips.manifest_value('version')}\n" in about
    assert "\nLicense-Expression: GPL-3.0-or-later\n" in about and "\nRequires-Python: >=3.11\n" in about


def test_it_touches_matches_and_works_in_children(installed: Installed) -> None:
    told = installed.json(
        "import dermis, json\n"
        "library = dermis.Library()\n"
        "groups = ('devices', 'materials', 'skins')\n"
        "broken = [str(e) for g in groups for e in library.list(g) if e.error]\n"
        "skin = dermis.fingertip(level='draft')\n"
        "touch = dermis.press(skin, dermis.Surface.sphere(5e-3, 2_000), depth=1e-3)\n"
        "pins = dermis.match(touch, device='pin_array_128')\n"
        "import tempfile\n"
        "with tempfile.TemporaryDirectory() as folder, dermis.ProcessExecutor() as executor:\n"
        "    wanted = {'skin': {}, 'level': 'draft', 'folder': folder, 'limit': 10**9}\n"
        "    back = int(executor.submit('skin', parameters=wanted).result(120)['pad']) == skin.pad_count\n"
        "print(json.dumps([dermis.__version__, [len(library.list(g)) for g in groups], broken,\n"
        "    touch.resultant.tolist(), len(pins.commands), pins.optimality, back]))\n"
    )
    version, presets, broken, force, commands, optimality, back = told
    assert version == build_addon.zips.manifest_value("version")
    assert presets == [len(list((ROOT / "presets" / g).glob("*.json"))) for g in ("devices", "materials", "skins")]
    assert not broken and commands == 128 and optimality < 1e-9
    assert force[2] > 0.1 and back is True, "a child made the same skin"
    assert abs(np.array(force[:2])).max() < 0.1 * force[2], "a ball in the middle pushes straight up"


@pytest.mark.one_line("3.11", "it is C; the rest of this file runs on both lines")
def test_without_a_library_in_the_sources_it_is_compiled(sources: Path, tmp_path: Path) -> None:
    """As pip does it for a person without a compiler: by the package that pyproject.toml asks for."""
    folder = tmp_path / "sources"
    shutil.copytree(sources, folder, ignore=shutil.ignore_patterns("build", "*.so", "*.dll", "*.dylib"))
    zig = build_addon.compiler(Path(sys.executable)).parents[1]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(zig), os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-m", "pip", "wheel", *OFFLINE, "--wheel-dir", str(tmp_path), str(folder)]
    done = subprocess.run(command, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    library = build_addon.library(build_addon.this_platform(), Path(sys.executable))
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as archive:
        assert archive.read(f"dermis/kernels/{library.name}") == library.read_bytes()


def test_it_has_a_command_line(installed: Installed) -> None:
    assert installed.run("-m", "dermis", "--version") == f"dermis {build_addon.zips.manifest_value('version')}\n"
    assert installed.run("-m", "dermis", "--help").startswith("usage: python -m dermis")


def test_it_reads_the_files_that_an_edit_changes_when_it_is_editable(installed: Installed) -> None:
    where = Path(installed.run("-c", "import dermis; print(dermis.__file__)").strip())
    packages = installed.python.parents[1]
    assert (where.parent == installed.sources / "core") != where.is_relative_to(packages)


@pytest.mark.parametrize(("first", "second"), [("core", "dermis"), ("dermis", "core")])
def test_under_two_names_at_once_it_is_refused(installed: Installed, first: str, second: str) -> None:
    code = f"import {first}\ntry:\n    import {second}\nexcept ImportError as error:\n    print(error)"
    said = installed.run("-c", code, path=str(installed.sources))
    assert said == f"Dermis is loaded as '{first}' already: import it under one name only\n"


def test_a_package_of_another_project_may_be_called_core(library: Installed, tmp_path: Path) -> None:
    (tmp_path / "core.py").write_text("x = 1\n", encoding="utf-8")
    code = "import core, dermis; print(core.x, dermis.DermisError('no').what)"
    assert library.run("-c", code, path=str(tmp_path)) == "1 no\n"
