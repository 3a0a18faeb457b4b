"""What enabling the extension costs at Blender's start, from the installed zip in processes of its own.

The zip (DERMIS_ZIP, set by build_addon.py) is installed into a profile once; then fresh processes load bpy, turn the
add-on on and report the time of that one call: import of the package and register(), with the bytecode cached as on
every start but the first. scipy, onnxruntime, serial or PIL loaded by it is an error, whatever the time. Peer:
Blender's own node_wrangler (operators and panels, pure Python) in the same process, before ours.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from . import Result, benchmark, timing

NAME = "register_ms"
PROCESSES = 9
WALKTHROUGH = Path(__file__).resolve().parents[1] / "extension"

INSTALL = """
walkthrough.install(os.environ["DERMIS_ZIP"], enable=False)
assert addon_utils.enable(walkthrough.PACKAGE) is not None  # writes the bytecode
"""
ENABLE = """
def timed(module):
    started = time.perf_counter()
    found = addon_utils.enable(module)
    took = (time.perf_counter() - started) * 1e3
    assert found is not None, f"{module} could not be enabled"
    return took

peer = timed("node_wrangler")
before = set(sys.modules)
ours = timed(walkthrough.PACKAGE)
heavy = sorted({n.partition(".")[0] for n in set(sys.modules) - before} & {"scipy", "onnxruntime", "serial", "PIL"})
answer = {"ours": ours, "peer": peer, "heavy": heavy}
"""
SCRIPT = """
import json, os, sys, time
sys.path.insert(0, os.environ["DERMIS_WALKTHROUGH"])
import bpy, walkthrough
import addon_utils  # there once bpy is
answer = None
try:
    exec(sys.argv[1])
    print("ANSWER" + json.dumps(answer), flush=True)
except BaseException:
    sys.excepthook(*sys.exc_info())
    sys.stderr.flush()
    os._exit(1)
os._exit(0)
"""


@benchmark(NAME, limit=45.0, quick=True)
def register() -> Result:
    """Time enabling the installed extension in fresh processes."""
    if not os.environ.get("DERMIS_ZIP"):
        return Result(NAME, None, "ms", error="no zip to install: run it by build_addon.py bench")
    with tempfile.TemporaryDirectory(prefix="dermis-register-") as profile:
        blender(INSTALL, profile)
        answers = [blender(ENABLE, profile) for _ in range(PROCESSES)]
    ours, peer = timing([a["ours"] for a in answers]), timing([a["peer"] for a in answers])
    heavy = sorted({name for a in answers for name in a["heavy"]})
    error = f"registering loads {', '.join(heavy)}" if heavy else None
    return Result(NAME, ours.median, "ms", ours.p95, {"node_wrangler": peer.median}, error)


def blender(code: str, profile: str) -> Any:
    """Run code in a Blender that sees the profile's wheels and no others."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE")}
    environment.update({"BLENDER_USER_RESOURCES": profile, "DERMIS_WALKTHROUGH": str(WALKTHROUGH)})
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, code], cwd=profile, env=environment, capture_output=True, text=True, timeout=300
    )
    answers = [line[6:] for line in done.stdout.splitlines() if line.startswith("ANSWER")]
    if done.returncode or not answers:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no answer"])[-1])
    return json.loads(answers[-1])
