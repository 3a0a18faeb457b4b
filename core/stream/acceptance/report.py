"""A dated report of the acceptance checks of a built device."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Literal

from ...files import atomic
from ...version import version

Outcome = Literal["passed", "failed", "not judged", "not tried", "does not apply"]
SCHEMA = "dermis-acceptance 2"  # 1 had no "not judged"
CHECKS = ("link", "first-arm", "motors", "speed", "stop", "silence", "flood", "rate", "exits", "unplug", "switch")


@dataclass(frozen=True)
class Check:
    """The result of one check.

    Attributes:
        name: name of the check.
        what: the action that was tested.
        outcome: result of the check; 'not judged' if this computer was too busy to decide.
        judge: 'measured' by this program, 'seen' by the person at the bench, or both.
        figure: the measurement or the answer, with its unit. limit: the bound it was compared with.
    """

    name: str
    what: str
    outcome: Outcome
    judge: str = ""
    figure: str = ""
    limit: str = ""


@dataclass
class Report:
    """All checks of one device on one day.

    Attributes:
        device: facts about device, link and software, by name. checks: results in the order of execution.
        interrupted: the checks ended before the last one.
        unsafe: why the device may not have been left in its safe state; '' if it was.
    """

    device: dict[str, str]
    checks: list[Check] = field(default_factory=list)
    interrupted: bool = False
    unsafe: str = ""

    @property
    def verdict(self) -> str:
        """Return 'accepted', 'not accepted' or 'incomplete'.

        A device is accepted only if every check was tried and judged, and none failed.
        """
        if self.unsafe or any(check.outcome == "failed" for check in self.checks):
            return "not accepted"
        if (
            self.interrupted
            or not self.checks
            or any(check.outcome in ("not tried", "not judged") for check in self.checks)
        ):
            return "incomplete"
        return "accepted"

    def markdown(self, when: datetime) -> str:
        """Return the report as Markdown for people."""
        lines = [
            f"# Acceptance of {self.device.get('device', 'a device')}: {self.verdict}",
            "",
            f"{when:%Y-%m-%d %H:%M}, Dermis {version()}. Tried on the bench, without a finger in it. It speaks of this "
            "built device with these settings, and of no other; it is no certificate.",
            "",
            *(f"* {name}: {value}" for name, value in self.device.items()),
            "",
            "| check | what was done | outcome | judged | found | limit |",
            "|---|---|---|---|---|---|",
            *(_row(check) for check in self.checks),
        ]
        if self.interrupted:
            lines += ["", "Interrupted: what is missing was not tried."]
        if self.unsafe:
            lines += ["", f"It may not have been left in its safe state: {self.unsafe}."]
        return "\n".join(lines) + "\n"

    def write(self, path: Path, when: datetime) -> None:
        """Write the report as Markdown, and as JSON beside it.

        Raises:
            DermisError: a file cannot be written.
        """
        plain = {
            "schema": SCHEMA,
            "date": when.isoformat(timespec="seconds"),
            "version": version(),
            "verdict": self.verdict,
            "interrupted": self.interrupted,
            "unsafe": self.unsafe,
            "device": self.device,
            "checks": [asdict(check) for check in self.checks],
        }
        with atomic(path) as part:
            part.write_text(self.markdown(when), encoding="utf-8")
        with atomic(path.with_suffix(".json")) as part:
            part.write_text(json.dumps(plain, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def judged(seen: bool | None, measured: Mapping[str, bool] | None = None, *, busy: bool = False) -> tuple[Outcome, str]:
    """Return the outcome of a check, and who judged it.

    Args:
        seen: the person's answer; None: skipped, or not asked.
        measured: name -> whether the requirement held; None: not measured.
        busy: this computer was too busy to complete the measurement. The check has then failed if the person's answer
            or a completed measurement says so; otherwise it is not judged.
    """
    held = None if not measured else all(measured.values())
    if busy and seen is not False and held is not False:
        return "not judged", ""
    judge = " and ".join(name for name, by in (("measured", held), ("seen", seen)) if by is not None)
    if seen is False or held is False:
        return "failed", judge
    return ("passed" if judge else "not tried"), judge


def _row(check: Check) -> str:
    cells = (check.name, check.what, check.outcome, check.judge, check.figure, check.limit)
    return "| " + " | ".join(" ".join(cell.replace("|", "/").split()) for cell in cells) + " |"
