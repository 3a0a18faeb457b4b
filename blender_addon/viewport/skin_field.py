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
from .display_surface import DisplaySurface, Nodal

COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")
SIGNED = frozenset(COMPONENTS)
IN_TABLE = {name: number for number, name in enumerate((*COMPONENTS, "von_mises", "displacement"))}  # see `Nodal`
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
        surface: the drawn surface.
        averaging: matrix from elements to those nodes, sparse (s, e). pad_rows: indices of the nodes that may touch.
        stresses: by the skin's key, matrix from displacement to the nodes' stress at E = 1 Pa, sparse (6 s, 3 n).
        shortcuts: by the skin's key, displacement and stress of the nodes for unit forces; see `_shortcut`.
        below: by the id of the smooth skin's remainder, stress below the drawn vertices of the pad.
        readings: by the same id, the matrix of `_reading_of`.
    """

    surface: DisplaySurface
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
        own = _kits[mesh] = _Kit(surface, mesh.averaging[surface.nodes], pad_rows)
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
    own = kit(state.model.mesh)
    surface = own.surface
    if not state.force.any():
        zero, lifted = np.zeros(len(surface.rest)), surface.rest + (0.0, 0.0, state.lift)
        return Drawn(surface, lifted, surface.at_rest, zero, 0.0, 0.0, surface.middle, np.zeros(2))
    stimulus = core.skin.stimulus.Stimulus(state.model, state.force, state.points, state.amounts)
    nodal = _nodal(own, stimulus, quantity)
    fine = surface.deformed(state.model, state.force, state.normal_force, nodal, exaggeration, state.lift)
    drawn = Drawn(surface, *fine)
    if not _is_stress(quantity) or state.points is None:
        return drawn
    near, stress = _beneath(own, state.model.mesh, state.points, stimulus.more)
    drawn.values[near] = _read(quantity, stress)
    return drawn._replace(low=float(drawn.values.min()), high=float(drawn.values.max()))


def _nodal(own: _Kit, stimulus: core.skin.stimulus.Stimulus, quantity: str) -> Nodal:
    """Return displacement and values of the surface's nodes.

    For a linear skin whose map is kept, see `SMALL`, they come from the map where they can: this takes a third of the
    time of a pass over all elements.
    """
    model = stimulus.skin
    if _by_table(model) and quantity != "energy":
        table = _shortcut_of(own, model)
        if quantity in IN_TABLE:
            return Nodal(None, None, table, IN_TABLE[quantity])
        return Nodal(None, _on_pad(own, stimulus, quantity), table)
    moved = stimulus.displacement if model.follows_law else model.displacement(stimulus.force)
    on_surface = moved[own.surface.nodes]
    if quantity == "displacement":
        return Nodal(on_surface, np.linalg.norm(on_surface, axis=1))
    if quantity == "energy":
        return Nodal(on_surface, np.asarray(own.averaging @ stimulus.energy_density))
    if not _is_stress(quantity):
        return Nodal(on_surface, _on_pad(own, stimulus, quantity))
    if model.follows_law:
        stress = np.asarray(own.averaging @ stimulus.stress, float)
    else:
        stress = model.material.modulus * (_stress_of(own, model) @ moved.ravel()).reshape(-1, 6)
    return Nodal(on_surface, _read(quantity, stress))


def _is_stress(quantity: str) -> bool:
    return quantity == "von_mises" or quantity in SIGNED


def is_light(state: SkinState) -> bool:
    """Return whether drawing a skin takes less than a millisecond.

    It does for a linear skin that is touched at its nodes and whose map is kept, see `SMALL`.
    """
    return state.points is None and _by_table(state.model)


def _by_table(model: core.skin.model.SkinModel) -> bool:
    return not model.follows_law and model.pad_count <= SMALL


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
    kept = None if path is None else store.read_table(path, (3 * model.pad_count, 9 * len(own.surface.nodes)))
    if kept is not None:
        return np.ascontiguousarray(kept, np.float32)
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
    out = np.empty((size, len(own.surface.nodes), 9), np.float32)
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


def _on_pad(own: _Kit, stimulus: core.skin.stimulus.Stimulus, quantity: str) -> Array:
    """Return pressure or shear traction at the nodes of the surface [Pa], which are zero outside the pad."""
    out = np.zeros(len(own.surface.nodes))
    model = stimulus.skin
    if quantity == "pressure":
        out[own.pad_rows] = stimulus.pressure
        return out
    push = np.einsum("ij,ij->i", stimulus.force, model.normals)
    across = stimulus.force - push[:, None] * model.normals
    out[own.pad_rows] = np.linalg.norm(across, axis=1) / model.areas
    return out


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
    slid = ", more slid over edges" if where == "nodes" else ""
    said.append(f"contact on {where}: {off} off at most where pressed{slid}")
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
