"""What a scene does not need is left out: each kind is counted, and leaving it out changes no byte of a track."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import Finding
from core.parameters.skin import DEFAULT_SKIN
from core.pipeline.bake import Bake
from core.pipeline.felt import skin_models
from core.pipeline.render import RENDERERS, run
from core.pipeline.skipping import SKIPPED, told
from core.pipeline.stages import Stages
from core.presets import Library
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.steps import drain
from core.surface.gap import Surface
from tests.finger_rows import COUNT, DRAFT, alone, scene_of, three

ROOT = Path(__file__).parents[3]
COUNTED = re.compile(
    r'skip(?:ped)?\w*(?:\(|\[|\s*=\s*\{)\s*"(\w+)"|\{"(\w+)": (?:int|count) ?[(-]|"(\w+)": stepper\.far'
)
PARTS = "contact stress gradient effects matching imports objects frames fingers overlays".split()


def sources() -> dict[Path, str]:
    files = [*(ROOT / "core").rglob("*.py"), *(ROOT / "blender_addon").rglob("*.py")]
    return {path: path.read_text(encoding="utf-8") for path in files if path.name != "skipping.py"}


def test_every_counter_has_a_row_and_every_row_a_counter() -> None:
    texts = sources()
    for name in SKIPPED:
        assert any(f'"{name}"' in text for text in texts.values()), f"nobody counts {name}"
    rendering = {p: t for p, t in texts.items() if p.parent.name in ("matching", "pipeline", "contact")}
    found = {name for text in rendering.values() for match in COUNTED.findall(text) for name in match if name}
    assert {"effects_off", "surfaces_far", "skin_pairs_far", "pin_frames_without_contact", "fingers_unchanged"} <= found
    assert found <= SKIPPED.keys()
    assert {row.part for row in SKIPPED.values()} == set(PARTS)


def test_counts_are_told_in_words() -> None:
    words = dict(told({"effects_off": 1200, "pair_samples_far": 3, "fingers_unchanged": 0, "of a later version": 2}))
    assert words == {
        "objects": "3 pads and objects too far apart, by sample",
        "effects": "1,200 effects that are off",
        "other": "2 of a later version",
    }
    assert [part for part, _ in told(dict.fromkeys(reversed(SKIPPED), 1))] == [r.part for r in SKIPPED.values()]


def tracks(bake: Bake, fingers: int) -> list[bytes]:
    names = {f.name for f in three().fingers[:fingers]}
    return [o.track.values.tobytes() for o in bake.outputs if o.finger in names]


@pytest.fixture(scope="module")
def plain() -> Bake:
    return alone()


def beside(scene: TactileScene, kind: str, item: Any, at: float) -> TactileScene:
    """Return the scene with one more finger or object at a height, far to the side."""
    chunks = []
    for chunk in scene.chunks:
        pose = np.tile(np.eye(4), (1, len(chunk.times), 1, 1))
        pose[0, :, 1, 3], pose[0, :, 2, 3] = 5.0, at
        chunks.append(replace(chunk, **{kind: np.concatenate([getattr(chunk, kind), pose])}))
    return replace(scene, **{kind: (*getattr(scene, kind), item)}, chunks=chunks)


def test_far_objects(plain: Bake) -> None:
    more = run(beside(three(), "bodies", Body("far", Surface.sphere(1e-2).mesh, {"friction": 0.4}), 0.0))
    assert tracks(more, 3) == tracks(plain, 3)
    for name in ("pair_samples_far", "skin_pairs_far"):
        assert more.skipped[name] - plain.skipped.get(name, 0) == 3 * COUNT, name


def test_fingers_without_a_skin(plain: Bake) -> None:
    more = run(beside(three(), "fingers", Finger("Little", (DeviceUse("haptip"),), DRAFT), 1.0))
    assert tracks(more, 3) == tracks(plain, 3)
    assert (plain.skipped.get("fingers_without_skin", 0), more.skipped["fingers_without_skin"]) == (0, 1)


def test_fingers_with_nothing_near(plain: Bake) -> None:
    more = run(beside(three(), "fingers", Finger("Little", (DeviceUse("pin_array_128"),), DRAFT), 1.0))
    assert tracks(more, 3) == tracks(plain, 3)
    idle = [bake.skipped.get("skin_frames_idle", 0) for bake in (plain, more)]
    assert idle[1] - idle[0] == COUNT and not more.skins["Little"].force.any()
    pins = [bake.skipped.get("pin_frames_without_contact", 0) for bake in (plain, more)]
    assert pins[1] - pins[0] == COUNT and not more.outputs[-1].track.values.any()


def test_a_skin_is_made_once_for_all_fingers_alike(plain: Bake) -> None:
    """Two have the same skin, and then one is told apart by each of the three settings that make it."""
    assert plain.skins["Thumb"].model is plain.skins["Index"].model is plain.skins["Ring"].model
    skin = {**Library().skin(DEFAULT_SKIN), "young": 2e5}
    for other in ({"skin": skin}, {"skin_level": "standard"}, {"tissue": "neo_hookean"}):
        scene = three()
        fingers = list(scene.fingers)
        fingers[2] = replace(fingers[2], parameters={**fingers[2].parameters, **other})
        clock, told_of = Stages(), list[Finding]()
        models = drain(skin_models(replace(scene, fingers=tuple(fingers)), range(3), Library(), None, clock, told_of))
        assert models[0] is models[1] is not models[2] and not told_of, other
        assert models[2].material.young == (2e5 if "skin" in other else models[0].material.young)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_effects_that_are_off(plain: Bake) -> None:
    """One whose amplitude is zero is not computed, and one whose switch is off: the same bytes."""
    given = {"friction": 0.4, "texture_amplitude_x": 0.0, "transient_amplitude": 0.0}
    silent = replace(three(), bodies=tuple(replace(body, parameters=given) for body in three().bodies))
    off = {"use_transient": False, "use_texture": False}
    fingers = [
        replace(f, devices=tuple(replace(d, parameters=off) if d.preset == "haptip" else d for d in f.devices))
        for f in three().fingers
    ]
    one, other = run(silent), run(replace(three(), fingers=tuple(fingers)))
    assert one.skipped["effects_off"] == other.skipped["effects_off"] > 0
    assert tracks(one, 3) == tracks(other, 3)


def test_frames_in_which_nothing_moves() -> None:
    block = Surface.block(30e-3, 30e-3, 20e-3).mesh
    lifted = replace(block, vertices=block.vertices + [0.0, 0.0, 20e-3 - block.vertices[:, 2].max()])
    finger = Finger("Thumb", (), {**DRAFT, "skin_shown": True})
    scene = scene_of([finger], [Body("block", lifted, {"friction": 0.4})], np.array([1e-3]), count=26)
    held = [replace(c, fingers=np.repeat(c.fingers[:, :1], len(c.times), axis=1)) for c in scene.chunks]
    rested = run(replace(scene, chunks=held))
    assert run(scene).skipped["skin_frames_same"] < 5, "it moves"
    skin = rested.skins["Thumb"]
    assert rested.skipped["skin_frames_same"] >= 13
    third = skin.force[skin.contact >= 20]
    assert len(third) == 5 and (third == third[0]).all(), "the same pose, the same forces"


def test_code_of_devices_that_nobody_wears(plain: Bake) -> None:
    assert plain.skipped["renderers_not_loaded"] == len(RENDERERS) - len({"shear_tactor", "pins"})
