"""Errors of models of tissue, relative to a neo-Hookean finger.

Legends and results show these errors. They were simulated, not measured on fingers. In each comparison, the model and
the neo-Hookean finger have the same mesh, object, movement and law of friction. Contact is solved for each of them. The
error is therefore that of the tissue alone. Errors of the shape, of a person's stiffness and of the mesh (see
`MESH_STRESS`) are not included. For tissue that is neo-Hookean itself, the error shows how closely each frame is
solved.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..errors import DermisError
from ..units import finite

LINEAR, NEO_HOOKEAN = "linear", "neo_hookean"
DEPTHS = (0.5e-3, 1e-3, 1.5e-3, 2e-3, 3e-3, 4e-3)  # [m] depths of the touches without a slide
SLIDES = (0.0, 0.5e-3, 1e-3, 1.5e-3, 2e-3, 3.5e-3)  # [m] tangential displacements of the loaded skin, see `SLID_AT`
SLID_AT = 2e-3  # [m] depth of the touches with a slide

# Relative error that the standard mesh adds to the neo-Hookean stress, by the depth below the skin [m]. It is the error
# against converged meshes of the same law, for contact on points and a touch 2 mm deep. The largest error of a ball, a
# plane and a cylinder is taken, less the errors of the references (`bench nl_true_`).
MESH_STRESS = {0.3e-3: 0.14, 1.6e-3: 0.10}


class Spread(NamedTuple):
    """Distribution of a relative error over many touches.

    Attributes:
        median: half of the touches have a larger error.
        p90: a tenth of the touches have a larger error.
    """

    median: float
    p90: float


class ErrorBand(NamedTuple):
    """Error of a model of tissue at a depth and a slide.

    Attributes:
        stress: error of the stress in all tissue, weighted by volume, relative to the neo-Hookean model.
        force: error of the total force on the finger, as a vector.
    """

    stress: Spread
    force: Spread


# Median and 90th percentile at DEPTHS and at SLIDES, from `python -m tests.benchmarks.nonlinear_reference bands`. The
# errors at a slide are raised to those at shorter slides if they are smaller.
_BY_DEPTH: dict[str, dict[str, tuple[tuple[float, float], ...]]] = {
    LINEAR: {
        "stress": ((0.068, 0.088), (0.125, 0.160), (0.185, 0.221), (0.243, 0.293), (0.367, 0.417), (0.521, 0.689)),
        "force": ((0.034, 0.049), (0.073, 0.095), (0.130, 0.157), (0.185, 0.232), (0.332, 0.352), (0.459, 0.483)),
    },
    NEO_HOOKEAN: {
        "stress": ((0.005, 0.008), (0.006, 0.008), (0.007, 0.009), (0.007, 0.012), (0.009, 0.014), (0.015, 0.043)),
        "force": ((0.001, 0.003), (0.001, 0.003), (0.001, 0.003), (0.001, 0.003), (0.001, 0.003), (0.002, 0.007)),
    },
}
_BY_SLIDE: dict[str, dict[str, tuple[tuple[float, float], ...]]] = {
    LINEAR: {
        "stress": ((0.242, 0.281), (0.279, 0.454), (0.291, 0.454), (0.341, 0.454), (0.341, 0.897), (0.567, 0.897)),
        "force": ((0.192, 0.238), (0.192, 0.238), (0.223, 0.249), (0.238, 0.273), (0.238, 0.289), (0.238, 0.289)),
    },
    NEO_HOOKEAN: {
        "stress": ((0.006, 0.012), (0.008, 0.013), (0.009, 0.013), (0.014, 0.017), (0.014, 0.017), (0.014, 0.045)),
        "force": ((0.001, 0.002), (0.001, 0.003), (0.001, 0.003), (0.002, 0.003), (0.002, 0.003), (0.002, 0.010)),
    },
}


def error_band(tissue: str, depth: float, slide: float = 0.0) -> ErrorBand:
    """Return the error of a model of tissue.

    Errors are interpolated between the measured depths and slides. At a depth of 0 they are 0. Beyond the largest depth
    or slide they are those of the largest, and `validated` returns False.

    A slide adds the error that it adds at a depth of 2 mm. At a smaller depth, the added error is reduced in proportion
    to the depth.

    Args:
        tissue: 'linear' or 'neo_hookean'.
        depth: depth of the undeformed skin inside the object [m].
        slide: mean tangential displacement of the loaded skin by friction, weighted by load, see `PathStep.sums` [m].
            Slip does not add to it.

    Raises:
        DermisError: the tissue is unknown, or the depth or the slide is not finite or is below zero.
    """
    _check(tissue, depth, slide)
    share = min(depth / SLID_AT, 1.0)
    found = []
    for kind in ("stress", "force"):
        pressed, slid = _BY_DEPTH[tissue][kind], _BY_SLIDE[tissue][kind]
        both = []
        for k in (0, 1):
            more = _between(slide, SLIDES, [row[k] for row in slid]) - slid[0][k]
            both.append(_between(depth, (0.0, *DEPTHS), [0.0, *(row[k] for row in pressed)]) + share * more)
        found.append(Spread(*both))
    return ErrorBand(*found)


def validated(tissue: str, depth: float, slide: float = 0.0) -> bool:
    """Return whether errors were measured up to this depth and slide.

    The arguments are those of `error_band`.

    Raises:
        DermisError: see `error_band`.
    """
    _check(tissue, depth, slide)
    return depth <= DEPTHS[-1] and slide <= SLIDES[-1]


def _check(tissue: str, depth: float, slide: float) -> None:
    if tissue not in _BY_DEPTH:
        raise DermisError("unknown tissue", where="error band", value=tissue, limit=", ".join(_BY_DEPTH))
    for name, value in {"depth": depth, "slide": slide}.items():
        if not finite(value) or value < 0.0:
            raise DermisError(f"the {name} is no length", where="error band", value=value, limit=">= 0 m")


def _between(at: float, places: Sequence[float], values: Sequence[float]) -> float:
    """Return a value by linear interpolation.

    Args:
        at: place of the value, at least the first of `places`. Beyond the last place, the last value is returned.
        places: increasing numbers.
        values: one for each place.
    """
    for low, high, first, second in zip(places, places[1:], values, values[1:], strict=False):
        if at <= high:
            return first + (second - first) * (at - low) / (high - low)
    return values[-1]
