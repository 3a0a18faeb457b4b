"""Report geometry without faces that touchable objects show.

Points, curves and volumes are not felt.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from .._core import Finding
from . import participants

_CALLED = {
    "POINTCLOUD": ("points", "instances of a sphere on the points, or Points to Volume and Volume to Mesh"),
    "CURVES": ("curves", "Curve to Mesh"),
    "CURVE": ("curves", "Curve to Mesh"),
    "VOLUME": ("a volume", "Volume to Mesh"),
    "GREASEPENCIL": ("Grease Pencil strokes", "Grease Pencil to Curves and Curve to Mesh"),
}
"""Name of the geometry, by type of object, and the nodes that make faces of it."""


class Unfelt(NamedTuple):
    """Geometry without faces that an object shows.

    Attributes:
        uid: session uid of the object. kind: type of the geometry.
    """

    uid: int
    kind: str


def is_unfelt(instance: Any, shown: Any) -> bool:
    """Return whether an instance is visible without having faces.

    Args:
        instance: the shown instance. shown: the object that it is an instance of. A curve object has a surface, which
            is shown as another instance, of a mesh. Curves that nodes make of a mesh have none.
    """
    kind = instance.type
    if kind == "POINTCLOUD":
        return len(instance.data.points) > 0
    return kind in _CALLED and (kind != "CURVE" or shown.type != "CURVE")


def findings(seen: Iterable[tuple[Unfelt, float]]) -> list[Any]:
    """Return findings on unfelt geometry, with the first frame of each."""
    first = dict(seen)
    objects = participants.look_up({unfelt.uid for unfelt in first})
    out = []
    for unfelt, frame in sorted(first.items()):
        called, nodes = _CALLED[unfelt.kind]
        out.append(
            Finding(
                "warning",
                "shown-without-faces",
                f"it shows {called}, which are not felt: only faces are",
                where=f"object '{objects[unfelt.uid].name_full}'",
                value=called,
                limit="faces",
                remedy=f"Make faces of them with geometry nodes: {nodes}",
                frame=frame,
            )
        )
    return out
