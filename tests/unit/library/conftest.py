"""Dermis as pip installs it: from its folder, from a wheel and editable, each in an environment of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import venv
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import build_addon

ROOT = Path(__file__).resolve().parents[3]
READ_BY_PIP = ("pyproject.toml", "README.md", "LICENSE", "blender_addon/blender_manifest.toml", "core", "presets")
OFFLINE = (
    "--no-deps",
    "--no-build-isolation",
    "--no-index",
    "--quiet",
    "--disable-pip-version-check",
    "--no-cache-dir",
)


class Installed(NamedTuple):
    """An environment that has Dermis, and the sources that it was installed from."""

    python: Path
    sources: Path

    def run(self, *arguments: str, path: str = "", status: int = 0) -> str:
        """Run its Python far from the sources and return what it prints."""
        path = os.pathsep.join(filter(None, (path, os.environ.get("PYTHONPATH", ""))))
        env = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}
        command = [str(self.python), *arguments]
        done = subprocess.run(
            command, cwd=self.python.parent, env=env, capture_output=True, encoding="utf-8", timeout=300
        )
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + (done.stderr if status else "")

    def json(self, code: str) -> Any:
        """Run code and return what it prints as JSON."""
        return json.loads(self.run("-c", code))


@pytest.fixture(scope="session")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of what pip reads: it builds inside of it."""
    folder = tmp_path_factory.mktemp("sources")
    for name in READ_BY_PIP:
        source, target = ROOT / name, folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
        else:
            shutil.copyfile(source, target)
    return folder


@pytest.fixture(scope="session")
def wheel(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a wheel without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    target = build_addon.this_platform()
    before = sources / "build" / "lib" / "dermis" / "kernels"  # what an earlier build leaves goes into no wheel
    before.mkdir(parents=True)
    (before / f"dermis-{target}-0-0{build_addon.building.TARGETS[target].suffix}").write_bytes(b"of other sources")
    pip("wheel", *OFFLINE, "--wheel-dir", str(folder), str(sources))
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="session")
def library(sources: Path, wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """Install from the wheel, which is enough for what does not depend on the way."""
    return install([str(wheel)], sources, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="session", params=["folder", "wheel", "editable"])
def installed(request: pytest.FixtureRequest, sources: Path, library: Installed, tmp_path_factory: Any) -> Installed:
    """Install in each way that a person may choose."""
    if request.param == "wheel":
        return library
    what = ["--editable"] if request.param == "editable" else []
    return install([*what, str(sources)], sources, tmp_path_factory.mktemp(request.param))


def install(what: list[str], sources: Path, folder: Path) -> Installed:
    """Make an environment, show it numpy, scipy and setuptools of this one, and install Dermis into it."""
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    found = [find_spec(name) for name in ("numpy", "scipy", "setuptools")]
    places = {str(Path(spec.origin).parents[1]) for spec in found if spec is not None and spec.origin}
    packages = next(folder.rglob("site-packages"))
    (packages / "shown.pth").write_text("\n".join(sorted(places)) + "\n", encoding="utf-8")
    pip("--python", str(python), "install", *OFFLINE, *what)
    return Installed(python, sources)


def pip(*arguments: str) -> None:
    """Run this environment's pip."""
    done = subprocess.run([sys.executable, "-m", "pip", *arguments], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
