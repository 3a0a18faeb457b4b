"""The command `stream accept`: test a built device and write a report.

It is `python -m core stream accept`. No finger may be in the device.
"""

from __future__ import annotations

import argparse
import contextlib
import re
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from ... import clock
from ...errors import DermisError
from ..device_options import request_from
from ..drive import ARMING
from ..local_stream import say
from ..signals import Interrupted, Signals
from .bench import NOT_ARMED, Bench
from .host import ATTEMPTS
from .person import INTRODUCTION, QUESTIONS, NobodyThere, Terminal
from .report import Check, Report
from .walk import Walk


def run(options: argparse.Namespace) -> int:
    """Run the checks and write the report; return the exit status.

    It is 0 if the device is accepted, 1 if it is not or a check is missing, and 128 plus the number of a signal that
    ended the checks.
    """
    request = request_from(options, options.device)
    now = datetime.now().astimezone()
    path = options.out or Path(f"acceptance_{_plain(options.device)}_{now:%Y-%m-%d_%H%M}.md")
    if path.suffix == ".json":
        raise DermisError(
            "the report is Markdown, and its JSON is written beside it",
            where=str(path),
            remedy="Give --out another ending",
        )
    for there in (path, path.with_suffix(".json")):
        if there.exists():
            raise DermisError("the report's file exists", where=str(there), remedy="Choose another name with --out")
    signals = Signals()

    def heed() -> None:
        if signals.number:
            raise Interrupted

    bench = Bench(request, heed)
    person = Terminal(lambda: bench.run(0.01))
    play = ["--url", options.url, "--device", options.device, "--protocol", options.protocol]
    for name in ("presets", "calibration", "rate"):
        if getattr(options, name):
            play += [f"--{name}", str(getattr(options, name))]
    facts = {"device": bench.wire.spec.name, "preset": f"{options.device} ({bench.wire.spec.hash[:16]})"}
    report = Report({**facts, "url": options.url, "protocol": options.protocol}, interrupted=True)
    connected = False
    with signals.caught():  # an interruption first brings the device to its safe state
        try:
            print(INTRODUCTION, QUESTIONS, sep="\n")
            person.wait(f"{bench.wire.spec.name} at {options.url}: fingers out? Enter begins.")
            report.write(path, now)  # if the file cannot be written, the error comes before anything moves
            bench.connect()
            connected = True
            report.device |= _facts(bench)
            _go(Walk(bench, person, play), options.only, report)
            report.interrupted = False
        except Interrupted:
            say("Stopping.")
        finally:
            if unsure := bench.end():
                report.unsafe = unsure
                say(f"{unsure}. THE DEVICE MAY NOT BE SAFE: switch its supply off")
            if not connected and not report.unsafe:  # nothing was tried, so the next attempt can use the same name
                path.unlink(missing_ok=True)
                path.with_suffix(".json").unlink(missing_ok=True)
            elif path.exists():
                report.write(path, now)
                with contextlib.suppress(OSError):  # the terminal may have been closed
                    print(f"{report.verdict}: {path}")
    return 128 + signals.number if signals.number else int(report.verdict != "accepted")


def _go(walk: Walk, only: list[str] | None, report: Report) -> None:
    """Run every check, or those of `only`, and add the results to the report."""
    for name, check in walk.checks().items():
        if only and name not in only:
            report.checks.append(Check(name, "left out by --only", "not tried"))
            continue
        for found in _tried(name, check, walk.bench):
            report.checks.append(found)
            print(f"{found.outcome.upper():10} {found.name}: {found.figure or found.judge or found.limit}", flush=True)


def _tried(name: str, check: Callable[[], Iterator[Check]], bench: Bench) -> Iterator[Check]:
    """Yield the results of a check.

    A check that ends with an error has failed. If this computer stood still meanwhile, so that the board's watchdog may
    have acted, the check is tried again. A device that does not arm within the streamer's time-out is tried again only
    if a single pause of this computer took more than half of that time.
    """
    found: list[Check] = []
    for _ in range(ATTEMPTS):
        since, found = clock.now(), []
        try:
            for one in check():
                found.append(one)
            yield from found
            return
        except NobodyThere:
            yield from found
            raise
        except DermisError as error:
            last = Check(name, "could not be gone through", "failed", "measured", str(error))
            unarmed = error.code == NOT_ARMED
            excused = bench.host.worst(since) > 0.5 * ARMING if unarmed else bench.host.disturbed(since)
            if not excused or not _there(bench):
                break
            last = Check(name, last.what, "not judged", "", f"{last.figure}; {bench.host.words(since)}")
    yield from found
    yield last


def _there(bench: Bench) -> bool:
    """Return whether the device can be connected again."""
    try:
        bench.connect()
    except DermisError:
        return False
    return True


def _facts(bench: Any) -> dict[str, str]:
    """Return facts about the connected device, by name."""
    connection = bench.connection
    adapter = connection.adapter
    return {
        "rate": f"{connection.output.rate:g} Hz",
        "serial number": adapter.device or "it says none",
        "holds for later": f"{adapter.queue} commands",
        "new values a second": f"{adapter.output_hz:g}" if adapter.output_hz else "at every command",
        "pose at the start": "not known" if adapter.pose is None else "known",
        **({"caution": adapter.caution} if adapter.caution else {}),
    }


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text)
