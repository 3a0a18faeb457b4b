"""Notes: warnings with their first frame and the number of frames."""

from __future__ import annotations

from dataclasses import replace

from ...errors import Finding


class Notes:
    """Warnings about one subject, one for each kind.

    Args:
        where: name of the subject.
    """

    def __init__(self, where: str) -> None:
        self.where = where
        self._known: dict[str, Finding] = {}

    def warn(
        self, code: str, what: str, scene_frame: float, *, value: object = None, limit: str = "", remedy: str = ""
    ) -> None:
        """Record a warning, or count it if there is one of its kind."""
        known = self._known.get(code)
        if known is None:
            self._known[code] = Finding("warning", code, what, self.where, value, limit, remedy, scene_frame)
        else:
            self._known[code] = replace(known, count=known.count + 1)

    def too_deep(self, skin: str, depth: float, limit: float, scene_frame: float, *, remedy: str) -> None:
        """Record that skin, in words linear or neo-Hookean, is deeper in an object than it is trusted [m]."""
        what = f"the finger sinks too deep: {skin} skin is not trusted at this depth"
        value, limited = f"{1e3 * depth:.2f} mm", f"<= {1e3 * limit:g} mm"
        self.warn("too-deep", what, scene_frame, value=value, limit=limited, remedy=remedy)

    def findings(self) -> tuple[Finding, ...]:
        """Return one finding for each kind, in the order of their first frames."""
        return tuple(self._known.values())

    def copy(self) -> Notes:
        """Return a copy that shares nothing with this one."""
        other = Notes(self.where)
        other._known = dict(self._known)
        return other
