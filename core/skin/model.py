"""SkinModel: compliance of a fingertip, condensed to its pad nodes.

Skins are computed once and kept in a cache.
"""

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
from .blas import symmetric_eigenvectors
from .condense import Condensed, condense
from .fingertip import LEVELS, fingertip_mesh
from .law_tables import LawTables
from .material import Elastic
from .mesh import TetraMesh
from .own_mesh import own_mesh
from .quality import check_mesh, unsolvable
from .shape import FingertipShape, shape_from_parameters
from .store import MESH_ARRAYS, kept, read_model, read_table, write_model, write_table
from .stress import Probes, StressOperator, receptor_probes

Floats = NDArray[np.floating[Any]]

_laws: Recent[str, LawTables] = Recent(8)

COLUMNS = 32  # vectors that a sparse matrix multiplies at once: about 8 ms of work, far below a window's 50 ms
MODEL_VERSION = 1  # part of every cache key; increase it when mesh, assembly or condensation changes


@dataclass(frozen=True, eq=False)
class SkinModel:
    """Linear response of a fingertip's skin, condensed to the pad nodes.

    Forces act on the skin [N]. Forces and displacements [m] are in the finger's frame, with x, y and z of each pad node
    in the order of `mesh.pad`; forces may have the shape (m, 3) or (3 m,). The methods return displacement, stress and
    energy of linear tissue, even if `follows_law` is set. `Stimulus` takes the neo-Hookean law into account.

    Attributes:
        mesh: mesh of the tissue.
        material: Young's modulus E, Poisson's ratio and the personal stiffness factor alpha.
        element: 'anp' (averaged nodal pressure) or 'p1'.
        unit_compliance: displacement of the pad nodes for forces on them for E = 1 Pa, symmetric positive definite
            [1/m], shape (3 m, 3 m).
        key: hash of all inputs except E and alpha, 64 hexadecimal digits.
        cache: cache for larger tables; None for none.
        shape: the parametric fingertip that was meshed, which has a smooth surface; None for any other mesh.
        follows_law: whether the tissue follows the neo-Hookean law (`law`).
        rounded_key: as `key`, with lengths rounded to a nanometre, so that a length has the same key in metres and in
            millimetres; '' for any other mesh.
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
        """Model of the tissue: 'linear' or 'neo_hookean'."""
        return NEO_HOOKEAN if self.follows_law else LINEAR

    @property
    def positions(self) -> Array:
        """Positions of the pad nodes at rest [m], shape (m, 3)."""
        return self.mesh.nodes[self.mesh.pad]

    @property
    def normals(self) -> Array:
        """Outward unit normals of the pad nodes at rest, shape (m, 3)."""
        return self.mesh.pad_normals

    @property
    def areas(self) -> Array:
        """Area of skin of each pad node [m^2], shape (m,)."""
        return self.mesh.pad_areas

    @cached_property
    def compliance(self) -> Array:
        """Displacement of the pad nodes for unit forces [m/N], shape (3 m, 3 m)."""
        return self.unit_compliance / self.material.modulus

    @cached_property
    def compliance32(self) -> NDArray[np.float32]:
        """`compliance` in single precision.

        It is for iterations whose residual is then verified in double precision.
        """
        return self.compliance.astype(np.float32)

    def with_material(self, *, young: float | None = None, alpha: float | None = None) -> SkinModel:
        """Return the same skin with another stiffness.

        Tables that do not depend on the stiffness are shared. None leaves a value as it is.
        """
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
        """Return the same skin with neo-Hookean tissue; all tables are shared."""
        return self if self.follows_law else self._like(follows_law=True)

    @cached_property
    def linear(self) -> SkinModel:
        """The same skin with linear tissue; all tables are shared."""
        return self._like(follows_law=False) if self.follows_law else self

    def _like(self, **changed: Any) -> SkinModel:
        other = replace(self, **changed)
        self._share(other, "unit_response", "unit_stress", "probes", "operator", "compliance", "compliance32", "law")
        return other

    @cached_property
    def on_nodes(self) -> SkinModel:
        """The same skin without its smooth surface.

        Contact is then solved at the nodes of the mesh.
        """
        return self._like(shape=None)

    def _share(self, other: SkinModel, *tables: str) -> None:
        """Share tables, if they have been computed, with another model."""
        other.__dict__.update({name: self.__dict__[name] for name in tables if name in self.__dict__})

    def pad_displacement(self, force: Floats) -> Array:
        """Return the displacement of the pad nodes for forces [m], shape (m, 3)."""
        return self._pad_displacement(self._force(force)).reshape(-1, 3)

    def displacement(self, force: Floats) -> Array:
        """Return the displacement of all nodes [m], shape (n, 3).

        For the pad nodes it is computed in double precision, for all other nodes in single precision.

        Args:
            force: forces on the pad nodes [N], shape (m, 3) or (3 m,).
        """
        from scipy.linalg.blas import sgemv  # numpy may come without a BLAS

        flat = self._force(force)
        active = np.flatnonzero(flat.reshape(-1, 3).any(axis=1))
        out = np.zeros((len(self.mesh.nodes), 3))
        if len(active) == 0:
            return out
        rows = self.unit_response
        if 2 * len(active) < self.pad_count:  # read only the rows of loaded nodes
            chosen = degrees(active)
            rows, flat32 = rows[chosen], flat[chosen]
        else:
            flat32 = flat
        # Forces are divided by the largest one, so that the product in single precision has numbers near one.
        scale = float(np.abs(flat32).max())
        moved = sgemv(1.0, rows.T, (flat32 / scale).astype(np.float32))
        out[self.mesh.free] = moved.astype(np.float64).reshape(-1, 3) * (scale / self.material.modulus)
        out[self.mesh.pad] = self._pad_displacement(flat).reshape(-1, 3)
        return out

    def stress(self, force: Floats) -> Array:
        """Return the stress of each element [Pa], shape (e, 6).

        The components are xx, yy, zz, yz, xz, xy in the finger's frame.
        """
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
        """Operator from displacement to stress."""
        return StressOperator(self.mesh, self.material, self.element)

    @cached_property
    def probes(self) -> Probes:
        """Probes below the pad nodes, at the depths of receptors.

        The depths are 0.3, 1.6 and 2.0 mm.
        """
        return receptor_probes(self.mesh)

    @cached_property
    def unit_response(self) -> NDArray[np.float32]:
        """Displacement of the free nodes for E = 1 Pa [1/m], shape (3 m, 3 free).

        There is one row for each unit force on the pad. The table is read from the cache, or computed at its first use.
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
        """Tables of the neo-Hookean law on this mesh.

        All skins with the same `key` share them.
        """
        return _laws.make(self.key, lambda: LawTables(self.mesh, self.material.poisson, lambda: self.unit_response))

    def stress_components(self, count: int | None = None, forces: Floats | None = None) -> Array:
        """Return a matrix W: W f are stress components for forces f.

        The 2-norm of W f equals the volume-weighted L2 norm of the stress, in which shear counts twice [Pa m^1.5]. With
        all 3 m components this is exact. With fewer, W f has the `count` principal components, and its norm is
        approximate.

        Args:
            count: number of components; None for all.
            forces: sample forces [N], shape (s, 3 m); the principal components of their stress are kept. None for unit
                forces on each node.

        Returns:
            W, shape (count, 3 m).

        Raises:
            DermisError: `count` is not between 1 and 3 m.
        """
        size = 3 * self.pad_count
        count = size if count is None else count
        if not 1 <= count <= size:
            raise DermisError(
                "the number of components is out of range", where="skin stress", value=count, limit=f"1 to {size}"
            )
        root = self.unit_stress
        samples = root if forces is None else root @ np.asarray(forces, np.float64).reshape(-1, size).T
        values, vectors = symmetric_eigenvectors(samples @ samples.T)
        keep = vectors[:, np.argsort(values)[::-1][:count]]
        keep = keep * np.where(keep[np.abs(keep).argmax(axis=0), np.arange(count)] < 0, -1.0, 1.0)
        return keep.T @ root

    @cached_property
    def unit_stress(self) -> Array:
        """Matrix H: |H f| is the stress norm for forces f, shape (3 m, 3 m).

        It is the same for every E, since the stress for given forces does not depend on E. The matrix is read from the
        cache, or computed at its first use.
        """
        shape = 2 * (3 * self.pad_count,)
        made = kept(self.cache, cache_key(self.key, "stress"), {"root": shape}, lambda: {"root": self._stress_root()})
        return made["root"]

    def _stress_root(self) -> Array:
        weighted = StressOperator(self.mesh, self.material.unit, self.element).weighted_matrix
        weighted = weighted[:, degrees(self.mesh.free)].tocsr()
        normal = (weighted.T.tocsr() @ weighted).tocsr()
        response = self.unit_response
        gram = np.empty((len(response), len(response)))
        for start in range(0, len(response), 256):
            part = np.asarray(response[start : start + 256], np.float64)
            # SciPy keeps Python's lock during a product of a sparse matrix, so it is made in pieces.
            pieces = [normal @ part[at : at + COLUMNS].T for at in range(0, len(part), COLUMNS)]
            forced = np.concatenate(pieces, axis=1)
            gram[:, start : start + 256] = np.asarray(response, np.float32) @ forced.astype(np.float32)
        values, vectors = symmetric_eigenvectors(0.5 * (gram + gram.T))
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T

    def _pad_displacement(self, flat: Array) -> Array:
        from scipy.linalg.blas import dgemv

        return dgemv(1.0, self.compliance.T, flat)  # the transpose of a symmetric matrix avoids a copy

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
    """Return the skin of a parametric fingertip, computed or from a cache.

    Args:
        shape: the fingertip; None for the default lengths.
        material: material of the tissue; None for the default.
        level: resolution of the mesh: 'draft', 'standard', 'fine' or 'reference'.
        element: 'anp' or 'p1'.
        cache: cache of skins; None always computes the skin.

    Raises:
        DermisError: the level or the element is unknown, or the shape cannot be meshed.
    """
    shape, material = shape or FingertipShape(), material or Elastic()
    made = _cached(
        _told(asdict(shape), level), "fingertip", lambda: fingertip_mesh(shape, level), material, element, cache
    )
    rounded = {name: round(length, 9) for name, length in asdict(shape).items()}
    return replace(made, shape=shape, rounded_key=_key_of(_told(rounded, level), material, element))


def _told(lengths: Mapping[str, float], level: str) -> str:
    """Return the inputs of a fingertip's mesh as text, for its key."""
    if level not in LEVELS:
        raise DermisError("unknown accuracy", where="skin", value=level, limit=", ".join(LEVELS))
    return json.dumps({"shape": dict(lengths), "level": asdict(LEVELS[level])}, sort_keys=True)


def _key_of(what: str, material: Elastic, element: Element) -> str:
    return cache_key(f"dermis-skin-model {MODEL_VERSION}", what, repr(material.poisson), element)


def mesh_skin(
    mesh: TetraMesh, material: Elastic | None = None, *, element: Element = "anp", cache: Cache | None = None
) -> SkinModel:
    """Return the skin of any tetrahedral mesh, computed or read from a cache.

    Args:
        mesh: mesh of the tissue.
        material: material of the tissue; None for the default.
        element: 'anp' or 'p1'.
        cache: cache of skins; None always computes the skin.

    Raises:
        DermisError: the mesh is invalid (see `check_mesh`).
    """
    check_mesh(mesh)
    return _cached(mesh.hash, mesh.name, lambda: mesh, material or Elastic(), element, cache)


def skin_from_parameters(
    parameters: Mapping[str, Any], *, level: str = "standard", cache: Cache | None = None, where: str = "skin"
) -> SkinModel:
    """Return the skin that parameters describe.

    Args:
        parameters: lengths of `FingertipShape` [m] or 'mesh' (path of a file), and 'young' [Pa], 'poisson', 'alpha'.
        level: resolution of the mesh of a fingertip.
        cache: cache of skins.
        where: name of the finger, for errors.

    Raises:
        DermisError: a parameter is unknown, a value is out of range, or the mesh cannot be used (see `own_mesh`).
    """
    shape, material = shape_and_material(parameters, where)
    if shape is None:
        try:
            return mesh_skin(own_mesh(parameters, where), material, cache=cache)
        except DermisError as error:
            raise error if where in error.where else error.changed(where=f"{where}, {error.where}") from error
    return fingertip_skin(shape, material, level=level, cache=cache)


def is_kept(parameters: Mapping[str, Any], *, level: str, cache: Cache, where: str = "skin") -> bool:
    """Return whether a skin and its table of responses are in a cache.

    The skin is the one that `parameters` describe. For a mesh of the user's own the result is True, because its key
    cannot be computed before the mesh is read.

    Raises:
        DermisError: a parameter or the level is unknown, or a value is out of range.
    """
    shape, material = shape_and_material(parameters, where)
    if shape is None:
        return True
    key = _key_of(_told(asdict(shape), level), material, "anp")
    return cache.get(key) is not None and cache.get(cache_key(key, "response")) is not None


def shape_and_material(parameters: Mapping[str, Any], where: str = "skin") -> tuple[FingertipShape | None, Elastic]:
    """Return the fingertip and the tissue that a skin's parameters describe.

    For a mesh of the user's own, the fingertip is None.

    Raises:
        DermisError: a parameter is unknown, or a value is out of range.
    """
    if not isinstance(parameters, Mapping):
        raise DermisError("the skin's parameters are not a JSON object", where=where, value=type(parameters).__name__)
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
    """Condense a mesh to its pad nodes, for E = 1 Pa.

    Args:
        mesh: mesh of the tissue.
        material: material of the tissue, of which only Poisson's ratio is used.
        element: 'anp' or 'p1'.
        response: whether to compute the displacement of all free nodes as well, see `condense`.

    Raises:
        DermisError: the equations cannot be solved in double precision.
    """
    free = degrees(mesh.free)
    matrix = stiffness(mesh, material.unit, element)[free][:, free]
    try:
        return condense(matrix, np.searchsorted(mesh.free, mesh.pad), response=response)
    except DermisError as error:  # the mesh is held, see `check_mesh`, so rounding errors are the cause
        raise unsolvable(mesh, material.poisson) from error
