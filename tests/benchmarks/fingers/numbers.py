"""The numbers of the page of measured fingers, from what a skin did."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .balls import Profile
from .laws import ellipsoid, exponential, paraboloid, power, slope, straight
from .plate import MM, SLIDES, Array, Moment
from .trials import BELOW, DIRECTIONS, PULLED, RADII, STEP, TIMES, Trials

AT = (0.5, 1.0, 2.0)  # forces of the press at which numbers are told [N]
MEASURED = (0.79, 1.53)  # stiffness sideways [N/mm]. Source: Gleeson et al. 2010 through [S3] section 3
FELT = 0.48  # share that slips when people notice. Source: Barrea, Delhaye, Lefevre and Thonnard 2018, abstract


def numbers(found: Trials) -> dict[str, Any]:
    """Return what the page says of one skin, to four digits."""
    drag: dict[str, dict[str, Any]] = {}
    for (friction, name), moments in found.dragged.items():
        drag.setdefault(f"{friction:g}", {})[name] = _drag(moments, name, friction) | {
            "gives way": (friction, name) in found.gave_way
        }
    every = [*found.pressed, *(m for moments in found.dragged.values() for m in moments)]
    out = {
        "press": _press(found.pressed),
        "drag": drag,
        "balls": _balls(found.balls),
        "sideways": {name: _sideways(values) for name, values in found.sideways.items()},
        "moments": len(every),
        "unsettled": sum(not m.settled for m in every),
    }
    rounded: dict[str, Any] = json.loads(json.dumps(out), parse_float=lambda text: float(f"{float(text):.4g}"))
    return rounded


def _press(moments: Sequence[Moment]) -> dict[str, Any]:
    depth = np.array([m.place[2] for m in moments]) / MM
    force = np.array([m.force[2] for m in moments])
    plate = np.array([m.plate for m in moments]) / MM**2
    stiffness = np.gradient(force, depth)
    felt = force >= 0.25
    at_one = moments[int(np.abs(force - 1.0).argmin())]
    laws = {}
    for name, kept in (("to 2 N", force <= 2.0), ("to 2 mm", depth > 0.0)):
        e, p = exponential(depth[kept], force[kept]), power(depth[kept], force[kept])
        laws[name] = {"exponential": e.fit, "rate": e.rate, "power": p.fit, "exponent": p.rate}
    return {
        "force": float(force[-1]),
        "laws": laws,
        "straight": straight(force[felt], stiffness[felt]),
        "stiffness": {f"{f:g}": float(np.interp(f, force, stiffness)) for f in AT},
        "area": {f"{f:g}": float(np.interp(f, force, plate)) for f in AT},
        "area exponent": slope(force[felt], plate[felt]),
        "paraboloid": paraboloid(at_one.points, at_one.pressure),
        "ellipsoid": ellipsoid(at_one.points, at_one.pressure),
    }


def _drag(moments: Sequence[Moment], name: str, friction: float) -> dict[str, Any]:
    pull = pulls(moments, name, friction)
    stuck = np.array([m.stuck for m in moments])
    slips = np.maximum.accumulate(1.0 - stuck)
    return {
        "area": moments[-1].plate / moments[0].plate,
        "way": float(STEP * (len(moments) - 1) / MM),
        "slides": bool(stuck[-1] < SLIDES),
        "straight": straight(pull, stuck),
        "pull when felt": float(np.interp(FELT, slips, pull)),
        "rim": _rim(moments[int(np.abs(stuck - 0.5).argmin())]),
        "held": float(max(abs(m.force[2] / PULLED - 1.0) for m in moments)),
    }


def _sideways(stiffness: Sequence[float]) -> dict[str, float]:
    """Return the stiffness of the skin as it is, and times how much its modulus it would be the measured ones."""
    rising = np.maximum.accumulate(np.log(stiffness))
    fitted = np.exp(np.interp(np.log(MEASURED), rising, np.log(TIMES), left=np.nan, right=np.nan))
    return {"stiffness": stiffness[TIMES.index(1.0)], "low": float(fitted[0]), "high": float(fitted[1])}


def pulls(moments: Sequence[Moment], name: str, friction: float) -> Array:
    """Return the force along a direction of `DIRECTIONS`, over what friction can carry, shape (n,)."""
    along = np.array(DIRECTIONS[name])
    return np.array([m.force[:2] @ along / m.force[2] for m in moments]) / friction


def _rim(moment: Moment) -> float:
    """Return how far from the middle of what sticks the rest lies, over what sticks itself.

    It is 1.83 of an annulus around half of a disc: (1 - 2^-1.5) / 2^-1.5.
    """
    far = np.linalg.norm(moment.points - moment.points[moment.sticks].mean(axis=0), axis=1)
    return float(far[~moment.sticks].mean() / far[moment.sticks].mean())


def _balls(found: Mapping[tuple[float, float], Sequence[Profile]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for below in BELOW:
        peaks = np.array([[p.density.max() for p in found[below, r]] for r in RADII])
        wide = np.array([[width(p.across, p.density) for p in found[below, r]] for r in RADII])
        out[f"{below:g}"] = {
            "peaks": peaks.tolist(),
            "widths": (wide / MM).tolist(),
            "depths": [[p.depth / MM for p in found[below, r]] for r in RADII],
            "rises with curvature": bool((np.diff(peaks, axis=0) < 0).all()),
            "rises with force": bool((np.diff(peaks, axis=1) > 0).all()),
            "narrows with curvature": bool((np.diff(wide, axis=0) > 0).all()),
        }
    return out


def width(across: Array, density: Array) -> float:
    """Return the width of a profile at half of its height, in the unit of `across`."""
    half = 0.5 * float(density.max())
    above = np.flatnonzero(density >= half)

    def edge(inside: int, outside: int) -> float:
        if not 0 <= outside < len(across):
            return float(across[inside])
        share = (density[inside] - half) / (density[inside] - density[outside])
        return float(across[inside] + share * (across[outside] - across[inside]))

    first, last = int(above[0]), int(above[-1])
    return edge(last, last + 1) - edge(first, first - 1)
