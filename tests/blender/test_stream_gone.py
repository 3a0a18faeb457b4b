"""What is streamed and is gone from the scene is safe at once: the finger, its device, or that it is one at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon._core import DermisError
from blender_addon.streaming import session, streamed_track

from . import build
from .test_stream import HAPTIP, a_bake, a_track, ended, heard, state, wait
from .test_stream_changes import there
from .test_undo import push, undo

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]


@pytest.fixture
def scene() -> Any:
    """A finger with a HapTip and a bake for it, and another finger with such a device that has none."""
    for name in ("Finger", "Another"):
        build.finger(name).dermis.finger.devices.add().preset = HAPTIP
    bpy.context.view_layer.update()
    made = a_bake(a_track())
    made.dermis_stream.ramp = 0.1
    made.frame_set(13)
    return made


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    session.close()


def finger() -> Any:
    return bpy.data.objects["Finger"]


def remove_by_operator() -> None:
    bpy.ops.object.select_all(action="DESELECT")
    finger().select_set(True)
    bpy.ops.object.delete()


def remove_device_by_operator() -> None:
    bpy.context.view_layer.objects.active = finger()
    assert bpy.ops.dermis.remove_device() == {"FINISHED"}


def set_preset() -> None:
    finger().dermis.finger.devices[0].preset = "thimble_3rrs"


GONE: dict[str, Callable[[], Any]] = {
    "finger removed": lambda: bpy.data.objects.remove(finger()),
    "finger deleted": remove_by_operator,
    "finger unlinked": lambda: bpy.context.scene.collection.objects.unlink(finger()),
    "no finger any more": lambda: setattr(finger().dermis, "role", "TOUCHABLE"),
    "device removed": lambda: finger().dermis.finger.devices.remove(0),
    "device taken off": remove_device_by_operator,
    "device switched off": lambda: setattr(finger().dermis.finger.devices[0], "enabled", False),
    "another device": set_preset,
}


def live(scene: Any, mode: str) -> Any:
    """Stream in a mode until the device is away from its safe pose; return the sender."""
    scene.dermis_stream.mode = mode
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    if mode == "jog":
        scene.dermis_stream.channels[0].jog = 0.1
        wait(there([0.1, 0.0]))
    else:
        wait(lambda s: s["armed"] and np.abs(heard(s)).max() > 1e-3)
    return session._client


@pytest.mark.parametrize(
    ("how", "mode"), [*((how, "jog") for how in GONE), ("finger removed", "play"), ("device removed", "follow")]
)
def test_what_is_gone_is_safe_at_once(scene: Any, how: str, mode: str) -> None:
    client = live(scene, mode)
    GONE[how]()
    bpy.context.view_layer.update()  # as Blender does between two events
    session.heartbeat()
    assert not session.connected() and ended(client)
    assert "brought to its safe state" in session.status()["message"] and "'Finger'" in session.status()["message"]


@pytest.mark.parametrize("said", ["", "Finger: haptip"])
def test_no_other_finger_takes_its_place(scene: Any, said: str) -> None:
    scene.dermis_stream.output = said
    live(scene, "jog")
    bpy.data.objects.remove(finger())
    bpy.data.objects["Another"].name = "Finger"
    bpy.context.view_layer.update()
    session.heartbeat()
    assert not session.connected()


def test_a_device_that_no_finger_wears_is_told_with_a_remedy(scene: Any) -> None:
    scene.dermis_stream.output = f"Finger: {HAPTIP}"
    finger().dermis.finger.devices[0].preset = "thimble_3rrs"
    scene.dermis_stream.output_of = ""
    with pytest.raises(DermisError, match="give the finger this device"):
        streamed_track.device(scene)
    finger().dermis.finger.devices[0].preset = HAPTIP
    assert streamed_track.device(scene).finger == "Finger", "the remedy works without a bake"


def test_a_new_name_changes_nothing(scene: Any) -> None:
    live(scene, "jog")
    finger().name = "Index"
    bpy.data.objects["Another"].name = "Finger"
    bpy.context.view_layer.update()
    wait(there([0.1, 0.0]))
    assert streamed_track.chosen(scene).finger == "Index" and session.status()["armed"]
    scene.dermis_stream.channels[0].jog = 0.05
    wait(there([0.05, 0.0]))
    bpy.data.objects.remove(finger())  # the other one
    session.heartbeat()
    assert session.connected()


@pytest.mark.undo
def test_undo_that_takes_the_finger_back_is_safe_too(scene: Any) -> None:
    push("before")
    made = build.finger("Late")
    made.dermis.finger.devices.add().preset = HAPTIP
    push("added")
    scene.dermis_stream.output = "Late: haptip"
    live(scene, "jog")
    undo()
    session.heartbeat()
    assert not session.connected()


@pytest.mark.undo
def test_undo_of_something_else_goes_on(scene: Any) -> None:
    push("before")
    live(scene, "jog")
    push("connected")
    bpy.data.objects["Another"].location.x = 1.0
    push("moved")
    undo()
    session.heartbeat()
    assert session.connected()
    wait(there([0.1, 0.0]))
