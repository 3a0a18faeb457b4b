"""Replacement of the gaps of points."""

from __future__ import annotations

from ...arrays import Indices
from .bodies import NodeGaps

PER_POINT = ("gap", "clearance", "normal", "body", "triangle", "friction", "softness")


def passed_on(gaps: NodeGaps, count: int, heirs: Indices, sources: Indices) -> NodeGaps:
    """Return the gaps of `count` points: points `heirs` get those of `sources`, and all others are beyond reach."""
    out = NodeGaps.nothing(gaps.bodies, count)
    for name in PER_POINT:
        getattr(out, name)[heirs] = getattr(gaps, name).take(sources, axis=0)
    return out
