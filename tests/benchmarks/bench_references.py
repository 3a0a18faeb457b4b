"""How right the references are that contact is judged by: their own errors, by their own convergence.

The rule is in `references/results.py`; `python -m tests.benchmarks.references` makes them anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from core.arrays import Array

from . import Result, benchmark, one_blas_thread
from .references.results import OWN_FORCE, OWN_STRESS, is_judged, load

if TYPE_CHECKING:
    from .references.cases import Family


@benchmark("reference_own_force", limit=OWN_FORCE, quick=True)
def own_force() -> Result:
    """The worst error of a reference's own force, of the cases that are judged by."""
    return _worst("reference_own_force", lambda case: case["error"]["force"])


@benchmark("reference_own_stress", limit=OWN_STRESS, quick=True)
def own_stress() -> Result:
    """The worst error of a reference's own stress 1.2 mm deep, of the cases that are judged by."""
    from .references.cases import JUDGED_AT

    return _worst("reference_own_stress", lambda case: case["error"]["stress"][JUDGED_AT])


def _worst(name: str, figure: Callable[[Mapping[str, Any]], float]) -> Result:
    """Return the worst of the judged cases; beside it every other case with its own error, and families not made.

    It is a failure where a shape is judged at no depth.
    """
    from .references.cases import FAMILIES

    cases = load()["cases"]
    judged = {title: figure(case) for title, case in cases.items() if is_judged(case)}
    rest = {title: figure(case) for title, case in cases.items() if title not in judged}
    worst = max(judged, key=lambda title: judged[title], default=None)
    made = {case["family"] for case in cases.values()}
    shapes = {shape for name in made for shape, _ in FAMILIES[name].shapes}
    lost = sorted(shapes - {title.partition(",")[0] for title in judged})
    error = f"judged at no depth: {', '.join(lost)}" if lost else None
    if worst is None:
        return Result(name, None, "1", error=error)
    peers = {f"{worst}, the worst of {len(judged)}": judged[worst]}
    peers.update({f"not judged by: {title}": own for title, own in rest.items()})
    left = [family for family in FAMILIES if family not in made]
    if left:
        peers[f"families not made: {', '.join(left)}"] = float(len(left))
    return Result(name, judged[worst], "1", None, peers, error)


@benchmark("reference_softer_difference")
def softer_difference() -> Result:
    """Neo-Hookean tissue by another discretisation: tetrahedra of averaged pressure, contact at the nodes of triangles.

    It is the exact answer of the product's standard mesh, on a ball of 5 mm: how far that is from the reference in the
    force and in the stress 1.2 mm deep, the worst of the depths. Errors of `nl_*` rows come on top of it.
    """
    from .references.cases import FAMILIES, JUDGED_AT
    from .references.results import difference

    family, cases = FAMILIES["neo-Hookean ball 5"], load()["cases"]
    titles = [title for *_, title in family.cases()]
    force, stress = [], []
    with one_blas_thread():
        for title, (pushed, felt) in zip(titles, _by_tetrahedra(family, cases[titles[0]]["place"]), strict=True):
            force.append(abs(pushed / cases[title]["force"][2] - 1.0))
            stress.append(difference(felt, cases[title]["stress"], len(family.probe_depths))[JUDGED_AT])
            print(f"{title}: {pushed:.4f} N, {force[-1]:.1%} off, stress {stress[-1]:.1%}", flush=True)
    return Result("reference_softer_difference", max(stress), "1", None, {"of the force": max(force)})


def _by_tetrahedra(family: Family, place: Sequence[float]) -> Iterator[tuple[float, Array]]:
    """Yield the force [N] and the stress at the probes [Pa] at each depth; `place` is the first depth's [mm]."""
    from core.contact.solver.bodies import ContactBody
    from core.skin.model import fingertip_skin
    from tests.exact.exact_finger import ExactFinger
    from tests.tissue import probes_at

    skin = fingertip_skin(level="standard")
    finger, surface, before = ExactFinger(skin), family.shapes[0][1].surface(), None
    probes = probes_at(skin.mesh, 1e-3 * family.probes)
    start = np.array(place) - [0.0, 0.0, family.depths[0]]
    for number in range(1, round(family.depths[-1] / family.step) + 1):
        depth = number * family.step
        bodies = [ContactBody(surface, translation=1e-3 * (start + [0.0, 0.0, depth]), friction=family.friction)]
        held, before = finger.step(bodies, before), bodies
        if np.isclose(depth, family.depths).any():
            yield float(held.force[:, 2].sum()), probes.read(finger.stress(held.displacement))


@benchmark("reference_slid_apart", limit=0.01)
def slid_apart() -> Result:
    """A frictionless slide against a press in the same place, in plane strain: is there one answer, and from when on?

    An edge of 90 degrees with cells of a tenth of its rounding; beside it wider cells, a plate, and friction.
    """
    from .references.shapes import Edge, Plate
    from .references.slab import slid_apart as study

    edge, plate, peers = Edge(90.0), Plate(2.0, 0.1), {}
    for cells in (0.08, 0.04, 0.02):
        slid, pressed, apart = study(edge, (0.2,), cells, 0.6, 0.0)
        peers[f"edge 90, cells of {cells:g} mm"] = value = float(apart.max())
        print(f"edge 90, {cells:g} mm: slid {slid.round(4).tolist()}, pressed {pressed.round(4).tolist()}", flush=True)
    for friction in (0.0, 0.3):
        for cells in (0.04, 0.02):
            slid, pressed, apart = study(plate, (-1.0, 1.0), cells, 0.4, friction)
            peers[f"plate 2 mm, friction {friction:g}, cells of {cells:g} mm: apart"] = float(apart.max())
            peers[f"plate 2 mm, friction {friction:g}, cells of {cells:g} mm [N/mm]"] = float(pressed[0, 2])
    return Result("reference_slid_apart", value, "1", None, peers)
