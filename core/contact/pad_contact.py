"""PadContact: gaps and closest points of all pads and bodies, at every sample of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ..arrays import Array
from ..errors import Finding
from ..memory import Carry, Memory
from ..motion import Knots, Motion, MotionSamples, Spline
from ..parameters.parameter import Parameter
from ..scene.tactile_scene import Mesh, TactileScene, device_times
from ..surface.centre import centre_of

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class PairContact:
    """Contact of one pad and one body that come within reach of each other.

    Attributes:
        gap: signed distance of the pad's centre from the body [m], shape (n,); inf beyond reach.
        normal: outward normal of the body in world axes, shape (n, 3); zero beyond reach.
        point: closest point in the body's carried space (scaled, not rotated) [m], shape (n, 3); zero beyond reach.
        surface_velocity: velocity of the closest point of a deforming body in its carried space [m/s], shape (n, 3);
            None for a rigid body.
        smooth_normal: normal of the curved surface that the faces approximate, in world axes, shape (n, 3), zero beyond
            reach; None if no device of the finger uses it.
    """

    gap: Array
    normal: Array
    point: Array
    surface_velocity: Array | None = None
    smooth_normal: Array | None = None


@dataclass(frozen=True, eq=False)
class PadContact:
    """Contact of all pads over a whole range.

    Only pairs that come within reach at some sample are stored, in `pairs`.

    Attributes:
        frames, times: scene frame and time [s] of each sample, shape (n,).
        fingers, bodies, screens: object-to-world matrices, shape (count, n, 4, 4).
        pairs: contact of each pair, by the indices of finger and body.
        centres: centres of gravity of deforming bodies in their own space [m], shape (n, 3), by the index of the body.
        apart: least distance between a pad's centre and the bounding box of a deforming body [m], and its sample, by
            the indices of finger and body.
        animated: animated parameters over the whole range, by name, shape (n,).
        skipped: amounts of work that were left out, by name.
        findings: repairs, and doubts about surfaces.
        kept: derived results, which several devices share.
        memory: state before the first sample if this is the end of a longer range; None if it begins at rest.
    """

    frames: Array
    times: Array
    fingers: Array
    bodies: Array
    screens: Array
    pairs: Mapping[tuple[int, int], PairContact] = field(default_factory=dict)
    centres: Mapping[int, Array] = field(default_factory=dict)
    apart: Mapping[tuple[int, int], tuple[float, int]] = field(default_factory=dict)
    animated: Mapping[str, Array] = field(default_factory=dict)
    skipped: Mapping[str, int] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    kept: dict[Any, Any] = field(default_factory=dict, repr=False)
    memory: Memory | None = None

    @cached_property
    def knots(self) -> Knots:
        """Times of the samples as knots of splines."""
        return Knots(self.times)

    def device_times(self, scene: TactileScene, rate: float) -> Array:
        """Return the times of a device's commands [s]; devices of the same rate [Hz] get the same array."""

        def made() -> Array:
            return device_times(scene, rate) if self.memory is None else self.memory.times(rate)

        times: Array = self.keep(("device times", rate), made)
        return times

    def carry(self, key: Hashable, times: Array) -> AbstractContextManager[Carry]:
        """Return a context with the state at the first time, which stores the state at the end.

        Without a memory, the state is that of rest.

        Args:
            key: key of the state.
            times: the device's times [s], shape (m,).
        """
        return nullcontext(Carry()) if self.memory is None else self.memory.carry(key, times)

    def lasting(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return a value that holds for the whole scene; with a memory it is computed once for all windows."""
        made: T = make() if self.memory is None else self.memory.lasting(key, make)
        return made

    def finger_motion(self, finger: int) -> Motion:
        """Return the smooth motion of a finger, which is kept."""
        return self.keep(("finger", finger), lambda: Motion(self.knots, self.fingers[finger]))

    def body_motion(self, body: int) -> Motion:
        """Return the smooth motion of a body, which is kept."""
        return self.keep(("body", body), lambda: Motion(self.knots, self.bodies[body]))

    def finger_at(self, finger: int, times: Array) -> MotionSamples:
        """Return a finger's motion at times [s], shape (m,), which is kept for these times."""
        return self.keep(("finger at", finger, len(times)), lambda: self.finger_motion(finger).at(times), times)

    def body_at(self, body: int, times: Array) -> MotionSamples:
        """Return a body's motion at times [s], shape (m,), which is kept for these times."""
        return self.keep(("body at", body, len(times)), lambda: self.body_motion(body).at(times), times)

    def centre(self, body: int, mesh: Mesh | None) -> Spline:
        """Return the path of a body's centre of gravity in the world [m], which is kept."""

        def path() -> Spline:
            if body in self.centres:
                centre = self.centres[body]
            else:
                middle = np.zeros(3) if mesh is None else centre_of(mesh)
                centre = np.broadcast_to(middle, (len(self.times), 3))
            pose = self.bodies[body]
            return Spline(self.knots, np.einsum("nij,nj->ni", pose[:, :3, :3], centre) + pose[:, :3, 3])

        return self.keep(("centre", body), path)

    def series(self, owner: str, row: Parameter, constants: Mapping[str, Any], times: Array) -> float | Array:
        """Return an animated parameter at times, shape (m,), which is kept, or its constant value.

        Numbers are interpolated linearly. A switch keeps the value of each sample until the next.

        Args:
            owner: owner of the parameter, such as 'body/3'.
            row: the parameter.
            constants: the owner's parameters that are not animated.
            times: times [s], shape (m,).
        """
        key = f"{owner}/{row.name}"
        values = self.animated.get(key)
        if values is None:
            return float(constants.get(row.name, row.absent))
        known: tuple[Array, float | Array] | None = self.kept.get((key, len(times)))
        if known is None or not (known[0] is times or np.array_equal(known[0], times)):
            found: float | Array
            if (values == values[0]).all():
                found = float(values[0])
            elif row.numeric:
                found = np.interp(times, self.times, values)
            else:
                found = values[np.clip(np.searchsorted(self.times, times + 1e-9, side="right") - 1, 0, None)]
            known = self.kept[key, len(times)] = times, found
        return known[1]

    def keep(self, key: Any, make: Callable[[], Any], times: Array | None = None) -> Any:
        """Return the result with a key, computed once; with `times`, again if these have changed."""
        known = self.kept.get(key)
        if known is None or (times is not None and known.times is not times and not np.array_equal(known.times, times)):
            self.kept[key] = known = make()
        return known
