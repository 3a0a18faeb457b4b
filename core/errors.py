"""Errors and findings: the problem, its place, value, limit and remedy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Literal

Severity = Literal["info", "warning", "error"]
SEVERITIES: tuple[Severity, ...] = ("info", "warning", "error")
REFUSED = "refused"  # the code of an error that nobody has to tell from others


class DermisError(ValueError):
    """An error message with where, value, limit and remedy.

    Args:
        what: the problem, as a short sentence without a full stop.
        where: the object, file, field or frame that it concerns.
        value: the value found.
        limit: the values that would be accepted.
        remedy: a way to solve the problem.
        code: a stable word to tell refusals apart by, such as 'no-finger': programs compare codes, never messages.

    >>> from dermis import DermisError
    >>> print(DermisError("a length must be above zero", where="radius", value=-1.0, limit="> 0 m"))
    radius: a length must be above zero (found -1.0; allowed: > 0 m).
    """

    def __init__(
        self, what: str, *, where: str = "", value: Any = None, limit: str = "", remedy: str = "", code: str = REFUSED
    ) -> None:
        self.what, self.where, self.value, self.limit, self.remedy = what, where, value, limit, remedy
        self.code = code
        super().__init__(sentence(what, where, value, limit, remedy))

    def __reduce__(self) -> tuple[Any, ...]:  # else the whole sentence would be pickled as the problem
        return partial(type(self), **self._parts()), ()

    def changed(self, **parts: Any) -> DermisError:
        """Return the same refusal with some parts replaced, such as `where` by the caller's name for it."""
        return DermisError(**{**self._parts(), **parts})

    def as_finding(self, severity: Severity = "error", **parts: Any) -> Finding:
        """Return the refusal as a finding, for work that goes on without the refused item."""
        return Finding(**{"severity": severity, **self._parts(), **parts})

    def as_dict(self) -> dict[str, Any]:
        """Return the refusal as plain JSON values."""
        plain = self.value if isinstance(self.value, str | int | float | bool | None) else str(self.value)
        return {**self._parts(), "value": plain}

    def _parts(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("code", "what", "where", "value", "limit", "remedy")}


@dataclass(frozen=True)
class Finding:
    """One observation about a scene or a track that does not stop the work.

    Attributes:
        severity: 'info', 'warning' or 'error'.
        code: a stable word to filter by, such as 'out-of-range'.
        what, where, value, limit, remedy: as in `DermisError`.
        frame: the first scene frame it concerns, if any.
        count: how many samples it concerns.
    """

    severity: Severity
    code: str
    what: str
    where: str = ""
    value: Any = None
    limit: str = ""
    remedy: str = ""
    frame: float | None = None
    count: int = 1

    def __repr__(self) -> str:
        return f"Finding({self.code}, {self})"

    def __str__(self) -> str:
        text = sentence(self.what, self.where, self.value, self.limit, self.remedy)
        if self.frame is not None:
            text = f"{text.removesuffix('.')} (first at frame {self.frame:g})."
        return f"{self.severity}: {text}"

    def as_dict(self) -> dict[str, Any]:
        """Return the finding as plain JSON values."""
        return asdict(self)


def worst(findings: Iterable[Finding]) -> Severity | None:
    """Return the highest severity present, or None where there are no findings.

    >>> from dermis import Finding, worst
    >>> worst([Finding("info", "a", "seen"), Finding("warning", "b", "doubtful")])
    'warning'
    """
    ranks = [SEVERITIES.index(f.severity) for f in findings]
    return SEVERITIES[max(ranks)] if ranks else None


def sentence(what: str, where: str, value: Any, limit: str, remedy: str) -> str:
    """Join the parts of a message into one readable line."""
    text = f"{where}: {what}" if where else what
    details = []
    if value is not None:
        details.append(f"found {value!r}" if isinstance(value, str) else f"found {value}")
    if limit:
        details.append(f"allowed: {limit}")
    if details:
        text += f" ({'; '.join(details)})"
    return f"{text}. {remedy}." if remedy else f"{text}."
