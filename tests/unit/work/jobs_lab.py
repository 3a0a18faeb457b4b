"""Jobs that only tests ask for: they echo, dawdle, refuse, break and die; and the line of a child that serves them."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from core.errors import DermisError
from core.work.cluster import serve as reply_to

TABLE = {name: f"{__name__}:{name}" for name in ("echo", "dawdle", "refuse", "fail", "die", "babble", "leave", "plain")}
LINE = [sys.executable, "-c", f"from core.work.processes import serve; from {__name__} import TABLE; serve(TABLE)"]


def on_worker(request: bytes, *large: bytes) -> bytes:
    """Do a job of this table on a worker of a cluster."""
    return reply_to(request, large, TABLE)


def echo(arrays: Any, parameters: Any, report: Any) -> Any:
    """Return what came in, and where it did."""
    print("what a job prints is no reply")
    report(1, 1)
    found = {"python": sys.version.split()[0], "numpy": np.__version__, "parameters": dict(parameters)}
    return {**arrays, "found": np.array(json.dumps(found)), "pid": np.array(os.getpid())}


def dawdle(arrays: Any, parameters: Any, report: Any) -> Any:
    """Take some steps of some seconds, and leave a file with the process's id at the start."""
    if "file" in parameters:
        Path(parameters["file"]).write_text(str(os.getpid()))
    steps = parameters.get("steps", 1)
    began = time.monotonic()
    for i in range(steps):
        report(i, steps)
        time.sleep(parameters.get("seconds", 0.0))
    report(steps, steps)
    return {**arrays, "span": np.array([began, time.monotonic()]), "pid": np.array(os.getpid())}


def refuse(arrays: Any, parameters: Any, report: Any) -> Any:
    """Refuse."""
    raise DermisError(
        "the disc is too thick", where="disc", value=Path("x"), limit="1 mm", remedy="File it", code="too-thick"
    )


def fail(arrays: Any, parameters: Any, report: Any) -> Any:
    """Have a defect."""
    return {}["missing"]


def die(arrays: Any, parameters: Any, report: Any) -> Any:
    """End the process in the middle of the job."""
    report(1, 3)
    print("last words", file=sys.stderr, flush=True)
    os._exit(3)


def babble(arrays: Any, parameters: Any, report: Any) -> Any:
    """Write to whatever is open, the pipe of the replies included."""
    for descriptor in range(3, 16):
        with contextlib.suppress(OSError):
            os.write(descriptor, b"{babble}\n")
    return {}


def leave(arrays: Any, parameters: Any, report: Any) -> Any:
    """Try to end Python."""
    sys.exit(4)


def plain(arrays: Any, parameters: Any, report: Any) -> Any:
    """Return what a careless job does, and report so, too."""
    report(np.int64(1), np.int64(1))
    given = {"nothing": None, "numbers": {"x": [1, 2], 3: 4.5}, "object": {"x": np.array([{}])}}
    return given[parameters["what"]]
