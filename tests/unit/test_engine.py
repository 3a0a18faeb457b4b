"""The engine's number: raised wherever the same scenes give other commands."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.pipeline.render import run
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, Mesh
from core.surface.gap import Surface
from core.version import ENGINE

STORED = Path(__file__).with_name("engine.json")
SAME = 2e-3  # of a channel's largest command: another processor's rounding changes smooth touches by less
SHAPES = ("plate", "ball")
ASIDE, TILT = 1e-3, np.radians(8.0)  # of the finger on the ball [m], and of the plate about the finger's axis
TISSUES = {"": {}, ", neo-Hookean": {"tissue": "neo_hookean"}}
DEVICES = ("haptip", "thimble_3rrs", "pin_array_128")
SCENES = tuple(product(SHAPES, TISSUES))
LOOKED_UP = ("plate", "")  # the one scene with a cable platform, whose table takes seconds to sweep


def mesh_of(shape: str) -> Mesh:
    """Return a plate that is tilted about the finger's axis, or a ball."""
    if shape == "ball":
        return Surface.sphere(5e-3, 1280).mesh
    plate = Surface.block(0.1, 0.1).mesh
    across, up = plate.vertices[:, 1], plate.vertices[:, 2]
    turned = np.stack([across * np.cos(TILT) - up * np.sin(TILT), across * np.sin(TILT) + up * np.cos(TILT)], axis=1)
    return Mesh(np.column_stack([plate.vertices[:, 0], turned]), plate.triangles)


def devices_of(shape: str, tissue: str) -> tuple[str, ...]:
    """Return the devices on the finger in a scene."""
    return (*DEVICES, "cable_platform") if (shape, tissue) == LOOKED_UP else DEVICES


def commands(shape: str, tissue: str) -> dict[str, list[list[float]]]:
    """Return the commands at every tenth frame of a press with a short slide, by shape, device and tissue.

    The plate is tilted, and the finger beside the middle of the ball. Pressed straight onto something symmetric, a
    device that is searched may have two best poses, mirror images of each other, and a processor's rounding chooses.
    """
    aside = ASIDE if shape == "ball" else 0.0
    way = [(1e-3 * max(i - 30, 0) / 20, aside, 0.2e-3 - 1e-3 * min(i / 30, 1.0)) for i in range(51)]
    finger = Finger(
        "Index", tuple(map(DeviceUse, devices_of(shape, tissue))), {"skin_level": "draft", **TISSUES[tissue]}
    )
    body = Body("Body", mesh_of(shape), {"friction": 0.3})
    bake = run(scene_from_poses(120.0, [(finger, way)], [(body, (0.0, 0.0, 0.0))]))
    found = {}
    for output in bake.outputs:
        values = output.track.values[:: max(len(output.track.times) // 5, 1)]
        found[f"{shape}, {output.device}{tissue}"] = [[float(f"{v:.6g}") for v in row] for row in values.tolist()]
    return found


@pytest.fixture(scope="module")
def stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(STORED.read_text())
    return found


def test_every_scene_is_stored(stored: dict[str, Any]) -> None:
    names = {f"{shape}, {device}{tissue}" for shape, tissue in SCENES for device in devices_of(shape, tissue)}
    assert stored["commands"].keys() == names


@pytest.mark.parametrize(("shape", "tissue"), SCENES)
def test_an_engine_that_gives_other_commands_has_another_number(
    shape: str, tissue: str, stored: dict[str, Any]
) -> None:
    """Where this fails after a change of the engine: raise ENGINE, and run this file to store what it gives now."""
    assert stored["engine"] == ENGINE, "run 'python -m tests.unit.test_engine' after raising the number"
    found = commands(shape, tissue)
    assert len(found) == len(devices_of(shape, tissue))
    for name, values in found.items():
        wanted = np.array(stored["commands"][name])
        size = max(float(np.abs(wanted).max()), 1e-12)
        assert np.array(values) == pytest.approx(wanted, abs=SAME * size), name


if __name__ == "__main__":
    made = {name: rows for scene in SCENES for name, rows in commands(*scene).items()}
    STORED.write_text(json.dumps({"engine": ENGINE, "commands": made}, indent=0) + "\n")
