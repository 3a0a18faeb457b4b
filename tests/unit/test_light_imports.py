"""Importing the engine costs next to nothing: Blender pays for it at every start."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HEAVY = set("scipy onnxruntime serial mpmath PIL threadpoolctl bpy mathutils multiprocessing matplotlib dask".split())


def loaded_by(code: str) -> set[str]:
    """Return the names of the top-level modules that a fresh interpreter has loaded after running code."""
    script = f"import json, sys\n{code}\nprint(json.dumps(sorted({{n.partition('.')[0] for n in sys.modules}})))"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_core_loads_nothing_heavier_than_numpy() -> None:
    extra = loaded_by("import core") - loaded_by("import numpy")
    foreign = {name for name in extra if name not in sys.stdlib_module_names} - {"core"}
    assert not foreign, f"import core loads {', '.join(sorted(foreign))}"
    assert not extra & HEAVY


def test_scipy_is_there_to_be_loaded() -> None:
    """The check above means something: scipy can be imported here, and counts as heavy when it is."""
    pytest.importorskip("scipy")
    assert "scipy" in loaded_by("import core, scipy.linalg") & HEAVY


@pytest.mark.parametrize("verb", ["--help", "render --help", "check --help"])
def test_help_loads_nothing_heavy(verb: str) -> None:
    """Asking for help must not wait for a scientific library."""
    code = (
        "import runpy\n"
        f"sys.argv = ['core', *{verb.split()!r}]\n"
        "try:\n    runpy.run_module('core', run_name='__main__', alter_sys=True)\n"
        "except SystemExit as stop:\n    assert not stop.code, stop.code\n"
    )
    assert not loaded_by(code) & HEAVY


@pytest.mark.parametrize("plots", [False, True])
def test_a_shear_tactor_is_rendered_and_exported_without_a_scientific_library(plots: bool, tmp_path: Path) -> None:
    """A light device does not wait for scipy, and Pillow comes with the first picture only."""
    code = (
        "from pathlib import Path\nfrom core.pipeline.outputs import export\nfrom core.pipeline.render import run\n"
        "from tests.reader_examples import scene\n"
        f"assert export(run(scene()), Path({str(tmp_path)!r}), plots={plots})"
    )
    assert loaded_by(code) & HEAVY == ({"PIL"} if plots else set())
