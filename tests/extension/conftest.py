"""The installed zip: one profile for this process, and fresh processes for what must start from nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def zip_path() -> Path:
    """The zip on trial; `build_addon.py test` builds it."""
    path = os.environ.get("DERMIS_ZIP")
    if not path:
        pytest.exit("tests/extension needs the built zip: run them by build_addon.py test tests/extension", 1)
    return Path(path)


@pytest.fixture(scope="session")
def blender_in() -> Callable[[Path], Callable[..., Any]]:
    """What gives, for a folder, a call that runs code in a Blender of its own, with its profile in that folder."""
    return lambda folder: partial(run_in, folder)


def run_in(folder: Path, code: str, **variables: str) -> Any:
    """Run code in a Blender of its own, with a profile in a folder; return the value left in `answer`."""
    answer = folder / "answer.json"
    answer.unlink(missing_ok=True)
    script = (
        f"import json, os, sys\nsys.path.insert(0, {str(HERE)!r})\nanswer = None\n{code}\n"
        f"with open({str(answer)!r}, 'w') as file:\n    json.dump(answer, file)\n"
        "sys.stdout.flush()\nos._exit(0)\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    environment.update({"BLENDER_USER_RESOURCES": str(folder / "profile"), **variables})
    # A failure has to leave at once, too: the interpreter's own end may hang with an add-on registered.
    guarded = (
        "import os, sys, traceback\ntry:\n    exec(compile(sys.argv[1], 'fresh_blender', 'exec'))\n"
        "except BaseException:\n    traceback.print_exc()\n    sys.stderr.flush()\n    os._exit(1)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", guarded, script],
        cwd=folder,
        env=environment,
        timeout=300,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0 and answer.is_file(), done.stdout
    return json.loads(answer.read_text())


@pytest.fixture
def fresh_blender(blender_in: Any, tmp_path: Path) -> Callable[..., Any]:
    """Run code in a Blender of its own, in one profile per test; the value left in `answer` comes back."""
    run: Callable[..., Any] = blender_in(tmp_path)
    return run


@pytest.fixture(scope="session")
def dermis(zip_path: Path) -> Any:
    """The extension, installed and enabled in this process."""
    import walkthrough

    walkthrough.install(zip_path)
    yield walkthrough
    import addon_utils

    addon_utils.disable(walkthrough.PACKAGE)
