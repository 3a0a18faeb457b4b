"""SkinModel: a fingertip condensed to the nodes that may touch. Made once per skin, kept on disk."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..cache import Cache, cache_key
from ..errors import DermisError
from ..parameters.error_bands import LINEAR, NEO_HOOKEAN
from ..parameters.skin import LENGTHS, OWN_MESH, TISSUE
from ..recent import Recent
from .assembly import Element, degrees, stiffness
from .condense import Condensed, condense
from .fingertip import LEVELS, fingertip_mesh
from .law_tables import LawTables
from .material import Elastic
from .mesh import TetraMesh
from .own_mesh import own_mesh
from .quality import check_mesh, unsolvable
from .shape import FingertipShape, shape_from_parameters
from .store import MESH_ARRAYS, read_model, read_table, write_model, write_table
from .stress import Probes, StressOperator, receptor_probes

Floats = NDArray[np.floating[Any]]

_laws: Recent[str, LawTables] = Recent(8)

MODEL_VERSION = 1  # part of every key: raise it whenever mesh, assembly or condensation changes


@dataclass(frozen=True, eq=False)
class SkinModel:
    """A linear skin, condensed to its pad.

    Forces are those on the skin [N], displacements [m], both in the finger's frame, x, y, z by pad node in the order of
    `mesh.pad`; (m, 3) and (3 m,) are both accepted. Nothing but `compliance` and what follows from it assumes that
    skin is linear: what its tissue's law adds is an offset (see `Stimulus`, which goes through these methods only).

    Attributes:
        mesh: the tissue.
        material: E, Poisson's ratio and alpha. E and alpha only scale.
        element: 'anp' (averaged nodal pressure) or 'p1'.
        unit_compliance: displacement of the pad for force on it at E = 1 Pa, symmetric positive definite [1/m],
            shape (3 m, 3 m).
        key: what the model depends on besides E and alpha, 64 hexadecimal digits.
        cache: where larger tables go, or None.
        shape: the fingertip that was meshed, whose skin is smooth; None for any other mesh.
        follows_law: its tissue follows the neo-Hookean law, node by node (`law`). What is said of displacement, stress
            and energy here is of linear skin: `Stimulus` adds the rest.
        rounded_key: as `key`, of lengths to the nanometre, so that a length is the same in metres and in millimetres;
            '' of any other mesh.
    """

    mesh: TetraMesh
    material: Elastic
    element: Element
    unit_compliance: Array
    key: str
    cache: Cache | None = None
    shape: FingertipShape | None = None
    follows_law: bool = False
    rounded_key: str = ""

    def __repr__(self) -> str:
        size = f"{len(self.mesh.nodes)} nodes, {self.pad_count} on the pad"
        kind = "" if self.tissue == LINEAR else ", neo-Hookean"
        return f"SkinModel({self.mesh.name}, {size}, E {1e-3 * self.material.modulus:.3g} kPa{kind})"

    @property
    def pad_count(self) -> int:
        """Number of pad nodes, m."""
        return len(self.mesh.pad)

    @property
    def tissue(self) -> str:
        """What its tissue is: 'linear' or 'neo_hookean'."""
        return NEO_HOOKEAN if self.follows_law else LINEAR

    @property
    def positions(self) -> Array:
        """Pad nodes at rest [m], shape (m, 3)."""
        return self.mesh.nodes[self.mesh.pad]

    @property
    def normals(self) -> Array:
        """Outward unit normals of the pad nodes at rest, shape (m, 3)."""
        return self.mesh.pad_normals

    @property
    def areas(self) -> Array:
        """Skin that belongs to each pad node [m^2], shape (m,)."""
        return self.mesh.pad_areas

    @cached_property
    def compliance(self) -> Array:
        """Displacement of the pad for force on it [m/N], shape (3 m, 3 m)."""
        return self.unit_compliance / self.material.modulus

    @cached_property
    def compliance32(self) -> NDArray[np.float32]:
        """`compliance` in single precision, for iterations that a float64 residual checks afterwards."""
        return self.compliance.astype(np.float32)

    def with_material(self, *, young: float | None = None, alpha: float | None = None) -> SkinModel:
        """Return the same skin of another stiffness: no work, all tables are shared."""
        material = replace(
            self.material,
            young=self.material.young if young is None else young,
            alpha=self.material.alpha if alpha is None else alpha,
        )
        other = replace(self, material=material)
        self._share(other, "unit_response", "unit_stress", "probes", "law")
        if "operator" in self.__dict__:
            other.__dict__["operator"] = self.operator.with_material(material)
        return other

    def with_law(self) -> SkinModel:
        """Return the same skin of tissue that follows the neo-Hookean law: no work, tables are shared."""
        return self if self.follows_law else self._like(follows_law=True)

    @cached_property
    def linear(self) -> SkinModel:
        """The same skin of linear tissue: no work, tables are shared."""
        return self._like(follows_law=False) if self.follows_law else self

    def _like(self, **changed: Any) -> SkinModel:
        other = replace(self, **changed)
        self._share(other, "unit_response", "unit_stress", "probes", "operator", "compliance", "compliance32", "law")
        return other

    @cached_property
    def on_nodes(self) -> SkinModel:
        """The same skin without its smooth surface: what presses it is solved at the nodes of its mesh."""
        return self._like(shape=None)

    def _share(self, other: SkinModel, *tables: str) -> None:
        """Let another model use the tables that were made."""
        other.__dict__.update({name: self.__dict__[name] for name in tables if name in self.__dict__})

    def pad_displacement(self, force: Floats) -> Array:
        """Return the displacement of the pad nodes, shape (m, 3)."""
        return self._pad_displacement(self._force(force)).reshape(-1, 3)

    def displacement(self, force: Floats) -> Array:
        """Return the displacement of all nodes, shape (n, 3); the pad's is exact, the others' to float32."""
        from scipy.linalg.blas import sgemv  # numpy may come without a BLAS

        flat = self._force(force)
        active = np.flatnonzero(flat.reshape(-1, 3).any(axis=1))
        out = np.zeros((len(self.mesh.nodes), 3))
        if len(active) == 0:
            return out
        rows = self.unit_response
        if 2 * len(active) < self.pad_count:  # most of a pad is not touched: read only what is
            chosen = degrees(active)
            rows, flat32 = rows[chosen], flat[chosen]
        else:
            flat32 = flat
        # scaled in float64 before and after, so that single precision sees numbers near one
        scale = float(np.abs(flat32).max())
        moved = sgemv(1.0, rows.T, (flat32 / scale).astype(np.float32))
        out[self.mesh.free] = moved.astype(np.float64).reshape(-1, 3) * (scale / self.material.modulus)
        out[self.mesh.pad] = self._pad_displacement(flat).reshape(-1, 3)
        return out

    def stress(self, force: Floats) -> Array:
        """Return the stress of each element in the nail's frame [Pa], xx, yy, zz, yz, xz, xy, shape (e, 6)."""
        return self.operator.stress(self.displacement(force))

    def energy(self, force: Floats) -> float:
        """Return the strain energy [J]."""
        flat = self._force(force)
        return 0.5 * float(flat @ self._pad_displacement(flat))

    def energy_density(self, force: Floats) -> Array:
        """Return the strain energy density of each element [J/m^3], shape (e,)."""
        return self.operator.energy_density(self.displacement(force))

    @cached_property
    def operator(self) -> StressOperator:
        """From displacement to stress."""
        return StressOperator(self.mesh, self.material, self.element)

    @cached_property
    def probes(self) -> Probes:
        """Probes under the pad nodes at the depths of receptors (0.3, 1.6 and 2.0 mm)."""
        return receptor_probes(self.mesh)

    @cached_property
    def unit_response(self) -> NDArray[np.float32]:
        """Displacement of the free nodes for force on the pad at E = 1 Pa, transposed [1/m], shape (3 m, 3 free).

        Computed or read from the cache when first asked for.
        """
        key = cache_key(self.key, "response")
        if self.cache is not None:
            path = self.cache.get(key)
            table = None if path is None else read_table(path, (3 * self.pad_count, 3 * len(self.mesh.free)))
            if table is not None:
                return table
        full = condensed_pad(self.mesh, self.material, self.element, response=True).response
        assert full is not None
        if self.cache is not None:
            self.cache.put(key, lambda part: write_table(part, full))
        return full

    @cached_property
    def law(self) -> LawTables:
        """The neo-Hookean law on this mesh, which fingers that are alike share."""
        return _laws.make(self.key, lambda: LawTables(self.mesh, self.material.poisson, lambda: self.unit_response))

    def stress_components(self, count: int | None = None, forces: Floats | None = None) -> Array:
        """Return W: few numbers whose norm is the stress's, sigma_k = W f.

        The 2-norm of W f equals the volume-weighted L2 norm of the stress (shear counted twice) [Pa m^1.5], exactly
        with all 3 m components and nearly with the `count` that matter most.

        Args:
            count: components to keep; all where None.
            forces: samples that say what matters [N], shape (s, 3 m); unit forces on each node where None.

        Returns:
            shape (count, 3 m).

        Raises:
            DermisError: more components than there are.
        """
        size = 3 * self.pad_count
        count = size if count is None else count
        if not 1 <= count <= size:
            raise DermisError("as many components as there are", where="skin stress", value=count, limit=f"1 to {size}")
        root = self.unit_stress
        samples = root if forces is None else root @ np.asarray(forces, np.float64).reshape(-1, size).T
        from scipy.linalg import eigh

        values, vectors = eigh(samples @ samples.T)
        keep = vectors[:, np.argsort(values)[::-1][:count]]
        keep = keep * np.where(keep[np.abs(keep).argmax(axis=0), np.arange(count)] < 0, -1.0, 1.0)
        return keep.T @ root

    @cached_property
    def unit_stress(self) -> Array:
        """Return H (3 m, 3 m) with |H f| the stress norm of f; stress does not depend on E when forces are given."""
        from scipy.linalg import eigh

        weighted = StressOperator(self.mesh, self.material.unit, self.element).weighted_matrix
        weighted = weighted[:, degrees(self.mesh.free)].tocsr()
        normal = (weighted.T.tocsr() @ weighted).tocsr()
        response = self.unit_response
        gram = np.empty((len(response), len(response)))
        for start in range(0, len(response), 256):
            part = np.asarray(response[start : start + 256], np.float64)
            forced = normal @ part.T
            gram[:, start : start + 256] = np.asarray(response, np.float32) @ forced.astype(np.float32)
        values, vectors = eigh(0.5 * (gram + gram.T))
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T

    def _pad_displacement(self, flat: Array) -> Array:
        from scipy.linalg.blas import dgemv

        return dgemv(1.0, self.compliance.T, flat)  # symmetric, and in the order that BLAS wants without a copy

    def _force(self, force: Floats) -> Array:
        flat = np.ascontiguousarray(force, np.float64).reshape(-1)
        if flat.size != 3 * self.pad_count:
            raise DermisError(
                "forces do not fit the pad",
                where=f"skin '{self.mesh.name}'",
                value=np.shape(force),
                limit=f"({self.pad_count}, 3)",
            )
        return flat


def fingertip_skin(
    shape: FingertipShape | None = None,
    material: Elastic | None = None,
    *,
    level: str = "standard",
    element: Element = "anp",
    cache: Cache | None = None,
) -> SkinModel:
    """Return the skin of a parametric fingertip, from the cache where it is there.

    Args:
        level: 'draft', 'standard', 'fine' or 'reference'.

    Raises:
        DermisError: an unknown level or element, or a shape that cannot be meshed.
    """
    shape, material = shape or FingertipShape(), material or Elastic()
    made = _cached(
        _told(asdict(shape), level), "fingertip", lambda: fingertip_mesh(shape, level), material, element, cache
    )
    rounded = {name: round(length, 9) for name, length in asdict(shape).items()}
    return replace(made, shape=shape, rounded_key=_key_of(_told(rounded, level), material, element))


def _told(lengths: Mapping[str, float], level: str) -> str:
    """Return what a fingertip's mesh depends on."""
    if level not in LEVELS:
        raise DermisError("unknown accuracy", where="skin", value=level, limit=", ".join(LEVELS))
    return json.dumps({"shape": dict(lengths), "level": asdict(LEVELS[level])}, sort_keys=True)


def _key_of(what: str, material: Elastic, element: Element) -> str:
    return cache_key(f"dermis-skin-model {MODEL_VERSION}", what, repr(material.poisson), element)


def mesh_skin(
    mesh: TetraMesh, material: Elastic | None = None, *, element: Element = "anp", cache: Cache | None = None
) -> SkinModel:
    """Return the skin of any tetrahedral mesh, from the cache where it is there.

    Raises:
        DermisError: the mesh cannot be solved on (see `check_mesh`).
    """
    check_mesh(mesh)
    return _cached(mesh.hash, mesh.name, lambda: mesh, material or Elastic(), element, cache)


def skin_from_parameters(
    parameters: Mapping[str, Any], *, level: str = "standard", cache: Cache | None = None, where: str = "skin"
) -> SkinModel:
    """Return the skin that parameters describe, in SI: lengths of `FingertipShape` or 'mesh', young, poisson, alpha.

    Raises:
        DermisError: an unknown parameter, values out of range, or a mesh that cannot be used (see `own_mesh`).
    """
    shape, material = shape_and_material(parameters, where)
    if shape is None:
        try:
            return mesh_skin(own_mesh(parameters, where), material, cache=cache)
        except DermisError as error:
            raise error if where in error.where else error.changed(where=f"{where}, {error.where}") from error
    return fingertip_skin(shape, material, level=level, cache=cache)


def is_kept(parameters: Mapping[str, Any], *, level: str, cache: Cache, where: str = "skin") -> bool:
    """Return whether the skin that parameters describe, and its table of responses, lie in a cache.

    Raises:
        DermisError: an unknown parameter or level, or values out of range.
    """
    shape, material = shape_and_material(parameters, where)
    if shape is None:
        return True  # a mesh of one's own is hashed to know its key: whoever reads it finds out
    key = _key_of(_told(asdict(shape), level), material, "anp")
    return cache.get(key) is not None and cache.get(cache_key(key, "response")) is not None


def shape_and_material(parameters: Mapping[str, Any], where: str = "skin") -> tuple[FingertipShape | None, Elastic]:
    """Return the fingertip that a skin's parameters describe, None where they name a mesh, and its tissue.

    Raises:
        DermisError: an unknown parameter, or values out of range.
    """
    if not isinstance(parameters, Mapping):
        raise DermisError("the skin's parameters are no object", where=where, value=type(parameters).__name__)
    own = "mesh" in parameters
    known = {**(OWN_MESH if own else LENGTHS), **TISSUE}
    for name, value in parameters.items():
        if name not in known:
            raise DermisError("unknown parameter", where=where, value=name, limit=", ".join(known))
        known[name].check(value, where)
    material = Elastic(**{n: float(v) for n, v in parameters.items() if n in TISSUE})
    if own:
        return None, material
    return shape_from_parameters({n: v for n, v in parameters.items() if n in LENGTHS}, where=where), material


def _cached(
    what: str, name: str, build: Callable[[], TetraMesh], material: Elastic, element: Element, cache: Cache | None
) -> SkinModel:
    key = _key_of(what, material, element)
    if cache is not None:
        path = cache.get(key)
        arrays = None if path is None else read_model(path)
        if arrays is not None:
            mesh = TetraMesh(**{n: arrays[n] for n in MESH_ARRAYS}, name=name)
            return SkinModel(mesh, material, element, arrays["compliance"], key, cache)
    mesh = build()
    compliance = condensed_pad(mesh, material, element).compliance
    if cache is not None:
        cache.put(key, lambda part: write_model(part, mesh, compliance))
    return SkinModel(mesh, material, element, compliance, key, cache)


def condensed_pad(mesh: TetraMesh, material: Elastic, element: Element, *, response: bool = False) -> Condensed:
    """Return what forces on the pad of a mesh do at E = 1, and with `response` what they do to all free nodes."""
    free = degrees(mesh.free)
    matrix = stiffness(mesh, material.unit, element)[free][:, free]
    try:
        return condense(matrix, np.searchsorted(mesh.free, mesh.pad), response=response)
    except DermisError as error:  # the mesh is held, or `check_mesh` had refused it: numbers are too far apart
        raise unsolvable(mesh, material.poisson) from error
