"""The exact answers of the forty unseen touches, on the standard mesh: kept as a file, and made anew in half an hour.

`python -m tests.benchmarks.nonlinear_reference make` solves and writes them, `... bands` prints what each model of
tissue is off by, for `core/parameters/error_bands.py`.

The file keeps what frames that are compared need: forces and displacement of the pad as float32, and of the nodes
beneath it what differs from linear tissue under the same displacement of the pad, in steps of 1/8191 of each frame's
largest: stress is then good to 0.1 %.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path as File

import numpy as np
from numpy.typing import NDArray

from core.files import atomic
from core.skin.assembly import degrees
from core.skin.model import SkinModel, fingertip_skin
from tests.exact.exact_finger import ExactFinger
from tests.exact.neo_hookean import NeoHookean

from .nonlinear_paths import SEED, Path, paths

Array = NDArray[np.float64]

VERSION = 1
FILE = File(__file__).parent / "data" / "nonlinear_reference.npz"
LEVEL = "standard"
LARGEST = 8191.0  # step that the largest displacement of a frame is kept in


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of the truth.

    Attributes:
        path, number: which. force: on the pad [N], shape (m, 3). stress: of each element [Pa], shape (e, 6).
    """

    path: Path
    number: int
    force: Array
    stress: Array

    @property
    def depth(self) -> float:
        """How deep it is pressed [m]."""
        return self.path.way[self.number][0]

    @property
    def slide(self) -> float:
        """How far it has slid [m]."""
        return self.path.way[self.number][1]


class Beneath:
    """What is beneath the pad of a mesh while the pad is held, in linear tissue."""

    def __init__(self, skin: SkinModel) -> None:
        from scipy.sparse.linalg import splu

        mesh = skin.mesh
        self.pad, self.inner = degrees(mesh.pad), degrees(np.setdiff1d(mesh.free, mesh.pad))
        self.size = mesh.nodes.size
        stiff = NeoHookean(mesh, skin.material.poisson).tangent(np.zeros_like(mesh.nodes))
        self._factor = splu(stiff[self.inner][:, self.inner].tocsc())
        self._rows = stiff[self.inner][:, self.pad]

    def follow(self, pad: Array) -> Array:
        """Return the displacement of what is beneath for that of the pad [m], flat."""
        return -np.asarray(self._factor.solve(self._rows @ pad.reshape(-1)))

    def whole(self, pad: Array, beyond: Array) -> Array:
        """Return the displacement of all nodes [m], shape (n, 3)."""
        out = np.zeros(self.size)
        out[self.pad] = pad.reshape(-1)
        out[self.inner] = self.follow(pad) + beyond
        return out.reshape(-1, 3)


class Reference:
    """The truth of all paths.

    Raises:
        ValueError: the file is of another version, of other paths or of another mesh.
    """

    def __init__(self, file: File = FILE) -> None:
        self.skin = fingertip_skin(level=LEVEL)
        with np.load(file, allow_pickle=False) as archive:
            self._arrays = {name: archive[name] for name in archive.files}
        found = int(self._arrays["version"]), int(self._arrays["seed"]), len(self._arrays["nodes"])
        if found != (VERSION, SEED, len(self.skin.mesh.nodes)):
            raise ValueError(f"{file.name} is of another version, seed or mesh: {found}")
        if not np.allclose(self._arrays["nodes"], self.skin.mesh.nodes, atol=1e-7):
            raise ValueError(f"{file.name} is of another mesh")
        self.law = NeoHookean(self.skin.mesh, self.skin.material.poisson)

    @cached_property
    def beneath(self) -> Beneath:
        """Of its mesh."""
        return Beneath(self.skin)

    @cached_property
    def paths(self) -> list[Path]:
        """All paths, as far as they were solved."""
        return paths(lowest(self.skin))

    def frames(self, path: int) -> Iterator[Frame]:
        """Yield the kept frames of a path."""
        a = self._arrays
        for i in np.flatnonzero(a["path"] == path):
            beyond = a["beyond"][i].astype(float) * float(a["quantum"][i])
            moved = self.beneath.whole(a["pad"][i].astype(float), beyond)
            stress = self.skin.material.modulus * self.law.response(moved[None, None]).cauchy()[0, 0]
            yield Frame(self.paths[path], int(a["frame"][i]), a["force"][i].astype(float), stress)


def lowest(skin: SkinModel) -> Array:
    """Return the pad's lowest node [m], shape (3,)."""
    return np.asarray(skin.positions[skin.positions[:, 2].argmin()])


def make(file: File = FILE) -> None:
    """Solve all paths and write their frames."""
    skin = fingertip_skin(level=LEVEL)
    beneath, kept = Beneath(skin), Kept()
    for number, path in enumerate(paths(lowest(skin))):
        finger, before = ExactFinger(skin), None
        worst = 0.0
        for i, bodies in enumerate(path.frames(skin.positions)):
            held = finger.step(bodies, before)
            before = bodies
            worst = max(worst, finger.contact_residual(held))
            if i in path.shown:
                kept.add(number, i, held.displacement, held.force, beneath)
        print(f"{path.name}: worst residual {worst:.0e}", flush=True)
    kept.write(file, skin)


class Kept:
    """Frames on their way into a file."""

    def __init__(self) -> None:
        self._rows: list[dict[str, NDArray[np.generic]]] = []

    def add(self, path: int, frame: int, displacement: Array, force: Array, beneath: Beneath) -> None:
        """Keep a frame."""
        flat = displacement.reshape(-1)
        pad = flat[beneath.pad].astype(np.float32)
        beyond = flat[beneath.inner] - beneath.follow(pad.astype(float))
        quantum = np.float32(np.abs(beyond).max() / LARGEST)
        row = {"path": np.int16(path), "frame": np.int16(frame), "force": force.astype(np.float32)}
        steps = np.rint(beyond / float(quantum)).astype(np.int16)
        self._rows.append({**row, "pad": pad, "quantum": quantum, "beyond": steps})  # type: ignore[dict-item]

    def write(self, file: File, skin: SkinModel) -> None:
        """Write all of them."""
        arrays = {name: np.array([row[name] for row in self._rows]) for name in self._rows[0]}
        file.parent.mkdir(parents=True, exist_ok=True)
        about = {"version": np.array(VERSION), "seed": np.array(SEED), "nodes": skin.mesh.nodes.astype(np.float32)}
        with atomic(file) as part, open(part, "wb") as out:
            np.savez_compressed(out, **about, **arrays)


if __name__ == "__main__":
    if sys.argv[1:] == ["make"]:
        make()
    elif sys.argv[1:] == ["bands"]:
        from .nonlinear_errors import print_bands

        print_bands()
    else:
        sys.exit("say make or bands")
