"""Log and tee of a stream: a scene's settings as the sender takes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..preferences import user_folder


def folder(settings: Any) -> Path:
    """Return the folder for logs: the chosen one, or the extension's own.

    It need not exist.
    """
    return Path(bpy.path.abspath(settings.log_folder)) if settings.log_folder else user_folder("logs")


def fields(settings: Any) -> dict[str, str]:
    """Return the fields of the sender's request."""
    return {"log": str(folder(settings)) if settings.use_log else "", "tee": settings.tee}


def lines(log: dict[str, Any]) -> tuple[list[str], str]:
    """Return the state of a log, as short lines, and an error message; '' for none."""
    said = []
    if log.get("file"):
        path = Path(log["file"])
        said.append(f"Log: {path.name}, {log.get('bytes', 0) / 1e6:.1f} MB")
        files = log.get("files", 1)
        many = f" in {files} files" if files > 1 else ""
        said.append(f"Logged: {log.get('written', 0):,} rows{many}")
    if log.get("removed"):
        said.append(f"Oldest files of this log removed: {log['removed']}")
    for tee in log.get("tees", ()):
        said.append(f"{tee['name'].capitalize()}: {tee['sent']:,}")
        said += [f"Not teed, {name}: {tee[name]:,}" for name in ("dropped", "thinned") if tee[name]]
    wrong = [str(log["ended"])] if log.get("ended") else []
    if log.get("lost"):
        wrong.insert(0, f"{log['lost']:,} rows were lost: they came faster than they could be written")
    return said, ". ".join(wrong)
