"""What renders show otherwise of the parts of a felt object: members of collections, children, particles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import pytest

from . import build
from .test_sampling_instances import host, in_collection, info_geometry, instance_of, on_points, plain
from .test_sampling_renders import apart, told


@pytest.fixture(autouse=True)
def ranged() -> None:
    """Start with a finger and a short range."""
    build.span(1, 3)
    build.finger()


def members(role: str = "TOUCHABLE", shown_role: str = "NONE") -> tuple[Any, Any, Any, Any]:
    """Return two objects, the collection that has them and nothing else, and its instance."""
    first, second = plain("P", location=(0, 0, 0), role=shown_role), plain("Q", location=(3, 0, 0))
    collection = in_collection("C", first, second)
    made = instance_of(collection, "E")
    made.dermis.role = role
    return first, second, collection, made


def finer(obj: Any) -> None:
    modifier = obj.modifiers.new("Fine", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 3


def test_members_that_are_the_same_are_not_told() -> None:
    members()
    assert not told()


def test_a_member_that_renders_refine() -> None:
    first, _, _, made = members()
    finer(first)
    (found,) = told()
    assert (found.where, found.value) == ("object 'E'", "P: Fine: 0, in renders 3")
    still = apart(found)
    made.scale = (2.0, 2.0, 2.0)
    (found,) = told()
    assert 0.1 < still and apart(found) == pytest.approx(2.0 * still, rel=0.01)


def by_object(second: Any, _collection: Any) -> str:
    second.hide_render = True
    return "Q is hidden in renders"


def by_key(second: Any, _collection: Any) -> str:
    build.keys(second, "hide_render", [1, 2], [0, 1], "CONSTANT")
    return "Q is hidden in renders"


def by_collection(second: Any, collection: Any) -> str:
    inner = bpy.data.collections.new("Inner")
    collection.children.link(inner)
    collection.objects.unlink(second)
    inner.objects.link(second)
    inner.hide_render = True
    return "Inner is hidden in renders"


def only_in_renders(second: Any, _collection: Any) -> str:
    second.hide_viewport = True
    return "Q is shown in renders only"


@pytest.mark.parametrize("hide", [by_object, by_key, by_collection, only_in_renders])
def test_a_member_that_only_one_of_them_shows(hide: Callable[..., str]) -> None:
    _, second, collection, _ = members()
    said = hide(second, collection)
    (found,) = told()
    assert (found.where, found.value) == ("object 'E'", said)
    assert found.frame == (2.0 if hide is by_key else 1.0) and apart(found) > 2.0


def test_a_member_of_an_instance_in_an_instance() -> None:
    first, _, _, inner = members(role="NONE")
    outer = instance_of(in_collection("D", inner), "F")
    outer.dermis.role = "TOUCHABLE"
    finer(first)
    found = {f.where: f.value for f in told()}
    assert found["object 'F'"] == "P: Fine: 0, in renders 3"


def test_instances_of_a_touchable_member_are_told_of_it_alone() -> None:
    first, _, _, _ = members(role="NONE", shown_role="TOUCHABLE")
    assert not told()  # that it is in no collection of the scene hides no instance
    finer(first)
    (found,) = told()
    assert (found.where, found.value) == ("object 'P'", "Fine: 0, in renders 3")
    first.modifiers.clear()
    first.hide_render = True
    (found,) = told()
    assert (found.severity, found.where) == ("info", "object 'P'") and "do not show it" in found.what


def test_instances_are_as_far_apart_as_they_are_large() -> None:
    first = plain("P", role="TOUCHABLE")
    finer(first)
    (found,) = told()
    still = apart(found)
    collection = in_collection("C", first)
    bpy.context.scene.collection.children.link(collection)
    instance_of(collection, "E").scale = (3.0, 3.0, 3.0)
    (found,) = told()
    assert found.where == "object 'P'" and apart(found) == pytest.approx(3.0 * still, rel=0.01)


def collection_info(collection: Any) -> Any:
    def make(tree: bpy.types.NodeTree) -> Any:
        node = tree.nodes.new("GeometryNodeCollectionInfo")
        node.inputs["Collection"].default_value = collection
        return node.outputs[0]

    return make


def test_a_collection_among_the_nodes() -> None:
    first = plain("P")
    first.hide_render = True
    on_points(host(), collection_info(in_collection("C", first)), join=True)
    (found,) = told()
    assert (found.where, found.value) == ("object 'Host'", "P is hidden in renders")


def test_nodes_do_not_ask_whether_an_object_is_hidden() -> None:
    first = plain("P")
    first.hide_render = True
    on_points(host(), info_geometry(first))
    assert not told()


@pytest.mark.parametrize("differs", ["finer", "hidden"])
def test_children_on_vertices(differs: str) -> None:
    first, made = plain("P", location=(0, 0, 0)), host()
    first.parent, made.instance_type = made, "VERTS"
    assert not told()
    if differs == "finer":
        finer(first)
    else:
        first.hide_render = True
    (found,) = told()
    said = "P: Fine: 0, in renders 3" if differs == "finer" else "P is hidden in renders"
    assert (found.where, found.value) == ("object 'Host'", said) and "not known" in found.what


def test_a_material_of_a_member_that_displaces_in_renders() -> None:
    first, _, _, _ = members()
    material = bpy.data.materials.new("Rough")
    if bpy.app.version < (5, 0, 0):  # later ones always have a tree
        material.use_nodes = True
    moved = material.node_tree.nodes.new("ShaderNodeDisplacement")
    material.node_tree.links.new(moved.outputs[0], material.node_tree.get_output_node("ALL").inputs["Displacement"])
    material.displacement_method = "DISPLACEMENT"
    first.data.materials.append(material)
    (found,) = told()
    assert (found.where, found.value) == ("object 'E'", "displacement of Rough")


def hair(role: str = "TOUCHABLE", shown_role: str = "NONE") -> Any:
    """Return the settings of 20 hairs that an object is shown on."""
    corners = [(x / 8, y / 8, 0) for x in range(9) for y in range(9)]
    faces = [(x * 9 + y, x * 9 + 9 + y, x * 9 + 10 + y, x * 9 + y + 1) for x in range(8) for y in range(8)]
    emitter = host("Emitter", corners, faces, role)
    emitter.modifiers.new("Hair", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.type, settings.count, settings.render_type, settings.particle_size = "HAIR", 20, "OBJECT", 1.0
    settings.instance_object = plain("P", 0.2, role=shown_role)
    return settings


def fewer(settings: Any) -> str:
    settings.display_percentage = 20
    return "20 % of its particles, in renders all"


def fewer_later(settings: Any) -> str:
    build.keys(settings, "display_percentage", [1, 2], [100, 20], "CONSTANT")
    return "20 % of its particles, in renders all"


def fewer_children(settings: Any) -> str:
    settings.child_type, settings.child_percent, settings.rendered_child_count = "SIMPLE", 2, 20
    return "2 children of each particle, in renders 20"


def simplified_children(settings: Any) -> str:
    settings.child_type, settings.child_percent, settings.rendered_child_count = "SIMPLE", 10, 10
    render = bpy.context.scene.render
    render.use_simplify, render.simplify_child_particles, render.simplify_child_particles_render = True, 0.5, 1.0
    return "5 children of each particle, in renders 10"


def not_shown(settings: Any) -> str:
    settings.display_method = "NONE"
    return "its objects are in renders only"


@pytest.mark.parametrize("less", [fewer, fewer_later, fewer_children, simplified_children, not_shown])
def test_particles_that_the_viewport_thins_out(less: Callable[[Any], str]) -> None:
    settings = hair()
    assert not told()
    said = f"{bpy.data.objects['Emitter'].particle_systems[0].name}: {less(settings)}"
    (found,) = told()
    assert (found.severity, found.where, found.value) == ("warning", "object 'Emitter'", said)
    assert "not known" in found.what and found.frame == (2.0 if less is fewer_later else 1.0)


@pytest.mark.parametrize("less", [fewer, not_shown])
def test_particles_that_show_something_touchable(less: Callable[[Any], str]) -> None:
    settings = hair(role="NONE", shown_role="TOUCHABLE")
    assert not told()
    said = less(settings)
    (found,) = told()
    assert found.where == "object 'Emitter'" and found.value.endswith(said)


def test_particles_that_are_not_felt() -> None:
    settings = hair()
    settings.render_type = "PATH"
    fewer(settings)
    assert not told()
