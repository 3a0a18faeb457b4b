"""How right contact is on every shape: the product's standard skin against references that resolve what it touches.

Plane, balls, edges and ribs are pressed into the pad without friction, as a scene presses them: triangles that rise by
0.05 mm a sample. The references (`references/`, kept in `references/shapes.json`) touch the exact shapes with meshes
graded towards them; each figure's own error stands beside it. Force errors are of the force along Z, stress errors
relative L2 over 42 points at a depth, shear counted twice. A card is judged by a block with the same top, an edge moved
sideways by itself.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from . import Result, benchmark, one_blas_thread

STEP, BEFORE, RATE = 0.05e-3, 4, 240.0  # of a press: a sample's way [m], samples before first contact, samples a second
CARD_DEPTHS, CARDS, FRICTION = (0.5e-3, 1e-3, 1.5e-3, 2e-3), (3e-3, 2e-3, 1e-3, 0.1e-3), 0.6
RIPPLE = np.linspace(-1.5, 1.5, 13)  # places of an edge across the pad [mm]


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


@benchmark("shape_force_error", limit=0.08)
def shape_force_error() -> Result:
    """The worst force on any shape."""
    return _worst("shape_force_error", lambda case: (abs(case.error), case.own_force))


@benchmark("shape_stress_error", limit=0.15)
def shape_stress_error() -> Result:
    """The worst stress 1.2 mm under the skin."""
    return _worst("shape_stress_error", lambda case: (case.stress[1], case.own_stress[1]))


@benchmark("shape_stress_error_shallow", limit=0.25)
def shape_stress_error_shallow() -> Result:
    """The worst stress 0.3 mm under the skin, on planes and balls."""
    return _worst("shape_stress_error_shallow", lambda case: (case.stress[0], case.own_stress[0]), ("plane", "ball"))


@benchmark("shape_stress_error_shallow_edge", limit=0.40)
def shape_stress_error_shallow_edge() -> Result:
    """The worst stress 0.3 mm under the skin, on edges and ribs."""
    return _worst(
        "shape_stress_error_shallow_edge", lambda case: (case.stress[0], case.own_stress[0]), ("edge", "ribs")
    )


@benchmark("thin_card_force_error", limit=0.01)
def thin_card_force_error() -> Result:
    """Closed cards down to 0.1 mm against a block with the same top, with friction, 0.5 to 2 mm deep."""
    from core.surface.gap import Surface

    def forces(thickness: float) -> Any:
        return _pressed(Surface.block(0.02, 0.02, thickness), np.zeros(3), CARD_DEPTHS, FRICTION).sum(axis=1)[:, 2]

    with one_blas_thread():
        block = forces(0.02)
        errors = {f"{1e3 * t:g} mm": float(np.abs(forces(t) / block - 1.0).max()) for t in CARDS}
    return Result("thin_card_force_error", max(errors.values()), "1", None, errors)


@benchmark("edge_shift_ripple", limit=0.10)
def edge_shift_ripple() -> Result:
    """Force on an edge of 90 degrees 1 mm deep while it moves across the pad: peak to peak over mean."""
    from .references.cases import first_contact
    from .references.shapes import Edge

    edge = Edge(90.0)
    surface = edge.surface()
    with one_blas_thread():
        places = [1e-3 * first_contact(edge, float(x)) for x in RIPPLE]
        force = np.array([_pressed(surface, place, (1e-3,), 0.0).sum(axis=1)[0, 2] for place in places])
    peers = {"least [N]": float(force.min()), "most [N]": float(force.max())}
    return Result("edge_shift_ripple", float(np.ptp(force) / force.mean()), "1", None, peers)


def _worst(name: str, figure: Callable[[Judged], tuple[float, float]], kinds: tuple[str, ...] = ("",)) -> Result:
    cases = [case for case in _judged() if case.name.startswith(kinds)]
    worst = max(cases, key=lambda case: figure(case)[0])
    value, own = figure(worst)
    return Result(name, value, "1", None, {worst.name: value, "its reference's own": own})


@functools.cache
def _judged() -> list[Judged]:
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
                [force] = _pressed(shape.surface(), origin, (1e-3 * depth,), 0.0)
                stress = difference(_stress(force, 1e-3 * family.probes), exact["stress"], len(PROBE_DEPTHS))
                own, pushed = exact["error"], force[:, 2].sum()
                wrong = pushed / exact["force"][2] - 1.0
                out.append(Judged(title, pushed, wrong, stress, own["force"], own["stress"]))
                print(out[-1], flush=True)
    return out


@functools.cache
def _skin() -> Any:
    from core.skin.model import fingertip_skin

    return fingertip_skin(level="standard")


def _stress(force: Any, points: Any) -> Any:
    """Return the product's stress [Pa] at points in the tissue [m]."""
    from core.skin.stress import locate, nodal_average

    skin = _skin()
    element, weights = locate(skin.mesh, points)
    nodal = nodal_average(skin.mesh, skin.stress(force))
    return np.einsum("kj,kjc->kc", weights, nodal[skin.mesh.tetrahedra[element]])


def _pressed(surface: Any, place: Any, depths: Sequence[float], friction: float) -> Any:
    """Bake an object that rises along +Z to where it first meets the smooth skin, and on.

    Args:
        surface: of the object. place: its origin at first contact in the finger's frame [m]. depths: beyond it [m].

    Returns:
        Forces on the nodes of the skin at each depth [N], shape (len(depths), m, 3).
    """
    from core.contact.skin_sampler import SkinSampler
    from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

    parts = np.arange(-BEFORE, round(max(depths) / STEP) + 1)
    poses = np.tile(np.eye(4), (len(parts), 1, 1))
    poses[:, :3, 3] = place
    poses[:, 2, 3] += parts * STEP
    still, none = np.tile(np.eye(4), (1, len(parts), 1, 1)), np.zeros((0, len(parts), 4, 4))
    body = Body("shape", Mesh(surface.vertices, surface.triangles), {"friction": friction})
    finger = Finger("finger", (), {})
    scene = TactileScene("shapes", Fraction(24), (1, 1 + len(parts)), RATE, (finger,), (body,), (), ())
    sampler = SkinSampler(scene, {0: _skin()})
    sampler.add(Chunk(1.0 + parts, parts / RATE, still, poses[None], none, {}, {}))
    contact = sampler.finish()[0]
    return np.array([contact.force_at(BEFORE + round(depth / STEP)) for depth in depths], np.float64)
