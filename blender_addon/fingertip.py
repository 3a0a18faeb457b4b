"""The fingertip that Add > Dermis > Finger puts into the scene: shape in millimetres, mesh in scene units.

Its origin is the pad's centre, +Y points to the tip, +Z to the nail, so the object's own matrix is the finger's frame.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDTH, TIP, BASE = 16.0, 11.0, -16.0  # an adult's index finger; the pad's centre lies 11 mm behind the tip
_TOP, _TIP_HEIGHT = 12.4, 6.0
_RINGS, _SEGMENTS = 60, 80
_NAIL_Y, _NAIL_WIDTH, _NAIL_LENGTH = 3.1, 5.5, 7.0
SKIN, NAIL = (0.76, 0.42, 0.31, 1.0), (0.87, 0.58, 0.52, 1.0)


def shape() -> tuple[Array, list[tuple[int, ...]], NDArray[np.int32]]:
    """Return vertices [mm] (n, 3), polygons, and the material of each polygon: 0 skin, 1 nail."""
    skin, skin_faces = _skin()
    nail, nail_faces = _nail()
    faces = skin_faces + [tuple(i + len(skin) for i in face) for face in nail_faces]
    material = np.repeat(np.array([0, 1], dtype=np.int32), [len(skin_faces), len(nail_faces)])
    return np.vstack([skin, nail]), faces, material


def mesh(metres_per_unit: float = 1.0) -> bpy.types.Mesh:
    """Return a new mesh with skin and nail materials, in scene units."""
    vertices, faces, material = shape()
    data = bpy.data.meshes.new("Fingertip")
    data.from_pydata((vertices * 1e-3 / metres_per_unit).tolist(), [], faces)
    data.polygons.foreach_set("material_index", material)
    smooth = np.array([len(face) <= 4 for face in faces])  # the cut end stays flat
    data.polygons.foreach_set("use_smooth", smooth)
    data.materials.append(_material("Fingertip Skin", SKIN, 0.5))
    data.materials.append(_material("Fingertip Nail", NAIL, 0.25))
    data.update()
    return data


def _material(name: str, colour: tuple[float, ...], roughness: float) -> bpy.types.Material:
    found = bpy.data.materials.get(name)
    if found is not None and found.library is None:
        return found
    made = bpy.data.materials.new(name)
    made.diffuse_color = colour
    made.roughness = roughness
    if made.node_tree is None:
        made.use_nodes = True
    shader = next((n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if shader is not None:
        shader.inputs["Base Color"].default_value = colour
        shader.inputs["Roughness"].default_value = roughness
    return made


def _rounded(t: Array, power: float) -> Array:
    """Fall from 1 at t <= 0 to 0 at t = 1 along a superellipse."""
    return np.power(np.clip(1.0 - np.power(np.clip(t, 0.0, 1.0), power), 0.0, 1.0), 1.0 / power)


def _profile(y: Array) -> tuple[Array, Array, Array, Array]:
    """Half width, middle height, height above the middle and depth below it, along the finger."""
    back = np.clip(-y / -BASE, 0.0, 1.0)
    half = WIDTH / 2 * _rounded((y + 2.0) / (TIP + 2.0), 2.35) * (1.0 - 0.05 * back**2)
    crease = 0.16 * np.exp(-(((y + 13.2) / 1.1) ** 2))  # the fold of the last joint
    middle = np.full_like(y, _TIP_HEIGHT)
    above = (_TOP - _TIP_HEIGHT) * _rounded((y + 3.0) / (TIP + 3.0), 2.5) + 0.5 * back**2 - crease
    below = _TIP_HEIGHT * _rounded(y / TIP, 2.2) - 0.8 * back**2 - crease
    return half - crease, middle, above, below


def _nail_distance(x: Array, y: Array) -> Array:
    """How far a point lies from the nail's middle: 1 on its outline."""
    return np.power(
        np.abs(x / _NAIL_WIDTH) ** 3.2 + np.abs((y - _NAIL_Y) / _NAIL_LENGTH) ** 3.2, 1.0 / 3.2
    )


def _skin() -> tuple[Array, list[tuple[int, ...]]]:
    # Rings crowd towards the tip, where the surface turns.
    y = BASE + (TIP - BASE) * np.sin(np.linspace(0.0, np.pi / 2, _RINGS + 1))[:-1]
    half, middle, above, below = _profile(y)
    angle = np.arange(_SEGMENTS) * (2.0 * np.pi / _SEGMENTS)
    cos, sin = np.cos(angle), np.sin(angle)
    power = 2.0 / 2.25  # a little squarer than an ellipse
    x = half[:, None] * (np.sign(cos) * np.abs(cos) ** power)
    height = np.sign(sin) * np.abs(sin) ** power
    z = middle[:, None] + np.where(height > 0.0, above[:, None], below[:, None]) * height
    yy = np.broadcast_to(y[:, None], x.shape)

    # The skin sinks under the nail and folds up around its sides and root.
    distance = _nail_distance(x, yy)
    upper = np.clip((z - 6.5) / 2.0, 0.0, 1.0)
    bed = np.clip((1.13 - distance) / 0.13, 0.0, 1.0) * np.clip((10.5 - yy) / 2.5, 0.0, 1.0)
    fold = np.exp(-(((distance - 1.22) / 0.11) ** 2)) * np.clip((10.0 - yy) / 5.0, 0.0, 1.0)
    z = z + upper * (0.42 * fold - 0.75 * bed * bed * (3.0 - 2.0 * bed))

    ring = np.arange(_SEGMENTS)
    following = np.roll(ring, -1)
    vertices = np.vstack([np.stack([x, yy, z], axis=-1).reshape(-1, 3), [[0.0, TIP, _TIP_HEIGHT]]])
    faces: list[tuple[Any, ...]] = []
    for r in range(_RINGS - 1):
        a, b = r * _SEGMENTS, (r + 1) * _SEGMENTS
        faces += zip(a + ring, b + ring, b + following, a + following, strict=True)
    last, tip = (_RINGS - 1) * _SEGMENTS, len(vertices) - 1
    faces += [(last + i, tip, last + j) for i, j in zip(ring, following, strict=True)]
    faces.append(tuple(ring.tolist()))  # the cut end
    return vertices, [tuple(int(i) for i in face) for face in faces]


def _nail() -> tuple[Array, list[tuple[int, ...]]]:
    """A plate with a curve in both directions and an edge, over the same outline as the bed."""
    circles, segments = 10, 48
    radius = np.append(np.linspace(0.0, 1.0, circles + 1)[1:], [1.0])
    angle = np.arange(segments) * (2.0 * np.pi / segments)
    outline = np.power(np.abs(np.cos(angle)) ** 3.2 + np.abs(np.sin(angle)) ** 3.2, -1.0 / 3.2)
    x = _NAIL_WIDTH * radius[:, None] * outline * np.cos(angle)
    y = _NAIL_Y + _NAIL_LENGTH * radius[:, None] * outline * np.sin(angle)
    z = _nail_height(x, y)
    z[-1] -= 0.45  # the plate's thickness
    centre = np.array([[0.0, _NAIL_Y, float(_nail_height(np.zeros(1), np.full(1, _NAIL_Y))[0])]])
    vertices = np.vstack([centre, np.stack([x, y, z], axis=-1).reshape(-1, 3)])
    ring = np.arange(segments)
    following = np.roll(ring, -1)
    faces: list[tuple[int, ...]] = [(0, int(1 + i), int(1 + j)) for i, j in zip(ring, following, strict=True)]
    for c in range(circles):
        a, b = 1 + c * segments, 1 + (c + 1) * segments
        quads = zip(a + ring, b + ring, b + following, a + following, strict=True)
        faces += [tuple(int(i) for i in quad) for quad in quads]
    return vertices, faces


def _nail_height(x: Array, y: Array) -> Array:
    arch = 8.6
    return 12.25 - 0.0085 * (y + 4.0) ** 2 - (arch - np.sqrt(arch**2 - np.clip(np.abs(x), 0, arch) ** 2))
