"""Measure, print tables, and save tables, JSON and diagrams: `python -m tests.benchmarks.work_precision --out DIR`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from core.files import write_bytes
from core.plot.canvas import PngCanvas, SvgCanvas

from . import diagram, matched, on_meshes, on_shapes, sliding, slopes, tissues, whole
from .measured import Noise, Panel, blas, machine, panel_of

KEY = "Dashed: what each tissue is off a neo-Hookean finger at that depth. Grey: the reference's own error."
NO_BLAS = "for one that has its own loops alone, build it: presets/ACCURACY.md, Time against error"
PICTURES = {  # of a picture: its diagrams, how many side by side, its title, and what it says
    "contact": ((*on_shapes.CASES, "card"), 3, "Contact, pressed 1 mm deep: time a frame against error", KEY),
    "meshes": (
        ("scan", "deforming"),
        2,
        "A ball of 5 mm, pressed 1 mm deep, by its mesh",
        "A scan's noise, and a shape of its own at each sample, cost time. Dashed: the tissues' own error.",
    ),
    "sliding": (
        tuple(f"{shape}, sliding" for shape in sliding.SHAPES),
        3,
        "Sliding with friction, 1 mm deep: time against error",
        "Too few samples a second cost more accuracy than any tolerance does. " + KEY,
    ),
    "tissues": (("tissues",), 1, "Models of tissue", "Each step to the right law costs time."),
    "matching": (
        ("pin solvers", "pin methods", "thimble", "thimble components", "gradient", "sampling"),
        3,
        "Matching: time against error",
        "Solvers of the same problem; what methods leave; what searches of a thimble leave; slopes of a relief.",
    ),
    "scenes": (("scenes",), 1, "Whole scenes", "Dashed: the tissues' own error."),
    "work_precision": (
        ("plane", "ball 5 mm", "edge 90 degrees at 0 mm", "ribs", "pin solvers", "scenes"),
        3,
        "On points, contact is nearer than linear tissue's own error on these shapes; "
        "at nodes the fine mesh is, if nothing is sharp or small",
        KEY,
    ),
}


def contact() -> Iterator[Panel]:
    """Yield what is pressed."""
    yield from on_shapes.panels()
    yield on_shapes.card()
    yield on_meshes.scanned()
    yield on_meshes.deforming()


def matching() -> Iterator[Panel]:
    """Yield what devices and screens do with a touch."""
    for make in (matched.pin_solvers, matched.pin_methods, matched.thimble, matched.thimble_components):
        yield make()
    yield slopes.of_maps()
    yield slopes.at_points()


def scenes() -> Iterator[Panel]:
    """Yield whole scenes."""
    yield whole.scenes()


def tissue() -> Iterator[Panel]:
    """Yield what models of tissue are off by."""
    yield tissues.models()


PARTS: dict[str, Callable[[], Iterator[Panel]]] = {
    "contact": contact,
    "sliding": sliding.panels,
    "tissues": tissue,
    "matching": matching,
    "scenes": scenes,
}


def measured(parts: Sequence[str], noise: Noise) -> Iterator[Panel]:
    """Yield the diagrams of some of `PARTS`, or of all."""
    for part in parts or PARTS:
        for panel in PARTS[part]():
            noise.look()
            yield panel


def table(panels: Sequence[Panel]) -> str:
    """Return all points as lines of Markdown."""
    lines = [
        "| what | setting | time [ms] | p95 | error | algebraic | discretisation | more |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for panel in panels:
        for p in panel.points:
            solved, method = ("" if part is None else f"{part:.2g}" for part in (p.algebraic, p.discretisation))
            more = ", ".join(f"{name} {value:.3g}" for name, value in p.other.items())
            name = f"{p.curve}: {p.knob}" if p.knob != p.curve else p.curve
            chosen = " (default)" if p.default else ""
            lines.append(
                f"| {panel.name} | {name}{chosen} | {p.median:.3g} | {p.p95:.3g} | {p.error:.3g} | {solved} | {method} "
                f"| {more} |"
            )
        bands = [f"{name} {value:.3g}" for name, value in panel.bands.items()]
        known = [f"the reference's own error {panel.own:.2g}"] if panel.own else []
        if bands or known:
            lines.append(f"| {panel.name} | {panel.each} | | | | | | {'; '.join([*known, *bands])} |")
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
    parser.add_argument("parts", nargs="*", choices=(*PARTS, []), help="all where none is named")
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
        print(
            f"NOISY: the same work took up to {seen['most_over_least']:.1f} times as long, and the wall "
            f"{seen['wall_over_processor']:.1f} times the processor's time; compare ratios alone"
        )
    print(f"numpy calls {blas()}" + ("" if blas() == "none" else f"; {NO_BLAS}"))
    for path in save(options.out, panels, noise, time.perf_counter() - started):
        print(path)
    return 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # with Blender loaded, the ordinary end of the interpreter may hang
