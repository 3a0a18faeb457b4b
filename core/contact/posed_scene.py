"""PosedScene: fingers and bodies of a scene at the samples of a chunk, common to all fingers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..motion import rotations, singular
from ..parameters.material import BODY, FRICTION
from ..scene.tactile_scene import Body, Chunk, Mesh
from .posed_body import Posed, PosedBody
from .proximity import RelativePoses
from .solver.bodies import ContactBody
from .surfaces import bounds_in_world, boxes_in_world

# Up to this many boxes, of all bodies at all samples of a chunk, are computed at once for all fingers: a call takes as
# long as this many boxes. This affects only the run time.
AT_ONCE = 512


class PosedScene:
    """Fingers and bodies of a scene in the present chunk.

    Args:
        bodies: headers of the bodies that may be touched.
        deforms: whether each surface may change, see `PosedBody`; None if chunks contain only surfaces that deform.

    Attributes:
        chunk: the present chunk.
    """

    chunk: Chunk

    def __init__(self, bodies: Sequence[Body], deforms: Sequence[bool] | None = None) -> None:
        self._headers = tuple(bodies)
        told = [None] * len(bodies) if deforms is None else deforms
        self._bodies = [PosedBody(body, d) for body, d in zip(bodies, told, strict=True)]
        self._turns: Array | None = None
        self._bounds: tuple[Array, Array] | None = None  # bounds of the bodies over the chunk
        self._boxes: tuple[Indices, Array, Array, NDArray[np.bool_]] | None = None  # all bodies, and their boxes
        self._asked: dict[bytes, tuple[Array, Array, NDArray[np.bool_]]] = {}  # boxes by set of bodies
        self._previous: Array | None = None  # the fingers' poses at the sample before the chunk

    def take(self, chunk: Chunk, bodies: Sequence[Body] | None = None, *, again: bool = False) -> None:
        """Take a chunk.

        Args:
            chunk: the chunk.
            bodies: new headers of the bodies if parameters were edited; None keeps them.
            again: whether the chunk replaces the last one.
        """
        if not again and hasattr(self, "chunk"):
            self._previous = self.chunk.fingers[:, -1]
        self.chunk, self._turns, self._bounds, self._boxes, self._asked = chunk, None, None, None, {}
        self._headers = self._headers if bodies is None else tuple(bodies)
        for b, body in enumerate(self._bodies):
            body.take(b, chunk, again=again)

    def cut(self) -> None:
        """Forget the sample before the chunk; the next chunk does not continue it."""
        self._previous = None
        for body in self._bodies:
            body.cut()

    def name(self, b: int) -> str:
        """Return the name of body `b`."""
        return self._headers[b].name

    def turns(self) -> Array:
        """Return the fingers' rotations to the world, shape (F, n, 3, 3)."""
        if self._turns is None:
            linear = self.chunk.fingers[:, :, :3, :3]
            turns = rotations(linear.reshape(-1, 3, 3)).reshape(linear.shape)
            # The memory layout of matrices affects the rounding of their products. It must not depend on the chunk.
            self._turns = np.ascontiguousarray(turns)
        return self._turns

    def own_boxes(self, b: int) -> Array:
        """Return a body's boxes in its own space [m], shape (n, 2, 3), or (1, 2, 3) for a rigid body.

        Raises:
            DermisError: a deforming object has no surface.
        """
        return self._bodies[b].boxes()

    def near(self, low: Array, high: Array) -> tuple[Indices, Array, Array, NDArray[np.bool_]]:
        """Return the bodies that may enter a box in the chunk, and perhaps others.

        Args:
            low, high: corners of the box [m], shape (3,) each.

        Returns:
            Indices of the bodies, shape (k,). Centre and half size of the bounding box of each in the world at every
            sample [m], shape (k, n, 3) each, and whether the body has a scale of 0 along an axis, shape (k, n), so that
            it cannot be touched.

        Raises:
            DermisError: a deforming object has no surface.
        """
        if len(self._bodies) * len(self.chunk.times) <= AT_ONCE:
            if self._boxes is None:
                every = np.arange(len(self._bodies))
                self._boxes = every, *self._boxes_of(every)
            return self._boxes
        if self._bounds is None:
            own = [body.boxes() for body in self._bodies]
            boxes = np.array([(b[:, 0].min(axis=0), b[:, 1].max(axis=0)) for b in own]).reshape(-1, 2, 3)
            self._bounds = bounds_in_world(self.chunk.bodies, boxes)
        bodies = np.flatnonzero(((self._bounds[0] <= high) & (self._bounds[1] >= low)).all(axis=1))
        key = bodies.tobytes()
        if key not in self._asked:
            self._asked[key] = self._boxes_of(bodies)
        return bodies, *self._asked[key]

    def _boxes_of(self, bodies: Indices) -> tuple[Array, Array, NDArray[np.bool_]]:
        boxes, poses = np.zeros((len(bodies), len(self.chunk.times), 2, 3)), self.chunk.bodies[bodies]
        for k, b in enumerate(bodies.tolist()):
            boxes[k] = self._bodies[b].boxes()
        linear = poses[:, :, :3, :3]
        return *boxes_in_world(poses, boxes), singular(linear.reshape(-1, 3, 3)).reshape(linear.shape[:2])

    def at(self, b: int, i: int) -> Posed:
        """Return body `b` at sample `i` in the world; its scale there must not be 0."""
        return self._bodies[b].at(i)

    def mesh_at(self, b: int, i: int) -> Mesh:
        """Return the mesh of body `b` at sample `i`."""
        mesh = self.chunk.surfaces[b][i] if b in self.chunk.surfaces else self._headers[b].mesh
        assert mesh is not None  # `boxes` refused it
        return mesh

    def relative(self, turn: Array, place: Array, bodies: Sequence[int]) -> dict[int, RelativePoses]:
        """Return the poses of bodies in a finger's frame at all samples, by the index of the body.

        Args:
            turn: rotations of the finger to the world, shape (n, 3, 3).
            place: positions of the finger in the world [m], shape (n, 3).
            bodies: indices of the bodies.
        """
        if not bodies:
            return {}
        poses, back = self.chunk.bodies[list(bodies)], np.swapaxes(turn, 1, 2)
        moved = (back @ (poses[:, :, :3, 3] - place)[..., None])[..., 0]
        return {b: RelativePoses(*seen) for b, *seen in zip(bodies, back @ poses[:, :, :3, :3], moved, strict=True)}

    def finger_before(self, f: int, i: int) -> tuple[Array, Array] | None:
        """Return rotation and position of finger `f` at the sample before sample `i`; None if there is none."""
        if i > 0:
            return self.turns()[f, i - 1], self.chunk.fingers[f, i - 1, :3, 3]
        if self._previous is None:
            return None
        return rotations(self._previous[f : f + 1, :3, :3])[0], self._previous[f, :3, 3]

    def seen_before(self, turn: Array, place: Array, b: int, i: int) -> ContactBody | None:
        """Return body `b` at the sample before sample `i`, see `seen_from`; None if it is not known."""
        posed = self._bodies[b].before(i)
        return None if posed is None else _seen(posed, turn, place)

    def seen_from(self, turn: Array, place: Array, b: int, i: int) -> ContactBody:
        """Return body `b` at sample `i` in a finger's frame.

        Args:
            turn: rotation of the finger to the world, shape (3, 3).
            place: position of the finger in the world [m], shape (3,).
            b: index of the body.
            i: index of the sample.
        """
        posed = self._bodies[b].at(i)
        stiffness = self._value(b, i, "surface_stiffness")
        return _seen(posed, turn, place, self._value(b, i, "friction"), 1.0 / stiffness if stiffness > 0 else 0.0)

    def settings(self, b: int) -> Array:
        """Return a body's friction and stiffness [Pa/m] at every sample, shape (n, 2); nan for a deforming body."""
        count = len(self.chunk.times)
        if b in self.chunk.surfaces:
            return np.full((count, 2), np.nan)
        series = [self._series(b, name) for name in ("friction", "surface_stiffness")]
        return np.stack([np.broadcast_to(values, count) for values in series], axis=1)

    def _series(self, b: int, name: str) -> Array | float:
        """Return a parameter of a body: animated values, shape (n,), or the constant or default value."""
        series = self.chunk.animated.get(f"body/{b}/{name}")
        return float(self._headers[b].parameters.get(name, BODY[name].absent)) if series is None else series

    def _value(self, b: int, i: int, name: str) -> float:
        """Return a parameter of body `b` at sample `i`."""
        series = self._series(b, name)
        return series if isinstance(series, float) else float(series[i])


def _seen(posed: Posed, turn: Array, place: Array, friction: float = FRICTION, softness: float = 0.0) -> ContactBody:
    back = turn.T
    return ContactBody(
        posed.surface,
        back @ posed.turn,
        back @ (posed.origin - place),
        friction,
        softness,
        deforms=posed.deforms,
        carry=posed.carry,
    )
