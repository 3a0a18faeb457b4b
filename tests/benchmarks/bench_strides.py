"""What solving contact only as far on as things move costs in accuracy: hands that press, drag, tap and turn at 240 Hz.

Every shape is met by a finger of standard skin with friction, on points, in four ways of a hand that eases in and out.
Judged is what a bake keeps of it, against the same with every sample solved: the force, relative to its largest, and
stress 1.2 mm under the skin. `python -m tests.benchmarks.bench_strides` prints a line for each.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from core.arrays import Array

from . import Result, benchmark, one_blas_thread
from .bench_shapes import stress_at
from .work_precision.on_shapes import CASES

if TYPE_CHECKING:
    from core.skin.model import SkinModel

RATE, DEPTH, FRICTION = 240.0, 1e-3, 0.6
LOOKED_AT = 5  # stress is judged in one of so many samples


class Met(NamedTuple):
    """A shape met in one way.

    Attributes:
        name: of both. apart: 95th percentile of the difference of the force, relative to the largest.
        stress: by how much it is apart, relative L2 over points and samples. between: share of samples not solved.
        times: of the contact of a bake, and of that with every sample solved [s].
    """

    name: str
    apart: float
    stress: float
    between: float
    times: tuple[float, float]

    def __str__(self) -> str:
        told = f"force {self.apart:6.2%}  stress {self.stress:6.2%}  between {self.between:4.0%}"
        return f"{self.name:32} {told}  {self.times[0]:.2f} s ({self.times[1]:.2f} s)"


@benchmark("stride_force_error", limit=0.01)
def stride_force_error() -> Result:
    """By how much force differs from that with every sample solved, 95th percentile, on the worst shape and way."""
    worst = {met.name: met.apart for met in all_met()}
    return Result("stride_force_error", max(worst.values()), "1", None, dict(_worst(worst)))


@benchmark("stride_stress_error", limit=0.01)
def stride_stress_error() -> Result:
    """The same of stress 1.2 mm under the skin, relative L2."""
    worst = {met.name: met.stress for met in all_met()}
    return Result("stride_stress_error", max(worst.values()), "1", None, dict(_worst(worst)))


@benchmark("stride_speedup")
def stride_speedup() -> Result:
    """Time of contact with every sample solved over that of a bake, over all shapes and ways."""
    once, every = (sum(met.times[k] for met in all_met()) for k in (0, 1))
    between = float(np.mean([met.between for met in all_met()]))
    return Result("stride_speedup", every / once, "1", None, {"share of samples not solved": between})


def ways() -> Iterator[tuple[str, Array]]:
    """Yield how an object goes from 0.2 mm under first contact on, by name: poses, shape (n, 4, 4)."""

    def eased(seconds: float) -> Array:
        t = np.linspace(0.0, 1.0, round(RATE * seconds) + 1)
        return np.asarray(t * t * (3.0 - 2.0 * t))

    rise = eased(0.3) * (DEPTH + 0.2e-3) - 0.2e-3
    stay, go = np.full(len(eased(0.4)), DEPTH), eased(0.4)
    taps = 0.4e-3 - 0.6e-3 * np.cos(2.0 * np.pi * 4.0 * np.arange(120) / RATE)
    none = np.zeros(len(go))
    for name, up, across, angle in (
        ("press", rise, np.zeros(len(rise)), np.zeros(len(rise))),
        ("drag", np.concatenate([rise, stay]), np.concatenate([0 * rise, 2e-3 * go]), np.zeros(len(rise) + len(go))),
        ("tap", taps, np.zeros(120), np.zeros(120)),
        (
            "turn",
            np.concatenate([rise, stay]),
            np.concatenate([0 * rise, none]),
            np.radians(np.append(0 * rise, 6 * go)),
        ),
    ):
        poses = np.tile(np.eye(4), (len(up), 1, 1))
        poses[:, 2, 3], poses[:, 0, 3] = up, across
        poses[:, 0, 0] = poses[:, 2, 2] = np.cos(angle)
        poses[:, 0, 2] = np.sin(angle)
        poses[:, 2, 0] = -poses[:, 0, 2]
        yield name, poses


@functools.cache
def all_met() -> list[Met]:
    """Return every shape in every way, and print a line each."""
    from .references.cases import FAMILIES
    from .references.results import load

    known, out = load()["cases"], []
    with one_blas_thread():
        for family in FAMILIES.values():
            for shape, depth, title in family.cases():
                name = title.partition(",")[0]
                if name not in CASES or depth != 1e3 * DEPTH or title not in known:
                    continue
                place = 1e-3 * (np.array(known[title]["place"]) - [0.0, 0.0, depth])
                for way, poses in ways():
                    out.append(_met(f"{name}, {way}", shape.surface(), place, poses, 1e-3 * family.probes))
                    print(out[-1], flush=True)
    return out


def _met(name: str, surface: Any, place: Array, poses: Array, probes: Array) -> Met:
    (once, quick), (every, slow) = (_felt(surface, place, poses, how) for how in ("way", "samples"))
    both, count = (once, every), len(poses)
    force = [np.array([touch.force_at(i).sum(axis=0) for i in range(count)]) for touch in both]
    apart = np.linalg.norm(force[0] - force[1], axis=1) / np.linalg.norm(force[1], axis=1).max()
    some = range(0, count, LOOKED_AT)
    stress = [np.array([stress_at(touch.stimulus_at(i), probes) for i in some]) for touch in both]
    off = float(np.linalg.norm(stress[0] - stress[1]) / np.linalg.norm(stress[1]))
    between = once.skipped.get("skin_frames_between", 0) / count
    return Met(name, float(np.percentile(apart, 95)), off, between, (quick, slow))


def _felt(surface: Any, place: Array, poses: Array, how: str) -> tuple[Any, float]:
    """Return what is felt, and how long its contact takes [s]."""
    from core.contact.skin_sampler import SkinSampler
    from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

    placed = poses.copy()
    placed[:, :3, 3] += place
    times, still = np.arange(len(poses)) / RATE, np.tile(np.eye(4), (1, len(poses), 1, 1))
    body = Body("shape", Mesh(surface.vertices, surface.triangles), {"friction": FRICTION})
    scene = TactileScene(
        "strides", Fraction(24), (1, 100), RATE, (Finger("finger", (), {"solved_at": how}),), (body,), (), ()
    )
    sampler = SkinSampler(scene, {0: _skin()})
    started = time.process_time()
    sampler.add(Chunk(1.0 + 24 * times, times, still, placed[None], still[:0], {}, {}))
    felt = sampler.finish()[0]
    return felt, time.process_time() - started


@functools.cache
def _skin() -> SkinModel:
    from core.skin.model import fingertip_skin

    return fingertip_skin(level="standard")


def _worst(values: dict[str, float]) -> list[tuple[str, float]]:
    return sorted(values.items(), key=lambda item: -item[1])[:3]


if __name__ == "__main__":
    all_met()
