"""The fingertip that Add > Dermis > Finger puts into the scene.

Its shape is in millimetres, its mesh in scene units. Its origin is the pad's centre, +Y points to the tip, and +Z to
the nail, so the object's own matrix is the finger's frame. Pad and sides follow the engine's skin of the same lengths;
crease, nail bed, folds and nail are drawn on top of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ._core import Array

_RINGS, _SEGMENTS = 60, 80
_PALM_SHARE, _WAIST_PALM, _WAIST_SIDE = 0.54, 0.12, 0.05  # the same as of the engine's skin
SKIN, NAIL = (0.76, 0.42, 0.31, 1.0), (0.87, 0.58, 0.52, 1.0)
# Share of a finger's width by which a pad may miss the skin of its hand. A pad that is placed well misses by at most
# 1 mm; pads placed wrongly missed by 0.18 of a width and more.
OFF = 0.1
OURS = "dermis_fingertip"  # custom property of a mesh that follows the finger's lengths


@dataclass(frozen=True)
class Lengths:
    """Lengths of a fingertip [mm]; see the engine's `FingertipShape`.

    The default is an adult's index finger.
    """

    width: float = 16.0
    thickness: float = 13.0
    length: float = 24.0
    tip: float = 10.5
    nail_width: float = 10.5
    nail_length: float = 11.0
    nail_margin: float = 1.5

    @classmethod
    def of(cls, lengths: Mapping[str, float]) -> Lengths:
        """Return the lengths [mm] from lengths [m] by the engine's names; other names are ignored."""
        return cls(**{name: 1e3 * lengths[name] for name in cls.__dataclass_fields__})

    @property
    def base(self) -> float:
        """Position along Y at which the finger is cut off."""
        return self.tip - self.length

    @property
    def middle(self) -> float:
        """Height of the widest part above the pad."""
        return self.thickness * _PALM_SHARE

    @property
    def top(self) -> float:
        """Height of the back above the pad; the nail lies a little higher."""
        return 0.975 * self.thickness

    @property
    def nail_reach(self) -> float:
        """Half the length of the visible nail, which reaches beyond its bed."""
        return 0.58 * self.nail_length

    @property
    def nail_centre(self) -> float:
        """Middle of the nail along Y."""
        return self.tip - 0.6 * self.nail_margin - self.nail_reach


def shape(lengths: Lengths | None = None) -> tuple[Array, list[tuple[int, ...]], NDArray[np.int32]]:
    """Return a fingertip's vertices, polygons and materials.

    Vertices are in mm, shape (n, 3). The material of a polygon is 0 for skin and 1 for the nail.
    """
    lengths = lengths or Lengths()
    skin, skin_faces = _skin(lengths)
    nail, nail_faces = _nail(lengths)
    faces = skin_faces + [tuple(i + len(skin) for i in face) for face in nail_faces]
    material = np.repeat(np.array([0, 1], dtype=np.int32), [len(skin_faces), len(nail_faces)])
    return np.vstack([skin, nail]), faces, material


def mesh(metres_per_unit: float = 1.0, lengths: Lengths | None = None) -> bpy.types.Mesh:
    """Return a new mesh with skin and nail materials, in scene units."""
    vertices, faces, material = shape(lengths)
    data = bpy.data.meshes.new("Fingertip")
    data.from_pydata((vertices * 1e-3 / metres_per_unit).tolist(), [], faces)
    data.polygons.foreach_set("material_index", material)
    smooth = np.array([len(face) <= 4 for face in faces])  # the cut end stays flat
    data.polygons.foreach_set("use_smooth", smooth)
    data.materials.append(_material("Fingertip Skin", SKIN, 0.5))
    data.materials.append(_material("Fingertip Nail", NAIL, 0.25))
    data[OURS] = True
    data.update()
    return data


def fit(obj: bpy.types.Object, lengths: Mapping[str, float], metres_per_unit: float) -> None:
    """Fit a fingertip of ours to a finger's lengths; leave an artist's mesh alone.

    Args:
        lengths: lengths of the finger's skin [m], by the engine's names.
        metres_per_unit: metres in a scene unit.
    """
    data = obj.data
    if not isinstance(data, bpy.types.Mesh) or not data.get(OURS) or data.users > 1 or data.shape_keys is not None:
        return
    vertices, _, _ = shape(Lengths.of(lengths))
    if len(vertices) == len(data.vertices):
        data.vertices.foreach_set("co", (vertices * 1e-3 / metres_per_unit).astype(np.float32).ravel())
        data.update()


@contextmanager
def kept(data: bpy.types.Mesh) -> Iterator[None]:
    """Keep `fit` from changing a fingertip of ours.

    For setting its finger's lengths one by one while the mesh has them already.
    """
    del data[OURS]
    try:
        yield
    finally:
        data[OURS] = True


def coloured(name: str, colour: Sequence[float]) -> bpy.types.Material:
    """Return a new material of a colour, for solid and rendered shading."""
    made = bpy.data.materials.new(name)
    made.diffuse_color = colour
    if made.node_tree is None:
        made.use_nodes = True
    shader_of(made).inputs["Base Color"].default_value = colour
    return made


def shader_of(material: bpy.types.Material) -> Any:
    """Return the Principled BSDF that Blender's new materials have."""
    return next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")


def _material(name: str, colour: tuple[float, ...], roughness: float) -> bpy.types.Material:
    found = bpy.data.materials.get(name)
    if found is not None and found.library is None:
        return found
    made = coloured(name, colour)
    made.roughness = shader_of(made).inputs["Roughness"].default_value = roughness
    return made


def _rounded(t: Array, power: float) -> Array:
    """Fall from 1 at t <= 0 to 0 at t = 1 along a superellipse."""
    return np.power(np.clip(1.0 - np.power(np.clip(t, 0.0, 1.0), power), 0.0, 1.0), 1.0 / power)


def _waist(y: Array, tip: float, drop: float) -> Array:
    """Narrow a section behind the pad as the engine's skin does."""
    q2 = np.minimum(y / tip, 0.0) ** 2
    return 1.0 - 0.5 * q2 / (1.0 + q2 / (2.0 * drop))


def _profile(y: Array, size: Lengths) -> tuple[Array, Array, Array, Array]:
    """Return a section's half width, middle height, and extents [mm].

    The extents are those above and below the middle. Each has one value for every position along the finger.
    """
    section = _rounded(y / size.tip, 2.0)
    crease = 0.16 * np.exp(-(((y - size.base - 2.6) / 1.0) ** 2))  # the fold of the last joint
    half = 0.5 * size.width * section * _waist(y, size.tip, _WAIST_SIDE) - crease
    middle = np.full_like(y, size.middle)
    back = np.clip(y / size.base, 0.0, 1.0)
    above = (size.top - size.middle) * _rounded((y + 3.0) / (size.tip + 3.0), 2.5) + 0.3 * back**2 - crease
    below = size.middle * section * _waist(y, size.tip, _WAIST_PALM) - crease
    return half, middle, above, below


def _nail_distance(x: Array, y: Array, size: Lengths) -> Array:
    """Return the distance of points from the nail's middle, 1 on its outline."""
    across, along = 2.0 * x / size.nail_width, (y - size.nail_centre) / size.nail_reach
    return np.power(np.abs(across) ** 3.2 + np.abs(along) ** 3.2, 1.0 / 3.2)


def _skin(size: Lengths) -> tuple[Array, list[tuple[int, ...]]]:
    # Rings crowd towards the tip, where the surface turns.
    y = size.base + size.length * np.sin(np.linspace(0.0, np.pi / 2, _RINGS + 1))[:-1]
    half, middle, above, below = _profile(y, size)
    angle = np.arange(_SEGMENTS) * (2.0 * np.pi / _SEGMENTS)
    cos, sin = np.cos(angle), np.sin(angle)
    # The section is an ellipse on the palm's side, as in the engine, and a little squarer on the back.
    power = np.where(sin > 0.0, 2.0 / 2.25, 1.0)
    x = half[:, None] * (np.sign(cos) * np.abs(cos) ** power)
    height = np.sign(sin) * np.abs(sin) ** power
    z = middle[:, None] + np.where(height > 0.0, above[:, None], below[:, None]) * height
    yy = np.broadcast_to(y[:, None], x.shape)

    # The skin sinks under the nail and folds up around its sides and root.
    distance = _nail_distance(x, yy, size)
    upper = np.clip((z - size.middle - 0.5) / 2.0, 0.0, 1.0)
    bed = np.clip((1.13 - distance) / 0.13, 0.0, 1.0) * np.clip((size.tip - yy) / 2.5, 0.0, 1.0)
    fold = np.exp(-(((distance - 1.22) / 0.11) ** 2)) * np.clip((size.tip - 0.5 - yy) / 5.0, 0.0, 1.0)
    z = z + upper * (0.42 * fold - 0.75 * bed * bed * (3.0 - 2.0 * bed))

    ring = np.arange(_SEGMENTS)
    following = np.roll(ring, -1)
    vertices = np.vstack([np.stack([x, yy, z], axis=-1).reshape(-1, 3), [[0.0, size.tip, size.middle]]])
    faces: list[tuple[Any, ...]] = []
    for r in range(_RINGS - 1):
        a, b = r * _SEGMENTS, (r + 1) * _SEGMENTS
        faces += zip(a + ring, b + ring, b + following, a + following, strict=True)
    last, tip = (_RINGS - 1) * _SEGMENTS, len(vertices) - 1
    faces += [(last + i, tip, last + j) for i, j in zip(ring, following, strict=True)]
    faces.append(tuple(ring.tolist()))  # the cut end
    return vertices, [tuple(int(i) for i in face) for face in faces]


def _nail(size: Lengths) -> tuple[Array, list[tuple[int, ...]]]:
    """Return the nail: a plate curved in both directions, with the bed's outline."""
    circles, segments = 10, 48
    radius = np.append(np.linspace(0.0, 1.0, circles + 1)[1:], [1.0])
    angle = np.arange(segments) * (2.0 * np.pi / segments)
    outline = np.power(np.abs(np.cos(angle)) ** 3.2 + np.abs(np.sin(angle)) ** 3.2, -1.0 / 3.2)
    x = 0.5 * size.nail_width * radius[:, None] * outline * np.cos(angle)
    y = size.nail_centre + size.nail_reach * radius[:, None] * outline * np.sin(angle)
    z = _nail_height(x, y, size)
    z[-1] -= 0.45  # the plate's thickness
    middle = np.array([size.nail_centre])
    centre = np.array([[0.0, middle[0], _nail_height(np.zeros(1), middle, size)[0]]])
    vertices = np.vstack([centre, np.stack([x, y, z], axis=-1).reshape(-1, 3)])
    ring = np.arange(segments)
    following = np.roll(ring, -1)
    faces: list[tuple[int, ...]] = [(0, int(1 + i), int(1 + j)) for i, j in zip(ring, following, strict=True)]
    for c in range(circles):
        a, b = 1 + c * segments, 1 + (c + 1) * segments
        quads = zip(a + ring, b + ring, b + following, a + following, strict=True)
        faces += [tuple(int(i) for i in quad) for quad in quads]
    return vertices, faces


def _nail_height(x: Array, y: Array, size: Lengths) -> Array:
    arch = 0.54 * size.width
    bow = 0.0085 * 10.5 / size.tip * (y + 0.4 * size.tip) ** 2
    return size.top - 0.1 - bow - (arch - np.sqrt(arch**2 - np.clip(np.abs(x), 0, arch) ** 2))
