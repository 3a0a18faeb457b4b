"""What thimbles can make felt on the standard skins: `python -m tests.description_tables [skin preset ...]`.

It writes the files that ship: for each skin preset, draft and standard, pressed on its smooth skin and on its nodes.
Each takes some five seconds; all of them three minutes. They have to be made anew after every change of the sources
that `sources` names, since the engine refuses descriptions that other sources computed.
"""

from __future__ import annotations

import ast
import sys
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from core.matching.description import CORE, SHIPPED, describe, shipped_name, shipped_of, write_shipped
from core.matching.thimble_use import disc_device
from core.presets import Library
from core.skin.model import skin_from_parameters

DEVICES, LEVELS = ("thimble_3rrs",), ("draft", "standard")
ROOTS = ("surrogate/dataset.py", "surrogate/learned.py", "surrogate/press_points.py")
# What decides no number: the ground (errors, files, arrays), rows of settings, whose values are in the key, and what
# measures surfaces of triangles: a disc is a plane.
GROUND = ("parameters", "surface", "scene")
PLANE = ("surface", "plane.py")


@cache
def sources() -> tuple[str, ...]:
    """Return the files that compute a description: what the movements, the stress and the skin import, and so on."""
    found: set[Path] = set()
    pending = [CORE / name for name in ROOTS]
    while pending:
        path = pending.pop()
        if path not in found:
            found.add(path)
            pending += imported(path)
    found.add(CORE / "matching" / "description.py")
    if CORE / "kernels" / "library.py" in found:
        found.update(path for end in ("*.c", "*.h") for path in (CORE / "kernels").glob(end))
    return tuple(sorted(path.relative_to(CORE).as_posix() for path in found))


def imported(path: Path) -> list[Path]:
    """Return the engine's files that a file imports where it computes: those for checkers of types are left out."""
    return [file for node in _running(ast.parse(path.read_bytes())) for file in _files(path, node) if _counts(file)]


def _running(tree: ast.AST) -> Iterator[ast.ImportFrom]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.ImportFrom) and node.level:
            yield node
        yield from _running(node)


def _files(path: Path, node: ast.ImportFrom) -> Iterator[Path]:
    folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
    for place in (folder, *(folder / alias.name for alias in node.names)):
        yield from (file for file in (place.with_suffix(".py"), place / "__init__.py") if file.is_file())


def _counts(path: Path) -> bool:
    parts = path.relative_to(CORE).parts
    return parts == PLANE or (len(parts) > 1 and parts[0] not in GROUND)


def cases(presets: list[str]) -> Iterator[tuple[str, Any, Any, float]]:
    """Yield each case that ships: its name, device, skin and friction."""
    library = Library()
    for key in presets or [entry.key for entry in library.list("skins")]:
        for level in LEVELS:
            skin = skin_from_parameters(library.skin(key), level=level)
            for pressed in (skin, skin.on_nodes):
                for name in DEVICES:
                    device, friction = disc_device(library.device(name), pressed, {})
                    on = "nodes" if pressed.shape is None else "points"
                    yield f"{name} on {key}, {level}, {on}", device, pressed, friction


def main(presets: list[str]) -> None:
    """Write what is not there yet or was computed by other sources; without names, remove what nobody reads."""
    wanted = set()
    for name, device, skin, friction in cases(presets):
        path = SHIPPED / shipped_name(device, skin, friction)
        wanted.add(path)
        if shipped_of(device, skin, friction) is None:
            start = time.perf_counter()
            matrix = describe(device, skin, friction).observation_matrix
            write_shipped(path, device, skin, friction, matrix, sources())
            size, seconds = path.stat().st_size / 1e3, time.perf_counter() - start
            print(f"{name}: {path.name}, {len(matrix)} components, {size:.0f} kB, {seconds:.0f} s", flush=True)
    for path in () if presets else SHIPPED.glob("description_*.npz"):
        if path not in wanted:
            path.unlink()
            print(f"removed {path.name}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
