"""Drawings of skins: deformed vertices, a value at each, the legend's text.

All of it is computed from the forces on a skin.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import loading
from .._core import Array, core
from ..preview.skin_state import SkinState
from .display_surface import DisplaySurface

COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")
SIGNED = frozenset(COMPONENTS)
NEAR = 2e-3  # [m] drawn vertices closer than this to a touched point show the stress below them, not one between nodes
SMALL = 250  # up to so many pad nodes, the whole map from forces to the drawn surface is kept: at most 10 MB


class Quantity(NamedTuple):
    """A quantity in colour: title, unit of the legend, and size of that unit in SI."""

    title: str
    unit: str
    factor: float


QUANTITIES = {
    "von_mises": Quantity("von Mises stress", "kPa", 1e3),
    "pressure": Quantity("Pressure", "kPa", 1e3),
    "traction": Quantity("Shear traction", "kPa", 1e3),
    "displacement": Quantity("Displacement", "mm", 1e-3),
    "energy": Quantity("Strain energy density", "J/m³", 1.0),
    **{c: Quantity(f"Stress {c}", "kPa", 1e3) for c in COMPONENTS},
}


class Drawn(NamedTuple):
    """One skin, ready to be drawn, in the finger's frame.

    Attributes:
        surface: the surface that it is drawn on.
        positions: deformed vertices [m], shape (d, 3). normals: unit, shape (d, 3). values: SI, shape (d,).
        low, high: least and greatest value at the skin's own nodes.
        centre: centre of pressure in X and Y [m], shape (2,).
        shear: force in X and Y divided by the normal force, shape (2,).
    """

    surface: DisplaySurface
    positions: Array
    normals: Array
    values: Array
    low: float
    high: float
    centre: Array
    shear: Array


class _Below(NamedTuple):
    """Drawn vertices that are over or beside the pad, and the stress below them."""

    vertices: NDArray[np.intp]
    table: core.skin.stress_table.StressTable


@dataclass(eq=False)
class _Kit:
    """The parts for drawing a mesh: its surface, and matrices to its nodes.

    Attributes:
        surface: the drawn surface. points: its nodes at rest [m], shape (s, 3).
        averaging: matrix from elements to those nodes, sparse (s, e). pad_rows: indices of the nodes that may touch.
        stresses: by the skin's key, matrix from displacement to the nodes' stress at E = 1 Pa, sparse (6 s, 3 n).
        shortcuts: by the skin's key, displacement and stress of the nodes for unit forces; see `_shortcut`.
        below: by the id of the smooth skin's remainder, stress below the drawn vertices of the pad.
        readings: by the same id, the matrix of `_reading_of`.
    """

    surface: DisplaySurface
    points: Array
    averaging: Any
    pad_rows: NDArray[np.intp]
    stresses: dict[str, Any] = field(default_factory=dict)
    shortcuts: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    below: dict[int, _Below] = field(default_factory=dict)
    readings: dict[int, Any] = field(default_factory=dict)


_kits: weakref.WeakKeyDictionary[Any, _Kit] = weakref.WeakKeyDictionary()


def kit(mesh: Any) -> _Kit:
    """Return the kit of a mesh, made at its first use."""
    own = _kits.get(mesh)
    if own is None:
        surface = DisplaySurface.of(mesh)
        pad_rows = np.searchsorted(surface.nodes, mesh.pad)
        own = _kits[mesh] = _Kit(surface, mesh.nodes[surface.nodes], mesh.averaging[surface.nodes], pad_rows)
    return own


def prepare(model: core.skin.model.SkinModel) -> None:
    """Prepare the tables for drawing a skin, so that no view waits for them.

    The function needs nothing of Blender, so it may run in a thread.
    """
    own, pad = kit(model.mesh), core.skin.surface_store.smooth_pad(model)
    if model.pad_count <= SMALL:
        _shortcut_of(own, model)
    else:
        _stress_of(own, model)
    if pad is not None:
        _below_of(own, pad)


def learn(state: SkinState, quantity: str) -> Iterator[None]:
    """Compute the stress tables of newly touched places, piece by piece.

    `draw_of` then finds them ready.
    """
    if state.points is None or not _is_stress(quantity) or not state.force.any():
        return
    own, model, surface = kit(state.model.mesh), state.model, state.points.surface
    if model.follows_law and id(surface.remainder) not in own.readings:  # the matrices of its law are made at first use
        operator = model.operator
        yield from loading.aside(
            lambda: (operator.strain_matrix, operator.volumetric_matrix, _reading_of(own, model.mesh, surface))
        )
    table = _below_of(own, surface).table
    pieces = table.learn(state.points.cells)
    while table.unknown(state.points.cells):  # a thread is started only for new places
        yield from loading.aside(lambda: next(pieces, None))


def draw_of(state: SkinState, quantity: str, exaggeration: float = 1.0) -> Drawn:
    """Return a skin's deformed surface with the values of a quantity; nothing else is computed."""
    return draws_of([state], quantity, exaggeration)[0]


def draws_of(states: Sequence[SkinState], quantity: str, exaggeration: float = 1.0) -> list[Drawn]:
    """Return `draw_of` for each of several skins; those of one mesh are refined together."""
    drawn: dict[int, Drawn] = {}
    alike: dict[int, list[tuple[int, _Nodes]]] = {}
    for i, state in enumerate(states):
        if state.force.any():
            nodes = _nodes_of(state, quantity)
            alike.setdefault(id(nodes.own), []).append((i, nodes))
        else:
            surface = kit(state.model.mesh).surface
            zero, lifted = np.zeros(len(surface.rest)), surface.rest + (0.0, 0.0, state.lift)
            drawn[i] = Drawn(surface, lifted, surface.at_rest, zero, 0.0, 0.0, surface.middle, np.zeros(2))
    for group in alike.values():
        own = group[0][1].own
        fine = own.surface.deformed_alike(own.points, [(exaggeration * n.moved, n.values) for _, n in group])
        for (i, nodes), refined in zip(group, fine, strict=True):
            drawn[i] = _refined(states[i], quantity, nodes, *refined)
    return [drawn[i] for i in range(len(states))]


class _Nodes(NamedTuple):
    """State of a touched skin at its surface's nodes.

    It has their displacement [m], shape (s, 3), and the values of a quantity, shape (s,).
    """

    own: _Kit
    stimulus: core.skin.stimulus.Stimulus
    moved: Array
    values: Array


def _nodes_of(state: SkinState, quantity: str) -> _Nodes:
    own = kit(state.model.mesh)
    stimulus = core.skin.stimulus.Stimulus(state.model, state.force, state.points, state.amounts)
    stressed = _is_stress(quantity)
    if state.model.follows_law:
        moved = stimulus.displacement[own.surface.nodes]
        stress = np.asarray(own.averaging @ stimulus.stress, float) if stressed else np.zeros((len(moved), 6))
    else:
        moved, stress = _linear(own, state, quantity, stressed)
    return _Nodes(own, stimulus, moved, _nodal(own, stimulus, quantity, moved, stress))


def _is_stress(quantity: str) -> bool:
    return quantity == "von_mises" or quantity in SIGNED


def _refined(state: SkinState, quantity: str, nodes: _Nodes, positions: Array, normals: Array, values: Array) -> Drawn:
    """Return the drawing of a touched skin; change `positions` and `values`."""
    nodal = nodes.values
    if _is_stress(quantity) and state.points is not None:
        near, stress = _beneath(nodes.own, state.model.mesh, state.points, nodes.stimulus.more)
        values[near] = _read(quantity, stress)
        nodal = values
    positions[:, 2] += state.lift
    push = np.maximum(-np.einsum("ij,ij->i", state.force, state.model.normals), 0.0)
    centre = push @ state.model.positions[:, :2] / max(float(push.sum()), 1e-30)
    shear = state.force.sum(axis=0)[:2] / max(state.normal_force, 1e-12)
    low, high = float(nodal.min()), float(nodal.max())
    return Drawn(nodes.own.surface, positions, normals, values, low, high, centre, shear)


def is_light(state: SkinState) -> bool:
    """Return whether drawing a skin takes less than a millisecond.

    It does for a linear skin that is touched at its nodes and whose map is kept, see `SMALL`.
    """
    return not state.model.follows_law and state.points is None and state.model.pad_count <= SMALL


def _linear(own: _Kit, state: SkinState, quantity: str, stressed: bool) -> tuple[Array, Array]:
    """Return displacement and averaged stress of the surface's nodes, linear skin.

    Their shapes are (s, 3) and (s, 6).
    """
    model = state.model
    if model.pad_count <= SMALL and quantity != "energy":
        return _by_shortcut(own, model, state.force)
    linear = model.displacement(state.force)
    moved = linear[own.surface.nodes]
    if not stressed:
        return moved, np.zeros((len(moved), 6))
    return moved, model.material.modulus * (_stress_of(own, model) @ linear.ravel()).reshape(-1, 6)


def _beneath(
    own: _Kit, mesh: Any, points: core.skin.point_forces.PointForces, more: Array | None
) -> tuple[NDArray[np.intp], Array]:
    """Return the drawn vertices near a contact, and the stress below them.

    It is the stress at the depth of the first receptors. An edge is finer than the mesh, whose own stress is smeared
    over its elements. Farther from a contact, the mesh's stress is right.

    Args:
        more: stress of each element in addition to that of linear skin, shape (e, 6); None for linear skin.
    """
    from scipy.spatial import cKDTree

    cells, below = points.surface.cells.positions, _below_of(own, points.surface)
    apart = cKDTree(cells[points.cells]).query(own.surface.rest[below.vertices], distance_upper_bound=NEAR)[0]
    near = np.flatnonzero(apart < NEAR)
    stress = below.table.stress(points.cells, points.force, near)
    if more is not None:
        stress = stress + _reading_of(own, mesh, points.surface)[near] @ more
    return below.vertices[near], stress


def _below_of(own: _Kit, surface: core.skin.surface_compliance.SurfaceCompliance) -> _Below:
    """Return the drawn vertices over or beside a smooth pad, made once.

    With them comes the table of the stress below them.
    """
    below = own.below.get(id(surface.remainder))
    if below is None:
        from scipy.spatial import cKDTree

        over = cKDTree(surface.cells.positions[surface.chart.base]).query(own.surface.rest)[0] < NEAR
        vertices = np.flatnonzero(over)
        places, _ = surface.chart.project(own.surface.rest[vertices])
        probes = surface.probes(places, core.skin.stress.RECEPTOR_DEPTHS[0])
        below = own.below[id(surface.remainder)] = _Below(vertices, core.skin.stress_table.StressTable(surface, probes))
    return below


def _reading_of(own: _Kit, mesh: Any, surface: core.skin.surface_compliance.SurfaceCompliance) -> Any:
    """Return the matrix from values of elements to the places of `_below_of`.

    It is sparse, of shape (k, e), and is made once.
    """
    reading = own.readings.get(id(surface.remainder))
    if reading is None:
        points = _below_of(own, surface).table.probes.points
        reading = own.readings[id(surface.remainder)] = core.skin.recovery.fitted(mesh, points)
    return reading


def _read(quantity: str, stress: Array) -> Array:
    """Return a quantity of stresses, shape (k, 6)."""
    if quantity == "von_mises":
        return np.asarray(core.skin.stimulus.von_mises(stress))
    return stress[:, COMPONENTS.index(quantity)]


def _by_shortcut(own: _Kit, model: Any, force: Array) -> tuple[Array, Array]:
    """Return displacement and averaged stress of the surface's nodes by one product.

    Their shapes are (s, 3) and (s, 6).
    Both are linear in the forces. For all skins but fine ones the whole map is small, and its product takes a third of
    the time of a pass over all elements. Displacement goes with 1 / E; stress for given forces does not depend on E.
    """
    table = _shortcut_of(own, model)
    scale = float(np.abs(force).max())
    touched = np.flatnonzero(force.any(axis=1))
    if 4 * len(touched) < len(force):  # read only the touched rows
        rows, table = force[touched], table.reshape(len(force), 3, -1)[touched].reshape(3 * len(touched), -1)
    else:
        rows = force
    nodal = ((rows.reshape(-1) / scale).astype(np.float32) @ table).astype(np.float64).reshape(-1, 9)
    return nodal[:, :3] * (scale / model.material.modulus), nodal[:, 3:] * scale


def _shortcut_of(own: _Kit, model: Any) -> NDArray[np.float32]:
    table = own.shortcuts.get(model.key)
    if table is None:
        table = own.shortcuts[model.key] = _kept_shortcut(own, model)
    return table


def _kept_shortcut(own: _Kit, model: Any) -> NDArray[np.float32]:
    """Return `_shortcut`, from the skins' cache if it is there."""
    if model.cache is None:
        return _shortcut(own, model)
    store, key = core.skin.store, core.cache.cache_key(model.key, "drawn 1")
    path = model.cache.get(key)
    kept = None if path is None else store.read_table(path, (3 * model.pad_count, 9 * len(own.points)))
    if kept is not None:
        return np.asarray(kept, np.float32)
    made = _shortcut(own, model)
    model.cache.put(key, lambda part: store.write_table(part, made))
    return made


def _shortcut(own: _Kit, model: Any) -> NDArray[np.float32]:
    """Return displacement and stress of the surface's nodes for unit forces.

    They are those at E = 1 Pa, in one table of shape (3 m, 9 s).
    """
    mesh, size = model.mesh, 3 * model.pad_count
    moved = np.zeros((size, len(mesh.nodes), 3), np.float32)
    moved[:, mesh.free] = model.unit_response.reshape(size, -1, 3)
    moved[:, mesh.pad] = model.unit_compliance.reshape(size, -1, 3)
    stress = _stress_of(own, model) @ np.ascontiguousarray(moved.reshape(size, -1).T)
    out = np.empty((size, len(own.points), 9), np.float32)
    out[:, :, :3] = moved[:, own.surface.nodes]
    out[:, :, 3:] = stress.T.reshape(size, -1, 6)
    return out.reshape(size, -1)


def _stress_of(own: _Kit, model: Any) -> Any:
    """Return the matrix from a skin's displacement to the stress of the surface's nodes.

    The stress is that at E = 1 Pa. The matrix is made once.
    """
    if model.key not in own.stresses:
        from scipy.sparse import identity, kron

        unit = model.with_material(young=1.0, alpha=1.0).operator
        own.stresses[model.key] = (kron(own.averaging, identity(6)).tocsr() @ unit.matrix).tocsr()
    return own.stresses[model.key]


def _nodal(own: _Kit, stimulus: Any, quantity: str, moved: Array, stress: Array) -> Array:
    """Return a quantity at the nodes of the surface."""
    if quantity == "displacement":
        return np.linalg.norm(moved, axis=1)
    if quantity in ("pressure", "traction"):
        out = np.zeros(len(moved))
        model = stimulus.skin
        if quantity == "pressure":
            out[own.pad_rows] = stimulus.pressure
            return out
        push = np.einsum("ij,ij->i", stimulus.force, model.normals)
        across = stimulus.force - push[:, None] * model.normals
        out[own.pad_rows] = np.linalg.norm(across, axis=1) / model.areas
        return out
    if quantity == "energy":
        return np.asarray(own.averaging @ stimulus.energy_density)
    return _read(quantity, stress)


def nice(value: float) -> float:
    """Return the next larger of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten."""
    if not (value > 0.0 and math.isfinite(value)):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(float(f"{m * power:.3g}") for m in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if m * power >= value * (1 - 1e-9))


def error_lines(states: Sequence[SkinState]) -> list[str]:
    """Return the legend's lines on the error of stress of a frame's skins, one for each tissue that is shown.

    A second line says where a tissue is beyond the range in which it is trusted. A skin that is still being made
    has no line.
    """
    lines = []
    for tissue in dict.fromkeys(s.tissue for s in states if s.model is not None):
        own = [s for s in states if s.model is not None and s.tissue == tissue]
        name, deepest = core.contact.trusted.WORDS[tissue], max(own, key=lambda s: s.depth)
        touching = deepest.depth > 0.0
        at = (deepest.depth, deepest.slide) if touching else (1e-3, 0.0)
        off = _percent(core.parameters.error_bands.error_band(tissue, *at).stress.median)
        lines.append(f"{name} skin: stress about {off} off" if touching else f"{name} skin: stress {off} off at 1 mm")
        if beyond := _beyond(deepest):
            lines.append(beyond)
    return lines


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 5e-3 else "below 1 %"


def _beyond(state: SkinState) -> str:
    """Return in words that a skin is pressed or dragged beyond the range in which its tissue is trusted, or ''."""
    if state.too_deep:
        return "deeper than it is trusted"
    return "dragged farther than it is trusted" if state.too_far else ""


def error_text(states: Sequence[SkinState]) -> str:
    """Return a text on all errors of a frame's skins.

    It gives the errors of each tissue and of its mesh, and of contact if a skin is pressed.
    """
    tissues = list(dict.fromkeys(s.tissue for s in states)) or ["linear"]
    said = [_tissue_text(tissue, [s for s in states if s.tissue == tissue]) for tissue in tissues]
    if not any(s.depth > 0.0 for s in states):
        return "; ".join(said)
    where = "nodes" if any(s.touching and s.points is None and s.work != "rendered" for s in states) else "points"
    off = core.parameters.skin.FORCE_ERRORS[where]
    said.append(f"contact on {where}: {off} off at most where pressed, more slid over edges")
    return "; ".join(said)


def _tissue_text(tissue: str, states: Sequence[SkinState]) -> str:
    """Return a text on a tissue's errors where it is pressed deepest.

    If it is not pressed, the text is on presses of 1 and 2 mm.
    """
    bands, name = core.parameters.error_bands, core.contact.trusted.WORDS[tissue]
    deepest = max(states, key=lambda s: s.depth, default=None)
    if deepest is None or deepest.depth <= 0.0:
        shallow, deep = (100 * bands.error_band(tissue, depth).stress.median for depth in (1e-3, 2e-3))
        said = f"{name} skin: stress about {shallow:.0f} % off at 1 mm, {deep:.0f} % at 2 mm (simulated)"
        return said + _mesh_text(tissue, deepest)
    band = bands.error_band(tissue, deepest.depth, deepest.slide)
    place = f"{1e3 * deepest.depth:.2f} mm" + (f", {1e3 * deepest.slide:.1f} mm dragged" if deepest.dragged else "")
    beyond = f": {_beyond(deepest)}" if _beyond(deepest) else ""
    stress, force = (_percent(one.median) for one in band)
    said = f"{name} skin: stress about {stress} off, force {force}, at {place} (simulated){beyond}"
    return said + _mesh_text(tissue, deepest)


def _mesh_text(tissue: str, state: SkinState | None) -> str:
    """Return a text on the error of stress that the standard mesh alone causes, and on the size of the shown mesh.

    '' for linear tissue.
    """
    bands = core.parameters.error_bands
    if tissue == bands.LINEAR:
        return ""
    deep = max(bands.MESH_STRESS)
    said = f"; the standard mesh ({core.parameters.skin.TETRAHEDRA['standard']} tetrahedra) alone"
    said += f" {100 * bands.MESH_STRESS[deep]:.0f} % at 2 mm, {1e3 * deep:g} mm below the skin"
    if state is not None and state.model is not None:
        said += f", this mesh has {len(state.model.mesh.tetrahedra):,}"
    return said
