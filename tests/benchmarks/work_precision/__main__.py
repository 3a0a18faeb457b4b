"""Measure, print tables, and save tables, JSON and diagrams: `python -m tests.benchmarks.work_precision --out DIR`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from core.files import write_bytes
from core.plot.canvas import PngCanvas, SvgCanvas

from . import diagram, matched, on_shapes, whole
from .measured import Noise, Panel, machine, panel_of

KEY = "Dashed: what each tissue is off a neo-Hookean finger at that depth. Grey: the reference's own error."
PICTURES = {  # of a picture: its diagrams, how many side by side, its title, and what it says
    "contact": ((*on_shapes.CASES, "card"), 3, "Contact, pressed 1 mm deep: time a frame against error", KEY),
    "matching": (
        ("pin solvers", "pin methods", "thimble"),
        3,
        "Matching: time a frame against error",
        "Solvers of the same problem; what methods leave; what a thimble's searches leave.",
    ),
    "scenes": (("scenes",), 1, "Whole scenes", "Dashed: the tissues' own error."),
    "work_precision": (
        ("plane", "ball 5 mm", "edge 90 degrees at 0 mm", "ribs", "pin solvers", "scenes"),
        3,
        "On points, contact is nearer than linear tissue's own error on every shape; "
        "at nodes the fine mesh is, if nothing is sharp or small",
        KEY,
    ),
}


def measured(parts: Sequence[str], noise: Noise) -> Iterator[Panel]:
    """Yield the diagrams of some parts, or of all: 'contact', 'matching', 'scenes'."""
    if not parts or "contact" in parts:
        for panel in on_shapes.panels():
            noise.look()
            yield panel
        yield on_shapes.card()
    if not parts or "matching" in parts:
        for make in (matched.pin_solvers, matched.pin_methods, matched.thimble):
            noise.look()
            yield make()
    if not parts or "scenes" in parts:
        noise.look()
        yield whole.scenes()
    noise.look()


def table(panels: Sequence[Panel]) -> str:
    """Return all points as lines of Markdown."""
    lines = ["| what | setting | ms a frame | p95 | error | algebraic | more |", "|---|---|---|---|---|---|---|"]
    for panel in panels:
        for p in panel.points:
            solved = "" if p.algebraic is None else f"{p.algebraic:.1e}"
            more = ", ".join(f"{name} {value:.3g}" for name, value in p.other.items())
            name = f"{p.curve}: {p.knob}" if p.knob != p.curve else p.curve
            chosen = " (default)" if p.default else ""
            lines.append(
                f"| {panel.name} | {name}{chosen} | {p.median:.3g} | {p.p95:.3g} | {p.error:.3g} | {solved} | {more} |"
            )
        bands = [f"{name} {value:.3g}" for name, value in panel.bands.items()]
        known = [f"the reference's own error {panel.own:.2g}"] if panel.own else []
        if bands or known:
            lines.append(f"| {panel.name} | | | | | | {'; '.join([*known, *bands])} |")
    return "\n".join(lines) + "\n"


def save(out: Path, panels: Sequence[Panel], noise: Noise, seconds: float) -> list[Path]:
    """Write tables, JSON and the pictures whose diagrams are all there; return the files."""
    text = table(panels)
    told = {"machine": machine(), "noise": noise.as_json(), "seconds": seconds}
    files = {"work_precision.md": text.encode()}
    whole_text = json.dumps({**told, "panels": [p.as_json() for p in panels]}, indent=1) + "\n"
    files["work_precision.json"] = whole_text.encode()
    known = {panel.name: panel for panel in panels}
    for name, (wanted, across, title, says) in PICTURES.items():
        have = [known[panel] for panel in wanted if panel in known]
        if len(have) < len(wanted):
            continue
        for suffix, kind in ((".png", PngCanvas), (".svg", SvgCanvas)):
            canvas = kind(*diagram.size(len(have), across))
            diagram.draw(canvas, have, title, says, across)
            files[name + suffix] = canvas.to_bytes()
    for file, content in files.items():
        write_bytes(out / file, content)
    return [out / file for file in files]


def main(arguments: list[str]) -> int:
    """Measure and save; 0."""
    parser = argparse.ArgumentParser(prog="work_precision", description=__doc__)
    parser.add_argument(
        "parts", nargs="*", choices=("contact", "matching", "scenes", []), help="all where none is named"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("bench_out"), metavar="DIR", help="where to write (bench_out/)"
    )
    options = parser.parse_args(arguments)
    started, noise, panels = time.perf_counter(), Noise(), list[Panel]()
    path = options.out / "work_precision.json"
    if options.parts and path.is_file():  # the others stay as they were measured
        panels += [panel_of(entry) for entry in json.loads(path.read_text(encoding="utf-8"))["panels"]]
    for panel in measured(options.parts, noise):
        panels = [p for p in panels if p.name != panel.name] + [panel]
        save(options.out, panels, noise, time.perf_counter() - started)
        print(f"{panel.name}: {time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
    print(table(panels))
    seen = noise.as_json()
    if not seen["quiet"]:
        print(f"NOISY: the same work took up to {seen['most_over_least']:.1f} times as long; compare ratios alone")
    for path in save(options.out, panels, noise, time.perf_counter() - started):
        print(path)
    return 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # with Blender loaded, the ordinary end of the interpreter may hang
