"""Whatever is wrong with a surrogate, a target or a mechanism: said in words, and the direct method goes on."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from core.contact.skin_touch import SkinTouch
from core.devices.spec import from_preset
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.matching.thimble import finish, match_sequence, match_touch, render
from core.matching.thimble_use import prepare
from core.presets import Library
from core.scene import DeviceUse, Finger, TactileScene
from core.skin.model import fingertip_skin
from core.surrogate import onnx
from core.surrogate.store import adapt, save
from tests import touches


@pytest.fixture(scope="module")
def skin():
    return fingertip_skin(level="draft")


@pytest.fixture(scope="module")
def spec():
    return Library().device("thimble_3rrs")


@pytest.fixture(scope="module")
def made(skin, spec):
    steps = adapt(mechanism(spec), skin, 0.6, trajectories=40, hidden=6, iterations=5)
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value


OPSET = onnx._field(8, onnx._field(1, b"") + onnx._varint(2, onnx.OPSET))
NEWER = onnx._field(8, onnx._field(1, b"") + onnx._varint(2, 99))


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        (".onnx", lambda d: d[: len(d) // 2], "not a whole ONNX file"),
        (".onnx", lambda d: b"MZ\x90 another program", "ONNX"),
        (".onnx", lambda d: d.replace(OPSET, NEWER), "operator set"),
        (".onnx", lambda d: d.replace(b"friction", b"memories"), "friction"),
        (".onnx", lambda d: d.replace(b"MatMul", b"MutMal"), "cannot run"),
        (".onnx", None, "no surrogate was adapted"),
        (".npz", lambda d: d[: len(d) // 3], "cannot be read"),
        (".npz", None, "no surrogate was adapted"),
    ],
)
@pytest.mark.parametrize("method", ["network", "ridge"])
def test_a_bad_file_is_a_finding_and_the_direct_method_does_the_work(
    tmp_path, skin, spec, made, file, change, words, method
):
    pytest.importorskip("onnxruntime")
    save(tmp_path / "mine", made)
    path = (tmp_path / "mine").with_suffix(file)
    if change is None:
        path.unlink()
    else:
        data = path.read_bytes()
        assert change(data) != data
        path.write_bytes(change(data))
    use = {"thimble_method": method, "thimble_surrogate": str(tmp_path / "mine.npz")}
    used = prepare(spec, skin, use, "finger 'i'")
    assert used.method == "stress" and used.learned is None
    (finding,) = used.findings
    assert finding.code == "surrogate" and finding.severity == "warning" and finding.where == "finger 'i'"
    assert "the direct method was used" in finding.what and words in str(finding)


def test_of_another_skin_friction_or_device(tmp_path, skin, spec, made):
    pytest.importorskip("onnxruntime")
    save(tmp_path / "mine", made)
    use = {"thimble_method": "ridge", "thimble_surrogate": str(tmp_path / "mine.npz")}
    assert prepare(spec, skin, use).method == "ridge"
    other = prepare(spec, fingertip_skin(level="standard"), use)
    assert other.method == "stress" and "another skin" in str(other.findings[0])
    for name, value, words in (("skin_friction", 0.3, "another friction"), ("rod", 21, "another device")):
        own = json.loads(json.dumps(dict(spec.source)))
        own["parameters"][name]["value"] = value
        changed = prepare(from_preset("mine", own), skin, use)
        assert changed.method == "stress" and words in str(changed.findings[0])
    # and what took its place works
    found = match_touch(prepare(spec, fingertip_skin(level="draft"), {**use, "thimble_surrogate": "/none"}),
                        touches.flat_press(12).forces(skin))  # fmt: skip
    assert np.median(found.mismatch[found.wanted]) < 0.3


def felt_of(skin, forces, rate=30.0):
    """Return what a skin felt, from forces."""
    n, zero = len(forces), np.zeros(len(forces))
    contact, times = np.flatnonzero(forces.any(axis=(1, 2))), np.arange(n) / rate
    return SkinTouch(skin, times, times * rate, contact, forces[contact].astype(np.float32), zero, zero, zero, zero,
                     zero.astype(np.int32), zero.astype(np.int32), (), {})  # fmt: skip


def test_without_contact_the_device_waits_level_and_that_is_counted(skin, spec):
    scene = TactileScene("s", Fraction(30), (0, 30), 30.0, (Finger("index"),), (), (), ())
    felt = felt_of(skin, np.zeros((31, skin.pad_count, 3)))
    out = render(None, scene, 0, DeviceUse("thimble_3rrs"), spec, felt)  # type: ignore[arg-type]
    assert out.findings == () and not out.signals["contact"].any() and not out.signals["mismatch"].any()
    assert np.ptp(out.track.values, axis=0).max() == 0.0 and out.skipped["thimble frames without touch"] == 101
    assert not out.signals["normal_force"].any()


def test_servo_limits_that_exclude_first_contact_lose_the_device_only(skin, spec):
    own = json.loads(json.dumps(dict(spec.source)))
    own["parameters"]["mount_position"] = {"value": [0, 0, 30], "unit": "mm", "source": "far"}
    with pytest.raises(DermisError, match="exclude first contact|no pose within the servo limits|exclude contact"):
        match_touch(prepare(from_preset("far", own), skin, {}), touches.flat_press(5).forces(skin))


def test_a_speed_limit_does_not_keep_the_device_in_a_poor_place(skin, spec):
    """An edge that turns: the better pose is farther than one frame, so several frames are spent on the way."""
    device, forces = mechanism(spec), touches.edge_press(120).forces(skin)
    off = {}
    for change in (None, np.radians(6.0)):
        found = finish(match_sequence(device, skin, forces, change=change))
        off[change] = np.median(found.mismatch[found.wanted])
        if change is not None:
            assert np.abs(np.diff(found.angles, axis=0)).max() <= change * (1 + 1e-9)
    assert off[np.radians(6.0)] < 1.25 * off[None] < 0.75
