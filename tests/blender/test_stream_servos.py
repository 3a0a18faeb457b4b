"""Smart servos in Blender's panel: who answered, how warm they are, and a limit that ends the stream, in words."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from blender_addon._core import DermisError
from blender_addon.panels.stream import DERMIS_PT_stream
from blender_addon.streaming import session

from . import build
from .stand_in import Anything, Panel
from .test_stream import HAPTIP, state, wait

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]


@pytest.fixture
def scene() -> Any:
    """A finger with a HapTip, and a simulated line of servos."""
    build.finger().dermis.finger.devices.add().preset = HAPTIP
    bpy.context.view_layer.update()
    made = bpy.context.scene
    settings = made.dermis_stream
    settings.protocol, settings.url, settings.mode, settings.ramp = "dynamixel", "virtual:", "jog", 0.0
    return made


def labels() -> str:
    """Return what the panel says."""
    layout = Anything()
    Panel(DERMIS_PT_stream, layout).draw(bpy.context)
    return " ".join(layout.words)


def test_what_servos_measure_is_in_the_panel(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene, fingers_out=True)
    wait(lambda status: status["armed"])
    said = labels()
    assert "XL330-M288" in said and "Temperature up to 31 degC" in said and "Current up to 0 A" in said, said


def test_a_wrong_servo_is_refused_in_the_panel_and_nothing_is_armed(scene: Any) -> None:
    scene.dermis_stream.url = "virtual:?board_model=350"
    session.connect(scene)
    wait(lambda status: "model number" in status["message"])
    with pytest.raises(DermisError, match="not ready to be armed"):
        session.arm(scene, fingers_out=True)
    assert not session.status()["armed"] and "350" in labels()
