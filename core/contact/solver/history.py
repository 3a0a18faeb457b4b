"""ContactHistory: anchors of friction, the points of bodies' material to which nodes stick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import byref

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from ...surface.gap import Surface
from ...surface.plane import Plane
from ...surface.topology import cut_otherwise
from .bodies import ContactBody, NodeGaps, corners_of, from_material, owned, to_material, unplaced

# The arrays of a history in the order of the kernels' record, with the numbers of a node, and types. `_local` has no
# field there. All lie in one block, with `sticking` of one byte a node at its end.
_ARRAYS: tuple[tuple[str, int, type[np.generic]], ...] = (
    ("_local", 3, np.float64),
    ("body", 1, np.int64),
    ("_material", 3, np.float64),
    ("_normal", 3, np.float64),
    ("gap", 1, np.float64),
    ("slip", 3, np.float64),
    ("swept", 3, np.float64),
    ("_triangle", 1, np.int64),
    ("_corners", 3, np.int64),
    ("sticking", 1, np.bool_),
)
# Bytes of a node in each of these arrays, and the byte that fills it without a history: integers are then -1.
_WIDTHS = np.array([np.dtype(kind).itemsize * width for _, width, kind in _ARRAYS], dtype=np.int64)
_BLANK = np.array([255 if kind is np.int64 else 0 for _, _, kind in _ARRAYS], dtype=np.int64)
_NODE = int(_WIDTHS.sum())
_STARTS = [*np.cumsum(_WIDTHS).tolist()]  # of all arrays but the first, in bytes a node; the last one is the end
NOTHING = np.zeros(0, dtype=np.int64), np.zeros((0, 3))  # no node is shifted


class ContactHistory:
    """Anchors of the nodes in the material of the bodies, with which they move, turn and stretch.

    A sticking node keeps its anchor, so that errors of frames do not add up to creep. The anchor of a slipping node
    follows the node. The anchor of an open node is the material below it. Slip after a contact that begins between two
    frames is then counted from this anchor.

    Args:
        count: number of nodes, m.

    Attributes:
        body: index of the body of each anchor, shape (m,); -1 without an anchor.
        gap: gap of each node above its anchor in the last frame [m], shape (m,).
        sticking: whether each node stuck in the last frame, shape (m,).
        slip: slip of each node in the last frame [m], shape (m, 3).
        swept: slip that each node would have had if the skin had not moved [m], shape (m, 3).
    """

    body: Indices
    gap: Array
    sticking: NDArray[np.bool_]
    slip: Array
    swept: Array
    _material: Array
    _triangle: Indices
    _corners: Indices  # vertices of the triangle when the anchor was set
    _local: Array  # last position on a deforming body at its first scale
    _normal: Array  # out of the body, in its axes

    def __init__(self, count: int, block: NDArray[np.uint8] | None = None) -> None:
        self._block = np.zeros(_NODE * count, np.uint8) if block is None else block
        starts = [0, *(count * start for start in _STARTS)]
        for (name, width, kind), start in zip(_ARRAYS, starts, strict=False):
            shape = count if width == 1 else (count, width)
            setattr(self, name, np.ndarray(shape, kind, self._block, start))
        first = address(self._block)
        self.record = records.FrictionRecord(count, 0, None, *(first + start for start in starts[1:-1]))
        if block is None:
            self.body[:] = self._triangle[:] = self._corners[:] = -1
        self._empty: bool | None = None  # None: not known
        self._faces: dict[int, NDArray[np.integer]] = {}  # triangles of deforming bodies when anchors were set
        self._seen: tuple[Sequence[ContactBody], Array] | None = None  # bodies, and what `expected` found for them

    @property
    def empty(self) -> bool:
        """Whether no node has an anchor."""
        if self._empty is None:
            self._empty = not (self.body >= 0).any()
        return self._empty

    def clear(self) -> None:
        """Remove all anchors; the next frame starts from rest."""
        self.body[:] = -1
        self._empty = True
        self.sticking[:] = False
        self._seen = None
        self._faces.clear()

    def save(self) -> tuple[NDArray[np.uint8], dict[int, NDArray[np.integer]]]:
        """Return the state, for `restored`."""
        return self._block.copy(), dict(self._faces)

    @classmethod
    def restored(cls, state: tuple[NDArray[np.uint8], dict[int, NDArray[np.integer]]]) -> ContactHistory:
        """Return a history of a saved state, which shares nothing with it."""
        block, faces = state
        history = cls(len(block) // _NODE, block.copy())
        history._faces = dict(faces)
        return history

    def rearranged(self, former: Indices) -> ContactHistory:
        """Return the history of other points: each has that of a point of this one, or none with -1, shape (n,)."""
        count = len(former)
        other = ContactHistory(count, np.empty(_NODE * count, np.uint8))
        widths = address(_WIDTHS), address(_BLANK)
        places = address(former), address(self._block), address(other._block)
        states = records.StatesRecord(count, len(self.body), len(_WIDTHS), *widths, *places)
        kernels().rearrange(byref(states))
        other._faces = dict(self._faces)
        return other

    def anchor(self, nodes: Indices, bodies: Sequence[ContactBody], positions: Array) -> None:
        """Anchor points at given positions on the bodies above which they were.

        Args:
            nodes: indices of the points, shape (n,).
            bodies: the bodies as they were in the last frame.
            positions: positions of the points in that frame [m], shape (n, 3).
        """
        self._put(bodies, nodes, self.body[nodes], self._triangle[nodes], positions)

    def expected(
        self,
        bodies: Sequence[ContactBody],
        deformed: Array,
        search_radius: float,
        force: Array | None = None,
        drift: tuple[Array, Array] | None = None,
    ) -> Array:
        """Return the expected positions of the nodes in the next frame [m], shape (m, 3).

        They are the positions in the last frame; nodes that stick move with their body.

        Args:
            bodies: bodies in the next frame.
            deformed: positions of the nodes in the last frame [m], shape (m, 3).
            search_radius: sticking nodes do not move with a body that moved farther than this [m].
            force: forces of the last frame [N], shape (m, 3); needed with a drift.
            drift: `Drift.moved` and `Drift.passed` of the last frame, with which slipping skin moves on; None if it is
                expected to stay.
        """
        record, m = self.record, len(self.body)
        out = np.empty((3, m, 3))  # anchors, their normals, and expected places
        poses, shaped = self._pose(bodies), self._shaped(bodies)
        if shaped:
            for index, own in shaped:
                self._meet(index, own, bodies[index].surface)
                poses[index, -1] = 1.0
            out[0] = from_material(bodies, self.body, self._material, self._triangle, self._corners)
        deformed = np.ascontiguousarray(deformed)
        record.image, record.radius, record.force = address(deformed), search_radius, None
        if drift is not None and force is not None:
            force = np.ascontiguousarray(force)
            record.force, record.drift[:], record.passed[:] = address(force), drift[0].tolist(), drift[1].tolist()
        at, size = address(out), out.strides[0]
        record.anchors, record.normals, record.places = at, at + size, at + 2 * size
        self.call(kernels().expect)
        for index, own in shaped:
            self._local[own] = unplaced(bodies[index], out[0, own])
        self._seen = bodies, out
        return out[2]

    def _shaped(self, bodies: Sequence[ContactBody]) -> list[tuple[int, Indices | slice]]:
        """Return the bodies whose anchors may be on triangles that change, with the nodes above them."""
        if not self._faces and not any(body.deforms for body in bodies):
            return []
        return [(i, own) for i, own in owned(self.body) if bodies[i].deforms or i in self._faces]

    def _pose(self, bodies: Sequence[ContactBody]) -> Array:
        """Give the record the poses of bodies, and return them, shape (b, 32)."""
        self._poses = np.array([body.pose for body in bodies]).reshape(-1, records.POSE)
        self.record.bodies, self.record.poses = len(bodies), address(self._poses)
        return self._poses

    def see(self, bodies: Sequence[ContactBody]) -> None:
        """Compute the anchors on bodies; they are kept, because a frame needs them twice."""
        if self._seen is None or self._seen[0] is not bodies:
            self.expected(bodies, np.zeros((len(self.body), 3)), 0.0)

    def call(self, kernel: Callable[[object], int]) -> None:
        """Call a kernel with the record.

        Raises:
            DermisError: a number is not finite.
        """
        if kernel(byref(self.record)) == records.NOT_FINITE:
            raise DermisError("a number in the friction history is not finite", where="contact")

    def _meet(self, index: int, own: Indices | slice, surface: Surface | Plane) -> None:
        """Take the present faces of a deforming body.

        If the faces have changed, the movement of the material is not known. The anchors then keep their positions in
        the body's own space.
        """
        if not isinstance(surface, Surface):
            return
        before, now = self._faces.get(index), surface.triangles
        self._faces[index] = now
        if before is None or before is now or np.array_equal(before, now) or cut_otherwise(before, now):
            return
        nodes = np.arange(len(self.body))[own]
        nodes = nodes[self._corners[nodes, 0] >= 0]
        self._material[nodes], self._triangle[nodes], self._corners[nodes] = self._local[nodes], -1, -1

    def offset(self, gaps: NodeGaps, points: Array) -> Array:
        """Return the offset b of the contact problem: the gap along the normal, and the slip across it.

        The slip is counted from the anchor. It is zero if there is no anchor on the closest body, or on one that forms
        a smooth surface with it.

        Args:
            gaps: present gaps of the nodes.
            points: undeformed nodes [m], shape (m, 3).

        Returns:
            b [m], shape (m, 3).
        """
        self.see(gaps.bodies)
        record, b, points = self.record, np.empty((len(self.body), 3)), np.ascontiguousarray(points)
        record.below, record.facing, record.gaps = address(gaps.body), address(gaps.normal), address(gaps.gap)
        record.points, record.offset = address(points), address(b)
        self.call(kernels().offset)
        return b

    def keep(
        self,
        gaps: NodeGaps,
        status: NDArray[np.int8],
        force: Array,
        displacement: Array,
        deformed: Array,
        soft: Array,
        shifted: tuple[Indices, Array] = NOTHING,
        entered: tuple[Indices, Array] = NOTHING,
    ) -> bool:
        """Update the history to the end of a frame, and return whether the frame is not at rest.

        The anchors of all nodes that do not stick are moved to their present positions.

        Args:
            gaps: present gaps of the nodes.
            status: of each node, see `Solution`, shape (m,).
            force: forces of the frame [N], shape (m, 3).
            displacement: relative displacement w of the nodes [m], shape (m, 3).
            deformed: positions of the nodes [m], shape (m, 3).
            soft: compliance of the body below each node [m/N], shape (m,).
            shifted: nodes whose slip was shifted, shape (k,), and the shifts [m], shape (k, 3). Their anchors are moved
                even if they stick.
            entered: the same for nodes that came into contact; their anchors then lag behind them.
        """
        record, m = self.record, len(self.body)
        self._pose(gaps.bodies)
        (nodes, shift), (entering, crossing) = shifted, entered
        frame = gaps.body, gaps.triangle, gaps.normal, status, force, displacement, deformed, soft
        given = [np.ascontiguousarray(array) for array in (*frame, nodes, shift, entering, crossing)]
        positions, renewed = np.empty((m, 3)), np.empty(m, dtype=np.bool_)
        (
            record.below,
            record.faces,
            record.facing,
            record.status,
            record.force,
            record.moved,
            record.image,
            record.soft,
            record.nodes,
            record.shift,
            record.entering,
            record.crossing,
        ) = [address(array) for array in given]
        record.shifted, record.entered = len(nodes), len(entering)
        record.positions, record.renewed = address(positions), address(renewed)
        self.call(kernels().keep)
        self._seen = self._empty = None
        for index, _ in self._shaped(gaps.bodies):
            own = (renewed & (self.body == index)).nonzero()[0]
            self._put(gaps.bodies, own, self.body[own], gaps.triangle[own], positions[own])
        return bool(record.slides)

    def _put(
        self, bodies: Sequence[ContactBody], nodes: Indices, body: Indices, triangle: Indices, positions: Array
    ) -> None:
        self._seen = None
        self._material[nodes] = to_material(bodies, body, triangle, positions)
        self._triangle[nodes] = triangle
        self._corners[nodes] = corners_of(bodies, body, triangle)
        for index, own in owned(body):
            posed = bodies[index]
            if posed.deforms and isinstance(posed.surface, Surface):
                self._local[nodes[own]] = unplaced(posed, positions[own])
                self._faces[index] = posed.surface.triangles
