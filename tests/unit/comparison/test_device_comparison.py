"""One touch through every device: figures that agree with the renderers' own, what is skipped and why, the reports."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from core.cache import Cache
from core.comparison import device_comparison, report, wearing
from core.comparison.measures import judge
from core.comparison.rendered_forces import rendered_forces
from core.devices.disc_device import seated
from core.devices.first_contact import first_contact
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.pipeline.render import render
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.shipped import BUILT_IN
from core.steps import drain
from core.surface.gap import Surface
from core.surrogate.store import contact_of

pytestmark = pytest.mark.one_line("3.11", "numbers alone, of one touch for the whole file")

RATE, DEPTH = 120.0, 0.8e-3
SKIN = {"skin_level": "draft", "contact": "nodes"}


def touch(devices: tuple[DeviceUse, ...] = ()) -> TactileScene:
    """Return a scene in which a finger comes down on a block, slides and lifts."""
    t = np.arange(37) / 36.0
    z = 2e-3 - (2e-3 + DEPTH) * np.clip(np.minimum(t, 1.0 - t) / 0.35, 0.0, 1.0)
    way = np.column_stack([np.zeros(37), 2e-3 * t, z])
    block = Surface.block().mesh
    top = np.array([0.0, 0.0, float(block.vertices[:, 2].max())])
    table = Body("Table", replace(block, vertices=block.vertices - top), Library().material("wood"))
    finger = Finger("Index", devices, SKIN)
    return scene_from_poses(RATE, [(finger, [tuple(p) for p in way.tolist()])], [(table, (0.0, 0.0, 0.0))])


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"), 10**9)


@pytest.fixture(scope="module")
def found(cache: Cache) -> device_comparison.Comparison:
    return drain(device_comparison.compare_devices(touch(), Library(), "Index", cache=cache))


def test_every_preset_is_a_row_or_says_why_not(found: device_comparison.Comparison) -> None:
    named = {row.device for row in found.rows} | {s.device for s in found.skipped}
    assert named == {entry.key for entry in Library().list("devices")}
    assert {s.device: s.why for s in found.skipped}["electrovibration"] == "the scene has no touch screen"
    rows = {row.device: row for row in found.rows}
    assert {"haptip", "pin_array_128", "thimble_3rrs"} <= set(rows)
    for row in found.rows:
        assert 0.0 <= row.clipped <= 1.0 and 0.0 <= row.judged.out_of_reach <= 1.0
        for measure in row.judged.measures:
            assert np.isfinite([measure.target, measure.rendered]).all() and 0.0 <= measure.off < 5.0
    pressing = [row for row in found.rows if row.judged.pad is not None]
    assert len({row.judged.measures[1].target.tobytes() for row in pressing}) == 1  # one touch for all
    assert [m.name for m in rows["haptip"].judged.measures] == ["shear displacement"]


def test_rendered_forces_are_those_that_the_renderers_report(cache: Cache) -> None:
    devices = (DeviceUse("pin_array_128", {"pin_fade_in": 0.0, "pin_fade_out": 0.0}), DeviceUse("thimble_3rrs"))
    bake = drain(render(touch(devices), Library(), cache=cache))
    skin = bake.skins["Index"]
    samples = skin.contact[2:-2:4]
    for output, signal, use in zip(bake.outputs, ("rendered_force", "normal_force"), devices, strict=True):
        forces = rendered_forces(output.track, skin, samples, use.parameters)
        assert forces.shape == (len(samples), skin.model.pad_count, 3)
        told = np.interp(skin.times[samples], output.track.times, output.signals[signal])
        assert forces.sum(axis=1)[:, 2] == pytest.approx(told, rel=0.08, abs=0.02)


def test_commands_under_which_tissue_does_not_settle_are_told(
    found: device_comparison.Comparison, cache: Cache
) -> None:
    """A disc 6 mm deep, or pins of 0.4 N each, are beyond what the law holds: the row and all reports say so."""
    scene = touch((DeviceUse("thimble_3rrs"), DeviceUse("pin_array_128")))
    finger = replace(scene.fingers[0], parameters={**SKIN, "tissue": "neo_hookean"})
    bake = drain(render(replace(scene, fingers=(finger,)), Library(), cache=cache))
    output, pins = bake.outputs
    skin, device = bake.skins["Index"], mechanism(output.track.spec)
    assert not judge(output, skin, {}).findings and not judge(pins, skin, {}).findings
    x = seated(device, 0.0, 0.0, first_contact(device, contact_of(device, skin.pressed, 0.6), 0.0, 0.0) - 6e-3)
    values = output.track.values.copy()
    for name, angle in zip(("servo_1", "servo_2", "servo_3"), device.joints(x)[0], strict=True):
        values[-len(values) // 3 :, [c.name for c in output.track.spec.channels].index(name)] = angle
    pushed = pins.track.values.copy()
    pushed[len(pushed) // 4 :] = 0.4  # the track is ahead of the touch
    for each, played in ((output, values), (pins, pushed)):
        deep = replace(each, track=replace(each.track, values=played))
        judged = judge(deep, skin, {})
        (told,) = judged.findings
        assert told.code == "law-unsettled" and told.count > 1 and each.track.spec.name in told.what
        assert told in device_comparison.row_of(deep, judged).findings
        made = replace(found, findings=judged.findings)
        assert told.what in report.text(made) and told.what in report.csv(made)
        assert any(told.what in words for words in report.as_dict(made)["findings"])


def test_a_device_that_is_worn_keeps_its_settings_and_others_leave(cache: Cache) -> None:
    scene = touch((DeviceUse("pin_array_128", {"pin_method": "FM2"}),))
    other = Finger("Thumb", (DeviceUse("thimble_3rrs"),), SKIN)
    worn, fit, _ = wearing.wearing_all(replace(scene, fingers=(*scene.fingers, other)), Library(), 0)
    assert worn.fingers[0].devices[0].parameters == {"pin_method": "FM2"} and fit.count("pin_array_128") == 1
    assert [use.preset for use in worn.fingers[0].devices].count("pin_array_128") == 1
    assert worn.fingers[1].devices == () and worn.fingers[1].parameters["skin_shown"] is True


def test_a_broken_preset_and_a_finger_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "devices").mkdir()
    (tmp_path / "devices" / "mine.json").write_text("{}")
    _, _, skipped = wearing.wearing_all(touch(), Library(tmp_path), 0)
    assert "mine" in {s.device for s in skipped} and all(s.why for s in skipped)
    with pytest.raises(DermisError, match="no such finger"):
        next(device_comparison.compare_devices(touch(), Library(), "Ring"))


def test_a_touch_in_the_air_is_refused_with_every_reason(cache: Cache) -> None:
    scene = touch()
    finger = (scene.fingers[0], [(0.0, 0.0, 0.05)] * 9)
    lifted = scene_from_poses(RATE, [finger], [(scene.bodies[0], (0.0, 0.0, 0.0))])
    with pytest.raises(DermisError, match="no device fits this touch") as refused:
        drain(device_comparison.compare_devices(lifted, Library(), cache=cache))
    assert "this touch gives it nothing to render" in str(refused.value)
    assert "the pad does not press into any object" in str(refused.value)


def test_table_and_page(found: device_comparison.Comparison, tmp_path: Path) -> None:
    table, page = report.write(found, tmp_path)
    rows = list(csv.DictReader(line for line in table.read_text().splitlines() if not line.startswith("#")))
    assert len(rows) == sum(len(row.judged.measures) for row in found.rows)
    assert float(rows[0]["off"]) == pytest.approx(found.rows[0].judged.measures[0].off, rel=1e-8)
    html = page.read_text()
    pictures = re.findall(r"<svg.*?</svg>", html, re.DOTALL)
    assert len(pictures) == len(found.rows) and not re.search(r"<(img|script|link)|url\(", html)
    for picture in pictures:
        assert ElementTree.fromstring(picture).tag.endswith("svg")
    assert "no touch screen" in html and "no touch screen" in report.text(found)
    assert json.loads(json.dumps(report.as_dict(found)))["rows"][0]["device"] == found.rows[0].device


def test_what_is_told_of_a_touch_is_told_once_and_in_a_line(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "DEPTH", 3.5e-3)
    deep = touch()
    deep = replace(deep, fingers=(replace(deep.fingers[0], name="In\rd\nex, left"),))
    found = drain(device_comparison.compare_devices(deep, Library(), cache=cache))
    assert [f.code for f in found.findings].count("too-deep") == 1
    head = report.csv(found).splitlines()
    assert [line[:6] for line in head if not line.startswith("#")][0] == "device"
    assert sum("sinks too deep" in line for line in head) == 1


def test_devices_are_compared_by_the_law_of_the_tissue(cache: Cache, tmp_path: Path) -> None:
    """Tissue that stiffens, of any Poisson's ratio: felt so, matched so and judged so, and nothing is to be told."""
    few = ("haptip", "pin_array_128", "thimble_3rrs")  # tables of six legs and platforms take minutes
    for group in ("materials", "skins"):
        (tmp_path / group).symlink_to(BUILT_IN / group)
    (tmp_path / "devices").mkdir()
    for key in few:
        (tmp_path / "devices" / f"{key}.json").symlink_to(BUILT_IN / "devices" / f"{key}.json")
    scene, found, library = touch(), [], Library(built_in=tmp_path)
    for tissue in ("linear", "neo_hookean"):
        own = {**SKIN, "tissue": tissue, "skin": {"poisson": 0.45}}
        worn = replace(scene, fingers=(replace(scene.fingers[0], parameters=own),))
        found.append(drain(device_comparison.compare_devices(worn, library, "Index", cache=cache)))
    linear, law = found
    assert not [f for f in law.findings if f.code in ("matched-linear", "law-unsettled")]
    rows = {row.device: row for row in law.rows if row.judged is not None}
    assert rows.keys() == set(few)
    for row in linear.rows:
        if row.judged is not None and row.device in ("pin_array_128", "thimble_3rrs"):
            other = rows[row.device].judged
            assert other is not None and other.measures[0].name == "stress"
            assert other.measures[0].off != row.judged.measures[0].off and 0.0 < other.measures[0].off < 2.0
