"""How right contact is on every shape: the product's standard skin against references that resolve what it touches.

Shapes are pressed into the pad as a scene presses them: triangles that rise by 0.05 mm a sample, without friction but
on rims and on edges beside the middle. The references (`references/`, kept in `references/shapes.json`) touch the exact
shapes with meshes graded towards them; each figure's own error stands beside it. Force errors are of the force along Z,
stress errors are relative L2 over 42 points at a depth, shear counted twice.

Only cases whose reference's own error is within its limits are judged (`references.results.is_judged`), and stress
nearer the skin only where the reference is as good there; the others are printed, and counted beside each figure with
the largest of their own errors. A card is judged by a block with the same
top, an edge moved sideways by itself.

What fingers use that do not say is held against the limits, the other contact is its peer. Stress is read as the
product reads it: beneath points in closed form, at nodes from the elements. `python -m tests.benchmarks.bench_shapes`
prints every shape's worst as a table.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from core.arrays import Array
from core.parameters.error_bands import LINEAR
from core.parameters.skin import CONTACT

from . import Result, benchmark, one_blas_thread
from .references.results import OWN_STRESS

if TYPE_CHECKING:
    from core.skin.model import SkinModel
    from core.skin.stimulus import Stimulus
    from core.surface.gap import Surface

STEP, BEFORE, RATE = 0.05e-3, 4, 240.0  # of a press: a sample's way [m], samples before first contact, samples a second
CARD_DEPTHS, CARDS, FRICTION = (0.5e-3, 1e-3, 1.5e-3, 2e-3), (3e-3, 2e-3, 1e-3, 0.1e-3), 0.6
RIPPLE = np.linspace(-1.5, 1.5, 13)  # places of an edge across the pad [mm]
CONTACTS = (CONTACT, "points" if CONTACT == "nodes" else "nodes")  # what is judged, and its peer


SOFTER = ("neo-Hookean",)
SMOOTH = ("plane", "ball", "torus", "rod", "cone", "Braille")
SHARP = ("edge", "ribs", "coin", "punch", "pillar", "plate")


class Judged(NamedTuple):
    """A case's errors, and its reference's own, relative: of the force, and of stress by the family's depths.

    Attributes:
        counts: whether the reference is good enough to judge by.
    """

    name: str
    counts: bool
    force: float
    error: float
    stress: list[float]
    own_force: float
    own_stress: list[float]

    def __str__(self) -> str:
        stress = ", ".join(f"{e:5.1%} (+-{o:.1%})" for e, o in zip(self.stress, self.own_stress, strict=True))
        told = f"{self.name:38} {self.force:8.4f} N {self.error:+7.1%} (+-{self.own_force:.1%})  stress {stress}"
        return told if self.counts else f"{told}  not judged"


@benchmark("shape_force_error", limit=0.05, quick=True)
def shape_force_error() -> Result:
    """The worst force on any shape."""
    return _worst("shape_force_error", lambda case: (abs(case.error), case.own_force))


@benchmark("shape_stress_error", limit=0.10, quick=True)
def shape_stress_error() -> Result:
    """The worst stress 1.2 mm under the skin."""
    return _worst("shape_stress_error", lambda case: (case.stress[1], case.own_stress[1]))


@benchmark("shape_stress_error_shallow", limit=0.18, quick=True)
def shape_stress_error_shallow() -> Result:
    """The worst stress 0.3 mm under the skin, on smooth shapes."""
    return _worst("shape_stress_error_shallow", lambda case: (case.stress[0], case.own_stress[0]), SMOOTH)


@benchmark("shape_stress_error_shallow_edge", limit=0.40, quick=True)
def shape_stress_error_shallow_edge() -> Result:
    """The worst stress 0.3 mm under the skin, on edges, rims and ribs."""
    return _worst("shape_stress_error_shallow_edge", lambda case: (case.stress[0], case.own_stress[0]), SHARP)


@benchmark("shape_force_error_softer", limit=0.08)
def shape_force_error_softer() -> Result:
    """The worst force of neo-Hookean tissue: of its law, the mesh and contact together."""
    return _worst("shape_force_error_softer", lambda case: (abs(case.error), case.own_force), SOFTER)


@benchmark("shape_stress_error_softer", limit=0.15)
def shape_stress_error_softer() -> Result:
    """The worst stress 1.2 mm under the skin of neo-Hookean tissue, likewise."""
    return _worst("shape_stress_error_softer", lambda case: (case.stress[1], case.own_stress[1]), SOFTER)


@benchmark("nl_true_stress_error_2mm", limit=0.06)
def true_stress_error() -> Result:
    """Stress 1.6 mm below the skin, pressed 2 mm deep: what it is off beyond the reference's own error, at worst."""
    return _beyond("nl_true_stress_error_2mm", 1.6)


@benchmark("nl_true_stress_error_shallow", limit=0.12)
def true_stress_error_shallow() -> Result:
    """The same 0.3 mm below the skin."""
    return _beyond("nl_true_stress_error_shallow", 0.3)


def _beyond(name: str, depth: float) -> Result:
    """Return the worst error of neo-Hookean stress at a depth of the probes [mm], less its reference's own."""
    from .references.cases import SOFT_DEPTHS, SOFT_PROBES

    at = SOFT_PROBES.index(depth)
    deepest = [case for case in _judged(CONTACTS[0], SOFTER) if case.name.endswith(f", {SOFT_DEPTHS[-1]:g} mm deep")]
    beyond = {case.name: max(case.stress[at] - case.own_stress[at], 0.0) for case in deepest}
    peers = {**beyond, "references' own at worst": max(case.own_stress[at] for case in deepest)}
    return Result(name, max(beyond.values()), "1", None, peers)


@benchmark("thin_card_force_error", limit=0.005, quick=True)
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
    """Return how right a contact is on each shape as lines of Markdown: the worst of the depths that are judged.

    Args:
        contact: 'points' or 'nodes'.
    """
    shapes: dict[str, list[Judged]] = {}
    for case in _judged(contact, SMOOTH + SHARP + SOFTER):
        shapes.setdefault(case.name.partition(",")[0], []).append(case)
    lines = [
        "| shape | judged | force | stress 1.2 mm deep | stress 0.3 mm deep | the reference's own |",
        "|---|---|---|---|---|---|",
    ]
    for name, cases in shapes.items():
        judged = [case for case in cases if case.counts]
        told = f"| {name} | {len(judged)} of {len(cases)} | "
        if judged:
            force = max((case.error for case in judged), key=abs)
            shallow = [case.stress[0] for case in judged if case.own_stress[0] <= OWN_STRESS]
            told += f"{force:+.1%} | {max(case.stress[1] for case in judged):.0%} | "
            told += f"{max(shallow):.0%} | " if shallow else "- | "
        else:
            told += "- | - | - | "
        owns = [(case.own_force, case.own_stress[1], case.own_stress[0]) for case in judged or cases]
        lines.append(told + " / ".join(f"{max(own):.1%}" for own in zip(*owns, strict=True)) + " |")
    return "\n".join(lines)


def _worst(
    name: str, figure: Callable[[Judged], tuple[float, float]], kinds: tuple[str, ...] = SMOOTH + SHARP
) -> Result:
    """Return the worst case that is judged; beside it what is not judged, with the largest of their own errors."""
    own, other = (_judged(contact, kinds) for contact in CONTACTS)

    def counts(case: Judged) -> bool:
        return case.counts and figure(case)[1] <= OWN_STRESS

    judged = [case for case in own if counts(case)]
    if not judged:
        return Result(name, None, "1", error="no reference is good enough to judge by")
    worst = max(judged, key=lambda case: figure(case)[0])
    value, doubt = figure(worst)
    peers = {worst.name: value, "its reference's own": doubt}
    peer = max((case for case in other if counts(case)), key=lambda case: figure(case)[0])
    peers[f"on {CONTACTS[1]}, {peer.name}"] = figure(peer)[0]
    rest = [case for case in own if not counts(case)]
    if rest:
        unsure = max(rest, key=lambda case: figure(case)[1])
        peers[f"not judged: {len(rest)} of {len(own)}, the reference's own up to"] = figure(unsure)[1]
    return Result(name, value, "1", None, peers)


def _judged(contact: str, kinds: tuple[str, ...]) -> list[Judged]:
    """Return every case of some kinds of shape that has a reference."""
    from .references.cases import FAMILIES

    families = [f.name for f in FAMILIES.values() if any(name.startswith(kinds) for name, _ in f.shapes)]
    return [case for name in families for case in _of_family(contact, name) if case.name.startswith(kinds)]


@functools.cache
def _of_family(contact: str, name: str) -> list[Judged]:
    """Return every case of a family that has a reference, and print a line each."""
    from .references.cases import FAMILIES
    from .references.results import difference, is_judged, load

    known, family = load()["cases"], FAMILIES[name]
    out = []
    with one_blas_thread():
        for _, shape in family.shapes:
            titles = [title for own, _, title in family.cases() if own is shape]
            if any(title not in known for title in titles):
                continue
            origin = 1e-3 * (np.array(known[titles[0]]["place"]) - [0.0, 0.0, family.depths[0]])
            depths = tuple(1e-3 * depth for depth in family.depths)
            felts = felt_at(shape.surface(), origin, depths, family.friction, contact, family.tissue)
            for title, felt in zip(titles, felts, strict=True):
                exact = known[title]
                stress = difference(stress_at(felt, 1e-3 * family.probes), exact["stress"], len(family.probe_depths))
                own, pushed = exact["error"], float(felt.resultant[2])
                wrong = pushed / exact["force"][2] - 1.0
                out.append(Judged(title, is_judged(exact), pushed, wrong, stress, own["force"], own["stress"]))
                print(f"{contact:6} {out[-1]}", flush=True)
    return out


@functools.cache
def _skin(tissue: str) -> SkinModel:
    from core.skin.finger_skin import of_tissue
    from core.skin.model import fingertip_skin

    return of_tissue(fingertip_skin(level="standard"), tissue)


def stress_at(felt: Stimulus, points: Array) -> Array:
    """Return the product's stress [Pa] at points in the tissue [m], shape (k, 6)."""
    from core.skin.recovery import fitted
    from core.skin.stress import Probes

    deep = np.full(len(points), np.nan) if felt.points is None else felt.points.surface.chart.project(points)[1]
    return felt.stress_at(Probes(points, fitted(felt.skin.mesh, points), deep, np.full(len(points), -1)))


def felt_at(
    surface: Surface, place: Array, depths: Sequence[float], friction: float, contact: str, tissue: str = LINEAR
) -> list[Stimulus]:
    """Bake an object that rises along +Z to where it first meets the smooth skin, and on.

    Args:
        surface: of the object. place: its origin at first contact in the finger's frame [m]. depths: beyond it [m].
        contact: 'points' or 'nodes'. tissue: 'linear' or 'neo_hookean'.

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
    finger = Finger("finger", (), {"contact": contact, "tissue": tissue})
    scene = TactileScene("shapes", Fraction(24), (1, 1 + len(parts)), RATE, (finger,), (body,), (), ())
    sampler = SkinSampler(scene, {0: _skin(tissue)})
    sampler.add(Chunk(1.0 + parts, parts / RATE, still, poses[None], none, {}, {}))
    touch = sampler.finish()[0]
    return [touch.stimulus_at(BEFORE + round(depth / STEP)) for depth in depths]


if __name__ == "__main__":
    for one in CONTACTS:
        print(f"\nContact on {one}\n\n{by_shape(one)}\n", flush=True)
