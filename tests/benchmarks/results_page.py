"""Write figures of a run into RESULTS.md: `python -m tests.benchmarks.results_page RUN.json`.

`python3 build_addon.py bench --full --json RUN.json` measures them. Rows that were measured get the median and the 95th
percentile of the run, and *over* where the median misses its limit; date, machine and load of the run are listed under
*Machine and load*. Rows of counts, such as '0 of 250', keep their words.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from core.files import read_json, read_text, write_bytes

from . import REGISTRY, Result
from .__main__ import load

PAGE = Path(__file__).with_name("RESULTS.md")
RUNS = "<!-- runs -->\n"
LIMIT = re.compile(r"^(?:median )?≤ ([\d.]+)(?= |$|;|:)")


def updated(page: str, run: Mapping[str, Any], day: str) -> str:
    """Return the page with the figures of a run.

    Args:
        run: as `bench --json` writes it. day: of the run, YYYY-MM-DD.
    """
    found = {row["name"]: row for row in run["results"] if row["value"] is not None and not row["error"]}
    lines, names = [], []
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]] if line.startswith("| `") else []
        name = cells[0].strip("`") if cells else ""
        if name in found and len(cells) == 7 and " of " not in cells[2]:
            row, percent = found[name], cells[2].endswith("%")
            cells[2] = shown(row["value"], row["unit"], percent)
            cells[3] = shown(row["p95"], row["unit"], percent) if row["p95"] is not None else ""
            cells[3] += tailed(name, row)
            cells[4] = judged(cells[4], row["value"])
            line = "".join(f"| {cell} " if cell else "| " for cell in cells) + "|"
            names.append(f"`{name}`")
        lines.append(line)
    machine, noise = run["machine"], run["noise"]
    told = f"{machine['processor']}, {machine['cores']} cores, {machine['system']}"
    told += f"; the same work took up to {noise['most_over_least']:.2f} times as long"
    text = "\n".join(lines) + "\n"
    return text.replace(RUNS, f"{RUNS}* {day}, {told}: {', '.join(names)}\n") if names else page


def shown(value: float, unit: str, percent: bool) -> str:
    """Return a figure with three significant digits and its unit; a ratio has none."""
    if percent:
        return f"{100.0 * value:.3g} %"
    number = f"{value:.0f}" if value >= 100.0 else f"{value:#.3g}"
    return f"{number} {unit}" if unit in ("ms", "us", "s", "MB", "deg") else number


def tailed(name: str, row: Mapping[str, Any]) -> str:
    """Return what is to be said of a row's 95th percentile: where it is too many times the median."""
    entry = REGISTRY.get(name)
    result = Result(name, row["value"], row["unit"], row["p95"])
    return f": over {entry.tail:g} medians" if entry is not None and entry.late(result) else ""


def judged(limit: str, value: float) -> str:
    """Return a row's limit, with 'over' where the median misses it."""
    there = LIMIT.match(limit)
    if there is None:
        return limit
    bare = re.sub(r": over(?: \([^)]*\))?", "", limit, count=1)
    if value <= float(there[1]):
        return bare
    first, semicolon, rest = bare.partition(";")
    return f"{first}: over{semicolon}{rest}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Rewrite the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN.json")
    parser.add_argument("--day", default=date.today().isoformat(), help="of the run (today)")
    options = parser.parse_args(arguments)
    load()  # the limits
    write_bytes(PAGE, updated(read_text(PAGE), read_json(options.run), options.day).encode())


if __name__ == "__main__":
    main()
