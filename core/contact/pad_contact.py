"""PadContact: which pads touch which bodies, with gaps and closest points, at every sample of the sweep."""

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
    """One pad and one body that come within reach of each other.

    Attributes:
        gap: signed distance of the pad's centre [m], inf beyond reach, shape (n,).
        normal: outward normal of the body in world axes, zero beyond reach, shape (n, 3).
        point: closest point in the body's carried space (scaled, not rotated) [m], zero beyond reach, shape (n, 3).
        surface_velocity: velocity of the closest point of a deforming body in its carried space [m/s]; None if the body
            is rigid.
        smooth_normal: that of the curved surface for which the faces stand, in world axes, zero beyond reach, shape
            (n, 3); None where no device of the finger asks for it.
    """

    gap: Array
    normal: Array
    point: Array
    surface_velocity: Array | None = None
    smooth_normal: Array | None = None


@dataclass(frozen=True, eq=False)
class PadContact:
    """The contact of all pads over a whole range.

    Only pairs that ever come within reach are kept, in `pairs`; `gap` and `normal` spread them over
    all fingers and bodies for those who want dense arrays.

    Attributes:
        frames, times: scene frame and time [s] of each sample, shape (n,).
        fingers, bodies, screens: object-to-world matrices, shape (count, n, 4, 4).
        pairs: by finger and body index.
        centres: centre of gravity of deforming bodies in their object space, shape (n, 3).
        animated: animated parameters over the whole range, shape (n,).
        skipped: how much work the scene did not need, by name.
        findings: repairs and refusals.
        kept: results derived from all this once, so that several devices share them.
        memory: state before the first sample if this is the end of a longer range; None if it begins at rest.
    """

    frames: Array
    times: Array
    fingers: Array
    bodies: Array
    screens: Array
    pairs: Mapping[tuple[int, int], PairContact] = field(default_factory=dict)
    centres: Mapping[int, Array] = field(default_factory=dict)
    animated: Mapping[str, Array] = field(default_factory=dict)
    skipped: Mapping[str, int] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    kept: dict[Any, Any] = field(default_factory=dict, repr=False)
    memory: Memory | None = None

    @cached_property
    def knots(self) -> Knots:
        """The times of the samples, as splines through them take them."""
        return Knots(self.times)

    @cached_property
    def gap(self) -> Array:
        """Signed distance between pads and bodies [m], inf beyond reach, shape (F, B, n)."""
        dense = np.full((len(self.fingers), len(self.bodies), len(self.times)), np.inf)
        for (f, b), pair in self.pairs.items():
            dense[f, b] = pair.gap
        return dense

    @cached_property
    def normal(self) -> Array:
        """Outward normals in world axes, zero beyond reach, shape (F, B, n, 3)."""
        dense = np.zeros((len(self.fingers), len(self.bodies), len(self.times), 3))
        for (f, b), pair in self.pairs.items():
            dense[f, b] = pair.normal
        return dense

    def device_times(self, scene: TactileScene, rate: float) -> Array:
        """Return the times of a device's commands [s], the same array for all devices of a rate [Hz]."""

        def made() -> Array:
            return device_times(scene, rate) if self.memory is None else self.memory.times(rate)

        times: Array = self.keep(("device times", rate), made)
        return times

    def carry(self, key: Hashable, times: Array) -> AbstractContextManager[Carry]:
        """Give the state that something at device times begins with, and note how it ends; rest without a memory."""
        return nullcontext(Carry()) if self.memory is None else self.memory.carry(key, times)

    def lasting(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what holds for the whole scene, made once where it is computed window by window."""
        made: T = make() if self.memory is None else self.memory.lasting(key, make)
        return made

    def finger_motion(self, finger: int) -> Motion:
        """Return the smooth motion of a finger, computed once."""
        return self.keep(("finger", finger), lambda: Motion(self.knots, self.fingers[finger]))

    def body_motion(self, body: int) -> Motion:
        """Return the smooth motion of a body, computed once."""
        return self.keep(("body", body), lambda: Motion(self.knots, self.bodies[body]))

    def finger_at(self, finger: int, times: Array) -> MotionSamples:
        """Return a finger's motion at times that are asked for again and again, computed once."""
        return self.keep(("finger at", finger, len(times)), lambda: self.finger_motion(finger).at(times), times)

    def body_at(self, body: int, times: Array) -> MotionSamples:
        """Return a body's motion at times that are asked for again and again, computed once."""
        return self.keep(("body at", body, len(times)), lambda: self.body_motion(body).at(times), times)

    def centre(self, body: int, mesh: Mesh | None) -> Spline:
        """Return the path of a body's centre of gravity in the world [m], computed once."""

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
        """Return an animated parameter at times, shape (m,), or its constant value where it is not animated.

        A switch holds each sample's value until the next; numbers are interpolated linearly.

        Args:
            owner: owner of the parameter, such as 'body/3'.
            row: the parameter.
            constants: the owner's parameters that are not animated.
            times: [s], shape (m,).
        """
        values = self.animated.get(f"{owner}/{row.name}")
        if values is None:
            return float(constants.get(row.name, row.absent))
        if (values == values[0]).all():
            return float(values[0])
        if row.numeric:
            return np.interp(times, self.times, values)
        return values[np.clip(np.searchsorted(self.times, times + 1e-9, side="right") - 1, 0, None)]

    def keep(self, key: Any, make: Callable[[], Any], times: Array | None = None) -> Any:
        """Return the result under a key, made once; with `times`, only for an object of the same times."""
        known = self.kept.get(key)
        if known is None or (times is not None and known.times is not times and not np.array_equal(known.times, times)):
            self.kept[key] = known = make()
        return known
