"""Make the deformed skin of a baked finger as a mesh that plays.

Stress, pressure and displacement are attributes of the mesh. Surface and values are those of the heat map in the view,
so that a figure equals the view.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import identity
from .._core import DermisError, core
from ..devices import skin_models
from ..fingertip_mesh import OURS
from ..identity import Place
from ..jobs import Steps
from ..preview.skin_state import SkinState
from ..quantities import metres_per_unit
from ..results import store
from ..viewport import skin_field
from . import film_objects, heat_material
from .frame_table import FrameTable, play

ATTRIBUTES = {"stress": "von_mises", "pressure": "pressure", "displacement": "displacement"}
"""Names of the attributes, in SI, and the quantities of the heat map that they hold."""
NAIL = 1  # index of the nail's material in a fingertip of the add-on
TOPS = "dermis_tops"  # property of the object: the largest value of each attribute over all frames


class Made(NamedTuple):
    """A finger's skin over its frames.

    It has triangles, shape (t, 3), the table of their motion, and the displacement of the bone [m].
    """

    finger: str
    place: Place
    triangles: Any
    table: FrameTable
    lift: Any


def work_out(scene: bpy.types.Scene, fingers: list[str]) -> Steps:
    """Compute the skins of fingers at every whole frame of the last bake.

    Yields progress, and returns a list of `Made`.

    Raises:
        DermisError: there is no bake, or it has no skin of these fingers.
    """
    result = store.current(scene)
    felt = {} if result is None else {n: t for n, t in result.bake.skins.items() if n in fingers and len(t.frames)}
    if not felt:
        raise DermisError(
            "this finger's skin is not baked",
            where=", ".join(f"finger '{n}'" for n in fingers),
            remedy="Switch Skin on and press Bake",
        )
    places = {name: Place.of(obj) for name in felt if (obj := identity.named(scene, name)) is not None}
    felt = {name: touch for name, touch in felt.items() if name in places}
    total, done, made = sum(len(_frames(t)) for t in felt.values()), 0, []
    for name, touch in felt.items():
        rows = []
        for frame in _frames(touch):
            yield core.pipeline.bake.Progress("skin", done, total)
            with skin_models.one_thread():
                rows.append(_row(name, touch, frame, float(scene.dermis.skin_view.exaggeration)))
            done += 1
        positions = np.stack([r[0] for r in rows])
        values = {n: np.stack([r[1][n] for r in rows]) for n in ATTRIBUTES}
        surface = skin_field.kit(touch.model.mesh).surface
        table = FrameTable.of_scene(scene, _frames(touch)[0], positions, values)
        made.append(Made(name, places[name], surface.triangles, table, np.array([r[2] for r in rows])))
    return made


def place(scene: bpy.types.Scene, made: list[Made], *, hide_finger: bool) -> list[bpy.types.Object]:
    """Put skins into the scene in place of earlier ones; return their objects.

    Args:
        hide_finger: hide the finger's own shape, which does not deform, in renders.
    """
    objects = []
    for skin in made:
        finger = skin.place.finger(scene)
        if finger is None:  # the finger was removed meanwhile
            continue
        obj = film_objects.named(scene, "skin", finger, "skin", f"{skin.finger} Skin", bpy.types.Mesh)
        film_objects.hang(obj, finger, scene)
        table, faces, nails = _with_nail(skin, finger, scene)
        film_objects.fill(obj.data, table.positions[0], faces)
        play(obj, table)
        obj[TOPS] = {name: float(values.max()) for name, values in skin.table.values.items()}
        if not obj.data.materials:
            obj.data.materials.append(heat_material.material())
        if nails:
            if len(obj.data.materials) < 2:
                obj.data.materials.append(finger.data.materials[NAIL])
            obj.data.polygons.foreach_set("material_index", [0] * (len(faces) - nails) + [1] * nails)
        if hide_finger and finger.library is None and not finger.hide_render:
            finger.hide_render = obj[film_objects.HIDES] = True
        objects.append(obj)
    return objects


def _with_nail(skin: Made, finger: bpy.types.Object, scene: bpy.types.Scene) -> tuple[FrameTable, list[Any], int]:
    """Return a skin's table and faces with the nail, and its face count.

    The nail is that of a fingertip of the add-on, and moves with the bone. It is added because the tissue has only a
    bed in its place, and the finger's own shape may be hidden in renders.
    """
    faces, data = skin.triangles.tolist(), finger.data
    if not isinstance(data, bpy.types.Mesh) or not data.get(OURS):
        return skin.table, faces, 0
    nails = [list(p.vertices) for p in data.polygons if p.material_index == NAIL]
    numbers = sorted({i for nail in nails for i in nail})
    size = np.array(finger.matrix_world.to_scale()) * metres_per_unit(scene)
    points = np.array([data.vertices[i].co for i in numbers]).reshape(-1, 3) * size
    lifted = points[None] + skin.lift[:, None, None] * (0.0, 0.0, 1.0)
    first, frames = skin.table.positions.shape[1], len(lifted)
    place = {old: first + new for new, old in enumerate(numbers)}
    nothing = np.zeros((frames, len(numbers)), np.float32)
    table = skin.table._replace(
        positions=np.concatenate([skin.table.positions, lifted.astype(np.float32)], axis=1),
        values={name: np.concatenate([values, nothing], axis=1) for name, values in skin.table.values.items()},
    )
    return table, faces + [[place[i] for i in nail] for nail in nails], len(nails)


def top(scene: bpy.types.Scene, name: str) -> float:
    """Return the value of an attribute at the end of its colours [SI].

    It is that of the view if its range is fixed and shows the attribute, else the largest of all skins, rounded.
    """
    view, quantity = scene.dermis.skin_view, ATTRIBUTES[name]
    factor = skin_field.QUANTITIES[quantity].factor
    if view.range_mode == "fixed" and view.quantity == quantity:
        return float(view.maximum * factor)
    largest = max((float(obj[TOPS][name]) for obj in film_objects.of_kind(scene, "skin") if TOPS in obj), default=0.0)
    return skin_field.nice(largest / factor) * factor


def _frames(touch: Any) -> range:
    return range(math.ceil(touch.frames[0] - 1e-6), math.floor(touch.frames[-1] + 1e-6) + 1)


def _row(name: str, touch: Any, frame: int, exaggeration: float) -> tuple[Any, dict[str, Any], float]:
    """Return vertices, values and the displacement of the bone at a frame."""
    step = touch.at(int(np.abs(touch.frames - frame).argmin()))
    state = SkinState.of(name, touch.model, step, "bake", "", {})
    drawn = {a: skin_field.draw_of(state, quantity, exaggeration) for a, quantity in ATTRIBUTES.items()}
    values = {a: d.values.astype(np.float32) for a, d in drawn.items()}
    return drawn["stress"].positions.astype(np.float32), values, state.lift
