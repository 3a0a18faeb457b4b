"""Where the only finger, or all there is to touch, is refused, the refusal's own reason is given."""

from __future__ import annotations

import bpy
import pytest

from blender_addon import baking
from blender_addon.preview import device_preview
from blender_addon.sampling import scene_sweep
from core.errors import DermisError
from core.presets import Library
from core.steps import drain

from .build import cube, finger, mesh_object, screen, span


def a_screen_without_an_image() -> None:
    finger()
    screen()


def a_screen_with_an_image_of_no_size() -> None:
    finger()
    pane = screen()
    image = bpy.data.images.new("void", 1, 1)
    image.source, image.filepath = "FILE", "/nonexistent.png"
    image.reload()
    pane.dermis.screen.image = image


def an_empty_mesh() -> None:
    finger()
    mesh_object("Hollow", [], []).dermis.role = "TOUCHABLE"


def a_mesh_that_is_no_number() -> None:
    finger()
    cube().data.vertices[0].co.x = float("nan")


def a_disabled_body() -> None:
    finger()
    cube().hide_viewport = True


def a_disabled_finger() -> None:
    cube()
    finger().hide_viewport = True


CASES = [
    (a_screen_without_an_image, "screen 'Screen': nothing to touch: the image is missing. Choose one"),
    (a_screen_with_an_image_of_no_size, "nothing to touch: the image has no pixels .*0 x 0"),
    (
        an_empty_mesh,
        "object 'Hollow': nothing to touch: the mesh has no faces. Give it faces, or stop it being touchable.$",
    ),
    (
        a_mesh_that_is_no_number,
        r"object 'Cube': nothing to touch: the mesh has vertices that are not finite numbers .*1 of 8; vertex 0 is "
        r"at \[nan, .*Remove these vertices",
    ),
    (a_disabled_body, "object 'Cube': nothing to touch: it is disabled or excluded in the view layer. Enable it"),
    (a_disabled_finger, "object 'Finger': no finger: it is disabled or excluded in the view layer. Enable it"),
]


@pytest.mark.parametrize(("build", "sentence"), CASES, ids=[c[0].__name__ for c in CASES])
def test_the_reason_is_that_of_the_refused_object(build, sentence: str) -> None:
    scene = span(1, 10)
    build()
    with pytest.raises(DermisError, match=sentence):
        scene_sweep.sample(scene)


def test_the_live_preview_gives_it_too() -> None:
    span(1, 10)
    device_preview.reset()
    a_screen_without_an_image()
    assert "the image is missing" in device_preview.step(bpy.context).note


def test_a_refused_body_is_not_blamed_for_a_missing_finger_nor_the_other_way_round() -> None:
    scene = span(1, 10)
    mesh_object("Hollow", [], []).dermis.role = "TOUCHABLE"
    with pytest.raises(DermisError, match="^scene 'Scene': no finger. Add one"):
        scene_sweep.sample(scene)
    finger("Off").hide_viewport = True
    finger("On")
    with pytest.raises(DermisError, match="object 'Hollow': nothing to touch: the mesh has no faces"):
        scene_sweep.sample(scene)


def test_a_refused_object_beside_a_good_one_stays_a_finding() -> None:
    scene = span(1, 10)
    cube()
    an_empty_mesh()
    tactile = scene_sweep.sample(scene)
    assert [(f.code, f.where) for f in tactile.findings] == [("mesh-unusable", "object 'Hollow'")]


def test_a_finger_that_only_plays_a_pattern_bakes_alone() -> None:
    span(1, 25)
    tip = finger()
    tip.dermis.finger.devices.add().preset = "haptip"
    tip.dermis.finger.pattern, tip.dermis.finger.pattern_play = "direction", True
    (output,) = drain(baking.bake(bpy.context.scene, Library(None))).outputs
    # eq. 8 at the end of the way out, a quarter of 1/f: the whole range of 2 mm
    assert output.track.column("tactor_y")[125] == pytest.approx(2e-3, abs=1e-9)
