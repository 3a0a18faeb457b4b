"""The kernels called without `KernelBody`: with any library, and any arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array, Indices
from core.contact.solver.bodies import TIE, TURN
from core.contact.solver.smooth_contact import LOOKS, ROOM
from core.kernels import building, records
from core.skin.assembly import degrees, stiffness
from core.skin.material import Elastic
from core.skin.mesh_law import MeshLaw
from core.skin.rest_factor import RestFactor
from core.skin.tiles import Tiles
from core.surface import shapes
from core.surface.gap import DIRECTIONS, Surface
from core.surface.topology import Topology
from core.surface.triangles import TriangleTable
from tests.problems import cube_mesh

GIVEN = "compliance", "offset", "normals", "friction", "softness", "force"  # of a contact
TYPES = {"double": "f8", "float": "f4"} | {f"{kind}_t": kind for kind in ("int64", "int32", "int16", "int8", "uint8")}
WORKSPACES = "room", "sums", "work", "indices"  # nobody reads them after a call
SIZES: dict[int, int] = {}  # bytes of an array, by where it begins: a call in another process sends them there
Record = TypeVar("Record", bound=ctypes.Structure)


def address(array: Array) -> int:
    """Return where an array begins, and note how long it is."""
    found = int(array.ctypes.data)
    SIZES[found] = array.nbytes
    return found


def declared(record: type[ctypes.Structure] | ctypes.Structure) -> list[building.Field]:
    """Return the fields of a record."""
    kind = record if isinstance(record, type) else type(record)
    return next(records.HEADER.records[name] for name, own in records.RECORDS.items() if own is kind)


def filled(kind: type[Record], *owners: object, **values: Any) -> Record:
    """Return a record that points to arrays of the types that `kernels.h` declares, and keeps them.

    Args:
        owners: objects whose attributes are the fields that are not among the values.
        values: arrays, records and numbers.
    """
    record, kept = kind(), dict[str, Any]()
    for field in declared(kind):
        found = next((getattr(owner, field.name) for owner in owners if hasattr(owner, field.name)), None)
        value = values.pop(field.name, found)
        if isinstance(value, np.ndarray) and field.type.endswith("*"):
            wanted = TYPES.get(field.type.split()[-2], value.dtype.str)
            assert np.dtype(value.dtype.str.replace("b", "u")) == np.dtype(wanted), (field, value.dtype)
            assert value.flags.c_contiguous, field
            kept[field.name], value = value, address(value)
        elif isinstance(value, ctypes.Structure | ctypes.Array):
            kept[field.name], value = value, ctypes.addressof(value)
            SIZES[value] = ctypes.sizeof(kept[field.name])
        if value is not None:
            setattr(record, field.name, tuple(np.ravel(value).tolist()) if field.length > 1 else value)
    assert not values, values
    record.kept = kept
    return record


class Case:
    """Arrays for functions of a library, which gets every change that is made before a call.

    Attributes:
        results: names of the numbers that a call has found, in any of its records.
        called: records of the last call, the main one first.
    """

    results: tuple[str, ...] = ()
    called: list[Any]

    def call(self, own: Any, **changed: float | None) -> list[int]:
        """Return the statuses of all functions, with fields of the main record changed; the results stay."""
        self.called = []
        return list(self._calls(own, **changed))

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        """Call the functions of this case one after the other."""
        raise NotImplementedError

    def _call(self, function: Any, record: ctypes.Structure, **changed: float | None) -> int:
        """Return the status of a call."""
        if record not in self.called:
            self.called.append(record)
        for name, value in changed.items():
            setattr(record, name, value)
        return int(function(ctypes.byref(record)))

    @property
    def record(self) -> Any:
        """The main record of the last call."""
        return self.called[0]

    def answer(self) -> bytes:
        """Return everything that the last call has found."""
        found = list[Any]()
        for record in self.called:
            for field in declared(record):
                if not field.type.endswith("*"):
                    found += [getattr(record, field.name)] * (field.name in self.results)
                elif not field.type.startswith("const") and field.name not in WORKSPACES:
                    kept = record.kept.get(field.name, ())
                    found.append(() if isinstance(kept, ctypes.Structure) else kept)
        return b"".join(np.asarray(one).tobytes() for one in found)


@dataclass(eq=False)
class Arrays(Case):
    """The arrays of a body and a query."""

    vertices: Array
    triangles: Indices
    points: Array
    limit: float = np.inf
    index, friction, softness = 1, 0.5, 1e-9
    results = "middle", "scale", "largest", "by_rays", "met", "turned"

    def __post_init__(self) -> None:
        self.table = table = TriangleTable.build(self.vertices, self.triangles)
        self.topology = Topology.build(self.vertices, self.triangles)
        self.order = np.flatnonzero(table.usable)
        self.count, n = self.order.size, len(self.points)
        blocks = -(-self.count // records.LANES)
        self.depth = next(k for k in range(16) if blocks >> 2 * k <= 2)
        self.packed = np.full((self.count, records.ROW), np.nan)
        self.boxes = np.full(((4**self.depth - 1) // 3 + blocks, records.BOXES), np.nan, dtype=np.float32)
        self.normals = np.full((len(self.vertices), 3), np.nan)
        self.part = np.sort(np.unique(self.topology.parts[self.order], return_index=True)[1])
        along = self.vertices @ DIRECTIONS.T
        self.slab = np.column_stack([DIRECTIONS, along.min(axis=0), along.max(axis=0)])
        self.by_rays = False
        self.found = {name: np.full((n, 3), np.nan) for name in ("normal", "closest", "weights")}
        self.found |= {"gap": np.full(n, np.nan), "triangle": np.full(n, -7)}
        self.found |= {name: np.full(n, -7, dtype=np.int8) for name in ("feature", "beside")}

    def records(self, packed: bool = True) -> tuple[records.TreeRecord, records.BodyRecord, records.QueryRecord]:
        """Return the records of a call, with a tree or without one; they hold addresses only."""
        table, topology = self.table, self.topology
        made: dict[str, Any] = {"packed": self.packed, "boxes": self.boxes}
        if not packed:
            made = {"packed": None, "boxes": None, "largest": float(np.abs(self.vertices).max())}
        tree = filled(records.TreeRecord, self, table, total=table.usable.size, **made)
        counts = {"vertices": len(self.vertices), "parts": len(self.part), "slabs": len(self.slab)}
        made = {"normals": self.normals if packed else None, "by_rays": self.by_rays or not packed}
        body = filled(records.BodyRecord, self, topology, tree=tree, all=tree, weld=0.0, **counts, **made)
        return tree, body, filled(records.QueryRecord, self, body=body, count=len(self.points), **self.found)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        tree, body, query = self.records()
        for function, record in (("tree_split", tree), ("tree_fit", tree), ("body_fit", body)):
            status = self._call(getattr(own, f"dermis_{function}"), record)
            yield status
            if status:
                return
        yield self.measure(own, packed=False)
        if body.closed:
            yield self._call(own.dermis_body_judge, body)
            self.by_rays = bool(body.by_rays)
        yield self._call(own.dermis_distances, query)
        # the gaps of nodes at the points, to the body turned upside down about X
        n = len(self.points)
        self.told, self.which = np.full((7, n), np.nan), np.full((3, n), -7)
        numbers = {"count": n, "radius": max(0.0, self.limit), "side": -1.0 if self.by_rays else 1.0}
        pose = np.concatenate([np.diag([1.0, -1.0, -1.0]).ravel(), np.zeros(records.POSE - 9)])
        box = np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])
        places = np.ascontiguousarray(self.points * [1.0, -1.0, -1.0])
        arrays = {"pose": pose, "box": box, "points": places, "places": places, "came": np.arange(n) % 2}
        arrays["before"] = np.tile([0.0, 0.0, 1.0], (n, 1))
        gaps = filled(records.GapsRecord, self, body=body, **numbers, **arrays)
        yield self._call(own.dermis_node_gaps, gaps)

    def measure(self, own: Any, packed: bool) -> int:
        """Return the status of distances alone, by a tree that was made before, or without."""
        tree, _, query = self.records(packed)
        if packed and own.dermis_tree_fit(ctypes.byref(tree)):
            raise AssertionError
        return int(own.dermis_distances(ctypes.byref(query)))


def edge() -> tuple[Array, Indices]:
    """Return vertices and triangles of an edge."""
    surface = Surface.edge()
    return surface.vertices, surface.triangles


def drawn(seed: int) -> Arrays:
    """Return triangles and points of all sizes, with slivers, triangles without area and points on triangles."""
    rng = np.random.default_rng(seed)
    kind, count = seed % 4, int(rng.integers(1, 200))
    if kind == 0:
        vertices, triangles = shapes.sphere(5e-3, int(rng.integers(20, 900)))
        if seed % 8 == 0:  # two that run through each other
            triangles = np.concatenate([triangles, triangles + len(vertices)])
            vertices = np.concatenate([vertices, vertices + rng.uniform(-6e-3, 6e-3, 3)])
    elif kind == 1:
        vertices, triangles = edge()
    else:
        size = 10.0 ** rng.uniform(-9.0 if kind == 3 else -4.0, -1.0, (count, 1, 1))
        flat = np.where(rng.random((count, 1, 1)) < 0.3, 10.0 ** rng.uniform(-12, -4, (count, 1, 1)), 1.0)
        corners = (
            rng.normal(size=(count, 3, 3)) * size * np.concatenate([np.ones((count, 1, 2)), flat[:, :, :1]], axis=2)
        )
        vertices = (corners + 0.01 * rng.normal(size=(count, 1, 3))).reshape(-1, 3)
        triangles = np.arange(3 * count).reshape(-1, 3)
        triangles[rng.random(count) < 0.1, 1] = 0
    vertices = np.ascontiguousarray(
        vertices * 10.0 ** rng.uniform(-3, 3) + rng.normal(size=3) * 10.0 ** rng.uniform(-6, 1)
    )
    some = triangles[rng.integers(0, len(triangles), 40)]
    weights = np.concatenate(
        [rng.dirichlet(np.ones(3), 20), np.eye(3)[rng.integers(0, 3, 10)], np.full((10, 3), [0.5, 0.5, 0.0])]
    )
    on = np.einsum("nc,nci->ni", weights, vertices[some])
    size = float(np.ptp(vertices, axis=0).max())
    away = vertices.mean(axis=0) + rng.normal(size=(60, 3)) * size * 10.0 ** rng.uniform(-6, 3, (60, 1))
    points = np.ascontiguousarray(np.concatenate([on, away]))
    limit = np.inf if seed % 3 else size * 10.0 ** float(rng.uniform(-3, 0))
    return Arrays(vertices, np.ascontiguousarray(triangles), points, limit)


@dataclass(eq=False)
class Contact(Case):
    """The arrays of a contact."""

    compliance: Array
    offset: Array
    normals: Array
    friction: Array
    softness: Array
    force: Array
    nodes: Indices
    tolerance: float = 1e-9
    most: int = 60
    results = "residual", "sweeps", "missed", "wrong"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.force)
        given, step = self.nodes.size, self.compliance.itemsize
        few = given < n
        self.image, self.moved = np.full((2, n, 3), np.nan)
        numbers = {"count": n, "given": given, "single": step == 4, "stride": self.compliance.strides[0] // step}
        room = np.full((9 * records.KEPT + 12 + few * (14 + (9 * given * step + 7) // 8)) * given + few, np.nan)
        status = np.full(n, -7, dtype=np.int8)
        record = filled(records.ContactRecord, self, **numbers, room=room, status=status)
        yield self._call(own.dermis_sweep, record, **changed)


def drawn_contact(seed: int) -> Contact:
    """Return nodes of all kinds: few and many, without friction and with much, soft ones, and some far from all."""
    rng = np.random.default_rng(seed)
    n, scale = int(rng.integers(1, 40)), 10.0 ** rng.uniform(-5, -1)
    basis = rng.normal(size=(3 * n, 6 * n))
    compliance = scale * (basis @ basis.T / (6 * n) + 0.1 * np.eye(3 * n))
    room = np.full((3 * n, 3 * n + int(rng.integers(0, 9))), np.nan)
    room[:, : 3 * n] = compliance
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(n) < 0.1] = 0.0
    offset = rng.normal(size=(n, 3)) * 1e-3 - 5e-4 * normals
    friction = rng.choice([0.0, 0.3, 1.0, 5.0], n)
    softness = np.where(rng.random(n) < 0.3, scale * rng.random(n), 0.0)
    start = rng.normal(size=(n, 3)) * (seed % 2)
    nodes = np.flatnonzero(rng.random(n) < 0.7) if seed % 4 else np.arange(n)
    compliance = room.astype(np.float32) if seed % 3 else room
    return Contact(compliance, offset, normals, friction, softness, start, nodes)


@dataclass(eq=False)
class Survey(Case):
    """The arrays of a pad's survey: square cells on a bowl at rest, an edge and a plane near it."""

    positions: Array
    normals: Array
    sides: Array
    limits: Array
    longs: Array
    tiles: Tiles
    solid: Arrays
    poses: Array
    finest: int
    sharpness: float
    rounding: float
    alone: int
    limit, turned, edge, bent, corners, beyond = 2.5e-3, 0.3, 0.9, 0.04e-3, 0.75, 0.4e-3
    beside, odd, above, deep, steep, coarsest, many, round = 0.35, 0.4, 3e-3, 0.02e-3, 0.3, 1, 450, 1.0 / 3.0
    results = "found", "finest"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        tiles = self.tiles
        roots = self.tiles.first[1, 1]
        posed = posed_pair(own, self.solid, self.poses, self.sharpness, self.rounding)
        found = {"leaves": np.zeros(4 * roots, dtype=np.int64), "clearance": np.zeros(4 * roots)}
        found |= {"room": np.zeros((2, 4 * roots), dtype=np.int64)}
        numbers = {"bodies": 2 - self.alone, "roots": roots, "levels": tiles.levels, "most": 4 * roots}
        names = "first", "ways", "root", "halved", "place"
        arrays = {name: np.ascontiguousarray(getattr(tiles, name)) for name in names}
        record = filled(records.SurveyRecord, self, posed=posed, **numbers, **arrays, **found)
        yield self._call(own.dermis_find_cells, record, **changed)


def drawn_survey(seed: int) -> Survey:
    """Return a pad of 12 by 12 cells of 0.8 mm, and an edge, alone or with a plane: far off, near and in the skin."""
    rng, across, side = np.random.default_rng(seed), 12, 0.8e-3
    tiles = Tiles(np.cumsum([0, *(across**2 * 4**k for k in range(4))]).tolist())
    size = side / 2.0**tiles.halved
    corner = np.stack(np.divmod(tiles.root, across), axis=1) * side - 0.5 * across * side
    flat = corner + (tiles.place + 0.5) * size
    positions = np.column_stack([flat, 2.0 * (flat**2).sum(axis=1)])
    normals = np.column_stack([-4.0 * flat, np.ones(len(flat))])
    normals = -normals / np.linalg.norm(normals, axis=1)[:, None]
    sides = np.zeros((len(flat), 2, 3))
    sides[:, 0, 0], sides[:, 1, 1] = size.T
    poses = rng.uniform(-1.5e-3, 1.5e-3, (2, 3))
    return Survey(
        positions,
        normals,
        sides,
        0.4 * size.max(axis=1) + 0.1e-3,
        size.max(axis=1),
        tiles,
        Arrays(*edge(), np.zeros((1, 3))),
        poses,
        int(rng.integers(1, 4)),
        float(rng.choice([1.0 / 3.0, 1.0])),
        float(rng.choice([0.0, 0.5e-3])),
        seed % 3 // 2,
    )


@dataclass(eq=False)
class Touch(Case):
    """Points of smooth skin that look at bodies, and the forces that these exert on them.

    Attributes:
        rounding: of the plane's rim [m]; 0: the plane is infinite.
        plane: whether the plane is the only body.
    """

    points: Array
    inward: Array
    spread: Array
    areas: Array
    where: Array
    drag: Array
    shift: Array
    force: Array
    body: Indices
    compliance: NDArray[np.float32]
    solid: Arrays
    poses: Array
    sharpness: float
    rounding: float
    bodies: int
    plane: bool = False
    limit, lift, ratio, tolerance, most, avx2 = 2.5e-3, 0.3e-3, 6.0, 1e-4, 60, 0
    results = "residual", "sweeps", "looks"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.points)
        pair = posed_pair(own, self.solid, self.poses, self.sharpness, self.rounding)
        posed = pair[1] if self.plane else pair
        found = {name: np.full((n, 3), np.nan) for name in ("normal", "image", "moved")}
        found |= {name: getattr(self, name).copy() for name in ("where", "force", "body")}
        found |= {"clearance": np.full(n, np.nan), "triangle": np.full(n, -7), "status": np.full(n, -7, np.int8)}
        work = {"slots": np.full((n, LOOKS), -1), "room": np.full((n, ROOM), np.nan)}
        work |= {"work": np.full((3 * records.KEPT + 7, n, 3), np.nan), "active": np.full(n, -1)}
        work |= {"gathered": np.full((3 * n, 3 * n), np.nan, np.float32)}
        numbers = {"count": n, "stride": self.compliance.shape[1], "width": 8 * ROOM}
        look = filled(records.TouchRecord, self, posed=posed, compliance=None, **numbers, **found, **work)
        status = self._call(own.dermis_touch_points, look, **changed)
        yield status
        if status:
            return
        solve = filled(records.TouchRecord, self, posed=posed, looked=1, **numbers, **found, **work)
        yield self._call(own.dermis_touch_points, solve, **changed)


def drawn_touch(seed: int) -> Touch:
    """Return points of a bowl, on cells of all sizes, and an edge, a plane or both: away, touching or deep."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 30))
    flat = rng.uniform(-3e-3, 3e-3, (n, 2))
    normals = np.column_stack([4.0 * flat, -np.ones(n)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    spread = np.zeros((n, 2, 3))
    spread[:, 0, 0] = spread[:, 1, 1] = 0.25e-3
    reach = np.linalg.norm(flat[:, None] - flat, axis=2)
    matrix = np.kron(np.exp(-((reach / 2e-3) ** 2)) + 0.2 * np.eye(n), np.diag([1.0, 1.2, 0.8]))
    compliance = np.full((3 * n, 3 * n + int(rng.integers(0, 9))), np.nan, np.float32)
    compliance[:, : 3 * n] = 10.0 ** rng.uniform(-4, -2) * matrix
    return Touch(
        np.column_stack([flat, 2.0 * (flat**2).sum(axis=1)]),
        -normals,
        spread,
        10.0 ** rng.uniform(-8, -6, n),
        1e-4 * rng.normal(size=(n, 3)),
        1e-4 * rng.normal(size=(n, 3)) * (seed % 2),
        1e-4 * rng.normal(size=(n, 3)) * (seed % 4 == 0),
        0.1 * rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.5),
        rng.integers(-1, 2, n),
        compliance,
        Arrays(*edge(), np.zeros((1, 3))),
        np.column_stack([rng.uniform(-1e-3, 1e-3, (2, 2)), rng.uniform(-1e-3, 1.5e-3, 2)]),
        float(rng.choice([1.0 / 3.0, 0.6, 1.0])),
        float(rng.choice([0.0, 0.5e-3])),
        int(rng.integers(1, 3)),
    )


def posed_pair(
    own: Any, solid: Arrays, poses: Array, sharpness: float, rounding: float
) -> ctypes.Array[records.PosedRecord]:
    """Return the records of a body and of a rough and soft plane or disc below it."""
    assert not any(solid.call(own))
    _, body, _ = solid.records()
    turn = {"rotation": np.eye(3), "side": 1.0, "tie": TIE, "turn": TURN}
    edge = filled(records.PosedRecord, body=body, translation=poses[0], sharpness=sharpness, **turn)
    soft = {"sharpness": 1.0 / 3.0, "friction": 0.7, "softness": 1e-9, "radius": 2e-3, "rounding": rounding}
    plane = filled(records.PosedRecord, plane=[0.0, 0.0, 1.0, -2e-3], translation=poses[1], **soft, **turn)
    pair = (records.PosedRecord * 2)(edge, plane)
    pair.kept = edge.kept  # the array copies addresses alone
    return pair


@dataclass(eq=False)
class Law(Case):
    """The arrays of the law on a mesh."""

    corners: NDArray[np.int32]
    slopes: NDArray[np.float32]
    volumes: NDArray[np.float32]
    around: NDArray[np.float32]
    moved: NDArray[np.float32]
    elements: int
    results = "energy", "flattest"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.around)
        self.force, self.stress = np.full((n, 3), np.nan, np.float32), np.full((self.elements, 6), np.nan)
        room = np.full(9 * self.volumes.size + 8 * n, np.nan, np.float32)
        record = filled(records.LawRecord, self, nodes=n, first=8.0, shear=0.34, least=0.06, room=room, stored=1)
        yield self._call(own.dermis_evaluate_law, record, **changed)


def drawn_law(seed: int) -> Law:
    """Return a block of tissue that is hardly moved, much, or inside out."""
    rng = np.random.default_rng(seed)
    mesh = cube_mesh(int(rng.integers(1, 5)), 10.0 ** rng.uniform(-4, 1), 0.1)
    law = MeshLaw(mesh, 0.45)
    size = 10.0 ** rng.uniform(-12, 1) * float(np.ptp(mesh.nodes, axis=0).max())
    moved = (rng.normal(size=mesh.nodes.shape) * size).astype(np.float32)
    return Law(*(table.copy() for table in law.tables), moved, len(mesh.tetrahedra))


@dataclass(eq=False)
class Rest(Case):
    """The arrays of linear tissue and forces on it."""

    factor: RestFactor
    force: NDArray[np.float32]

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        arrays = {name.lstrip("_"): array for name, array in vars(self.factor).items() if isinstance(array, np.ndarray)}
        numbers = {"size": self.factor.size, "levels": len(arrays["starts"]) - 1}
        numbers |= {"numbers": arrays["inverses"].size, "couplings": arrays["values"].size}
        room, moved = (np.full(size, np.nan, np.float32) for size in (3 * self.factor.slots, self.force.size))
        record = filled(records.RestRecord, self, **arrays, **numbers, room=room, moved=moved)
        yield self._call(own.dermis_rest_solve, record, **changed)


def drawn_rest(seed: int) -> Rest:
    """Return a block of tissue that is held below, and forces on all of its nodes."""
    rng = np.random.default_rng(seed)
    mesh = cube_mesh(int(rng.integers(2, 6)), 10.0 ** rng.uniform(-3, 0), 0.1)
    free = degrees(mesh.free)
    matrix = stiffness(mesh, Elastic(1.0, 0.48, 1.0))[free][:, free].tocsr()
    force = (rng.normal(size=len(free)) * 10.0 ** rng.uniform(-20, 5)).astype(np.float32)
    return Rest(RestFactor(matrix, np.searchsorted(mesh.free, mesh.pad)), force)


@dataclass(eq=False)
class Pieces(Case):
    """Pieces of skin that press each other: far ones, near ones, and each on itself."""

    positions: Array
    normals: Array
    sides: Array
    areas: Array

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.areas)
        field = filled(records.PatchesRecord, self, count=n)
        out = np.full((n, 3, n, 3), np.nan)
        record = filled(records.PiecesRecord, self, field=field, source=field, poisson=0.48, out=out)
        yield self._call(own.dermis_press_pieces, record, **changed)


def drawn_pieces(seed: int) -> Pieces:
    """Return pieces whose sides differ by up to a hundred times, some at one place."""
    rng, n = np.random.default_rng(seed), 12
    positions = 1e-3 * rng.normal(size=(n, 3))
    positions[1] = positions[0]
    normals = rng.normal(size=(n, 3)) + [0.0, 0.0, 3.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sides = 10.0 ** rng.uniform(-5, -3, (n, 1, 1)) * (np.eye(3)[:2] + 0.1 * rng.normal(size=(n, 2, 3)))
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return Pieces(positions, normals, np.ascontiguousarray(sides), areas)


@dataclass(eq=False)
class CellRows(Case):
    """Rows of the compliance between cells of a pad, of which some are written as columns as well.

    Attributes:
        pieces: the cells.
        smooth: rest of their compliance.
        mirrored: number of columns that are written twice.
    """

    pieces: Pieces
    field: Indices
    source: Indices
    smooth: NDArray[np.float32]
    spring: Array
    mirrored: int
    poisson, factor, avx2 = 0.48, 3e-5, 0

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        rows, columns, stride = len(self.field), len(self.source), 3 * max(len(self.source), len(self.field)) + 2
        cells = filled(records.PatchesRecord, self.pieces, count=len(self.pieces.areas))
        self.out, self.mirror = (np.full((3 * n, stride), np.nan, np.float32) for n in (rows, self.mirrored))
        record = filled(records.CellsRecord, self, cells=cells, rows=rows, columns=columns, stride=stride)
        yield self._call(own.dermis_compliance_rows, record, **changed)


def drawn_rows(seed: int) -> CellRows:
    """Return cells that occur several times, more of them than are computed at once."""
    rng, pieces = np.random.default_rng(seed), drawn_pieces(seed)
    rows, columns = int(rng.integers(1, 9)), int(rng.integers(1, 90))
    field, source = (rng.integers(0, len(pieces.areas), n) for n in (rows, columns))
    smooth = (1e3 * rng.normal(size=(rows, 3, 3, columns))).astype(np.float32)
    spring = 1e-3 * rng.normal(size=(3, 3)) * (seed % 3 == 0)
    return CellRows(pieces, field, source, smooth, spring, int(rng.integers(0, columns + 1)))


@dataclass(eq=False)
class Changed(Case):
    """Points of a pad of which some are removed and others added: compliance, forces and state.

    Attributes:
        places, former: points that fill the places of removed ones, and their indices before.
        matrix: compliance before.
        state: arrays of the points, of some bytes a point each.
    """

    tiles: Tiles
    places: Indices
    former: Indices
    matrix: NDArray[np.float32]
    left: Indices
    sources: Indices
    entered: Indices
    force: Array
    widths: Indices
    blank: Indices
    order: Indices
    state: NDArray[np.uint8]

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        count, tiles = len(self.matrix) // 3 - len(self.sources), self.tiles
        self.kept = np.full((3 * count, 3 * count), np.nan, np.float32)
        numbers = {"count": count, "moved": len(self.places), "width": self.matrix.shape[1], "stride": 3 * count}
        moves = filled(records.MovesRecord, self, given=self.matrix, out=self.kept, **numbers)
        yield self._call(own.dermis_move_points, moves, **changed)
        n = len(self.entered)
        self.inherited, self.main, self.load = np.full((n, 3), np.nan), np.full(n, -7), np.full(n, np.nan)
        numbers = {"tiles": tiles.count, "leaving": len(self.left), "entering": n, "former": len(self.force)}
        yield self._call(own.dermis_succeed, filled(records.HeirsRecord, self, tiles, **numbers))
        self.moved = np.full(int(self.widths.sum()) * len(self.order), 7, np.uint8)
        numbers = {"count": len(self.order), "before": len(self.state) // int(self.widths.sum())}
        states = {"arrays": len(self.widths), "former": self.order, "given": self.state, "out": self.moved}
        yield self._call(own.dermis_rearrange, filled(records.StatesRecord, self, **numbers, **states))


def drawn_change(seed: int) -> Changed:
    """Return points of a small pad of which some leave, and cells of all sizes that may overlap these."""
    rng, tiles = np.random.default_rng(seed), Tiles((0, 9, 45, 189))
    n, leaving, entering = int(rng.integers(2, 40)), int(rng.integers(1, 9)), int(rng.integers(0, 40))
    leaving = min(leaving, n)
    sources = np.sort(rng.choice(n, leaving, replace=False))
    stay = np.setdiff1d(np.arange(n), sources)
    count = n - leaving
    matrix = rng.normal(size=(3 * n, 3 * n + int(rng.integers(0, 5)))).astype(np.float32)
    widths, blank = np.array([8, 24, 1, 8]), np.array([255, 0, 0, 0])
    return Changed(
        tiles,
        sources[sources < count],
        stay[stay >= count],
        matrix,
        rng.choice(tiles.count, leaving, replace=False),
        sources,
        rng.choice(tiles.count, entering, replace=False),
        rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.6),
        widths,
        blank,
        np.concatenate([stay, rng.integers(-1, n, entering)]),
        rng.integers(0, 256, n * int(widths.sum())).astype(np.uint8),
    )


@dataclass(eq=False)
class DrawnSkin(Case):
    """A surface of random triangles, the matrix that refines it, and forces on a pad."""

    points: Array
    corners: NDArray[np.int32]
    rest: Array
    starts: NDArray[np.int32]
    columns: NDArray[np.int32]
    weights: Array
    pad_positions: Array
    pad_normals: Array
    force: Array
    table: NDArray[np.float32] | None
    quantity: int
    given: tuple[Array, Array]
    normal_force, modulus, exaggeration, lift = 2.0, 3e4, 1.5, 2e-3
    results = "low", "high", "centre", "shear"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        nodes, drawn = len(self.points), len(self.rest)
        self.moved, self.values = (a.copy() for a in self.given)
        self.positions, self.normals, self.shown = (np.full((drawn, k), np.nan) for k in (3, 3, 1))
        numbers = {"nodes": nodes, "triangles": len(self.corners), "drawn": drawn}
        numbers |= {"entries": len(self.columns), "pad": len(self.force)}
        work = {"sums": np.full((nodes, 9), np.nan, np.float32), "room": np.full((nodes, 8), np.nan)}
        record = filled(records.DrawnRecord, self, **numbers, **work)
        yield self._call(own.dermis_draw_skin, record, **changed)


def drawn_skin(seed: int) -> DrawnSkin:
    """Return a skin with or without a table, of which every quantity occurs; the first has no force."""
    rng = np.random.default_rng(seed)
    nodes, drawn, pad = int(rng.integers(3, 40)), int(rng.integers(1, 90)), int(rng.integers(1, 20))
    starts = np.concatenate([[0], np.cumsum(rng.integers(0, 9, drawn))]).astype(np.int32)
    columns = rng.integers(0, nodes, starts[-1]).astype(np.int32)
    normals = rng.normal(size=(pad, 3))
    force = rng.normal(size=(pad, 3)) * (rng.random((pad, 1)) < 0.6) * 10.0 ** rng.uniform(-20, 5)
    return DrawnSkin(
        1e-3 * rng.normal(size=(nodes, 3)),
        rng.integers(0, nodes, (int(rng.integers(1, 60)), 3)).astype(np.int32),
        1e-3 * rng.normal(size=(drawn, 3)),
        starts,
        columns,
        rng.normal(size=len(columns)),
        1e-3 * rng.normal(size=(pad, 3)),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        force * (seed > 0),
        rng.normal(size=(3 * pad, 9 * nodes)).astype(np.float32) if seed % 3 else None,
        seed % 9 - 1,
        (1e-3 * rng.normal(size=(nodes, 3)), rng.normal(size=nodes)),
    )


def opened(path: Path) -> ctypes.CDLL:
    """Load a library of kernels as it is."""
    library = ctypes.CDLL(str(path))
    for name in records.HEADER.functions:
        getattr(library, name).argtypes = (ctypes.c_void_p,)
    return library


def gcc(out: Path, *flags: str) -> list[str]:
    """Return the command by which gcc makes a library of the sources, and of others among the flags."""
    made = out.with_name("described.c")
    made.write_text(building.described())
    files = [str(path) for path in (*building.sources(), made) if path.suffix == ".c"]
    return ["gcc", *building.FLAGS, "-fPIC", f"-I{building.FOLDER}", *flags, "-o", str(out), *files]


@dataclass(eq=False)
class Friction(Case):
    """The friction history of some nodes, and a frame."""

    arrays: dict[str, Array]
    radius, share, drift, passed = 1e-3, 0.7, (1e-4, -2e-4, 0.0), (2e-4, 1e-4, 1e-5)
    results = "drift", "passed", "shifted", "slides", "normal", "tangential", "depth", "slide", "sticking", "slipping"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        arrays, n = self.arrays, len(self.arrays["gap"])
        numbers = {"count": n, "bodies": len(arrays["poses"]), "entered": len(arrays["entering"])}
        record = filled(records.FrictionRecord, self, **numbers, **arrays)
        for function in (own.dermis_expect, own.dermis_offset, own.dermis_foresee, own.dermis_keep, own.dermis_drift):
            yield self._call(function, record, **changed)
            changed = {}
        given = {name: arrays[name] for name in ("points", "force", "image", "gaps", "status")}
        frame = {"normals": arrays["facing"], "displacement": arrays["moved"], **given}
        self.sums = filled(records.SumsRecord, count=n, from_rest=n % 2, **frame)
        yield self._call(own.dermis_sum, self.sums)


@dataclass(eq=False)
class Arrivals(Case):
    """Nodes of which some come into contact."""

    arrays: dict[str, Array]
    compliance: NDArray[np.float32]
    results = ("entered",)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n, arrays = len(self.compliance) // 3, self.arrays
        self.entering, self.crossing = np.full(n, -7), np.full((n, 3), np.nan)
        names = "status", "loaded", "owner", "below", "friction", "moved", "force", "gap", "soft"
        given = {name: arrays[name] for name in names} | {"normals": arrays["facing"]}
        numbers = {"count": n, "stride": self.compliance.shape[1]}
        yield self._call(own.dermis_arrive, filled(records.ArrivalsRecord, self, **given, **numbers), **changed)


def drawn_arrivals(seed: int) -> Arrivals:
    """Return the nodes of `drawn_friction` and a compliance."""
    rng, arrays = np.random.default_rng(seed), drawn_friction(seed).arrays
    n = len(arrays["gap"])
    return Arrivals(arrays, (1e-3 * rng.normal(size=(3 * n, 3 * n + seed % 4))).astype(np.float32))


def drawn_friction(seed: int) -> Friction:
    """Return nodes that stick, slip and are off three bodies, of which one is stretched and one may be away."""
    rng = np.random.default_rng(seed)
    n, scale = int(rng.integers(1, 60)), 10.0 ** rng.uniform(-5, -2)
    poses = np.zeros((3, records.POSE))
    for k, row in enumerate(poses):
        carry = np.eye(3) + (k == 1) * 0.2 * rng.normal(size=(3, 3))
        row[:9], row[9:12] = np.linalg.qr(rng.normal(size=(3, 3)))[0].ravel(), scale * rng.normal(size=3)
        row[12:21], row[21:30] = carry.ravel(), np.linalg.inv(carry).ravel()
    poses[2, 30] = seed % 2
    owner, below = rng.integers(-1, 2 + seed % 3 // 2, (2, n))
    below[: n // 2] = owner[: n // 2]
    facing = rng.normal(size=(n, 3))
    facing /= np.linalg.norm(facing, axis=1)[:, None]
    force = np.where(rng.random((n, 1)) < 0.7, facing + 0.3 * rng.normal(size=(n, 3)), 0.0)
    arrays: dict[str, Array] = {"poses": poses, "owner": owner, "below": below, "facing": facing, "force": force}
    for name in ("material", "normal", "slip", "swept", "points", "image", "moved", "offset"):
        arrays[name] = scale * rng.normal(size=(n, 3))
    for name in ("anchors", "normals", "places", "origins", "sweeping", "shift", "positions", "crossing"):
        arrays[name] = scale * rng.normal(size=(n, 3))
    for name in ("gap", "gaps", "own", "soft", "friction"):
        arrays[name] = scale * rng.random(n) - (name == "gaps") * scale / 2
    for name in ("triangle", "faces", "nodes"):
        arrays[name] = rng.integers(0, 99, n)
    arrays["corners"], arrays["entering"] = rng.integers(0, 99, (n, 3)), rng.permutation(n)[: n // 4]
    for name in ("sticking", "loaded", "renewed"):
        arrays[name] = rng.integers(0, 2, n).astype(np.uint8)
    arrays["status"] = rng.integers(0, 3, n).astype(np.int8)
    return Friction(arrays)


@dataclass(eq=False)
class Pressed(Case):
    """A disc that presses on points of skin, and the step after it."""

    positions: Array
    places: Array
    anchors: Array
    anchored: NDArray[np.bool_]
    sticking: NDArray[np.bool_]
    near: Indices
    compliance: Array
    less: Array | None
    pose: Array
    told: Array
    friction: float
    weight: float
    freedoms: int
    radius, rounding, margin, tolerance, most = 4e-3, 1e-3, 1e-4, 1e-9, 10
    results = "residual", "steps", "strays", "touching"

    def disc(self) -> Any:
        """Return the record of the disc."""
        points, n, free = len(self.positions), len(self.near), self.freedoms
        rows = (3 * self.near[:, None] + np.arange(3)).ravel()
        self.gap, self.answers = np.full(points, np.nan), np.full((n, 3, 1 + free), np.nan)
        self.moved, self.status = np.full((n, 3), np.nan), np.full(n, 7, np.int8)
        part = np.ascontiguousarray(self.compliance[np.ix_(rows, rows)])
        numbers = {"points": points, "count": n, "turning": 2 if free == 3 else free}
        numbers["leading"] = self.told.shape[2] - 1
        work = {"room": np.full((60 + 3 * free + 18 * n) * n, np.nan), "indices": np.full(8 * n, 2**62)}
        out = {"answer": self.answers, "offset": np.full((n, 3), np.nan)}
        return filled(records.DiscRecord, self, compliance=part, **numbers, **work, **out)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        points, n, free, record = len(self.positions), len(self.near), self.freedoms, self.disc()
        status = self._call(own.dermis_press_disc, record, **changed)
        yield status
        if status or record.strays:
            return
        after = {"moved": np.full((points, 3), np.nan), "force": np.full((points, 3), np.nan)}
        after |= {"anchor": np.full((points, 2), np.nan), "sticks": np.full(points, 7, np.uint8)}
        fixed = {"points": points, "count": n, "width": 1 + free, "answer": self.answers}
        yield self._call(own.dermis_settle_disc, filled(records.SettledRecord, self, **fixed, **after))


def drawn_pressed(seed: int) -> Pressed:
    """Return a bowl of skin and a disc: above it, touching or deep, with and without friction, anchors and history."""
    rng = np.random.default_rng(seed)
    points, free = int(rng.integers(4, 40)), 6 if seed % 3 == 0 else 3
    flat = rng.uniform(-6e-3, 6e-3, (points, 2))
    positions = np.column_stack([flat, 12.0 * (flat**2).sum(axis=1)])
    places = positions + 1e-4 * rng.normal(size=(points, 3))
    reach = np.linalg.norm(positions[:, None] - positions, axis=2)
    spread = np.exp(-((reach / 3e-3) ** 2)) + 0.2 * np.eye(points)
    compliance = np.ascontiguousarray(np.kron(spread, np.diag([1.0, 1.2, 0.8]))) * 1e-3
    anchored = rng.random(points) < 0.8 if seed % 2 else np.zeros(points, np.bool_)
    sticking = anchored & (rng.random(points) < 0.5)
    anchors = np.where(anchored[:, None], flat + 1e-4 * rng.normal(size=(points, 2)), 0.0)
    turn = np.linalg.qr(np.eye(3) + 0.1 * rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.diag(turn))
    centre = np.array([*(5e-4 * rng.normal(size=2)), float(rng.choice([-1e-3, 2e-4, 1e-3]))])
    spin, shift = rng.normal(size=(free, 3)), rng.normal(size=(3, free))
    if free == 3:
        spin[2] = 0.0
    pose = np.concatenate([turn.ravel(), centre, spin.ravel(), shift.ravel(), 1e-5 * rng.normal(size=free)])
    near = np.arange(points) if seed % 5 else np.flatnonzero(rng.random(points) < 0.9)
    told = 0.01 * rng.normal(size=(len(near), 3, 1 + free * (seed % 2)))
    less = 1e-5 * rng.normal(size=(points, 3)) if seed % 4 == 0 else None
    friction, weight = float(rng.choice([0.0, 0.4, 1.0])), 1.0 / float(np.median(np.diag(compliance)))
    fixed = positions, places, anchors, anchored, sticking, near, compliance, less, pose, told
    return Pressed(*fixed, friction, weight, free)


@dataclass(eq=False)
class Searched(Case):
    """A search for a thimble's pose: of a disc on points of skin, or of a map that the caller evaluates.

    Attributes:
        pressed: disc and points; None for the map.
        matrix: of the map from pitch, roll, and distance over 0.01 m (k, 3).
        observation: of the disc's contact (points, 3, k).
        earlier: target and derivative of an earlier search that ended at the start; None for none.
    """

    pressed: Pressed | None
    matrix: Array
    observation: Array
    target: Array
    x: Array
    low: Array
    high: Array
    earlier: tuple[Array, Array] | None
    bounded: int
    follows: int
    foreseen: float
    least: float = 0.03
    most_evaluations: int = 16
    reach, optimal, small_step, exact, small_gain, hardly, later = 1.0, 3e-3, 1e-4, 1e-6, 1e-3, 2.5e-3, 1e-2
    least_reach, nearly, shortest, longest, armijo, damping, most_steps = 0.25, 0.8, 1.0 / 64.0, 0.35, 1e-4, 1e-9, 20
    on_limit = 1e-9
    results = (
        "x",
        "at",
        "pose",
        "room",
        "angles",
        "slopes",
        "multipliers",
        "active",
        "actives",
        "bounded",
        "why",
        "own",
    )
    results += (
        "held",
        "residual",
        "steps",
        "reach",
        "start_cost",
        "cost",
        "kkt",
        "iterations",
        "evaluations",
        "presses",
    )

    def value(self, x: Array) -> tuple[Array, Array]:
        """Return the map at a configuration, shape (k,), and its derivative, shape (3, k).

        They are rounded once, and in the same way in every floating-point environment.
        """
        if not (np.abs(self.matrix) < 1e100).all():
            return np.full(len(self.matrix), np.nan), np.full((3, len(self.matrix)), np.nan)
        units, middle = (1, 1, 100), (0, 0, Fraction(18, 1000))
        at = [unit * (Fraction(v) - zero) for unit, v, zero in zip(units, x.tolist(), middle, strict=True)]
        rows = [[Fraction(v) for v in row] for row in self.matrix.tolist()]
        y = [sum((a * b for a, b in zip(row, at, strict=True)), Fraction(0)) for row in rows]
        slopes = [
            [float(unit * row[j] * (1 + v)) for row, v in zip(rows, y, strict=True)] for j, unit in enumerate(units)
        ]
        return np.array([float(v + v * v / 2) for v in y]), np.array(slopes)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        size = len(self.target)
        mount = [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.018]
        links = {"platform_radius": 0.01, "base_radius": 0.015, "crank": 0.01, "rod": 0.02, "bend": 1.0, "side": 1.0}
        thimble = filled(records.ThimbleRecord, servo_zero=0.4024712149242631, least=self.least, mount=mount, **links)
        arrays: dict[str, Any] = {name: np.full((4, size), np.nan) for name in ("values", "trial_values")}
        arrays["answer"] = None
        if self.earlier is not None:
            arrays |= dict(zip(("before", "slope"), self.earlier, strict=True))
        disc = None
        if self.pressed is not None:
            disc, n = self.pressed.disc(), len(self.pressed.near)
            arrays |= {"answer": np.full((n, 3, 4), np.nan), "moved": np.full((n, 3), np.nan)}
            arrays |= {"status": np.full(n, 7, np.int8)}
        record = filled(records.SearchRecord, self, thimble=thimble, disc=disc, size=size, **arrays)
        status = self._call(own.dermis_descend, record, **changed)
        while status == records.ASKS and disc is None:
            arrays["trial_values"][0], arrays["trial_values"][1:] = self.value(np.array(record.trial))
            status = self._call(own.dermis_descend, record)
        yield records.DONE if status == records.ASKS else status  # Newton's method does not solve a contact


def drawn_search(seed: int) -> Searched:
    """Return a search within wide or narrow limits, alone or after another one, by a disc or a map."""
    rng = np.random.default_rng(seed)
    k, pressed = int(rng.integers(3, 20)), drawn_pressed(6 * seed + 1) if seed % 2 else None
    points = 1 if pressed is None else len(pressed.positions)
    if pressed is not None:
        pressed.near, pressed.told = np.arange(points), np.zeros((points, 3, 1))
    x = np.array([*rng.uniform(-0.1, 0.1, 2), 0.018 - rng.uniform(0.0, 1e-3)])
    matrix = rng.normal(size=(k, 3))
    target = 0.3 * matrix @ rng.normal(size=3) + 0.1 * rng.normal(size=k)
    slope = np.ascontiguousarray(matrix.T) * np.array([[1.0], [1.0], [100.0]])
    earlier = (target + 0.01 * rng.normal(size=k), slope) if seed % 3 else None
    wide = 0.7 if seed % 4 < 2 else 0.1
    limits = np.full(3, -wide), np.full(3, wide)
    observation = rng.normal(size=(points, 3, k))
    foreseen = 0.02 if seed % 5 == 0 else 0.0
    return Searched(pressed, matrix, observation, target, x, *limits, earlier, seed % 7 == 0, seed % 3 == 0, foreseen)
