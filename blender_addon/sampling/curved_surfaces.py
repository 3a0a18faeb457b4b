"""Decide which objects are felt as curved surfaces, and how exactly.

A curved surface is the one that the shading of an object shows.
"""

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
"""[m] Distance between flat faces and the curved surface above which it is reported. At 0.1 mm, the force of a ball of
6 mm is 5 % too small."""
LOOKED_AT = 20_000
"""[triangles] Size up to which this distance is measured; the faces of larger meshes are taken as fine enough."""


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
"""Types of constraint that do not change the scale."""


def is_curved(obj: bpy.types.Object) -> bool:
    """Return whether *Curved Surface* is on for an object."""
    return bool(value_of(obj.dermis.material, core.parameters.material.CURVED))


def tolerance_of(obj: bpy.types.Object, stretch: float) -> float | None:
    """Return the tolerance of an object's curved surface in its own space [m].

    It is None if the faces of the object are felt flat.

    Args:
        stretch: the largest factor by which its pose stretches it.
    """
    return float(core.surface.curved.TOLERANCE / stretch) if is_curved(obj) else None


def stretch_of(matrix: Any) -> float:
    """Return the largest stretch of a matrix to the world, shape (4, 4)."""
    return float(core.surface.curved.stretch_of(np.asarray(matrix, np.float64)))


def stretches_of(matrices: Array) -> Array:
    """Return the largest stretch of each of many matrices to the world.

    The matrices have shape (..., 4, 4). The stretch of a matrix that is not finite is 0.
    """
    linear = matrices[..., :3, :3]
    finite = np.logical_and.reduce(np.isfinite(linear), axis=(-2, -1), keepdims=True)
    found = np.linalg.norm(np.where(finite, linear, 0.0), ord=2, axis=(-2, -1))
    return np.asarray(found, np.float64)


def rounded_up(stretch: float) -> float:
    """Return the next power of two that is not smaller.

    The surface of an object that grows is then made anew each time its size has doubled.
    """
    return float(2.0 ** np.ceil(np.log2(stretch)))


def asks_for_size(obj: bpy.types.Object) -> bool:
    """Return whether the size of an object matters to its surface.

    It does if the object is felt curved, or if the distance of its facets may have to be reported.
    """
    return is_curved(obj) or obj.type != "MESH" or len(obj.modifiers) > 0 or obj.data.normals_domain != "FACE"


def may_grow(obj: bpy.types.Object) -> bool:
    """Return whether the stretch of an object's pose may vary with the frame.

    Scripts are not considered.
    """
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
    """Return whether an object's stretch may vary by frame or by scripts."""
    return script_changes.run_here() or may_grow(obj)


def _is_uniform(obj: bpy.types.Object) -> bool:
    scale = np.abs(np.multiply(obj.scale, obj.delta_scale))
    return bool(scale.max() - scale.min() <= 1e-6 * scale.max())


def findings(geometry: Geometry | None, stretch: float, unit: float, made: Any | None, where: str) -> tuple[Any, ...]:
    """Return the findings on an object's surface.

    They are those of its curved surface, or one that its facets will be felt.

    Args:
        geometry: its surface, with normals. stretch: the largest factor by which its pose stretches it in the range.
        unit: [m] length of a scene unit.
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
            "it is shaded smooth, but contact uses its flat faces",
            where=where,
            value=f"up to {1e3 * offset:.3g} mm beside the curved surface",
            remedy="Turn on Curved Surface in the Dermis tab under Touch: Material, or shade it flat",
        ),
    )


def outgrown(name: str, stretch: float, series: Array, frames: Array) -> Any | None:
    """Return a finding if an object outgrows its curved surface.

    It may become larger than its surface was made for between whole frames, or by a script.

    Args:
        stretch: the largest stretch of its pose at whole frames, without scripts.
        series: the stretch at each sample, shape (n,). frames: the frames of the samples, shape (n,).
    """
    off = core.surface.curved.TOLERANCE * series / stretch
    beyond = np.flatnonzero(off > FELT)
    if not len(beyond):
        return None
    return Finding(
        "warning",
        "curved-coarsely",
        "between whole frames, or by a script, it becomes larger than its curved surface allows: contact uses "
        "flat faces",
        where=f"object '{name}'",
        value=f"up to {1e6 * off.max():.3g} um off",
        limit=f"{1e6 * core.surface.curved.TOLERANCE:.3g} um",
        remedy="Let it reach its largest size at a whole frame, by keys; or bake the range in parts",
        frame=float(frames[beyond[0]]),
        count=len(beyond),
    )
