"""Contact by shape: what presses 1 mm into the pad as a scene presses it, at nodes of finer meshes and on points.

Errors are of stress 1.2 mm under the skin, relative L2 over 42 points, against references graded to each shape; the
force's stands beside. A diagram says where its reference is not good enough to judge by. The algebraic part is the
distance from the same method solved to `TIGHT`. Cards are judged by a block with the same top. Frames count from first
contact on.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest import mock

import numpy as np

from core.arrays import Array
from core.parameters.error_bands import LINEAR, NEO_HOOKEAN, error_band

from .. import one_blas_thread, timing
from ..bench_shapes import BEFORE, RATE, STEP, stress_at
from .measured import Panel, Point, clocked

if TYPE_CHECKING:
    from core.scene.tactile_scene import Mesh
    from core.skin.assembly import Element
    from core.skin.model import SkinModel
    from core.skin.stimulus import Stimulus

DEPTH, TIGHT, RUNS = 1e-3, 1e-7, 2
CASES = (
    "plane",
    "ball 2 mm",
    "ball 5 mm",
    "ball 12 mm",
    "edge 120 degrees at 0 mm",
    "edge 90 degrees at 0 mm",
    "edge 60 degrees at 0 mm",
    "ribs",
)
ELSEWHERE = ("plane", "ball 5 mm")  # where other programs press too
CARD = 0.1e-3
SAMPLES = BEFORE + round(DEPTH / STEP) + 1  # of a press
PROBED = 1  # of the depths of the probes: 1.2 mm


class Setting(NamedTuple):
    """One way to solve contact."""

    curve: str
    knob: str
    contact: str
    level: str = "standard"
    tolerance: float | None = None
    coarser: float = 1.0
    default: bool = False
    element: Element = "anp"


def settings() -> list[Setting]:
    """Return all ways that are compared; those that people get are marked."""
    from core.contact.solver.path_solver import TOLERANCE

    levels = [Setting("nodes, by mesh", level, "nodes", level) for level in ("draft", "standard", "fine")]
    nodes = [
        Setting("nodes, by tolerance", f"{t:.0e}", "nodes", tolerance=t) for t in (100 * TOLERANCE, 10 * TOLERANCE)
    ]
    factors = (1000.0, 100.0, 10.0, 1.0)
    points = [
        Setting("points, by tolerance", f"{f * TOLERANCE:.0e}", "points", tolerance=f * TOLERANCE, default=f == 1.0)
        for f in factors
    ]
    spacing = [Setting("points, by spacing", f"{f:g}x", "points", coarser=f) for f in (4.0, 2.0, 0.5)]
    plain = [s._replace(curve="nodes, plain elements", element="p1") for s in levels]
    return [*levels, *plain, *nodes, *points, *spacing]


def panels(names: Sequence[str] = CASES) -> Iterator[Panel]:
    """Yield a diagram for each shape."""
    from ..references.cases import FAMILIES
    from ..references.results import difference, is_judged, load
    from .elsewhere import flex_points, skfem_points

    known = load()["cases"]
    bands = {tissue: error_band(tissue, DEPTH).stress.median for tissue in (LINEAR, NEO_HOOKEAN)}
    for family in FAMILIES.values():
        for shape, depth, title in family.cases():
            name = title.partition(",")[0]
            if name not in names or depth != 1e3 * DEPTH or title not in known:
                continue
            exact = known[title]
            place = 1e-3 * (np.array(exact["place"]) - [0.0, 0.0, depth])
            probes = 1e-3 * family.probes
            truth = np.asarray(exact["stress"])
            heading = name if is_judged(exact) else f"{name} (reported, not judged: see the reference's own error)"
            own = exact["error"]["stress"][PROBED]
            panel = Panel(name, heading, "error of stress 1.2 mm deep", own=own, bands=bands)
            for setting, felt, tight, times in felt_by(shape.surface(), place):
                stress = stress_at(felt, probes)
                exactly = stress_at(tight, probes)
                off, solved = (difference(stress, of, 3)[PROBED] for of in (truth, exactly))
                method = difference(exactly, truth, 3)[PROBED]
                force = abs(float(felt.resultant[2]) / exact["force"][2] - 1.0)
                panel.points.append(point(setting, times, off, solved, method, {"force": force}))
            if name in ELSEWHERE:
                panel.points += skfem_points(shape, place, probes, truth)
            if name == "plane":
                panel.points += flex_points(place, probes, truth)
            yield panel


def card() -> Panel:
    """Return the diagram of a thin card: its force against that of a block with the same top."""
    from core.surface.gap import Surface

    panel = Panel("card", f"card of {1e3 * CARD:g} mm", "error of force, against a block")
    solid = {setting: felt for setting, felt, _, _ in felt_by(Surface.block(0.02, 0.02, 0.02), np.zeros(3))}
    for setting, felt, tight, times in felt_by(Surface.block(0.02, 0.02, CARD), np.zeros(3)):
        block = solid[setting].resultant[2]
        push, tightly = float(felt.resultant[2]), float(tight.resultant[2])
        off, solved, method = abs(push / block - 1.0), abs(push / tightly - 1.0), abs(tightly / block - 1.0)
        panel.points.append(point(setting, times, off, solved, method))
    return panel


def point(
    setting: Setting,
    times: Sequence[float],
    off: float,
    solved: float,
    method: float,
    other: Mapping[str, float] | None = None,
) -> Point:
    """Return the point of a setting: its times [ms], its error, and the algebraic part and the method's own of it."""
    found = timing(list(times))
    told = setting.curve, setting.knob, found.median, found.p95, off, solved, setting.default, other or {}
    return Point(*told, discretisation=method)


def felt_by(surface: Any, place: Array) -> Iterator[tuple[Setting, Stimulus, Stimulus, list[float]]]:
    """Yield what is felt at the depth by each setting, the same solved tightly, and the times of frames [ms]."""
    tight: dict[tuple[str, str, str, float], Stimulus] = {}
    with one_blas_thread():
        for setting in settings():
            key = (setting.contact, setting.level, setting.element, setting.coarser)
            if key not in tight:
                tight[key] = pressed(surface, place, setting._replace(tolerance=TIGHT))[0]
            times: list[float] = []
            for _ in range(RUNS):
                felt, taken = pressed(surface, place, setting)
                times += taken
            yield setting, felt, tight[key], times


def pressed(surface: Any, place: Array, setting: Setting, shapes: Sequence[Mesh] = ()) -> tuple[Stimulus, list[float]]:
    """Press a surface from its first contact on, a sample at a time; return the end, and the times in contact [ms].

    Args:
        surface: of the object. place: its origin at first contact [m]. setting: how contact is solved.
        shapes: what it looks like at each sample, the last one at the end; it keeps its shape where there is none.
    """
    from core.contact.skin_sampler import SkinSampler
    from core.contact.solver import point_tree
    from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

    rigid = None if shapes else Mesh(surface.vertices, surface.triangles)
    body = Body("shape", rigid, {"friction": 0.0})
    finger = Finger("finger", (), {"contact": setting.contact, "solved_at": "samples"})
    scene = TactileScene("shapes", Fraction(24), (1, 100), RATE, (finger,), (body,), (), ())
    limits = {name: setting.coarser * getattr(point_tree, name) for name in ("TURNED", "BENT")}
    times = []
    with mock.patch.multiple(point_tree, **limits):
        sampler = SkinSampler(scene, {0: skin_of(setting.level, setting.element)}, tolerance=setting.tolerance)
        for part in range(-BEFORE, SAMPLES - BEFORE):
            pose = np.eye(4)[None, None].copy()
            pose[0, 0, :3, 3] = place + [0.0, 0.0, part * STEP]
            at = np.array([float(part)])
            own = {0: (shapes[part + BEFORE],)} if shapes else {}
            chunk = Chunk(at, at / RATE, np.eye(4)[None, None].copy(), pose, pose[:0], own)
            taken = clocked(lambda chunk=chunk: sampler.add(chunk))[1]  # type: ignore[misc]
            times += [taken] if part > 0 else []
        touch = sampler.finish()[0]
    return touch.stimulus_at(len(touch.times) - 1), times


@functools.cache
def skin_of(level: str, element: Element = "anp") -> SkinModel:
    """Return the standard finger at a level of accuracy, of averaged or plain elements."""
    from core.skin.model import fingertip_skin

    return fingertip_skin(level=level, element=element)
