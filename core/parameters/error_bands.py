"""How far each model of tissue is from a neo-Hookean finger under the same touch: figures of legends and results.

Both press the same mesh with the same object, each with its own contact, and share the law of friction: the figure
is the error of the tissue alone, not of the shape or of a person's stiffness, nor of the mesh, see `MESH_STRESS`. Of
tissue that follows the law it is how closely each frame is solved. Simulated, not measured on fingers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..errors import DermisError
from ..units import finite

LINEAR, NEO_HOOKEAN = "linear", "neo_hookean"
DEPTHS = (0.5e-3, 1e-3, 1.5e-3, 2e-3, 3e-3, 4e-3)  # that a touch was pressed to, not slid [m]
SLIDES = (0.0, 0.5e-3, 1e-3, 1.5e-3, 2e-3, 3.5e-3)  # that loaded skin was then drawn along itself, 2 mm deep [m]
SLID_AT = 2e-3  # depth of the slides [m]

# Error that the standard mesh adds to that of neo-Hookean stress so deep below the skin [m]: contact on points, pressed
# 2 mm deep, against converged meshes of the same law; the worst of a ball, a plane and a cylinder, less the references'
# own errors (`bench nl_true_`).
MESH_STRESS = {0.3e-3: 0.14, 1.6e-3: 0.10}


class Spread(NamedTuple):
    """Relative errors of one kind: half and a tenth of the touches are farther off."""

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


# of `python -m tests.benchmarks.nonlinear_reference bands`: median and 90th percentile, at DEPTHS and at SLIDES; of
# slides never less than of shorter ones
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

    Between the measured depths and slides errors are interpolated, from none at rest; beyond the last they are the
    last ones, and `validated` says so. A slide adds its error 2 mm deep, by share of the depth where it is less.
    What counts of a slide is how far friction draws skin along itself: where it slips, skin is drawn no farther.

    Args:
        tissue: 'linear' or 'neo_hookean'.
        depth: depth of the undeformed skin inside the object [m].
        slide: that loaded skin is drawn along itself, on average by its load, `PathStep.slide` [m].

    Raises:
        DermisError: an unknown tissue, or a depth or slide that is not finite or below zero.
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
    """Return whether errors were measured as deep and as far.

    Raises:
        DermisError: as `error_band`.
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
    """Return the line through values at rising places; the last value beyond the last."""
    for low, high, first, second in zip(places, places[1:], values, values[1:], strict=False):
        if at <= high:
            return first + (second - first) * (at - low) / (high - low)
    return values[-1]
