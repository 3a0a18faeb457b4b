"""Reports of errors and findings: status bar, console, list in the sidebar.

The list lives in this module, for the session only: findings are results, and results are not saved in the .blend.
It belongs to the scene that the work was done in. Findings of work that can be undone come and go with it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from typing import Any

import bpy

from . import redraw
from ._core import DermisError, Finding, core, worst

_findings: tuple[Any, ...] = ()
_source = ""
_scene = 0  # session uid of the scene that the findings belong to
_step = 0  # number of the undo step that the findings belong to, which the scene has as well; 0 for none
_whom: dict[str, int] = {}  # session uids of the objects that findings name, by their names at that time


def findings() -> tuple[Any, ...]:
    """Return the findings of the last work, the worst first."""
    return _findings


def here(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return the findings of the last work if it was done in this scene, and is not undone."""
    undone = _step != 0 and scene.dermis.findings_step != _step
    return () if undone or scene.session_uid != _scene else _findings


def source() -> str:
    """Return the source of the findings, such as 'Bake of Scene'."""
    return _source


def show(found: Iterable[Any], what: str = "", scene: bpy.types.Scene | None = None) -> None:
    """Replace the list by findings, the worst first, equal ones once.

    Findings of one severity keep their order.

    Args:
        what: their source. scene: the scene that they belong to; the current one where None.
    """
    global _findings, _scene, _source, _step
    order = {severity: i for i, severity in enumerate(reversed(core.errors.SEVERITIES))}
    unique = {str(f): f for f in found}
    _findings = tuple(sorted(unique.values(), key=lambda f: order[f.severity]))
    _source, _step = what, 0
    own = scene if scene is not None else bpy.context.scene
    _scene = own.session_uid if own is not None else 0
    names = {name for finding in _findings for name in _names(finding)}
    _whom.clear()
    _whom.update((obj.name_full, obj.session_uid) for obj in bpy.data.objects if obj.name_full in names)
    redraw.request()


def belong_to_step(scene: bpy.types.Scene) -> None:
    """Let the findings come and go with the undo step that Blender closes next."""
    global _step
    if _findings and scene.session_uid == _scene and scene.is_editable:
        _step = 1 + int.from_bytes(os.urandom(3), "big")
        scene.dermis.findings_step = _step


def about(finding: Any, scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the object that a finding is about, even if it was renamed."""
    uids = [_whom[name] for name in _names(finding) if name in _whom]
    return next((obj for uid in uids for obj in scene.objects if obj.session_uid == uid), None)


def _names(finding: Any) -> list[str]:
    return re.findall(r"'([^']+)'", finding.where)


def forget() -> None:
    """Empty the list."""
    show(())


def as_finding(error: Exception) -> Any:
    """Return an error as a finding of severity error, so that it stays in the list."""
    if isinstance(error, DermisError):
        return error.as_finding()
    return Finding("error", "failed", f"{type(error).__name__}: {error}")


def report_error(operator: bpy.types.Operator, error: Exception, what: str = "") -> set[str]:
    """Report an error on an operator and in the list; return the operator's return value."""
    show((as_finding(error),), what)
    operator.report({"ERROR"}, str(error))
    return {"CANCELLED"}


def report_findings(operator: bpy.types.Operator, found: Sequence[Any], what: str, done: str) -> None:
    """Report that work is done, with its worst finding, and fill the list."""
    show(found, what)
    # Blender turns a report of type ERROR into an exception for scripts: the work was done, so it is a warning.
    severity = worst(_findings)
    if severity in (None, "info"):
        operator.report({"INFO"}, done)
        return
    bad = [f for f in _findings if f.severity != "info"]
    more = f"; {len(bad) - 1} more" if len(bad) > 1 else ""
    for finding in bad:
        print(finding)
    first = f"{bad[0].where}: {bad[0].what}" if bad[0].where else bad[0].what  # values and remedy would be cut off
    operator.report({"WARNING"}, f"{done.rstrip('.')}; {bad[0].severity}: {first}{more}")
