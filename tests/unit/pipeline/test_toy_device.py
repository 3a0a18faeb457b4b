"""A kind of device is added in the places that `core/README.md` names, and in no others.

A buzzer, which hums while a finger touches anything, is written into a copy of the engine; a fresh Python renders a
scene with it there and reads its track back.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]

ROW = """
    "buzzer": Kind(
        mechanism="buzzer.Buzzer.of",
        renderer="buzzer",
        channels={"hum": "1"},
        settings=("buzz_gain",),
        parameters=table(_size("strength", "1")),
    ),
"""
SETTING = """
    "buzz_gain": Parameter(
        name="buzz_gain", unit="1", label="Gain", text="Of the hum", default=0.5, low=0.0, high=2.0, keyed=True
    ),
"""
MECHANISM = """
from dataclasses import dataclass

from ..errors import DermisError
from .spec import DeviceSpec


@dataclass(frozen=True)
class Buzzer:
    strength: float

    @classmethod
    def of(cls, spec: DeviceSpec) -> "Buzzer":
        if len(spec.channels) != 1:
            raise DermisError("a buzzer has one channel", where=spec.key)
        return cls(float(spec.parameters["strength"]))
"""
RENDERER = """
import numpy as np

from ..contact.holding_times import meet
from ..devices.buzzer import Buzzer
from ..parameters.device import DEVICE
from ..scene.tactile_scene import device_times
from ..track.command_track import CommandTrack
from .rendered import Rendered


def render(pad_contact, scene, finger, use, spec):
    times = device_times(scene, spec.rate)
    gain = DEVICE["buzz_gain"].of(use.parameters, spec.key)
    met = [meet(pad_contact, scene, finger, b, times) for b in range(len(scene.bodies))]
    touching = np.any([m.touching for m in met if m is not None], axis=0) * np.ones(len(times))
    values = Buzzer.of(spec).strength * gain * touching
    return Rendered(CommandTrack(spec, times, values[:, None]), {"contact": touching})
"""
PRESET = {
    "schema": "dermis-device 1",
    "name": "Buzzer",
    "kind": "buzzer",
    "rate": {"value": 100, "unit": "Hz"},
    "channels": [{"name": "hum", "unit": "1", "actuator": "hum", "low": 0, "high": 1}],
    "safe": {"reach": "at_once", "values": {"hum": 0}},
    "parameters": {"strength": {"value": 0.8, "unit": "1"}},
}
SCRIPT = """
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np

import core
from core.pipeline.outputs import export
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene, sample_frames

assert Path(core.__file__).is_relative_to(Path(sys.argv[1])), core.__file__
frames, times = sample_frames(Fraction(24), (1, 25), 240.0)
poses = np.tile(np.eye(4), (1, len(times), 1, 1))
poses[0, :, 2, 3] = np.where(times < 0.5, 5e-3, 0.2e-3)  # above the plate, then on it
plate = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], dtype=float), np.array([[0, 1, 2]], dtype=np.int32))
uses = (DeviceUse("buzzer"), *(DeviceUse("buzzer", {"buzz_gain": gain}) for gain in (1.0, 9.0)))
finger = Finger("Index", uses)
still = np.tile(np.eye(4), (1, len(times), 1, 1))
chunk = Chunk(frames, times, poses, still, still[:0])
scene = TactileScene("Buzz", Fraction(24), (1, 25), 240.0, (finger,), (Body("Plate", plate),), (), (chunk,))
bake = core.run(scene, core.Library())
refused = [str(f) for f in bake.findings if f.code == "device-unavailable"]
assert len(refused) == 1 and "'buzz_gain' is too large (found 9.0; allowed: 0 to 2)" in refused[0], refused
for path, hum in zip(export(bake, Path(sys.argv[2])), (0.4, 0.8), strict=True):
    track = core.read_csv(path)
    level = track.column("hum")
    assert track.spec.kind == "buzzer" and track.spec.worn and not track.check(), track.check()
    assert set(level[track.times < 0.45]) == {0.0} and set(level[track.times > 0.55]) == {hum}, level
print("BUZZED", len(level))
"""


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """Return a folder with a copy of the engine and its presets."""
    for name in ("core", "presets"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
    (tmp_path / "blender_addon").mkdir()  # its manifest states the version
    shutil.copy(ROOT / "blender_addon" / "blender_manifest.toml", tmp_path / "blender_addon")
    return tmp_path


def insert(path: Path, after: str, text: str) -> None:
    source = path.read_text(encoding="utf-8")
    assert source.count(after) == 1, (path, after)
    path.write_text(source.replace(after, after + text), encoding="utf-8")


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_new_kind_bakes_when_it_is_added_where_the_readme_says(house: Path, tmp_path_factory) -> None:
    before = contents(house)
    insert(house / "core/devices/kinds.py", "KINDS: Mapping[str, Kind] = {", ROW)
    insert(house / "core/parameters/device.py", "DEVICE: Table = {", SETTING)
    (house / "core/devices/buzzer.py").write_text(MECHANISM, encoding="utf-8")
    (house / "core/matching/buzzer.py").write_text(RENDERER, encoding="utf-8")
    (house / "presets/devices/buzzer.json").write_text(json.dumps(PRESET), encoding="utf-8")
    changed = {name for name, content in contents(house).items() if before.get(name) != content}

    section = (ROOT / "core/README.md").read_text(encoding="utf-8").split("## A new device")[1]
    places = re.findall(r"^\| `(\S+)` \|", section.split("\n## ")[0], re.MULTILINE)
    assert changed == {re.sub("KIND|RENDERER|PRESET", "buzzer", place) for place in places}

    out = tmp_path_factory.mktemp("out")
    command = [sys.executable, "-B", "-c", SCRIPT, str(house), str(out)]
    done = subprocess.run(command, cwd=house, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "BUZZED" in done.stdout, done.stdout + done.stderr
