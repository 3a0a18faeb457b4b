"""Run the quick benchmarks, those named, or with --full all of them and the diagrams; print the table, write JSON."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from core.files import write_bytes

from . import QUICK_SECONDS, REGISTRY, Benchmark, Result
from .work_precision.measured import Noise, machine

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
        late = entry is not None and entry.late(result)
        marks = f"{'  OVER THE LIMIT' if over else ''}{f'  P95 OVER {entry.tail:g} MEDIANS' if entry and late else ''}"
        lines.append(f"{result.name:34} {shown}  {peers}{marks}".rstrip())
        if result.error:
            lines.append(f"    {result.error}")
    return "\n".join(lines)


def number(value: float | None) -> str:
    """Return four significant digits, or a dash."""
    return "-" if value is None else f"{value:.4g}"


def times(peer: float, ours: float | None) -> str:
    """Return how many times our time a peer takes."""
    return f" ({peer / ours:.1f}x)" if ours else ""


def as_json(results: Sequence[Result], about: Mapping[str, Any]) -> str:
    """Return the results, and what they were measured on, as the JSON text that other tools read."""
    rows = [
        {"name": r.name, "value": r.value, "unit": r.unit, "p95": r.p95, "peers": dict(r.peers), "error": r.error}
        for r in results
    ]
    return json.dumps({**about, "results": rows}, indent=2) + "\n"


def chosen(names: Sequence[str], full: bool) -> list[Benchmark]:
    """Return the benchmarks whose names have one of some words in them; without any the quick ones, or all."""
    if names:
        return [b for b in REGISTRY.values() if any(word in b.name for word in names)]
    return [b for b in REGISTRY.values() if full or b.quick]


def spoken(about: Mapping[str, Any]) -> str:
    """Return machine, versions and noise in two lines."""
    made, noise = about["machine"], about["noise"]
    versions = ", ".join(f"{name} {number}" for name, number in made["versions"].items())
    lines = [
        f"{made['processor']}, {made['cores']} cores, {made['system']}; {versions}; BLAS {made['blas']}, one thread"
    ]
    loud = "" if noise["quiet"] else ": NOISY, compare ratios alone"
    lines.append(
        f"{about['seconds']:.0f} s; the same work took up to {noise['most_over_least']:.2f} times as long, "
        f"{noise['wall_over_processor']:.2f} times the processor's time{loud}"
    )
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Run the named benchmarks, or the quick ones, or all; 1 where one could not run or is wrong, 2 where none fits."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="names, or parts of names, of benchmarks (the quick ones)"
    )
    parser.add_argument("--full", action="store_true", help="all, and time against error, knob by knob, with diagrams")
    parser.add_argument("--out", type=Path, default=Path("bench_out"), metavar="DIR", help="of --full (bench_out/)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file")
    options = parser.parse_args(arguments)
    results = load()
    wanted = chosen(options.names, options.full)
    if not wanted and not results:
        print(f"no such benchmark; there are: {', '.join(REGISTRY) or 'none'}", file=sys.stderr)
        return 2
    began, noise = time.perf_counter(), Noise()
    for entry in wanted:
        started = time.perf_counter()
        results.append(run(entry))
        noise.look()
        print(f"{entry.name}: {time.perf_counter() - started:.1f} s", file=sys.stderr, flush=True)
    seconds = time.perf_counter() - began
    about = {"machine": machine(), "noise": noise.as_json(), "seconds": seconds}
    print(table(results))
    print(spoken(about))
    if not options.names and not options.full and seconds > QUICK_SECONDS:
        print(f"OVER THE LIMIT: the quick benchmarks are to take less than {QUICK_SECONDS:g} s")
    if options.json:
        write_bytes(options.json, as_json(results, about).encode())
    if options.full:
        importlib.import_module(f"{__package__}.work_precision.__main__").main(["--out", str(options.out)])
    return 1 if any(r.value is None or r.error for r in results) else 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # with Blender loaded, the ordinary end of the interpreter may hang
