"""States are kept a few frames apart; a thimble goes on from one as it does from the frame before."""

from __future__ import annotations

from fractions import Fraction

import bpy
import numpy as np
import pytest

from blender_addon.demos import demo_skin
from blender_addon.preview import device_preview, skin_preview, thimble_preview
from blender_addon.preview.kept_states import SPACING, STATES, KeptStates
from blender_addon.scene_time import Clock
from blender_addon.viewport import shown

pytestmark = pytest.mark.shared_tests("the engine's states")

CLOCK = Clock(Fraction(24), 0.0)


def test_the_nearest_state_before_is_found_within_a_quarter_second() -> None:
    kept = KeptStates[str]()
    for frame in (1.0, 2.0, 3.0, 4.0, 9.0):
        kept.keep(frame, lambda frame=frame: f"at {frame:g}")
    assert kept.nearest(8.0, CLOCK) == (4.0, "at 4")
    assert kept.nearest(12.0, CLOCK) == (9.0, "at 9")
    assert kept.nearest(3.0, CLOCK) == (1.0, "at 1")  # 2 and 3 lie too near to 1
    assert kept.nearest(1.0, CLOCK) is None and kept.nearest(16.0, CLOCK) is None
    kept.clear()
    assert kept.nearest(8.0, CLOCK) is None


def test_the_oldest_makes_room() -> None:
    kept = KeptStates[int]()
    for k in range(STATES + 1):
        kept.keep(k * SPACING, lambda k=k: k)
    assert kept.nearest(1.0, CLOCK) is None
    assert kept.nearest(SPACING + 1.0, CLOCK) == (SPACING, 1)


def test_a_thimble_goes_on_from_a_kept_state_and_is_shown_as_it_was() -> None:
    device_preview.reset()
    skin_preview.reset()
    scene = demo_skin.build(1)
    finger = next(obj for obj in scene.objects if obj.dermis.role == "FINGER")
    finger.dermis.finger.devices.add().preset = "thimble_3rrs"
    bpy.context.window.scene = scene
    bpy.context.view_layer.update()

    def played(*frames: int) -> tuple[np.ndarray, str]:
        for frame in frames:
            scene.frame_set(frame)
            shown.on_frame(scene)
        (row,) = (row for row in shown.now(scene).devices.rows if row.kind == "thimble")
        return np.array(list(row.values.values())), thimble_preview._paths[finger.name].target.note

    seen, _ = played(*range(28, 31))
    back, note = played(31, 32, 34, 36, 33)
    assert note == "live: continued from frame 31"
    again, note = played(30)
    assert note == "live, as played: computed from frame 28 on" and np.array_equal(again, seen)
    device_preview.reset()
    skin_preview.reset()
    thimble_preview.reset()
    assert np.array_equal(back, played(28, 29, 30, 31, 33)[0])
    skin_preview.reset()
    thimble_preview.reset()
    assert not np.array_equal(back, played(33)[0])
