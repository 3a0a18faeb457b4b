"""Run the benchmarks, print the table, write JSON: `python build_addon.py bench [NAME ...] --json FILE`."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
import time
import traceback
from pathlib import Path

from . import REGISTRY, Benchmark, Result

FOLDER = Path(__file__).parent


def load() -> list[Result]:
    """Import every bench_*.py; a module that cannot be imported is a result with its reason."""
    broken = []
    for path in sorted(FOLDER.glob("bench_*.py")):
        try:
            importlib.import_module(f"{__package__}.{path.stem}")
        except Exception as error:
            broken.append(Result(path.stem, None, "", error=reason(error)))
    return broken


def run(entry: Benchmark) -> Result:
    """Run one benchmark; whatever stops it becomes the result's error."""
    try:
        result = entry.function()
    except Exception as error:
        traceback.print_exc()
        return Result(entry.name, None, entry.name.rpartition("_")[2], error=reason(error))
    if result.name != entry.name:
        return Result(entry.name, None, result.unit, error=f"it reports as {result.name!r}")
    return result


def reason(error: Exception) -> str:
    """Return one line that says what went wrong."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def table(results: list[Result]) -> str:
    """Return the results as text in columns."""
    lines = [f"{'benchmark':34} {'median':>10} {'p95':>10} {'unit':5} {'limit':>8}  peers"]
    for result in results:
        entry = REGISTRY.get(result.name)
        limit = entry.limit if entry is not None else None
        shown = f"{number(result.value):>10} {number(result.p95):>10} {result.unit:5} {number(limit):>8}"
        peers = ", ".join(f"{name} {number(value)}{times(value, result.value)}" for name, value in result.peers.items())
        over = limit is not None and result.value is not None and result.value > limit
        lines.append(f"{result.name:34} {shown}  {peers}{'  OVER THE LIMIT' if over else ''}".rstrip())
        if result.error:
            lines.append(f"    {result.error}")
    return "\n".join(lines)


def number(value: float | None) -> str:
    """Return four significant digits, or a dash."""
    return "-" if value is None else f"{value:.4g}"


def times(peer: float, ours: float | None) -> str:
    """Return how many times our time a peer takes."""
    return f" ({peer / ours:.1f}x)" if ours else ""


def as_json(results: list[Result]) -> str:
    """Return the results as the JSON text that other tools read."""
    rows = [
        {"name": r.name, "value": r.value, "unit": r.unit, "p95": r.p95, "peers": dict(r.peers), "error": r.error}
        for r in results
    ]
    return json.dumps({"results": rows}, indent=2) + "\n"


def main(arguments: list[str]) -> int:
    """Run the named benchmarks, or all; return 1 where one could not run or is wrong, 2 where there is none to run."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="names, or parts of names, of benchmarks")
    parser.add_argument("--full", action="store_true", help="also time against error, knob by knob, with diagrams")
    parser.add_argument("--out", type=Path, default=Path("bench_out"), metavar="DIR", help="of --full (bench_out/)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file")
    options = parser.parse_args(arguments)
    results = load()
    wanted = [b for b in REGISTRY.values() if not options.names or any(n in b.name for n in options.names)]
    if not wanted and not results:
        print(f"no such benchmark; there are: {', '.join(REGISTRY) or 'none'}", file=sys.stderr)
        return 2
    for entry in wanted:
        started = time.perf_counter()
        results.append(run(entry))
        print(f"{entry.name}: {time.perf_counter() - started:.1f} s", file=sys.stderr, flush=True)
    print(f"Python {platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} processors")
    print(table(results))
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        partial = options.json.with_name(options.json.name + ".part")
        partial.write_text(as_json(results), encoding="utf-8", newline="\n")
        os.replace(partial, options.json)
    if options.full:
        importlib.import_module(f"{__package__}.work_precision.__main__").main(["--out", str(options.out)])
    return 1 if any(r.value is None or r.error for r in results) else 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # with Blender loaded, the ordinary end of the interpreter may hang
