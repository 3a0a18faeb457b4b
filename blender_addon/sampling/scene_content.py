"""Contents of everything that a scene's bake may depend on, as digests, to detect by value whether any of it changed.

Blender reports that data were changed, not that they differ: undo gives them back, and a setting of another scene is
reported as well. The contents are read from the original data, at any frame: values that animation writes are left out,
because their curves and drivers are read instead. So are values that Blender computes, selections, and settings of
Dermis that no bake depends on.

Contents that cannot be read in reasonable time, such as pixels, are replaced by the number of their reported changes.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Generator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import action_content, changes, compat, marks
from ..properties import fields
from . import render_settings

WEIGHTS = 512  # number of vertices whose weights are read between two pauses

# Types of data that a bake may depend on. Of other types, such as lamps, the values that drivers read are compared.
_FOLLOWED = (
    bpy.types.Object,
    bpy.types.Action,
    bpy.types.Armature,
    bpy.types.CacheFile,
    bpy.types.Collection,
    bpy.types.Curve,
    bpy.types.Curves,
    bpy.types.Image,
    bpy.types.Key,
    bpy.types.Lattice,
    bpy.types.Material,
    bpy.types.Mesh,
    bpy.types.MetaBall,
    bpy.types.NodeTree,
    bpy.types.ParticleSettings,
    bpy.types.PointCloud,
    bpy.types.Texture,
    bpy.types.VectorFont,
    bpy.types.Volume,
)
# Of these, changes are counted.
_COUNTED = (
    bpy.types.CacheFile,
    bpy.types.Curves,
    bpy.types.Image,
    bpy.types.PointCloud,
    bpy.types.VectorFont,
    bpy.types.Volume,
)
_WHOLE_MODES = ("OBJECT", "POSE")  # in others, such as edit mode, Blender keeps the contents elsewhere
_VALUES = {  # property of an attribute's elements, number of values and their type, by the attribute's type
    "FLOAT": ("value", 1, np.float32),
    "INT": ("value", 1, np.int32),
    "INT8": ("value", 1, np.int32),
    "BOOLEAN": ("value", 1, bool),
    "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT2": ("vector", 2, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color", 4, np.float32),
    "QUATERNION": ("value", 4, np.float32),
    "FLOAT4X4": ("value", 16, np.float32),
    "INT16_2D": ("value", 2, np.int32),
    "INT32_2D": ("value", 2, np.int32),
}
_DISPLAYED = (".select", ".hide", ".uv_select", ".vs.", ".es.", ".pn.", ".sculpt")  # begin names of such attributes
# Properties of any type that are computed, differ by frame, or only concern the display.
_LEFT_OUT = frozenset(
    """
    rna_type name_full session_uid original library library_weak_reference asset_data override_library preview tag
    use_fake_user use_extra_user is_runtime_data animation_data animation_visualization motion_path select hide_select
    show_expanded show_wire show_name show_axis show_bounds show_in_front show_texture_space show_transparent
    active active_index active_material active_material_index active_shape_key active_exporter_index use_pin_to_last
    texspace_location texspace_size all_objects collection_objects collection_children exporters color_tag lineart
    display_type display_bounds_type selection_sets frame_current pixels particles child_particles is_valid
    """.split()
)
_LEFT_OUT_OF: Mapping[str, frozenset[str]] = {
    "Object": frozenset(
        {
            "matrix_world",
            "matrix_local",
            "matrix_basis",
            "dimensions",
            "bound_box",
            "display",
            "color",
            "shader_effects",
        }
        | {"cycles"}
    ),
    "PoseBone": frozenset(
        {"matrix", "matrix_basis", "matrix_channel", "head", "tail", "color", "parent", "child", "bone", "custom_shape"}
        | {"custom_shape_transform", "custom_shape_wire_width"}
    ),
    "Bone": frozenset({"matrix", "color", "parent", "children", "collections", "hide"}),
    "Node": frozenset({"location", "location_absolute", "width", "height", "label", "color", "internal_links"}),
    "ShapeKey": frozenset({"data", "points"}),
    "MetaElement": frozenset({"hide"}),
    "FCurve": frozenset({"color", "color_mode", "group", "hide", "lock"}),
    "Keyframe": frozenset({"select_control_point", "select_left_handle", "select_right_handle"}),
    "NlaStrip": frozenset({"strip_time", "action_suitable_slots"}),
    "Armature": frozenset({"bones", "edit_bones", "collections", "collections_all"}),
    "Modifier": frozenset({"is_active", "execution_time", "bakes", "node_warnings"}),
}


class Part(NamedTuple):
    """One data-block of a scene: its name, the list of `bpy.data` that has it, and the digest of its contents."""

    name: str
    kind: str
    digest: bytes


Content = Mapping[int, Part]
"""The data-blocks that a scene's bake may depend on, by session uid."""


def steps(scene: bpy.types.Scene) -> Generator[None, None, Content]:
    """Return the contents of a scene; pause after every few hundred microseconds of reading.

    Between two steps nothing may be removed from the file.
    """
    _plan.cache_clear()  # other add-ons may have declared properties, or taken them away
    found: dict[int, Part] = {}
    weighted: set[int] = set()
    seen = {scene.session_uid}
    queue: deque[Any] = deque([scene])

    def follow(block: Any) -> None:
        if block.session_uid not in seen and isinstance(block, _FOLLOWED):
            seen.add(block.session_uid)
            queue.append(block)

    while queue:
        block = queue.popleft()
        reader = _Reader(block, follow, weighted)
        yield from reader.read()
        found[block.session_uid] = reader.part()
        yield
    return found


def part(uid: int, before: Part) -> Part | None:
    """Return the present contents of one data-block; None if it is gone.

    Meshes are not read: their earlier contents are returned.

    Args:
        uid: its session uid. before: its earlier contents.
    """
    blocks = getattr(bpy.data, before.kind)
    block = blocks.get(before.name)
    if block is None or block.session_uid != uid:
        block = next((b for b in blocks if b.session_uid == uid), None)
    if block is None:
        return None
    if isinstance(block, bpy.types.Mesh):  # it may be large, and whether its weights count depends on its objects
        return before
    reader = _Reader(block, lambda _block: None, set())
    for _ in reader.read():
        pass
    return reader.part()


class _Reader:
    """Reads one data-block.

    Args:
        block: the data-block. follow: called with every other data-block that it uses.
        weighted: session uids of meshes whose weights are read.
    """

    def __init__(self, block: Any, follow: Callable[[Any], None], weighted: set[int]) -> None:
        self._block, self._follow, self._weighted = block, follow, weighted
        self._hash = hashlib.blake2b(digest_size=16)
        self._met: dict[tuple[int, type], int] = {}
        self._animated: set[tuple[int, str, int]] = set()

    def part(self) -> Part:
        """Return the contents that were read."""
        return Part(self._block.name_full, _kind(self._block), self._hash.digest())

    def read(self) -> Generator[None, None, None]:
        """Read the data-block, in steps."""
        block = self._block
        self._say("beyond", changes.beyond(block.session_uid))
        if isinstance(block, _COUNTED):
            self._say("changes", changes.count(block.session_uid))
        self._animation(block)
        if isinstance(block, bpy.types.Action):
            self._hash.update(action_content.digest(block))
        elif isinstance(block, bpy.types.Material):
            self._say("displaces", render_settings.displaces(block))
        elif isinstance(block, bpy.types.Scene):
            self._scene(block)
        elif isinstance(block, bpy.types.Mesh):
            yield from self._mesh(block)
        elif isinstance(block, bpy.types.Image):
            self._image(block)
        else:
            self._struct(block, block)
            if isinstance(block, bpy.types.Object):
                self._object(block)
            elif isinstance(block, bpy.types.Armature):
                for bone in block.bones:
                    self._say(bone.name, bone.parent.name if bone.parent is not None else "", bone.use_connect)
                    self._say(_plain(bone.head_local), _plain(bone.tail_local), _plain(bone.matrix_local))
                    self._struct(bone, block)
            elif isinstance(block, bpy.types.Key):
                for key in block.key_blocks:
                    self._key_shape(key, block)

    def _say(self, *values: Any) -> None:
        self._hash.update(repr(values).encode())

    def _use(self, block: Any) -> None:
        self._say(block.session_uid)
        self._follow(block)

    def _scene(self, scene: Any) -> None:
        self._say(scene.use_gravity, _plain(scene.gravity), scene.camera and scene.camera.session_uid)
        render = scene.render
        for prop in render.bl_rna.properties:
            if prop.identifier.startswith(("use_simplify", "simplify_")):
                self._say(prop.identifier, getattr(render, prop.identifier))
        if scene.rigidbody_world is not None:
            self._struct(scene.rigidbody_world, scene)
        self._struct(scene.dermis, scene)
        self._own_properties(scene)
        self._collection(scene.collection)
        for layer in scene.view_layers:
            self._say(layer.name, layer.use)
            for child in layer.layer_collection.children:
                self._layer(child)
            hidden = [o.session_uid for o in layer.objects if o.hide_get(view_layer=layer) and marks.FILM not in o]
            self._say(sorted(hidden))

    def _layer(self, layer: Any) -> None:
        if marks.FILM in layer.collection:
            return
        self._say(layer.collection.session_uid, layer.exclude, layer.hide_viewport, layer.holdout)
        for child in layer.children:
            self._layer(child)

    def _collection(self, collection: Any) -> None:
        """Read the members of a collection, without objects made for films, of which none takes part in a bake."""
        for held in (*collection.objects, *collection.children):
            if marks.FILM not in held:
                self._use(held)

    def _object(self, obj: Any) -> None:
        self._say(obj.mode in _WHOLE_MODES)
        if obj.mode not in _WHOLE_MODES:
            self._say(changes.count(obj.session_uid), changes.count(obj.data.session_uid) if obj.data else 0)
        if obj.type == "MESH" and len(obj.vertex_groups):
            self._weighted.add(obj.data.session_uid)

    def _mesh(self, mesh: Any) -> Generator[None, None, None]:
        self._say([m.session_uid if m is not None else 0 for m in mesh.materials])
        for material in mesh.materials:
            if material is not None:
                self._use(material)
        if mesh.shape_keys is not None:
            self._use(mesh.shape_keys)
        self._say([(layer.name, layer.active_render) for layer in mesh.uv_layers])
        self._own_properties(mesh)
        ends = np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("loop_start", ends)
        self._hash.update(ends.tobytes())
        yield
        for name in [a.name for a in mesh.attributes if not a.name.startswith(_DISPLAYED)]:
            attribute = mesh.attributes[name]
            self._say(name, attribute.domain, attribute.data_type, len(attribute.data))
            if attribute.data_type in _VALUES:
                key, width, kind = _VALUES[attribute.data_type]
                values = np.empty(width * len(attribute.data), kind)
                attribute.data.foreach_get(key, values)
                self._hash.update(values.tobytes())
            else:
                self._say(changes.count(mesh.session_uid))
            yield
        if mesh.session_uid in self._weighted:
            count = len(mesh.vertices)
            for start in range(0, count, WEIGHTS):
                rows = mesh.vertices[start : min(start + WEIGHTS, count)]
                self._say([(g.group, g.weight) for vertex in rows for g in vertex.groups], start)
                yield

    def _image(self, image: Any) -> None:
        self._say(image.filepath, image.source, image.alpha_mode, image.colorspace_settings.name, tuple(image.size))
        self._say(image.generated_type, image.generated_width, image.generated_height, _plain(image.generated_color))
        self._say(image.packed_file.size if image.packed_file is not None else -1, image.is_dirty)

    def _key_shape(self, key: Any, block: Any) -> None:
        try:
            places = np.empty(3 * len(key.data), np.float32)
            key.data.foreach_get("co", places)
            self._hash.update(places.tobytes())
        except (AttributeError, TypeError, RuntimeError):  # of a curve
            for point in key.data:
                self._struct(point, block)

    def _animation(self, block: Any) -> None:
        """Read actions, drivers and NLA tracks; note the values that they write."""
        data = getattr(block, "animation_data", None)
        if data is None:
            return
        for holder in compat.action_holders(data):
            action = holder.action
            if action is None or marks.COMMANDS in action:
                continue
            handle = holder.action_slot.handle if holder.action_slot is not None else -1
            self._use(action)
            self._say(handle)
            for bag in compat.channelbags(action):
                for curve in bag.fcurves if bag.slot_handle == handle else ():
                    self._note_animated(block, curve)
            if holder is data:
                self._say(data.action_blend_type, data.action_extrapolation, data.action_influence)
        if len(data.nla_tracks):
            self._say(data.use_nla, data.use_tweak_mode)
            for track in data.nla_tracks:
                for strip in track.strips:
                    if strip.use_animated_influence:
                        self._animated.add((strip.as_pointer(), "influence", -1))
                self._struct(track, block)
        for driver in data.drivers:
            self._struct(driver, block)
            self._note_animated(block, driver)
            for variable in driver.driver.variables:
                for target in variable.targets:
                    self._target(variable, target)

    def _note_animated(self, block: Any, curve: Any) -> None:
        try:
            prop = block.path_resolve(curve.data_path, False)
            owner = prop.data
        except (ValueError, AttributeError):
            return  # it writes nothing
        path = curve.data_path
        name = path[path.rindex("[") :] if path.endswith('"]') else path.rpartition(".")[2]
        index = curve.array_index if hasattr(prop, "foreach_get") else -1  # only arrays have it
        self._animated.add((owner.as_pointer(), name, index))

    def _target(self, variable: Any, target: Any) -> None:
        """Read the value of a driver's source, if it does not belong to data that are followed anyway."""
        source = bpy.context.scene if variable.type == "CONTEXT_PROP" else target.id
        if source is None or isinstance(source, _FOLLOWED):
            return
        paths = compat.animated_paths(source)
        if target.data_path and target.data_path not in paths and "frame_" not in target.data_path:
            try:
                self._say(_plain(source.path_resolve(target.data_path)))
            except ValueError:
                self._say("no such value")
        animation = source.animation_data
        if animation is not None and animation.action is not None:
            self._use(animation.action)

    def _struct(self, struct: Any, root: Any) -> None:
        """Read the properties of a struct of a data-block."""
        mark = (struct.as_pointer(), type(struct))
        if mark in self._met:
            self._say("met", self._met[mark])
            return
        self._met[mark] = len(self._met)
        self._say(type(struct).__name__)
        pointer = mark[0]
        for name, kind in _plan_of(type(struct)):
            value = getattr(struct, name, None)  # None of an add-on that was disabled since the types were looked at
            if kind == "POINTER":
                self._pointer(name, value, root)
            elif kind == "COLLECTION":
                self._say(name, len(value or ()))
                for item in value or ():
                    self._pointer("", item, root)
            elif not self._animated or not self._is_animated(pointer, name, value):
                if name == "hide_render" and value and self._hidden_by_film(struct):
                    value = False
                self._say(name, _plain(value))
        if isinstance(struct, bpy.types.Collection):
            self._collection(struct)
        self._own_properties(struct)

    def _is_animated(self, pointer: int, name: str, value: Any) -> bool:
        """Return whether animation writes a property; read the other elements of an array."""
        if (pointer, name, -1) in self._animated:
            return True
        plain = _plain(value)
        if not isinstance(plain, tuple):
            return False
        left = tuple(v for i, v in enumerate(plain) if (pointer, name, i) not in self._animated)
        if len(left) < len(plain):
            self._say(name, left)
        return len(left) < len(plain)

    def _pointer(self, name: str, value: Any, root: Any) -> None:
        if value is None:
            self._say(name, None)
        elif isinstance(value, bpy.types.ID) and not value.is_embedded_data:
            self._say(name)
            self._use(value)
        elif isinstance(value, bpy.types.ID):  # a node tree of its own
            self._say(name)
            self._animation(value)
            self._struct(value, value)
        elif value.id_data not in (root, None):  # an element of other data
            self._say(name, getattr(value, "name", ""))
            if isinstance(value.id_data, bpy.types.ID) and not value.id_data.is_embedded_data:
                self._use(value.id_data)
        else:
            self._say(name)
            self._struct(value, root)

    def _own_properties(self, struct: Any) -> None:
        """Read custom properties, among them the inputs of node modifiers."""
        try:
            keys = struct.keys()
        except (AttributeError, TypeError):
            return
        declared, pointer = struct.bl_rna.properties, struct.as_pointer()
        commands = str(struct.get(marks.COMMANDS, "")).split("\n")
        for key in sorted(keys):
            if key in declared or key in (marks.COMMANDS, *commands):
                continue
            value = struct[key]
            if isinstance(value, bpy.types.ID):
                self._say(key)
                self._use(value)
            elif (pointer, f'["{bpy.utils.escape_identifier(key)}"]', -1) not in self._animated:
                self._say(key, value.to_dict() if hasattr(value, "to_dict") else _plain(value))

    def _hidden_by_film(self, struct: Any) -> bool:
        return isinstance(struct, bpy.types.Object) and any(child.get(marks.FILM_HIDES) for child in struct.children)


def _plan_of(kind: Any) -> tuple[tuple[str, str], ...]:
    """Return `_plan`; Blender makes the types of a node modifier's inputs anew when its nodes change."""
    passing = kind.__module__ == "bpy.types" and getattr(bpy.types, kind.__name__, None) is not kind
    return _plan.__wrapped__(kind) if passing else _plan(kind)


@lru_cache(512)
def _plan(kind: Any) -> tuple[tuple[str, str], ...]:
    """Return the properties of a type that are read: identifier, and 'POINTER', 'COLLECTION' or another type."""
    left_out = set(_LEFT_OUT)
    names = {base.__name__ for base in kind.__mro__}
    for name in names & set(_LEFT_OUT_OF):
        left_out |= _LEFT_OUT_OF[name]
    if "ID" in names:
        left_out.add("name")
    if kind is bpy.types.Collection:
        left_out |= {"objects", "children"}
    own = {name: made for base in kind.__mro__ for name, made in getattr(base, "__annotations__", {}).items()}
    plan = []
    for prop in kind.bl_rna.properties:
        name = prop.identifier
        if name in left_out or (prop.is_readonly and prop.type not in ("POINTER", "COLLECTION")):
            continue
        if name in own and not _felt(own[name]):
            continue
        plan.append((name, prop.type))
    return tuple(plan)


def _felt(made: Any) -> bool:
    """Return whether a bake may depend on a property that an add-on declares."""
    given = getattr(made, "keywords", {})
    return given.get("update") not in (fields.unfelt, fields.redrawn) and "HIDDEN" not in given.get("options", ())


def _kind(block: Any) -> str:
    """Return the name of the list of `bpy.data` that has a data-block."""
    return next(name for types, name in _lists() if isinstance(block, types))


@lru_cache(1)
def _lists() -> tuple[tuple[type, str], ...]:
    props = bpy.data.bl_rna.properties
    lists = ((getattr(bpy.types, p.fixed_type.identifier), p.identifier) for p in props if p.type == "COLLECTION")
    return tuple((kind, name) for kind, name in lists if issubclass(kind, bpy.types.ID))


def _plain(value: Any) -> Any:
    """Return a value in a form whose text has no memory address."""
    if isinstance(value, (bool, int, float, str, bytes)) or value is None:
        return value
    if isinstance(value, (set, frozenset)):
        return tuple(sorted(value))
    try:
        return tuple(_plain(item) for item in value)
    except TypeError:
        return type(value).__name__
