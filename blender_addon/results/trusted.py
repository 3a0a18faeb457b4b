"""Keep the trust band of a scene.

It is the change of forces and commands with small changes of the scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from .._core import Array, core
from . import store
from .lanes import Lane, Mark, Series, marks_of


@dataclass(frozen=True, eq=False)
class Trusted:
    """One scene's bands.

    Attributes:
        bands: bands of devices, in the order of a bake's outputs, and then of skins.
        taken: the state of the scene when it was sampled, and the clock of the bands' times.
        findings: warnings about the bands, with their frames.
        marks: marks for the strip.
    """

    bands: tuple[Any, ...]
    taken: store.Taken
    findings: tuple[Any, ...]
    marks: tuple[Mark, ...]

    def into(self, lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
        """Return lanes with a series of doubt.

        It is 1 where any channel of the finger changes by more than a band may.
        """
        found: dict[str, list[Series]] = {}
        for band in self.bands:
            doubtful = (band.spread > core.comparison.trust_band.DOUBT * band.felt).any(axis=1)
            frames = np.asarray(self.taken.clock.frames(band.times))
            found.setdefault(band.finger, []).append(Series(frames, doubtful.astype(np.float64)))
        return tuple(Lane(x.finger, {**x.series, "doubt": tuple(found.get(x.finger, ()))}) for x in lanes)


_trusted: dict[int, Trusted] = {}


def forget() -> None:
    """Drop all bands, as after another file was opened."""
    _trusted.clear()


def current(scene: bpy.types.Scene) -> Trusted | None:
    """Return the scene's bands; None without any, or if the scene has changed."""
    made = _trusted.get(scene.session_uid)
    return made if made is not None and made.taken.holds(scene) else None


def spreads(scene: bpy.types.Scene, bake: Any) -> Mapping[int, Array]:
    """Return the known changes of a bake's tracks, by index of output.

    The bake may be older than the bands. Tracks whose values differ from those of the bands are left out.
    """
    made = current(scene)
    bands = [] if made is None else [band for band in made.bands if band.track is not None]
    return {
        k: band.spread
        for k, (band, output) in enumerate(zip(bands, bake.outputs, strict=False))
        if band.device == output.device and np.array_equal(band.values, output.track.values)
    }


def keep(scene: bpy.types.Scene, bands: tuple[Any, ...], taken: store.Taken) -> Trusted:
    """Keep a scene's bands for the session.

    Args:
        taken: the state of the scene when it was sampled.
    """
    told = ((band, band.finding) for band in bands)
    found = tuple(replace(f, frame=float(taken.clock.frames(band.worst_time))) for band, f in told if f is not None)
    made = _trusted[scene.session_uid] = Trusted(bands, taken, found, marks_of(found))
    return made
