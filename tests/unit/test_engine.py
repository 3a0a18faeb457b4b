"""The engine's number: raised wherever the same scenes give other commands."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from core.pipeline.render import run
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger
from core.surface.gap import Surface
from core.version import ENGINE

STORED = Path(__file__).with_name("engine.json")
SAME = 2e-3  # of a channel's largest command: another processor's rounding changes smooth touches by less
SHAPES = {"plate": lambda: Surface.block(0.1, 0.1).mesh, "ball": lambda: Surface.sphere(5e-3, 1280).mesh}
TISSUES = {"": {}, ", neo-Hookean": {"tissue": "neo_hookean"}}
DEVICES = ("haptip", "cable_platform", "pin_array_128")


def commands() -> dict[str, list[list[float]]]:
    """Return the commands at every tenth frame of a press with a short slide, by shape, device and tissue."""
    found = {}
    for (shape, mesh), (tissue, own) in product(SHAPES.items(), TISSUES.items()):
        way = [(1e-3 * max(i - 30, 0) / 20, 0.0, 0.2e-3 - 1e-3 * min(i / 30, 1.0)) for i in range(51)]
        finger = Finger("Index", tuple(map(DeviceUse, DEVICES)), {"skin_level": "draft", **own})
        bake = run(
            scene_from_poses(120.0, [(finger, way)], [(Body("Body", mesh(), {"friction": 0.3}), (0.0, 0.0, 0.0))])
        )
        for output in bake.outputs:
            values = output.track.values[:: max(len(output.track.times) // 5, 1)]
            found[f"{shape}, {output.device}{tissue}"] = [[float(f"{v:.6g}") for v in row] for row in values.tolist()]
    return found


def test_an_engine_that_gives_other_commands_has_another_number() -> None:
    """Where this fails after a change of the engine: raise ENGINE, and run this file to store what it gives now."""
    stored = json.loads(STORED.read_text())
    assert stored["engine"] == ENGINE, "run 'python -m tests.unit.test_engine' after raising the number"
    found = commands()
    assert found.keys() == stored["commands"].keys()
    for name, values in found.items():
        wanted = np.array(stored["commands"][name])
        size = max(float(np.abs(wanted).max()), 1e-12)
        assert np.array(values) == pytest.approx(wanted, abs=SAME * size), name


if __name__ == "__main__":
    STORED.write_text(json.dumps({"engine": ENGINE, "commands": commands()}, indent=0) + "\n")
