"""Trust Band in Blender: found for the scene, marked in the strip, drawn in plots, and gone after an edit."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from blender_addon.results import store, trusted
from blender_addon.timeline import strip
from core.comparison import trust_band
from core.comparison.scene_variants import shifted

from .build import pressing, span

pytestmark = pytest.mark.shared_tests("the engine's band")


@pytest.fixture
def baked() -> bpy.types.Scene:
    """Return a baked scene with a finger that presses a plate and slides on it."""
    scene, hand = pressing()
    hand.dermis.finger.skin.shown = True
    hand.dermis.finger.devices.add().preset = "pin_array_128"
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return scene


def test_it_needs_a_bake() -> None:
    span(1, 9)
    assert not bpy.ops.dermis.trust_band.poll()


def test_a_plate_is_trusted_and_an_edit_forgets_it(baked: bpy.types.Scene) -> None:
    before = store.current(baked)
    assert bpy.ops.dermis.trust_band() == {"FINISHED"}
    made: Any = trusted.current(baked)
    result: Any = store.current(baked)
    assert result.bake is before.bake and store.state(baked) == "fresh", "the bake stays as it was"
    assert [band.device for band in made.bands if band.track is not None] == [o.device for o in result.bake.outputs]
    assert all(band.share.max() < 0.05 for band in made.bands) and made.findings == ()
    spreads = trusted.spreads(baked, result.bake)
    assert sorted(spreads) == list(range(len(result.bake.outputs)))
    assert bpy.ops.dermis.show_plots() == {"FINISHED"}
    baked.objects["Plate"].location.z += 1e-3
    bpy.context.view_layer.update()
    assert trusted.current(baked) is None and not trusted.spreads(baked, result.bake)


CHANGES = {
    "gravity": lambda scene: setattr(scene, "use_gravity", False),
    "range": lambda scene: (setattr(scene, "frame_start", 2), setattr(scene, "frame_end", 10)),
    "unit": lambda scene: setattr(scene.unit_settings, "scale_length", 0.5),
    "preview": lambda scene: setattr(scene, "use_preview_range", True),
}


@pytest.mark.parametrize("what", CHANGES)
def test_settings_that_nobody_reports_forget_it_too(baked: bpy.types.Scene, what: str) -> None:
    assert bpy.ops.dermis.trust_band() == {"FINISHED"} and trusted.current(baked) is not None
    CHANGES[what](baked)
    assert store.state(baked) == "stale" and trusted.current(baked) is None
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    again: Any = store.current(baked)
    assert trusted.current(baked) is None and not trusted.spreads(baked, again.bake)


def test_a_bake_of_before_an_edit_has_no_band_of_the_scene_of_now(baked: bpy.types.Scene) -> None:
    old: Any = store.current(baked)
    baked.objects["Plate"].location.z += 2e-4
    bpy.context.view_layer.update()
    assert bpy.ops.dermis.trust_band() == {"FINISHED"}
    assert store.state(baked) == "stale" and trusted.current(baked) is not None
    assert not trusted.spreads(baked, old.bake)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    new: Any = store.current(baked)
    assert list(trusted.spreads(baked, new.bake)) == [0], "what is baked now is what was judged"


def test_where_nothing_was_baked_it_says_so() -> None:
    scene, hand = pressing()
    hand.dermis.finger.devices.add().preset = "electrovibration"
    assert bpy.ops.dermis.bake() == {"FINISHED"} and not store.current(scene).bake.outputs
    with pytest.raises(RuntimeError, match="no track and no skin to judge"):
        bpy.ops.dermis.trust_band()
    assert trusted.current(scene) is None


def test_what_cannot_be_trusted_is_marked_at_its_frame(baked: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trust_band, "VARIANTS", {"shifted": (lambda s: shifted(s, 5e-4), "shifted far", True)})
    assert bpy.ops.dermis.trust_band() == {"FINISHED"}
    made: Any = trusted.current(baked)
    assert made.findings and all(f.code == "not-reproduced" and 1.0 <= f.frame <= 9.0 for f in made.findings)
    shown: Any = strip.of(baked)
    assert {mark.text for mark in shown.marks} >= {str(f) for f in made.findings}
    doubts = [series for lane in shown.lanes for series in lane.series.get("doubt", ())]
    assert "no touch" not in shown.lanes[0].says and "not to be trusted" in shown.lanes[0].says
    assert strip.of(baked).lanes is shown.lanes, "made once"
    assert doubts and any(series.values.any() for series in doubts)
    assert all(1.0 <= series.frames.min() and series.frames.max() <= 10.0 for series in doubts)
