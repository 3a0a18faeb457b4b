"""Curved surfaces: whether an object is felt as its shading shows it, how exactly, and the findings on it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import compat
from .._core import Array, Finding, core
from ..properties.fields import value_of
from . import meshes, script_changes
from .meshes import Geometry

FELT = 50e-6
"""[m] between flat faces and the curved surface from which on it is told; 0.1 mm takes 5 % off a ball of 6 mm."""
LOOKED_AT = 20_000
"""Triangles up to which that is looked for; larger meshes are fine ones."""


_NEVER_SCALE = frozenset(
    {
        "CLAMP_TO",
        "COPY_LOCATION",
        "COPY_ROTATION",
        "DAMPED_TRACK",
        "FLOOR",
        "LIMIT_DISTANCE",
        "LIMIT_LOCATION",
        "LIMIT_ROTATION",
        "LOCKED_TRACK",
        "PIVOT",
        "SHRINKWRAP",
        "TRACK_TO",
    }
)
"""Types of constraint that only move and turn."""


def is_curved(obj: bpy.types.Object) -> bool:
    """Return whether *Curved Surface* is on for an object."""
    return bool(value_of(obj.dermis.material, core.parameters.material.CURVED))


def tolerance_of(obj: bpy.types.Object, stretch: float) -> float | None:
    """Return how far an object's surface may be off in its own space [m]; None where its faces are felt flat.

    Args:
        stretch: the most that its pose stretches it by.
    """
    return float(core.surface.curved.TOLERANCE / stretch) if is_curved(obj) else None


def stretch_of(matrix: Any) -> float:
    """Return the most that a matrix to the world, shape (4, 4), stretches by."""
    return float(core.surface.curved.stretch_of(np.asarray(matrix, np.float64)))


def stretches_of(matrices: Array) -> Array:
    """Return the most that each of many matrices to the world, shape (..., 4, 4), stretches by; 0 for unknown."""
    linear = matrices[..., :3, :3]
    finite = np.logical_and.reduce(np.isfinite(linear), axis=(-2, -1), keepdims=True)
    found = np.linalg.norm(np.where(finite, linear, 0.0), ord=2, axis=(-2, -1))
    return np.asarray(found, np.float64)


def rounded_up(stretch: float) -> float:
    """Return the next power of two: the surface of an object that grows is then made anew when it has doubled."""
    return float(2.0 ** np.ceil(np.log2(stretch)))


def asks_for_size(obj: bpy.types.Object) -> bool:
    """Return whether it matters how large an object becomes: it is felt curved, or its facets may have to be told."""
    return is_curved(obj) or obj.type != "MESH" or len(obj.modifiers) > 0 or obj.data.normals_domain != "FACE"


def may_grow(obj: bpy.types.Object) -> bool:
    """Return whether its pose may stretch an object by another factor at another frame, if no script does that."""
    own: bpy.types.Object | None = obj
    while own is not None:
        if not compat.animated_paths(own).isdisjoint({"scale", "delta_scale"}):
            return True
        if any(c.type not in _NEVER_SCALE for c in own.constraints):
            return True
        parent = own.parent
        if parent is not None and (own.parent_type != "OBJECT" or parent.type == "CURVE" or not _is_uniform(parent)):
            return True
        own = parent
    return False


def grows(obj: bpy.types.Object) -> bool:
    """Return whether its pose may stretch an object by another factor at another frame, scripts included."""
    return script_changes.run_here() or may_grow(obj)


def _is_uniform(obj: bpy.types.Object) -> bool:
    scale = np.abs(np.multiply(obj.scale, obj.delta_scale))
    return bool(scale.max() - scale.min() <= 1e-6 * scale.max())


def findings(geometry: Geometry | None, stretch: float, unit: float, made: Any | None, where: str) -> tuple[Any, ...]:
    """Return the findings on an object's surface: how it is curved, or that its facets will be felt.

    Args:
        geometry: its surface, with normals. stretch: the most that its pose stretches it by, over the range.
        unit: metres in a scene unit.
        made: the `CurvedMesh` that its surface was read as; None where it is flat.
    """
    if made is not None:
        return tuple(made.findings(where, stretch))
    if geometry is None or geometry.normals is None or not geometry.smooth:
        return ()
    places, faces = meshes.to_metres(geometry.positions, unit, False), geometry.topology.faces
    if not 0 < len(faces) <= LOOKED_AT or not np.isfinite(places).all():
        return ()
    shown, flat = geometry.normals, core.scene.tactile_scene.Mesh(places, faces)
    offset = core.surface.curved.curved_mesh(flat, shown, tolerance=FELT / stretch).offset * stretch
    if offset <= FELT:
        return ()
    return (
        Finding(
            "info",
            "facets",
            "it shades smooth, but its flat faces are felt",
            where=where,
            value=f"up to {1e3 * offset:.3g} mm beside the curved surface",
            remedy="Turn on Curved Surface in the Dermis tab under Touch: Material, or shade it flat",
        ),
    )


def outgrown(name: str, stretch: float, series: Array, frames: Array) -> Any | None:
    """Return the finding that an object becomes larger than its curved surface was made for.

    That is, between whole frames, or because a script lets it.

    Args:
        stretch: the most that its pose stretches it by at whole frames, without scripts. series: that of each sample,
            shape (n,). frames: of the samples, shape (n,).
    """
    off = core.surface.curved.TOLERANCE * series / stretch
    beyond = np.flatnonzero(off > FELT)
    if not len(beyond):
        return None
    return Finding(
        "warning",
        "curved-coarsely",
        "between whole frames, or by a script, it becomes larger than its curved surface was made for: facets are felt",
        where=f"object '{name}'",
        value=f"up to {1e6 * off.max():.3g} um off",
        limit=f"{1e6 * core.surface.curved.TOLERANCE:.3g} um",
        remedy="Let it be at its largest at a whole frame, and by keys; or bake the range in parts",
        frame=float(frames[beyond[0]]),
        count=len(beyond),
    )
