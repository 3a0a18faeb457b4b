"""Errors and findings: a problem with its place, value, limit and remedy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Literal

Severity = Literal["info", "warning", "error"]
SEVERITIES: tuple[Severity, ...] = ("info", "warning", "error")
REFUSED = "refused"  # code of an error that programs need not distinguish from others


class DermisError(ValueError):
    """An error message with where, value, limit and remedy.

    Args:
        what: the problem, as a short sentence without a full stop.
        where: the object, file, field or frame that the problem concerns.
        value: the value found.
        limit: the values that would be accepted.
        remedy: a way to solve the problem.
        code: stable word for the kind of error, such as 'no-finger'. Programs compare codes, never messages.

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

    def __reduce__(self) -> tuple[Any, ...]:  # by default, the whole message would become `what`
        return partial(type(self), **self._parts()), ()

    def changed(self, **parts: Any) -> DermisError:
        """Return the same error with some parts replaced.

        For example, a caller replaces `where` by a name that its user knows.
        """
        return DermisError(**{**self._parts(), **parts})

    def as_finding(self, severity: Severity = "error", **parts: Any) -> Finding:
        """Return the error as a finding.

        This is for work that continues without the refused item.

        Args:
            severity: severity of the finding.
            parts: further attributes of the finding, and replacements of parts of the error.
        """
        return Finding(**{"severity": severity, **self._parts(), **parts})

    def as_dict(self) -> dict[str, Any]:
        """Return the parts of the error by name, as plain JSON values."""
        plain = self.value if isinstance(self.value, str | int | float | bool | None) else str(self.value)
        return {**self._parts(), "value": plain}

    def _parts(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("code", "what", "where", "value", "limit", "remedy")}


@dataclass(frozen=True)
class Finding:
    """Observation about a scene or a track that does not stop the work.

    Attributes:
        severity: 'info', 'warning' or 'error'.
        code: stable word for the kind of finding, such as 'out-of-range'.
        what, where, value, limit, remedy: as in `DermisError`.
        frame: first frame of the scene that the finding concerns; None if it does not depend on frames.
        count: number of samples, triangles or other items that the finding concerns.
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
        """Return the attributes of the finding by name."""
        return asdict(self)


def worst(findings: Iterable[Finding]) -> Severity | None:
    """Return the highest severity of findings, or None without findings.

    >>> from dermis import Finding, worst
    >>> worst([Finding("info", "a", "seen"), Finding("warning", "b", "doubtful")])
    'warning'
    """
    ranks = [SEVERITIES.index(f.severity) for f in findings]
    return SEVERITIES[max(ranks)] if ranks else None


def sentence(what: str, where: str, value: Any, limit: str, remedy: str) -> str:
    """Join the parts of an error or a finding into a message of one line."""
    text = f"{where}: {what}" if where else what
    details = []
    if value is not None:
        details.append(f"found {value!r}" if isinstance(value, str) else f"found {value}")
    if limit:
        details.append(f"allowed: {limit}")
    if details:
        text += f" ({'; '.join(details)})"
    return f"{text}. {remedy}." if remedy else f"{text}."
