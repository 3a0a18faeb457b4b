"""Undo and redo by the hundred while a device is connected: Blender lives, and panel and sender agree.

Data-blocks come and go only with 'Undo Legacy': Blender's usual undo has a defect of its own there, which needs nothing
of Dermis (`undo_defect.py` shows it).
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import bpy
import pytest

from blender_addon.preview import device_preview, skin_preview
from blender_addon.streaming import device_calibration, session, streamed_track
from blender_addon.viewport import shown as views

from . import build
from .test_stream import HAPTIP, a_bake, a_track, state, wait

pytestmark = pytest.mark.long

STEPS = 500  # of undo and redo, beside the changes between them
ENDED = ("dead", "disconnected")


def ed(operator: str, **arguments: Any) -> bool:
    """Call an operator of undo; tell whether it did anything."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        call = getattr(bpy.ops.ed, operator)
        return (operator == "undo_push" or call.poll()) and call(**arguments) == {"FINISHED"}


class Walk:
    """A scene under a running sender, and what a person may do to it."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        for name, y in (("Finger", 0.0), ("Thumb", 0.1)):
            build.finger(name, (0.0, y, 0.0302)).dermis.finger.devices.add().preset = HAPTIP
        build.cube(size=0.06)
        build.screen().dermis.screen.mesh_object = bpy.data.objects["Cube"]
        bpy.context.view_layer.update()
        a_bake(a_track()).dermis_stream.ramp = 0.1
        session.connect(bpy.context.scene)
        wait(state("ready"))
        ed("undo_push", message="connected")
        self.settings: tuple[Callable[[], Any], ...] = (
            self.jog,
            self.jog,
            self.calibrate,
            self.mode,
            self.output,
            self.button,
            self.button,
            self.move,
            self.frame,
            self.device,
            self.skin,
            self.role,
            self.preview,
        )
        self.blocks = (self.add, self.delete, self.delete, self.rename, self.image, self.scene)

    @property
    def stream(self) -> Any:
        return bpy.context.scene.dermis_stream

    def thing(self, role: str = "") -> Any:
        """Return any object of a role, or None."""
        found = [o for o in bpy.context.scene.objects if not role or o.dermis.role == role]
        return self.chance.choice(found) if found else None

    def jog(self) -> None:
        self.chance.choice(self.stream.channels).jog = self.chance.uniform(-0.3, 0.3)

    def calibrate(self) -> None:
        channel = self.chance.choice(self.stream.channels)
        channel.zero, channel.gain = self.chance.uniform(-0.1, 0.1), self.chance.choice((1.0, -1.0, 1.5))
        channel.low, channel.high, channel.use_limits = -0.5, 0.5, self.chance.random() < 0.3

    def mode(self) -> None:
        self.stream.mode = self.chance.choice(("play", "follow", "jog", "jog"))

    def output(self) -> None:
        self.stream.output = self.chance.choice(("", "Finger: haptip", "Thumb: haptip"))

    def button(self) -> None:
        what = self.chance.choice(("BEGIN", "CANCEL", "CENTRE", session.stop, session.disarm))
        if callable(what):
            what()
        else:
            bpy.ops.dermis.stream_calibrate(action=what)

    def move(self) -> None:
        self.thing().location.x = self.chance.uniform(-0.002, 0.002)

    def frame(self) -> None:
        bpy.context.scene.frame_set(self.chance.randint(1, 49))

    def device(self) -> None:
        finger = self.thing("FINGER")
        if finger is not None and len(finger.dermis.finger.devices) > 1:
            finger.dermis.finger.devices.remove(1)
        elif finger is not None:
            finger.dermis.finger.devices.add().preset = HAPTIP

    def skin(self) -> None:
        finger = self.thing("FINGER")
        if finger is not None:
            finger.dermis.finger.skin.width_mm = self.chance.uniform(14.0, 18.0)

    def role(self) -> None:
        thing = bpy.context.scene.objects.get("Cube")
        if thing is not None:
            thing.dermis.role = self.chance.choice(("NONE", "TOUCHABLE", "SCREEN"))

    def preview(self) -> None:
        if self.thing("FINGER") is not None:
            device_preview.step(bpy.context)
            skin_preview.any_solved(bpy.context.scene)
            views.devices(bpy.context.scene)

    def add(self) -> None:
        self.chance.choice((build.cube, build.finger))(self.chance.choice("ABC"))

    def delete(self) -> None:
        found = [o for o in bpy.context.scene.objects if len(o.name) == 1 or o.name[1] == "."]
        if found:
            bpy.data.objects.remove(self.chance.choice(found))

    def rename(self) -> None:
        found = [o for o in bpy.context.scene.objects if len(o.name) == 1 or o.name[1] == "."]
        if found:
            self.chance.choice(found).name = self.chance.choice("ABC")

    def image(self) -> None:
        screen = bpy.data.objects["Screen"].dermis.screen
        screen.image = self.chance.choice((None, bpy.data.images.new("Relief", 4, 4)))
        screen.mesh_object = self.chance.choice((None, self.thing()))

    def scene(self) -> None:
        others = [s for s in bpy.data.scenes if s != bpy.context.scene]
        if others:
            bpy.data.scenes.remove(others[0])
        else:
            bpy.data.scenes.new("Other")

    def go(self, changes: tuple[Callable[[], Any], ...]) -> tuple[int, int]:
        """Walk until so many steps were undone or redone; return how many of each."""
        undone = redone = 0
        while undone + redone < STEPS:
            what = self.chance.random()
            if what < 0.55:
                undone += ed("undo") if what < 0.3 else 0
                redone += ed("redo") if what >= 0.3 else 0
                session.heartbeat()
                self.check()
            else:
                self.chance.choice(changes)()
                ed("undo_push", message="change")
            if self.chance.random() < 0.3:
                bpy.context.view_layer.update()
            session.heartbeat()
            assert session.connected() and session.status()["state"] not in ENDED, session.status()
            if session.status()["state"] == "ready" and self.chance.random() < 0.3:
                session.arm(bpy.context.scene)
        return undone, redone

    def check(self) -> None:
        """Compare what the panel says with what the sender was last told."""
        scene, request = bpy.context.scene, session._client._request
        assert all(isinstance(o, bpy.types.Object) for o in scene.collection.objects)
        assert [c.name for c in self.stream.channels] == ["pulley_1", "pulley_2"]
        assert request["mode"] == self.stream.mode and session._note == ""
        assert request["jog"] == ({c.name: c.jog for c in self.stream.channels} if self.stream.mode == "jog" else {})
        made = device_calibration.calibration_of(scene, streamed_track.device_key(scene))
        assert request["calibration"] == made.dumps()


@pytest.mark.parametrize("seed", (1, 2))
def test_settings(seed: int) -> None:
    walk = Walk(seed)
    undone, redone = walk.go(walk.settings)
    assert undone > 50 and redone > 50


@pytest.mark.parametrize("seed", (3, 4))
def test_settings_and_data_blocks(seed: int) -> None:
    preferences = bpy.context.preferences  # the fixture takes factory settings afterwards
    preferences.view.show_developer_ui = preferences.experimental.use_undo_legacy = True
    walk = Walk(seed)
    undone, redone = walk.go((*walk.settings, *walk.blocks, *walk.blocks))
    assert undone > 50 and redone > 50
