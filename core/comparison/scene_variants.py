"""Variants of a scene: shifted, sampled twice as often, or mirrored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..motion.rotation import rotations, singular
from ..parameters.device import DEVICE
from ..parameters.finger import FINGER
from ..parameters.material import BODY
from ..parameters.parameter import NAMES, SWITCH, TEXT
from ..parameters.screen import SCREEN
from ..scene.tactile_scene import Body, Chunk, Mesh, TactileScene

SHIFT = 0.1e-6  # [m] displacement of the shifted fingers; far below the resolution of any device or eye
_TABLES = {"finger": FINGER, "device": DEVICE, "body": BODY, "screen": SCREEN}
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])
_POSES = ("fingers", "bodies", "screens")


@dataclass(frozen=True, eq=False)
class _Chunks:
    """Chunks that are computed from others, anew in each iteration."""

    source: Iterable[Chunk]
    make: Callable[[Iterable[Chunk]], Iterator[Chunk]]

    def __iter__(self) -> Iterator[Chunk]:
        return self.make(self.source)


def shifted(scene: TactileScene, far: float = SHIFT) -> TactileScene:
    """Return a scene with displaced fingers.

    The direction of the displacement is not parallel to any axis or coordinate plane of the world.

    Args:
        far: length of the displacement [m].
    """
    by = far * np.array([2.0, 3.0, 6.0]) / 7.0

    def make(chunks: Iterable[Chunk]) -> Iterator[Chunk]:
        for chunk in chunks:
            fingers = chunk.fingers.copy()
            fingers[:, :, :3, 3] += by
            yield replace(chunk, fingers=fingers)

    return replace(scene, chunks=_Chunks(scene.chunks, make))


def denser(scene: TactileScene) -> TactileScene:
    """Return a scene with a sample half-way between each two samples.

    Positions, rotations and scales are interpolated by parabolas, see `_bent`, so smooth motion keeps its acceleration.
    Where the path is curved at only one of the two samples, the interpolation is linear, so motion that stops abruptly
    does not overshoot. Surfaces and animated quantities are interpolated linearly. A surface whose faces change, and a
    parameter that is a choice, keep the value of the sample before.
    """
    count = replace(scene, rate=2.0 * scene.rate).sample_count

    def make(chunks: Iterable[Chunk]) -> Iterator[Chunk]:
        middles = _middles(chunks)
        last, first, done = None, 0, 0
        for chunk in chunks:
            if last is None:
                yield _halved(chunk, middles, first, skip=False)
            elif _brings(last) == _brings(chunk):
                yield _halved(_joined(last, chunk), middles, first - 1, skip=True)
            else:
                yield _half_before(last, chunk, middles, first - 1)
                yield _halved(chunk, middles, first, skip=False)
            done += 2 * len(chunk.times) - (last is None)
            first += len(chunk.times)
            last = _sample(chunk, len(chunk.times) - 1)
        if last is not None and done < count:  # half a step after the last sample, repeat it
            half = 0.5 / scene.rate
            yield replace(last, times=last.times + half, frames=last.frames + half * float(scene.fps))

    return replace(scene, rate=2.0 * scene.rate, chunks=_Chunks(scene.chunks, make))


def mirrored(scene: TactileScene) -> TactileScene:
    """Return the mirror image of a scene, with left and right exchanged.

    Screens are left out. Fingertips are symmetric, so only their poses are mirrored.
    """

    def turned(poses: Array) -> Array:
        return _MIRROR @ poses @ _MIRROR

    def make(chunks: Iterable[Chunk]) -> Iterator[Chunk]:
        for chunk in chunks:
            surfaces = {index: tuple(map(_mirrored_mesh, meshes)) for index, meshes in chunk.surfaces.items()}
            fingers, bodies = turned(chunk.fingers), turned(chunk.bodies)
            yield replace(chunk, fingers=fingers, bodies=bodies, screens=chunk.screens[:0], surfaces=surfaces)

    bodies = tuple(_mirrored_body(body) for body in scene.bodies)
    x, y, z = scene.gravity
    chunks = _Chunks(scene.chunks, make)
    return replace(scene, bodies=bodies, screens=(), gravity=(-x, y, z), chunks=chunks)


def _mirrored_body(body: Body) -> Body:
    return body if body.mesh is None else replace(body, mesh=_mirrored_mesh(body.mesh))


def _mirrored_mesh(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices * _MIRROR.diagonal()[:3], np.ascontiguousarray(mesh.triangles[:, ::-1]))


def _sample(chunk: Chunk, i: int) -> Chunk:
    """Return sample `i` of a chunk as a chunk of its own."""
    some = slice(i, i + 1)
    poses = {name: getattr(chunk, name)[:, some] for name in _POSES}
    surfaces = {index: meshes[some] for index, meshes in chunk.surfaces.items()}
    animated = {name: values[some] for name, values in chunk.animated.items()}
    return Chunk(chunk.frames[some], chunk.times[some], **poses, surfaces=surfaces, animated=animated)


def _brings(chunk: Chunk) -> tuple[set[int], set[str]]:
    return set(chunk.surfaces), set(chunk.animated)


def _half_before(before: Chunk, chunk: Chunk, middles: Mapping[str, Array], start: int) -> Chunk:
    """Return the sample half-way between `before` and a chunk's first.

    Surfaces and animated parameters that only one of the two has are taken from `before`.
    """
    first = _sample(chunk, 0)

    def both(one: Mapping[Any, Any], other: Mapping[Any, Any]) -> dict[Any, Any]:
        return {name: one[name] for name in one.keys() & other.keys()}

    def common(a: Chunk, b: Chunk) -> Chunk:
        return replace(a, surfaces=both(a.surfaces, b.surfaces), animated=both(a.animated, b.animated))

    both_bring = _joined(common(before, first), common(first, before))
    middle = _sample(_halved(both_bring, middles, start, skip=True), 0)
    surfaces, animated = {**before.surfaces, **middle.surfaces}, {**before.animated, **middle.animated}
    return replace(middle, surfaces=surfaces, animated=animated)


def _joined(before: Chunk, chunk: Chunk) -> Chunk:
    """Return a chunk preceded by a sample.

    Both have the same surfaces and animated parameters.
    """
    poses = {n: np.concatenate([getattr(before, n), getattr(chunk, n)], axis=1) for n in _POSES}
    surfaces = {i: (*before.surfaces[i], *meshes) for i, meshes in chunk.surfaces.items()}
    animated = {n: np.concatenate([before.animated[n], v]) for n, v in chunk.animated.items()}
    times, frames = (np.concatenate([getattr(before, n), getattr(chunk, n)]) for n in ("times", "frames"))
    return Chunk(frames, times, **poses, surfaces=surfaces, animated=animated)


def _halved(chunk: Chunk, middles: Mapping[str, Array], start: int, *, skip: bool) -> Chunk:
    """Return a chunk with additional samples half-way between its own.

    Args:
        middles: see `_middles`.
        start: index of the chunk's first sample in the scene.
        skip: whether the first sample of the result is left out.
    """
    first = int(skip)

    def between(values: Array, middle: Array, axis: int) -> Array:
        """Interleave values and middles along an axis.

        On `skip` the first value is left out.
        """
        shape = list(values.shape)
        shape[axis] = 2 * shape[axis] - 1
        out = np.empty(shape, values.dtype)
        even, odd, rest = ([slice(None)] * values.ndim for _ in range(3))
        even[axis], odd[axis], rest[axis] = slice(0, None, 2), slice(1, None, 2), slice(first, None)
        out[tuple(even)], out[tuple(odd)] = values, middle
        return out[tuple(rest)]

    def series(values: Array) -> Array:
        return between(values, 0.5 * (values[1:] + values[:-1]), 0)

    def setting(name: str, values: Array) -> Array:
        return series(values) if _is_quantity(name) else between(values, values[:-1], 0)

    def poses(name: str) -> Array:
        values: Array = getattr(chunk, name)
        return between(values, middles[name][:, start : start + len(chunk.times) - 1], 1)

    surfaces = {}
    for index, meshes in chunk.surfaces.items():
        both = [mesh for pair in zip(meshes, _half_meshes(meshes), strict=False) for mesh in pair]
        surfaces[index] = (*both, meshes[-1])[first:]
    return Chunk(
        series(chunk.frames),
        series(chunk.times),
        poses("fingers"),
        poses("bodies"),
        poses("screens"),
        surfaces,
        {name: setting(name, values) for name, values in chunk.animated.items()},
    )


def _is_quantity(name: str) -> bool:
    """Return whether an animated parameter can be interpolated.

    The name is such as 'body/3/friction'.
    """
    kind, _, rest = name.partition("/")
    row = _TABLES[kind].get(rest.rpartition("/")[2])
    return row is not None and row.unit not in (SWITCH, TEXT, NAMES) and not row.whole and not row.choices


def _half_meshes(meshes: tuple[Mesh, ...]) -> list[Mesh]:
    def half(a: Mesh, b: Mesh) -> Mesh:
        alike = a.triangles is b.triangles and a.vertices.shape == b.vertices.shape
        return a if a is b or not alike else Mesh(0.5 * (a.vertices + b.vertices), a.triangles)

    return [half(a, b) for a, b in zip(meshes, meshes[1:], strict=False)]


def _middles(chunks: Iterable[Chunk]) -> dict[str, Array]:
    """Return the poses half-way between consecutive samples.

    The shape is (count, n - 1, 4, 4) for fingers, bodies and screens each.
    """
    parts = [[getattr(chunk, name) for name in _POSES] for chunk in chunks]
    return {name: _half_way(np.concatenate([part[k] for part in parts], axis=1)) for k, name in enumerate(_POSES)}


def _half_way(poses: Array) -> Array:
    """Return the poses half-way between consecutive ones.

    The shape is (count, n - 1, 4, 4). Rotation, scale and position are interpolated separately. A pose of scale 0
    has no rotation; beside it, the linear maps of the two poses are averaged instead.

    Args:
        poses: the poses, shape (count, n, 4, 4).
    """
    from scipy.spatial.transform import Rotation

    shape = count, n = poses.shape[:2]
    linear = poses[:, :, :3, :3].reshape(-1, 3, 3)
    known = ~singular(linear)
    turns, stretch = np.tile(np.eye(3), (len(linear), 1, 1)), linear.copy()
    turns[known] = rotations(linear[known])
    stretch[known] = turns[known].transpose(0, 2, 1) @ linear[known]
    known, turns = known.reshape(shape), turns.reshape(*shape, 3, 3)
    first, second = (Rotation.from_matrix(t.reshape(-1, 3, 3)) for t in (turns[:, :-1], turns[:, 1:]))
    steps = (first.inv() * second).as_rotvec().reshape(count, n - 1, 3)
    half = Rotation.from_rotvec((0.5 * steps - _bent(np.diff(steps, axis=1), known)).reshape(-1, 3))
    scaled = _middle(stretch.reshape(*shape, 9), known).reshape(count, n - 1, 3, 3)
    middle = 0.5 * (poses[:, :-1] + poses[:, 1:])
    middle[:, :, :3, 3] = _middle(poses[:, :, :3, 3], np.ones(shape, bool))
    both = known[:, :-1] & known[:, 1:]
    middle[both, :3, :3] = ((first * half).as_matrix().reshape(count, n - 1, 3, 3) @ scaled)[both]
    return middle


def _middle(values: Array, known: NDArray[np.bool_]) -> Array:
    """Return the vectors half-way between consecutive ones.

    The shape is (count, n - 1, k).

    Args:
        values: the vectors, shape (count, n, k).
        known: whether each vector is known, shape (count, n).
    """
    return 0.5 * (values[:, :-1] + values[:, 1:]) - _bent(np.diff(values, 2, axis=1), known)


def _bent(bends: Array, known: NDArray[np.bool_]) -> Array:
    """Return the chord's midpoint minus the curve's, between neighbours.

    The result has the shape (count, n - 1, k). The curve is a parabola. Its second difference is the mean of the
    second differences at both neighbours if they agree, and smaller if they differ. It is 0 if one of them is 0 or
    unknown, or if their scalar product is not positive. At each end of the series, the only second difference next
    to the interval is used for both neighbours.

    Args:
        bends: second differences, shape (count, n - 2, k).
        known: whether each value is known, shape (count, n).

    Source: the limiter of van Albada, van Leer and Roberts 1982, of second differences
    """
    if not bends.shape[1]:
        return np.zeros((len(bends), known.shape[1] - 1, bends.shape[2]))
    bends = np.where((known[:, :-2] & known[:, 1:-1] & known[:, 2:])[..., None], bends, 0.0)
    before = np.concatenate([bends[:, :1], bends], axis=1)
    after = np.concatenate([bends, bends[:, -1:]], axis=1)
    along = np.maximum(np.einsum("ijk,ijk->ij", before, after), 0.0)
    size = (before**2).sum(axis=2) + (after**2).sum(axis=2)
    share = np.divide(along, size, out=np.zeros_like(size), where=size > 0.0)
    return np.asarray(0.125 * share[..., None] * (before + after))
