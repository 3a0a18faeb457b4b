"""Curved surfaces: whether an object is felt as its shading shows it, how exactly, and what is told of it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .._core import Finding, core
from ..properties.fields import value_of
from . import meshes
from .meshes import Geometry

FELT = 50e-6
"""[m] between flat faces and the curved surface from which on it is told; 0.1 mm takes 5 % off a ball of 6 mm."""
LOOKED_AT = 20_000
"""Triangles up to which that is looked for; larger meshes are fine ones."""


def tolerance_of(obj: bpy.types.Object, matrix: Any) -> float | None:
    """Return how far an object's surface may be off in its own space [m]; None where its faces are felt flat.

    Args:
        matrix: to the world, shape (4, 4); a scale that is keyed counts as it is now.
    """
    if not value_of(obj.dermis.material, core.parameters.material.CURVED):
        return None
    return float(core.surface.curved.TOLERANCE / _scale(matrix))


def findings(geometry: Geometry | None, matrix: Any, unit: float, made: Any | None, where: str) -> tuple[Any, ...]:
    """Return what is to be said of an object's surface: how it is curved, or that its facets will be felt.

    Args:
        geometry: its surface, with normals. matrix: to the world, shape (4, 4). unit: metres in a scene unit.
        made: the `CurvedMesh` that its surface was read as; None where it is flat.
    """
    scale = _scale(matrix)
    if made is not None:
        return tuple(made.findings(where, scale))
    if geometry is None or geometry.normals is None or not geometry.smooth:
        return ()
    places, faces = meshes.to_metres(geometry.positions, unit, False), geometry.topology.faces
    if not 0 < len(faces) <= LOOKED_AT or not np.isfinite(places).all():
        return ()
    shown, flat = geometry.normals, core.scene.tactile_scene.Mesh(places, faces)
    offset = core.surface.curved.curved_mesh(flat, shown, tolerance=FELT / scale).offset * scale
    if offset <= FELT:
        return ()
    return (
        Finding(
            "info",
            "facets",
            "it shades smooth, but its flat faces are felt",
            where=where,
            value=f"up to {1e3 * offset:.3g} mm beside the curved surface",
            remedy="Turn on Curved Surface in the Dermis tab under Haptic Material, or shade it flat",
        ),
    )


def _scale(matrix: Any) -> float:
    """Return the most that an object stretches by."""
    return float(core.surface.curved.stretch_of(np.asarray(matrix, np.float64)))
