"""Adapting a thimble to a finger: what a child process learns, what is left when it is stopped, what is refused."""

from __future__ import annotations

import bpy
import pytest

from blender_addon import choices
from blender_addon._core import core
from blender_addon.demos import demo_thimble
from blender_addon.devices import skin_models, thimble_adaptation, thimble_devices
from blender_addon.panels import searched
from blender_addon.properties import skin_properties
from blender_addon.results import store

pytestmark = pytest.mark.shared_tests("the engine learns in a child")

LESS = {"trajectories": 40, "iterations": 20}


@pytest.fixture
def finger(tmp_path, monkeypatch):
    """Return the finger of the ball scene; adaptations go to a folder of the test's own."""
    pytest.importorskip("onnxruntime")
    folder = tmp_path / "surrogates"
    folder.mkdir()
    monkeypatch.setattr(thimble_devices, "folder", lambda create=False: folder)
    choices.refresh()
    scene = demo_thimble.build("BALL")
    bpy.context.window.scene = scene
    obj = scene.objects["Index"]
    bpy.context.view_layer.objects.active = obj
    yield obj
    core.work.child.close_all()


def through(steps):
    """Run a generator to its end; return what it told and gave."""
    told = []
    while True:
        try:
            told.append(next(steps))
        except StopIteration as stop:
            return told, stop.value


def model_of(obj):
    """Return the finger's skin."""
    values = skin_properties.parameters(obj.dermis.finger.skin)
    return thimble_devices.pressed(obj, skin_models.get(values["skin"], values["skin_level"]))


def test_an_adaptation_is_found_by_both_methods(finger) -> None:
    device, scene = finger.dermis.finger.devices[0], bpy.context.scene
    assert thimble_adaptation.status(device, model_of(finger)) is None
    told, made = through(thimble_adaptation.adapt(finger, **LESS))
    assert {p.stage for p in told} >= {"moving the disc", "learning"}
    shares = [p.done / p.total for p in told]
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert made["samples"] > 100 and (made["errors"] > 0).all()
    known = thimble_adaptation.status(device, model_of(finger))
    assert known["network_error"] == pytest.approx(float(made["errors"][1]))
    thimble_devices.forget()
    scene.frame_start, scene.frame_end = 1, 24
    for method in ("ridge", "network"):
        device.thimble_method = method
        assert bpy.ops.dermis.bake() == {"FINISHED"}
        bake = store.current(scene).bake
        assert bake.outputs[0].track.meta["method"] == method
        assert not [f for f in bake.all_findings if f.code == "surrogate"]
    finger.dermis.finger.skin.alpha = 0.8  # stiffness needs no new one, another shape does
    assert thimble_adaptation.status(device, model_of(finger)) is not None
    finger.dermis.finger.skin.width_mm += 1.0
    assert thimble_adaptation.status(device, model_of(finger)) is None


def test_on_neo_hookean_tissue_the_panel_says_that_linear_tissue_was_learned() -> None:
    """Models of linear tissue come from earlier versions, or from before the finger's tissue was changed."""
    judged = {"by_law": {"network": {"error": 0.08}, "ridge": {"error": 0.071}}}
    words = "It was learned on linear tissue, and the neo-Hookean law corrects it in each frame"
    remedy = "Adapt again to learn by the law."
    assert searched.linear_words(judged) == f"{words}: by the law, network 8 %, polynomial 7 % off. {remedy}"
    assert searched.linear_words({}) == f"{words}. {remedy}"


def test_lengths_that_do_not_ship_are_adapted_to_where_they_are_touched(finger, tmp_path, monkeypatch) -> None:
    """On points, as a bake touches them: with the table of the smooth pad, which is made first."""
    settings, stores = finger.dermis.finger.skin, core.skin.surface_store
    settings.level, settings.contact = "draft", "points"
    shipped = model_of(finger)
    table = stores.find_remainder(shipped.shape, shipped.material.poisson, shipped=stores.SHIPPED)
    cache = core.cache.Cache(tmp_path / "skins", 10**9)
    monkeypatch.setattr(skin_models, "cache", lambda: cache)
    monkeypatch.setattr(skin_models, "make_pad", lambda skin: made.append(skin) or keep())
    skin_models.forget()
    settings.width_mm += 0.01  # so little that the other's table still serves
    made, wanted = [], skin_properties.parameters(settings)
    assert skin_models.wants_pad(wanted)

    def keep() -> float:
        model = model_of(finger)
        cache.put(stores.remainder_key(model.shape, model.material.poisson), table.write)
        return 1.0

    through(thimble_adaptation.adapt(finger, **LESS))
    assert made == [wanted["skin"]] and core.surrogate.press_points.pressed_on(model_of(finger)) == "points"
    assert thimble_adaptation.status(finger.dermis.finger.devices[0], model_of(finger)) is not None
    skin_models.forget()


def test_stopping_leaves_nothing_behind(finger) -> None:
    finger.dermis.finger.skin.tissue = "neo_hookean"
    folder, before = thimble_devices.folder(), set(core.work.child._owners)
    steps = thimble_adaptation.adapt(finger, trajectories=2000)
    for _ in range(8):
        next(steps)
    steps.close()
    assert not list(folder.iterdir())
    assert thimble_adaptation.status(finger.dermis.finger.devices[0], model_of(finger)) is None
    assert set(core.work.child._owners) == before  # the child process is gone


def test_stopping_keeps_an_older_adaptation(finger) -> None:
    folder = thimble_devices.folder()
    through(thimble_adaptation.adapt(finger, **LESS))
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    steps = thimble_adaptation.adapt(finger, trajectories=2000)
    for _ in range(8):
        next(steps)
    steps.close()
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before and len(before) == 2


def test_what_the_child_refuses_is_a_finding(finger) -> None:
    from blender_addon import reporting

    device = finger.dermis.finger.devices[0]
    device.thimble_calibrated = True
    device.thimble_felt_1 = 1.2  # beyond the servos' range
    with pytest.raises(RuntimeError, match="outside the servos' range"):
        bpy.ops.dermis.adapt_thimble()
    assert [f.severity for f in reporting.findings()] == ["error"] and not list(thimble_devices.folder().iterdir())


def test_only_a_finger_with_a_thimble_can_be_adapted(finger) -> None:
    finger.dermis.finger.devices[0].preset = "haptip"
    assert not bpy.ops.dermis.adapt_thimble.poll()
    with pytest.raises(core.errors.DermisError, match="wears no thimble"):
        next(thimble_adaptation.adapt(finger))
