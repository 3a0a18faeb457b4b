"""PadSampler: gaps between all pads and all bodies, from chunks of poses.

The broad phase compares bounding boxes, first over a whole chunk and then at each sample. Pairs farther apart than the
search radius are counted and skipped. The narrow phase measures the gaps of the pads' centres to a body's `Surface` in
the body's *carried* space. This is its own space after scale and shear, but before rotation and translation, so that
lengths are in metres. Bodies that deform or change their scale need a surface for each sample, which is built only if a
pad is near.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError, Finding
from ..memory import Memory
from ..motion import turns_of
from ..motion.vectors import dot, turn_back, turn_map_back
from ..motion.vectors import turn as turned
from ..parameters.material import BODY
from ..scene.tactile_scene import Chunk, Mesh, TactileScene
from ..surface.centre import centres_of, held_centres
from ..surface.gap import GapQuery, Surface
from ..surface.repairs import Repairs
from .chunk_checks import check_animated, check_scales
from .deforming_surfaces import DeformingSurfaces
from .pad_contact import PadContact
from .pair_record import PairRecord
from .search_radius import SearchRadius
from .solver.bodies import BONE
from .stretch_rates import StretchRates
from .surfaces import alike, bounds_in_world, box_distances, box_of, boxes_in_world, carried, rigid_mesh, surface_of


class _Map(NamedTuple):
    """The linear map of a body's pose, and what follows from it alone.

    Attributes:
        key: bytes of the maps. rotation, flat: see `turns_of`. stretch: rotation transposed @ map, shape (k, 3, 3).
    """

    key: bytes
    rotation: Array
    flat: NDArray[np.bool_]
    stretch: Array


class PadSampler:
    """Collects the contact of pads in a scene, one chunk after the other.

    Args:
        scene: the scene's header; its chunks are passed to `add`.
        fingers: indices of the fingers; None for all.
    """

    def __init__(self, scene: TactileScene, fingers: Collection[int] | None = None) -> None:
        self.renew(scene)
        self._others = [] if fingers is None else [f for f in range(len(scene.fingers)) if f not in fingers]
        self._chunks: list[Chunk] = []
        self._checked: dict[str, bytes] = {}  # linear maps of the last valid poses, by kind
        self._first = self._count = 0  # range of the samples that are kept
        self._pairs: dict[tuple[int, int], PairRecord] = {}
        self._maps: dict[int, _Map] = {}  # the last of each body: most bodies keep theirs from chunk to chunk
        self._stretched: dict[int, tuple[Mesh, Array, Surface]] = {}
        self._centres: dict[int, list[Array]] = {}
        self._apart: dict[tuple[int, int], tuple[float, int]] = {}  # see `PadContact.apart`
        self._repairs = Repairs()
        self._rates = StretchRates()
        self._skipped = {"pair_samples_far": 0, "surfaces_far": 0}
        self._noted: dict[int, tuple[Finding, ...]] = {}
        self._deforming = DeformingSurfaces(scene.bodies, self._repairs)

    def renew(self, scene: TactileScene) -> None:
        """Continue with other settings of the same fingers, bodies and screens."""
        self._scene = scene
        self._names = [[item.name for item in items] for items in (scene.fingers, scene.bodies, scene.screens)]
        self._radius = SearchRadius(scene)
        # fingers with a device that uses the surface's smooth normals
        self._smooth = {
            i for i, f in enumerate(scene.fingers) if any(d.parameters.get("relief") == "mesh" for d in f.devices)
        }

    def add(self, chunk: Chunk) -> Chunk:
        """Take the next samples; return them with invalid poses and surfaces replaced.

        Raises:
            DermisError: shapes do not fit the header, a finger has scale 0, a scale is too large, or an animated
                parameter is out of range.
        """
        count = len(chunk.times)
        scene = self._scene
        sizes = {"fingers": len(scene.fingers), "bodies": len(scene.bodies), "screens": len(scene.screens)}
        for name, size in sizes.items():
            if getattr(chunk, name).shape != (size, count, 4, 4):
                raise DermisError(
                    f"a chunk's {name} do not fit the scene",
                    where=f"scene '{scene.name}'",
                    value=getattr(chunk, name).shape,
                    limit=f"({size}, {count}, 4, 4)",
                )
        if count == 0:
            return chunk
        names = self._names
        fingers = self._repairs.poses("finger", names[0], chunk.fingers, chunk.frames)
        bodies = self._repairs.poses("object", names[1], chunk.bodies, chunk.frames)
        screens = self._repairs.poses("screen", names[2], chunk.screens, chunk.frames)
        for kind, known, poses in zip(("finger", "object", "screen"), names, (fingers, bodies, screens), strict=True):
            maps = poses[:, :, :3, :3].tobytes()
            if maps != self._checked.get(kind):
                check_scales(kind, known, poses, chunk.frames)
                self._checked[kind] = maps
        check_animated(scene, chunk)
        self._chunks.append(Chunk(chunk.frames, chunk.times, fingers, bodies, screens, {}, chunk.animated))
        own = self._radius.over(chunk)
        chunk, boxes = self._deforming.take(chunk)
        self._broad_phase(chunk, fingers, bodies, own, boxes)
        self._count += count
        return replace(chunk, fingers=fingers, bodies=bodies, screens=screens)

    def forget(self, chunks: int) -> None:
        """Remove the first `chunks` chunks from the result of `finish`."""
        for chunk in self._chunks[:chunks]:
            self._first += len(chunk.times)
        del self._chunks[:chunks]
        for pair in self._pairs.values():
            pair.forget(self._first)
        for parts in self._centres.values():
            del parts[: -len(self._chunks)]

    def finish(self, memory: Memory | None = None) -> PadContact:
        """Return the contact at all samples that were taken.

        Args:
            memory: state before the first sample if this is the end of a longer range.

        Raises:
            DermisError: there is no sample, times do not rise, or an animated parameter is never finite.
        """
        if not self._chunks:
            raise DermisError("no samples", where=f"scene '{self._scene.name}'", remedy="Check the frame range")
        times = np.concatenate([c.times for c in self._chunks])
        if not (times[1:] > times[:-1]).all():
            raise DermisError("the samples' times do not rise", where=f"scene '{self._scene.name}'")
        frames = np.concatenate([c.frames for c in self._chunks])
        animated = self._repairs.animated(self._chunks, frames, self._scene)
        first, count = self._first, self._count - self._first
        pairs = {key: pair.assembled(first, count) for key, pair in sorted(self._pairs.items()) if pair.start}
        noted = {**self._noted, **self._deforming.noted}
        return PadContact(
            frames=frames,
            times=times,
            fingers=np.concatenate([c.fingers for c in self._chunks], axis=1),
            bodies=np.concatenate([c.bodies for c in self._chunks], axis=1),
            screens=np.concatenate([c.screens for c in self._chunks], axis=1),
            pairs=pairs,
            centres={b: held_centres(np.concatenate(parts)) for b, parts in self._centres.items()},
            apart={key: (far, sample - first) for key, (far, sample) in self._apart.items() if sample >= first},
            animated=animated,
            skipped={k: v for k, v in self._skipped.items() if v},
            findings=(*self._repairs.findings(), *(f for b in sorted(noted) for f in noted[b])),
            memory=memory,
        )

    # -- broad phase ---------------------------------------------------------------------------------------------

    def _broad_phase(
        self, chunk: Chunk, fingers: Array, bodies: Array, own: Array | None, boxes: Mapping[int, Array]
    ) -> None:
        pads = fingers[:, :, :3, 3]
        total = len(fingers) * len(chunk.times)
        within = self._within(chunk, bodies, pads)
        self._skipped["pair_samples_far"] += total * (len(bodies) - len(within))
        for b, middle, half in self._boxes(chunk, bodies, boxes, within):
            inside = np.abs(pads - middle) <= half + self._radius.longest
            near: NDArray[np.bool_] = np.logical_and.reduce(inside, axis=2)
            if self._others:
                near[self._others] = False
            if b in chunk.surfaces:
                self._note_apart(b, pads, middle, half)
            who, samples = near.nonzero()
            self._skipped["pair_samples_far"] += total - samples.size
            if samples.size:
                self._narrow(b, chunk, fingers, bodies[b], who, samples, own)
            elif b in chunk.surfaces:
                self._skipped["surfaces_far"] += len(chunk.times)
        self._deforming.leave(chunk)

    def _note_apart(self, b: int, pads: Array, middle: Array, half: Array) -> None:
        """Note how near the pads come to the boxes of a deforming body, whose surfaces are not kept."""
        apart = box_distances(pads, middle, half)
        for f, (sample, far) in enumerate(zip(apart.argmin(axis=1).tolist(), apart.min(axis=1).tolist(), strict=True)):
            if far < self._apart.get((f, b), (np.inf, 0))[0]:
                self._apart[f, b] = far, self._count + sample

    def _within(self, chunk: Chunk, bodies: Array, pads: Array) -> list[int]:
        """Return the bodies that may come within reach in a chunk, and all that deform or whose centre is recorded.

        Of thousands of instances, most are excluded here in one step.
        """
        rigid = [b for b in range(len(bodies)) if b not in chunk.surfaces]
        poses = bodies if len(rigid) == len(bodies) else bodies[rigid]
        if not rigid:
            return sorted(chunk.surfaces)
        low, high = bounds_in_world(poses, np.array([box_of(rigid_mesh(self._scene.bodies[b])) for b in rigid]))
        reach = self._radius.longest
        near = [((pad.min(axis=0) - reach <= high) & (pad.max(axis=0) + reach >= low)).all(axis=1) for pad in pads]
        close = np.flatnonzero(np.logical_or.reduce(near)).tolist() if near else []
        return sorted({*(rigid[i] for i in close), *chunk.surfaces, *self._centres})

    def _boxes(
        self, chunk: Chunk, bodies: Array, deforming: Mapping[int, Array], within: Sequence[int]
    ) -> Iterator[tuple[int, Array, Array]]:
        """Yield the index of each body with its bounding boxes in the world: centre and half size [m], (n, 3) each."""
        for b in within:
            body = self._scene.bodies[b]
            if b in chunk.surfaces:
                boxes = deforming[b]
                if any(body.parameters.get(name, BODY[name].absent) for name in ("weight_on", "content_on")):
                    before = [] if body.mesh is None else [self._still_centres(b, c) for c in self._chunks[:-1]]
                    self._centres.setdefault(b, before).append(centres_of(chunk.surfaces[b]))
            else:
                boxes = box_of(rigid_mesh(body))[None]
                if b in self._centres:
                    self._centres[b].append(self._still_centres(b, chunk))
            yield b, *boxes_in_world(bodies[b], boxes)

    def _still_centres(self, b: int, chunk: Chunk) -> Array:
        """Return the centre of a body's surface in the header, for each sample of a chunk [m], shape (n, 3)."""
        return np.repeat(centres_of((rigid_mesh(self._scene.bodies[b]),)), len(chunk.times), axis=0)

    # -- narrow phase --------------------------------------------------------------------------------------------

    def _narrow(
        self, b: int, chunk: Chunk, fingers: Array, poses: Array, who: Indices, samples: Indices, own: Array | None
    ) -> None:
        """Measure the gaps between one body and the pads that are near it.

        `who` and `samples` are the fingers and the samples of these pads, ordered by finger and then by sample.
        """
        single = len(chunk.times) == 1
        near_samples = samples[:1] if single else np.unique(samples)
        linear = poses[near_samples, :3, :3]
        maps = linear[:1] if single or (linear == linear[0]).all() else linear
        known = self._maps.get(b)
        if known is None or known.key != maps.tobytes():
            rotation, flat = turns_of(maps)
            known = self._maps[b] = _Map(maps.tobytes(), rotation, flat, turn_map_back(rotation, maps))
        _, rotation, flat, stretches = known
        if np.count_nonzero(flat):
            flat = np.broadcast_to(flat, len(linear))
            self._repairs.note("zero-scale", self._scene.bodies[b].name, chunk.frames[near_samples[flat]].tolist())
            near_samples, linear = near_samples[~flat], linear[~flat]
            there = np.isin(samples, near_samples)
            who, samples = who[there], samples[there]
            if not samples.size:
                return
            rotation, stretches = rotation[~flat], stretches[~flat]
        turn = rotation
        if not single:
            turn = np.zeros((len(chunk.times), 3, 3))
            turn[near_samples] = rotation
        stretch = np.broadcast_to(stretches, linear.shape)
        points = turn_back(turn[samples], fingers[who, samples, :3, 3] - poses[samples, :3, 3])
        last = self._chunks[-2] if len(self._chunks) > 1 else None
        before = None if last is None else (float(last.times[-1]), last.bodies[b, -1])
        rates = self._rates.of(b, chunk.times, poses, near_samples, stretch, before)
        for surface, group, velocity in self._surfaces(b, chunk, near_samples, stretch):
            if group.size == near_samples.size:
                self._measure(b, surface, who, samples, points, turn, fingers, velocity, own, rates)
                continue
            some = np.isin(samples, group)
            self._measure(b, surface, who[some], samples[some], points[some], turn, fingers, velocity, own, rates)

    def _surfaces(
        self, b: int, chunk: Chunk, near_samples: NDArray[np.intp], stretch: Array
    ) -> Iterator[tuple[Surface, NDArray[np.intp], Array | None]]:
        """Yield each surface of a body, its samples, and the velocities of its vertices if it deforms, else None."""
        mesh = self._scene.bodies[b].mesh
        if b in chunk.surfaces:
            for i, carry in zip(near_samples, stretch, strict=True):
                surface = self._deformed(b, chunk.surfaces[b][i], carry)
                self._deforming.look(b, chunk.surfaces[b][i], surface)
                yield surface, np.array([i]), self._deforming.velocity(b, chunk, int(i), carry)
            return
        assert mesh is not None
        left = np.arange(len(near_samples))
        while left.size:
            last_surface = self._stretched.get(b)
            if last_surface is None:
                first = stretch[left[0]]
                plain = bool(alike(first[None], np.eye(3))[0])
                last_surface = (mesh, np.eye(3), surface_of(mesh)) if plain else (mesh, first, surface_of(mesh, first))
                self._stretched[b] = last_surface
                self._noted[b] = last_surface[2].findings(f"object '{self._scene.bodies[b].name}'")
            same = alike(stretch[left], last_surface[1])
            if not same.any():  # the scale is animated, and this surface is used until it changes again
                carry = stretch[left[0]]
                last_surface = (mesh, carry, carried(mesh, carry))
                self._stretched[b] = last_surface
                same = alike(stretch[left], carry)
            yield last_surface[2], near_samples[left[same]], None
            left = left[~same]

    def _deformed(self, b: int, mesh: Mesh, carry: Array) -> Surface:
        """Return the surface of a deforming body; the last one if neither mesh nor scale has changed."""
        last = self._stretched.get(b)
        same = last is not None and (last[1].tobytes() == carry.tobytes() or bool(alike(carry[None], last[1])[0]))
        if last is None or last[0] is not mesh or not same:
            last = self._stretched[b] = (mesh, carry, carried(mesh, carry))
        return last[2]

    def _measure(
        self,
        b: int,
        surface: Surface,
        who: Indices,
        samples: Indices,
        points: Array,
        turn: Array,
        fingers: Array,
        velocity: Array | None,
        own_radius: Array | None,
        rates: Array | None,
    ) -> None:
        """Measure the gaps of all near pads to a surface, and store the samples at which it is within reach."""
        low, high = surface.box[0] - self._radius.longest, surface.box[1] + self._radius.longest
        inside = ((points >= low) & (points <= high)).all(axis=1)
        outside = inside.size - int(np.count_nonzero(inside))
        if outside:
            self._skipped["pair_samples_far"] += outside
            points, samples, who = points[inside], samples[inside], who[inside]
        if not samples.size:
            return
        nearest, closed, parts = surface.query(points, self._radius.longest), surface.closed, list(_parts(who))
        within_reach, turns = np.isfinite(nearest.gap), turn[samples]
        if closed:
            up = fingers[who, samples, :3, 2]
            nails = turn_back(turns, up / np.sqrt(dot(up, up))[:, None])
            for f, part in parts:
                which = within_reach[part].nonzero()[0] + part.start
                if which.size:
                    self._keep_side(self._pair(f, b), surface, nearest, which, points, samples, nails)
        if own_radius is not None:  # a chunk's longest radius must not lend others a touch that they lack alone
            within_reach &= (nearest.gap if closed else np.abs(nearest.gap)) <= own_radius[who, samples]
        moving = None if velocity is None and rates is None else np.zeros((len(points), 3))
        if moving is not None and velocity is not None and within_reach.any():
            moving[within_reach] = _interpolated(surface, nearest, within_reach, velocity)
        if moving is not None and rates is not None and within_reach.any():
            moving[within_reach] += turned(rates[samples[within_reach]], nearest.point[within_reach])
        for f, part in parts:
            own = within_reach[part].nonzero()[0] + part.start
            if own.size == 0:
                continue
            index, gap, normal = samples[own], nearest.gap[own], nearest.normal[own]
            smooth = surface.smooth_normals(nearest.triangle[own], nearest.weights[own]) if f in self._smooth else None
            pair = self._pair(f, b)
            if not closed:
                side = self._sides(pair, surface, index, points[own], turn, fingers[f])
                gap, normal = gap * side, normal * side[:, None]
                smooth = None if smooth is None else smooth * side[:, None]
            pair.last = self._count + int(index[-1])
            pair.start.append(self._count + index)
            pair.gap.append(gap)
            pair.normal.append(turned(turns[own], normal))
            pair.point.append(nearest.point[own])
            pair.surface_velocity.append(None if moving is None else moving[own])
            if smooth is not None:
                pair.smooth_normal.append(turned(turns[own], smooth))

    def _pair(self, f: int, b: int) -> PairRecord:
        pair = self._pairs.get((f, b))
        if pair is None:
            pair = self._pairs[f, b] = PairRecord()
        return pair

    def _keep_side(
        self,
        pair: PairRecord,
        surface: Surface,
        nearest: GapQuery,
        which: Indices,
        points: Array,
        samples: Indices,
        nails: Array,
    ) -> None:
        """Correct the gaps to a closed surface for the side from which the finger came.

        The proxy begins again after samples that are not known.
        """
        parts = [which]
        if which.size > 1:
            number = self._count + samples[which]
            parts = np.split(which, np.flatnonzero(number != np.concatenate([[pair.seen], number[:-1]]) + 1))
        for part in parts:
            if part.size == 0:
                continue
            own = nails.T[:, part].T  # directions that lie in memory as `turn_back` lays them
            first = int(pair.seen + 1 != self._count + samples[part[0]])
            if first:
                pair.proxy.start(surface, nearest, int(part[0]), points[part[0]], own[0])
            if part.size > first:
                pair.proxy.follow(surface, nearest, part[first:], points, own[first:])
            pair.seen = self._count + int(samples[part[-1]])

    def _sides(
        self, pair: PairRecord, surface: Surface, index: NDArray[np.intp], local: Array, turn: Array, finger: Array
    ) -> Array:
        """Return the side of an open surface from which the finger came at each sample, +1 or -1.

        It is decided when the surface comes within reach.
        """
        side = np.empty(index.size)
        follows = self._count + index == np.concatenate([[pair.last], self._count + index[:-1]]) + 1
        for k, (i, followed) in enumerate(zip(index, follows, strict=True)):
            if not followed:
                up = finger[i, :3, 2] / np.sqrt(finger[i, :3, 2] @ finger[i, :3, 2])
                pair.side = surface.side_of(local[k] + BONE[2] * (turn[i].T @ up))
            side[k] = pair.side
        return side


def _parts(who: Indices) -> Iterator[tuple[int, slice]]:
    """Yield each finger of a rising list of fingers, with its part of the list."""
    start = 0
    for f, count in Counter(who.tolist()).items():
        yield f, slice(start, start + count)
        start += count


def _interpolated(surface: Surface, nearest: GapQuery, within_reach: NDArray[np.bool_], velocity: Array) -> Array:
    """Interpolate the vertices' velocities at the closest points, shape (n, 3)."""
    corners = np.asarray(surface.triangles)[nearest.triangle[within_reach]]
    return np.einsum("nc,ncj->nj", nearest.weights[within_reach], velocity[corners])
