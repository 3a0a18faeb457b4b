"""Whatever is wrong with a surrogate, a target or a mechanism: said in words, and the direct method goes on."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from core.contact.skin_contact import PointRecord, SkinContact
from core.devices.disc_pose import FrictionState, placed
from core.devices.first_contact import first_contact
from core.devices.spec import from_preset
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.files import write_npz
from core.matching.replay import configurations
from core.matching.thimble import match_touch, render
from core.matching.thimble_use import prepare
from core.scene.tactile_scene import DeviceUse, Finger, TactileScene
from core.skin.model import fingertip_skin
from core.skin.surface_store import smooth_pad
from core.surrogate import onnx
from core.surrogate.network import Network
from core.surrogate.store import adapt, contact_of, save
from tests import touches
from tests.thimbles import match_sequence


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
        (".onnx", lambda d: d[: len(d) // 2], "the ONNX file is incomplete or damaged"),
        (".onnx", lambda d: b"MZ\x90 another program", "ONNX"),
        (".onnx", lambda d: d.replace(OPSET, NEWER), "operator set"),
        (".onnx", lambda d: d.replace(b"features", b"measures"), "features"),
        (".onnx", lambda d: d.replace(b"dermis-surrogate 2", b"dermis-surrogate 1"), "an older format"),
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


def rewritten(path, **changes):
    """Write a surrogate's tables again with some of them changed."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    write_npz(path, {**arrays, **{name: change(arrays[name]) for name, change in changes.items()}})


def nowhere(values):
    return values * np.nan


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("friction_basis", lambda a: a[:, :-3], "'friction_basis' has the wrong shape"),
        ("friction_basis", lambda a: a[:-1], "has the wrong shape"),
        ("trial_basis", lambda a: a[:, :-3], "'trial_basis' has the wrong shape"),
        ("friction_mean", lambda a: a[:-3], "'friction_mean' has the wrong shape"),
        ("ridge_constant", lambda a: a[:-1], "'ridge_constant' has the wrong shape"),
        ("ridge_linear", nowhere, "'ridge_linear' is not finite"),
        ("ridge_scale", lambda a: 0.0 * a, "'ridge_scale' has zeros"),
        ("readout", lambda a: a[:, :-3], "'readout' has the wrong shape"),
        ("readout", nowhere, "'readout' is not finite"),
        ("stress_basis", lambda a: a.astype("U8"), "not finite"),
        ("stress_basis", lambda a: a[0], "has the wrong shape"),
        (
            "meta",
            lambda a: np.frombuffer(a.tobytes().replace(b'"modulus"', b'"modulos"'), np.uint8),
            "no valid stiffness",
        ),
        (
            "meta",
            lambda a: np.frombuffer(a.tobytes().replace(b"surrogate 2", b"surrogate 1"), np.uint8),
            "an older format",
        ),
        ("meta", lambda a: np.frombuffer(b"[1, 2]", np.uint8), "cannot be read"),
    ],
)
@pytest.mark.parametrize("method", ["network", "ridge"])
def test_tables_that_do_not_fit_together_are_a_finding(tmp_path, skin, spec, made, name, change, words, method):
    pytest.importorskip("onnxruntime")
    save(tmp_path / "mine", made)
    rewritten(tmp_path / "mine.npz", **{name: change})
    used = prepare(spec, skin, {"thimble_method": method, "thimble_surrogate": str(tmp_path / "mine.npz")})
    assert used.method == "stress" and used.learned is None and used.observation_matrix is None
    (finding,) = used.findings
    assert finding.code == "surrogate" and words in str(finding)


@pytest.mark.parametrize(("more", "spoil", "words"), [(2, 1.0, "do not fit"), (0, np.nan, "output is not finite")])
def test_a_network_of_other_size_or_without_numbers_is_a_finding(tmp_path, skin, spec, made, more, spoil, words):
    """The metadata is right, and only what the file computes is not."""
    pytest.importorskip("onnxruntime")
    save(tmp_path / "mine", made)
    p, c, rng = made.network.inputs, made.network.outputs + more, np.random.default_rng(0)
    other = Network(
        np.zeros(p), np.ones(p), rng.normal(size=(8, p)), np.zeros(8), spoil * rng.normal(size=(c, 8)), np.zeros(c)
    )
    onnx.write(tmp_path / "mine.onnx", other, dict(made.meta))
    use = {"thimble_method": "network", "thimble_surrogate": str(tmp_path / "mine.npz")}
    used = prepare(spec, skin, use)
    assert used.method == "stress" and words in str(used.findings[0])
    forces = touches.flat_press(12).forces(skin)
    found = match_touch(used, forces)
    assert np.median(found.mismatch[found.touched]) < 0.3 and found.pressing.any() and not found.rescued.any()
    # the polynomial beside it is what it was, as long as the network is none of another size
    assert prepare(spec, skin, {**use, "thimble_method": "ridge"}).method == ("stress" if more else "ridge")


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_wrong_surrogate_says_in_how_many_frames_it_was_replaced(tmp_path, skin, spec, made):
    """A network of random numbers, in a file that is right in every other way."""
    pytest.importorskip("onnxruntime")
    save(tmp_path / "mine", made)
    p, c, rng = made.network.inputs, made.network.outputs, np.random.default_rng(0)
    other = Network(np.zeros(p), np.ones(p), rng.normal(size=(8, p)), np.zeros(8), rng.normal(size=(c, 8)), np.zeros(c))
    onnx.write(tmp_path / "mine.onnx", other, dict(made.meta))
    scene = TactileScene("s", Fraction(30), (0, 30), 30.0, (Finger("index"),), (), (), ())
    felt = felt_of(skin, touches.flat_press(31).forces(skin))
    use = {"thimble_surrogate": str(tmp_path / "mine.npz")}
    out = render(None, scene, 0, DeviceUse("thimble_3rrs", {**use, "thimble_method": "network"}), spec, felt)  # type: ignore[arg-type]
    replaced, touched = int(out.signals["rescued"].sum()), int(out.signals["contact"].sum())
    (finding,) = [f for f in out.findings if f.code == "rescued"]
    assert out.track.meta["method"] == "network"
    assert finding.severity == "warning" and finding.count == replaced > 0.3 * touched
    assert f"{replaced} of {touched} touched samples" in finding.what
    assert set(np.unique(out.signals["rescued"])) <= {0.0, 1.0}
    assert not (out.signals["rescued"] * (1 - out.signals["contact"])).any()
    direct = render(None, scene, 0, DeviceUse("thimble_3rrs", use), spec, felt)  # type: ignore[arg-type]
    assert "rescued" not in direct.signals and not [f for f in direct.findings if f.code == "rescued"]


def test_a_touch_too_steep_for_the_mechanism_ends_before_it_gives_way(skin, spec):
    """What the disc itself would press at poses beyond the singular ones, were they held: the track's angles still
    hold the poses that stand beside them, and it is said how often a better match lay beyond."""
    device, contact = mechanism(spec), contact_of(mechanism(spec), skin, 0.6)
    forces = []
    for share in np.linspace(0.0, 1.0, 31):
        pitch, roll = 0.0, np.radians(41.0) * share
        x = np.array([pitch, roll, first_contact(device, contact, pitch, roll) - 1.2e-3 * min(4 * share, 1.0)])
        contact.hold(FrictionState.rest(contact.count))
        forces.append(contact.nodal(contact.solve(placed(device, device.pose(x)))))
    assert np.linalg.det(device.servo_angles(x)[1]) < 0  # the last is beyond
    assert np.abs(device.servo_angles(x)[0] - device.servo_zero).max() < device.servo_range
    scene = TactileScene("s", Fraction(30), (0, 30), 30.0, (Finger("index"),), (), (), ())
    out = render(None, scene, 0, DeviceUse("thimble_3rrs"), spec, felt_of(skin, np.array(forces)))  # type: ignore[arg-type]
    told = np.stack([out.track.column(n) for n in ("pitch", "roll", "distance")], axis=1)
    np.testing.assert_allclose(configurations(out.track, device), told, atol=1e-9)
    steepest = np.degrees(np.hypot(told[:, 0], told[:, 1])).max()
    assert 20.0 < steepest < 41.0 and all(device.constraints(x, *device.servo_limits).min() >= -1e-9 for x in told)
    (finding,) = [f for f in out.findings if f.code == "singular-pose"]
    assert 2 <= finding.count <= int(out.signals["contact"].sum()) and "yields" in finding.what
    # where nothing is steep nothing is said
    level = render(None, scene, 0, DeviceUse("thimble_3rrs"), spec, felt_of(skin, np.array(forces[:8] * 4)[:31]))  # type: ignore[arg-type]
    assert not [f for f in level.findings if f.code == "singular-pose"]


def narrowed(spec, **changes):
    """Return a preset whose servo channels say something of their own."""
    own = json.loads(json.dumps(dict(spec.source)))
    del own["safe"]  # it lies outside of narrower limits
    for channel in own["channels"][:3]:
        channel.update({n: {"value": v, "unit": "deg/s" if n == "slew" else "deg"} for n, v in changes.items()})
    return from_preset("narrow", own)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_a_channels_narrower_limits_are_the_servos(skin, spec):
    """The pose in the track is the one that the angles in the track hold, whichever of both limits is the tighter."""
    scene = TactileScene("s", Fraction(30), (0, 30), 30.0, (Finger("index"),), (), (), ())
    felt = felt_of(skin, touches.edge_press(31).forces(skin))
    for changes in ({"low": -12.0, "high": 15.0}, {"slew": 90.0}, {"low": -60.0, "high": 70.0, "slew": 9000.0}):
        own = narrowed(spec, **changes)
        device = mechanism(own)
        assert device.servo_speed == pytest.approx(np.radians(min(changes.get("slew", 600.0), 600.0)))
        low, high = np.degrees(device.servo_limits)
        np.testing.assert_allclose(
            [low, high], [[max(changes.get("low", -40.0), -40.0)] * 3, [min(changes.get("high", 40.0), 40.0)] * 3]
        )
        track = render(None, scene, 0, DeviceUse("narrow"), own, felt).track  # type: ignore[arg-type]
        assert not track.check() and not any(track.within_limits().limited.values())  # nothing is left to cut off
        told = np.stack([track.column(n) for n in ("pitch", "roll", "distance")], axis=1)
        np.testing.assert_allclose(configurations(track, device), told, atol=1e-8)
        assert np.abs(np.degrees(track.column("pitch"))).max() > 3.0


def test_a_channel_without_any_range_is_refused(spec):
    with pytest.raises(DermisError, match="servo_1: the channel leaves its servo no range.*50 to 40 deg"):
        mechanism(narrowed(spec, low=50.0, high=60.0, rest=55.0))


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
    found = match_touch(
        prepare(spec, fingertip_skin(level="draft"), {**use, "thimble_surrogate": "/none"}),
        touches.flat_press(12).forces(skin),
    )
    assert np.median(found.mismatch[found.touched]) < 0.3


def felt_of(skin, forces, rate=30.0):
    """Return what a skin felt, from forces that were solved on points."""
    n, zero = len(forces), np.zeros(len(forces))
    contact, times = np.flatnonzero(forces.any(axis=(1, 2))), np.arange(n) / rate
    return SkinContact(
        skin,
        times,
        times * rate,
        contact,
        forces[contact].astype(np.float32),
        zero,
        zero,
        zero,
        zero,
        zero.astype(np.int32),
        zero.astype(np.int32),
        (),
        {},
        points=PointRecord(
            smooth_pad(skin), np.zeros(len(contact) + 1, np.intp), np.zeros(0, np.int32), np.zeros((0, 3), np.float32)
        ),
    )


def test_without_contact_the_device_waits_level_and_that_is_counted(skin, spec):
    scene = TactileScene("s", Fraction(30), (0, 30), 30.0, (Finger("index"),), (), (), ())
    felt = felt_of(skin, np.zeros((31, skin.pad_count, 3)))
    out = render(None, scene, 0, DeviceUse("thimble_3rrs"), spec, felt)  # type: ignore[arg-type]
    assert out.findings == () and not out.signals["contact"].any() and not out.signals["mismatch"].any()
    assert np.ptp(out.track.values, axis=0).max() == 0.0 and out.skipped["thimble_frames_without_contact"] == 101
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
        found = match_sequence(device, skin, forces, change=change)
        off[change] = np.median(found.mismatch[found.touched])
        if change is not None:
            assert np.abs(np.diff(found.angles, axis=0)).max() <= change * (1 + 1e-9)
    assert off[np.radians(6.0)] < 1.25 * off[None] < 0.9


def test_a_safe_pose_that_is_not_clear_of_this_finger_is_found(skin, spec):
    """The disc is first felt far from the base: a finger so thick that the retracted disc nearly touches it."""
    for degrees, found in ((0.0, ()), (21.0, ()), (25.0, ("safe-pose-near",)), (32.0, ("safe-pose-near",))):
        felt = {f"thimble_felt_{i}": np.radians(degrees) for i in (1, 2, 3)}
        use = prepare(spec, skin, {"thimble_calibrated": True, **felt})
        assert tuple(f.code for f in use.findings) == found
    assert str(use.findings[0].value) in ("0.0 mm", "-0.0 mm")
