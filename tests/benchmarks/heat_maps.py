"""Draw what an edge and a coin's rim do in the skin: the reference, contact on points and at nodes side by side.

`python -m tests.benchmarks.heat_maps --out presets/pictures` writes contact_on_edges.png there, in about a minute: the
von Mises stress 0.7 mm under the skin of the standard finger, frictionless, 1 mm deep.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.files import write_bytes
from core.plot.canvas import PngCanvas
from core.surface.gap import Surface

from . import one_blas_thread
from .bench_shapes import felt_at, stress_at
from .references.cases import FAMILIES, Family, below_skin, first_contact
from .references.hexahedra import Grading
from .references.making import Meshed
from .references.shapes import MM, ROUNDING, Edge, Shape

Array = NDArray[np.float64]

DEPTH, BELOW = 1.0, 0.7  # of the press, of what is drawn [mm]
SCALE_OF_MESH = 2.0**0.5  # of the reference's, over its family's
WIDE, LONG, STEP = 4.0, 6.5, 0.125  # half of what is drawn across and along the finger, and a pixel of it [mm]
SCALE, GAP, TITLE = 26.0, 12.0, 20.0  # of the picture: points a millimetre, between the maps, of a line of text
INFERNO = np.array(
    [[0, 0, 4], [66, 10, 104], [147, 38, 103], [221, 81, 58], [252, 165, 10], [252, 255, 164]]
)  # inferno


@dataclass(frozen=True)
class Coin:
    """A coin on edge across the finger's width: its axis runs along X, its rim is the top. Lengths in mm."""

    radius: float = 12.0
    half: float = 1.0  # of its thickness

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients."""
        y, z = points[:, 1], points[:, 2] + self.radius
        far = np.maximum(np.hypot(y, z), 1e-9)
        side = np.where(points[:, 0] < 0.0, -1.0, 1.0)
        across, up = np.abs(points[:, 0]) - (self.half - ROUNDING), far - (self.radius - ROUNDING)
        corner, top = (across > 0.0) & (up > 0.0), up >= across
        reach = np.where(corner, np.hypot(across, up), 1.0)
        nx = np.where(corner, across / reach, np.where(top, 0.0, 1.0))
        nr = np.where(corner, up / reach, np.where(top, 1.0, 0.0))
        return nx * across + nr * up - ROUNDING, np.stack([side * nx, nr * y / far, nr * z / far], axis=1)

    def surface(self) -> Surface:
        """Return a body of revolution of 360 steps."""
        turn = np.linspace(0.0, np.pi / 2, 16)
        x, r = self.half - ROUNDING * (1.0 - np.cos(turn)), self.radius - ROUNDING * (1.0 - np.sin(turn))
        x, r = np.concatenate([[self.half], x, -x[::-1], [-self.half]]), np.concatenate([[1.0], r, r[::-1], [1.0]])
        count, steps = len(x), 360
        around = 2.0 * np.pi * np.arange(steps) / steps
        rings = np.stack(
            [np.tile(x, (steps, 1)), np.outer(np.sin(around), r), np.outer(np.cos(around), r) - self.radius], axis=2
        )
        j, k = (a.ravel() for a in np.meshgrid(np.arange(count), np.arange(steps)))
        here, beside = k * count + j, k * count + (j + 1) % count  # the hole in the middle closes it
        ahead, across = (here + count) % (count * steps), (beside + count) % (count * steps)
        quads = np.stack([here, ahead, across, beside], axis=1)
        return Surface.build(rings.reshape(-1, 3) * MM, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def shapes() -> tuple[tuple[str, Shape, Family], ...]:
    """Return what is pressed in, and the mesh of its reference."""
    family = FAMILIES["edge 0"]
    edge, coin = Edge(90.0), Coin()
    across = replace(family.gradings.across, places=(-0.9, 0.9))
    gradings = replace(family.gradings, across=across, along=Grading(0.3, 4.0))
    rim = replace(family, name="coin", shapes=(("coin", coin),), depths=(DEPTH,), gradings=gradings, reach=0.02)
    return (
        ("edge of 90 degrees", edge, replace(family, shapes=(("edge", edge),), depths=(DEPTH,))),
        ("rim of a coin", coin, rim),
    )


def maps(shape: Shape, family: Family, probes: Array) -> dict[str, tuple[float, Array]]:
    """Return the force [N] and the von Mises stress [Pa] at points [mm], shape (n,): of the reference and of both."""
    (exact,) = Meshed(family, SCALE_OF_MESH).cases(shape, probes)
    found = {"reference": (float(exact.force[2]), exact.stress)}
    for contact in ("points", "nodes"):
        (felt,) = felt_at(shape.surface(), MM * first_contact(shape, 0.0), (MM * DEPTH,), 0.0, contact)
        found[contact] = float(felt.resultant[2]), stress_at(felt, MM * probes)
    return {name: (force, _von_mises(stress)) for name, (force, stress) in found.items()}


def draw() -> bytes:
    """Return the picture: a row for each shape, a column for each way."""
    x, y = np.arange(-WIDE, WIDE + 1e-9, STEP), np.arange(-LONG, LONG + 1e-9, STEP)
    probes = below_skin(*(a.ravel() for a in np.meshgrid(x, y, indexing="ij")), BELOW)
    wide, high = SCALE * 2.0 * WIDE, SCALE * 2.0 * LONG
    rows = shapes()
    size = 3 * wide + 4 * GAP, len(rows) * (high + 3.0 * TITLE)
    canvas = PngCanvas(*size, scale=1.0)
    canvas.rectangle(0.0, 0.0, *size, "#ffffff")
    for row, (title, shape, family) in enumerate(rows):
        found = maps(shape, family, probes)
        canvas.text(GAP, row * (high + 3.0 * TITLE) + TITLE, title, 11.0, "#202020")
        largest = float(np.percentile(found["reference"][1], 99.8))
        for column, (name, (force, stress)) in enumerate(found.items()):
            off = np.linalg.norm(stress - found["reference"][1]) / np.linalg.norm(found["reference"][1])
            told = f"{name}: {force:.2f} N" + (f", stress {off:.0%} off" if column else "")
            print(f"{title}, {told}", flush=True)
            left, top = GAP + column * (wide + GAP), row * (high + 3.0 * TITLE) + 2.2 * TITLE
            canvas.text(left, top - 6.0, told, 9.0, "#202020")
            shares = np.clip(stress.reshape(len(x), len(y)) / largest, 0.0, 1.0)
            for i, j in np.ndindex(shares.shape):
                place = left + i * wide / len(x), top + (len(y) - 1 - j) * high / len(y)
                canvas.rectangle(*place, wide / len(x) + 0.6, high / len(y) + 0.6, _colour(shares[i, j]))
    return canvas.to_bytes()


def _von_mises(stress: Array) -> Array:
    xx, yy, zz, yz, xz, xy = stress.T
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.asarray(np.sqrt(0.5 * apart + 3.0 * (yz**2 + xz**2 + xy**2)))


def _colour(share: float) -> str:
    at = share * (len(INFERNO) - 1)
    red, green, blue = (np.interp(at, np.arange(len(INFERNO)), INFERNO[:, k]) for k in range(3))
    return f"#{round(red):02x}{round(green):02x}{round(blue):02x}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    with one_blas_thread():
        write_bytes(parser.parse_args(arguments).out / "contact_on_edges.png", draw())


if __name__ == "__main__":
    main()
