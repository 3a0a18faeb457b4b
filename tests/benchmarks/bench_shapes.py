"""How right contact is on every shape: the product's standard skin against references that resolve what it touches.

Plane, balls, edges and ribs are pressed into the pad without friction, as a scene presses them: triangles that rise by
0.05 mm a sample. The references (`references/`, kept in `references/shapes.json`) touch the exact shapes with meshes
graded towards them; each figure's own error stands beside it. Force errors are of the force along Z, against what ever
finer meshes go to; stress errors are relative L2 over 42 points at a depth against the finest, shear counted twice. A
card is judged by a block with the same top, an edge moved sideways by itself.

What fingers use that do not say is held against the limits, the other contact is its peer. Stress is read as the
product reads it: beneath points in closed form, at nodes from the elements. `python -m tests.benchmarks.bench_shapes`
prints every shape's worst as a table.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from core.arrays import Array
from core.parameters.skin import CONTACT

from . import Result, benchmark, one_blas_thread

if TYPE_CHECKING:
    from core.skin.model import SkinModel
    from core.skin.stimulus import Stimulus
    from core.surface.gap import Surface

STEP, BEFORE, RATE = 0.05e-3, 4, 240.0  # of a press: a sample's way [m], samples before first contact, samples a second
CARD_DEPTHS, CARDS, FRICTION = (0.5e-3, 1e-3, 1.5e-3, 2e-3), (3e-3, 2e-3, 1e-3, 0.1e-3), 0.6
RIPPLE = np.linspace(-1.5, 1.5, 13)  # places of an edge across the pad [mm]
CONTACTS = (CONTACT, "points" if CONTACT == "nodes" else "nodes")  # what is judged, and its peer


class Judged(NamedTuple):
    """A case's errors, and its reference's own, relative: of the force, and of stress 0.3, 1.2 and 2 mm deep."""

    name: str
    force: float
    error: float
    stress: list[float]
    own_force: float
    own_stress: list[float]

    def __str__(self) -> str:
        stress = ", ".join(f"{e:5.1%} (+-{o:.1%})" for e, o in zip(self.stress, self.own_stress, strict=True))
        return f"{self.name:38} {self.force:8.4f} N {self.error:+7.1%} (+-{self.own_force:.1%})  stress {stress}"


@benchmark("shape_force_error", limit=0.08, quick=True)
def shape_force_error() -> Result:
    """The worst force on any shape."""
    return _worst("shape_force_error", lambda case: (abs(case.error), case.own_force))


@benchmark("shape_stress_error", limit=0.15, quick=True)
def shape_stress_error() -> Result:
    """The worst stress 1.2 mm under the skin."""
    return _worst("shape_stress_error", lambda case: (case.stress[1], case.own_stress[1]))


@benchmark("shape_stress_error_shallow", limit=0.25, quick=True)
def shape_stress_error_shallow() -> Result:
    """The worst stress 0.3 mm under the skin, on planes and balls."""
    return _worst("shape_stress_error_shallow", lambda case: (case.stress[0], case.own_stress[0]), ("plane", "ball"))


@benchmark("shape_stress_error_shallow_edge", limit=0.40, quick=True)
def shape_stress_error_shallow_edge() -> Result:
    """The worst stress 0.3 mm under the skin, on edges and ribs."""
    return _worst(
        "shape_stress_error_shallow_edge", lambda case: (case.stress[0], case.own_stress[0]), ("edge", "ribs")
    )


@benchmark("thin_card_force_error", limit=0.01, quick=True)
def thin_card_force_error() -> Result:
    """Closed cards down to 0.1 mm against a block with the same top, with friction, 0.5 to 2 mm deep."""
    from core.surface.gap import Surface

    def forces(thickness: float, contact: str) -> Array:
        card = Surface.block(0.02, 0.02, thickness)
        return np.array([s.resultant[2] for s in felt_at(card, np.zeros(3), CARD_DEPTHS, FRICTION, contact)])

    def errors(contact: str) -> dict[str, float]:
        block = forces(0.02, contact)
        return {f"{1e3 * t:g} mm": float(np.abs(forces(t, contact) / block - 1.0).max()) for t in CARDS}

    with one_blas_thread():
        own, other = (errors(contact) for contact in CONTACTS)
    peers = {**own, f"on {CONTACTS[1]}": max(other.values())}
    return Result("thin_card_force_error", max(own.values()), "1", None, peers)


@benchmark("edge_shift_ripple", limit=0.10)
def edge_shift_ripple() -> Result:
    """Force on an edge of 90 degrees 1 mm deep while it moves across the pad: peak to peak over mean."""
    from .references.cases import first_contact
    from .references.shapes import Edge

    edge = Edge(90.0)
    surface = edge.surface()
    places = [1e-3 * first_contact(edge, float(x)) for x in RIPPLE]
    with one_blas_thread():
        own, other = (
            np.array([felt_at(surface, place, (1e-3,), 0.0, contact)[0].resultant[2] for place in places])
            for contact in CONTACTS
        )
    value, peer = (float(np.ptp(force) / force.mean()) for force in (own, other))
    peers = {f"on {CONTACTS[1]}": peer, "least [N]": float(own.min()), "most [N]": float(own.max())}
    return Result("edge_shift_ripple", value, "1", None, peers)


def by_shape(contact: str) -> str:
    """Return how right a contact is on each shape as lines of Markdown: the worst of its depths and places.

    Args:
        contact: 'points' or 'nodes'.
    """
    shapes: dict[str, list[Judged]] = {}
    for case in _judged(contact):
        shapes.setdefault(re.split(" at |,", case.name)[0], []).append(case)
    lines = [
        "| shape | force | stress 1.2 mm deep | stress 0.3 mm deep | the reference's own |",
        "|---|---|---|---|---|",
    ]
    for name, cases in shapes.items():
        force = max((case.error for case in cases), key=abs)
        deep, shallow = (max(case.stress[k] for case in cases) for k in (1, 0))
        owns = [max(own) for own in zip(*((c.own_force, c.own_stress[1], c.own_stress[0]) for c in cases), strict=True)]
        own = " / ".join(f"{error:.0%}" for error in owns)
        lines.append(f"| {name} | {force:+.1%} | {deep:.0%} | {shallow:.0%} | {own} |")
    return "\n".join(lines)


def _worst(name: str, figure: Callable[[Judged], tuple[float, float]], kinds: tuple[str, ...] = ("",)) -> Result:
    worst, other = (
        max((case for case in _judged(contact) if case.name.startswith(kinds)), key=lambda case: figure(case)[0])
        for contact in CONTACTS
    )
    value, own = figure(worst)
    peers = {worst.name: value, "its reference's own": own, f"on {CONTACTS[1]}, {other.name}": figure(other)[0]}
    return Result(name, value, "1", None, peers)


@functools.cache
def _judged(contact: str) -> list[Judged]:
    """Return every case that has a reference, and print a line each."""
    from .references.cases import FAMILIES, PROBE_DEPTHS
    from .references.results import difference, load

    known = load()["cases"]
    out = []
    with one_blas_thread():
        for family in FAMILIES.values():
            for shape, depth, title in family.cases():
                if "error" not in known.get(title, {}):
                    continue
                exact = known[title]
                origin = 1e-3 * (np.array(exact["place"]) - [0.0, 0.0, depth])
                [felt] = felt_at(shape.surface(), origin, (1e-3 * depth,), 0.0, contact)
                stress = difference(stress_at(felt, 1e-3 * family.probes), exact["stress"], len(PROBE_DEPTHS))
                own, pushed = exact["error"], float(felt.resultant[2])
                # ever finer meshes fall towards it; their own error is how far the finest is from there
                wrong = pushed / float(np.atleast_1d(exact.get("limit", exact["force"]))[-1]) - 1.0
                out.append(Judged(title, pushed, wrong, stress, own["force"], own["stress"]))
                print(f"{contact:6} {out[-1]}", flush=True)
    return out


@functools.cache
def _skin() -> SkinModel:
    from core.skin.model import fingertip_skin

    return fingertip_skin(level="standard")


def stress_at(felt: Stimulus, points: Array) -> Array:
    """Return the product's stress [Pa] at points in the tissue [m], shape (k, 6)."""
    from core.skin.stress import locate, nodal_average

    if felt.points is not None:
        return felt.points.stress_below(points, felt.points.surface.chart.project(points)[1])
    mesh = felt.skin.mesh
    element, weights = locate(mesh, points)
    return np.asarray(np.einsum("kj,kjc->kc", weights, nodal_average(mesh, felt.stress)[mesh.tetrahedra[element]]))


def felt_at(surface: Surface, place: Array, depths: Sequence[float], friction: float, contact: str) -> list[Stimulus]:
    """Bake an object that rises along +Z to where it first meets the smooth skin, and on.

    Args:
        surface: of the object. place: its origin at first contact in the finger's frame [m]. depths: beyond it [m].
        contact: 'points' or 'nodes'.

    Returns:
        What is felt at each depth.
    """
    from core.contact.skin_sampler import SkinSampler
    from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

    parts = np.arange(-BEFORE, round(max(depths) / STEP) + 1)
    poses = np.tile(np.eye(4), (len(parts), 1, 1))
    poses[:, :3, 3] = place
    poses[:, 2, 3] += parts * STEP
    still, none = np.tile(np.eye(4), (1, len(parts), 1, 1)), np.zeros((0, len(parts), 4, 4))
    body = Body("shape", Mesh(surface.vertices, surface.triangles), {"friction": friction})
    finger = Finger("finger", (), {"contact": contact})
    scene = TactileScene("shapes", Fraction(24), (1, 1 + len(parts)), RATE, (finger,), (body,), (), ())
    sampler = SkinSampler(scene, {0: _skin()})
    sampler.add(Chunk(1.0 + parts, parts / RATE, still, poses[None], none, {}, {}))
    touch = sampler.finish()[0]
    return [touch.stimulus_at(BEFORE + round(depth / STEP)) for depth in depths]


if __name__ == "__main__":
    for one in CONTACTS:
        print(f"\nContact on {one}\n\n{by_shape(one)}\n", flush=True)
