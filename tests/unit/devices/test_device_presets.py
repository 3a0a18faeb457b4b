"""Device presets that somebody edited: what cannot be rendered is listed as broken, and breaks nothing else."""

from __future__ import annotations

import copy
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.kinds import KINDS
from core.devices.mechanism import mechanism_of
from core.devices.spec import DeviceSpec
from core.errors import DermisError
from core.pipeline import render
from core.presets import Library, check
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene, sample_frames
from core.shipped import BUILT_IN
from core.units import UNITS

PRESETS = {p["kind"]: p for p in (json.loads(f.read_text("utf-8")) for f in (BUILT_IN / "devices").glob("*.json"))}


def mm(value: Any) -> dict[str, Any]:
    return {"value": value, "unit": "mm"}


def changed(kind: str, name: str, value: Any) -> dict[str, Any]:
    """Return the built-in preset of a kind with one parameter set, or without it where the value is None."""
    preset = copy.deepcopy(PRESETS[kind])
    preset["parameters"].pop(name, None)
    if value is not None:
        preset["parameters"][name] = value
    return preset


def put(folder: Path, key: str, preset: dict[str, Any]) -> None:
    (folder / "devices").mkdir(parents=True, exist_ok=True)
    (folder / "devices" / f"{key}.json").write_text(json.dumps(preset), encoding="utf-8")


BAD = [
    (
        "shear_tactor",
        "link_length",
        "5 mm",
        r"link_length: a value of the wrong kind .*found '5 mm'; allowed: one number in m\)",
    ),
    ("shear_tactor", "link_length", mm([1, 2]), r"link_length: a value of the wrong kind .*allowed: one number in m\)"),
    ("shear_tactor", "link_length", {"value": 5, "unit": "N"}, r"unit of the wrong kind .*'N'; .* converts to m\)"),
    ("shear_tactor", "link_length", 0.005, r"unit of the wrong kind \(found '1'"),
    ("shear_tactor", "link_length", None, "'link_length' is missing"),
    ("shear_tactor", "link_length", True, "a value of the wrong kind"),
    ("shear_tactor", "link_length", mm(1e300), "'link_length' is too large"),
    ("shear_tactor", "range", mm(4), "cannot reach the whole workspace"),
    ("shear_tactor", "tap_axis", "x", r"tap_axis: a value of the wrong kind .*allowed: a list of 2 numbers\)"),
    ("shear_tactor", "tap_axis", [0, 1, 0], "tap_axis: a value of the wrong kind"),
    ("shear_tactor", "tap_axis", [0, 0], "a direction in the pad's plane"),
    ("shear_tactor", "lnik", mm(5), r"unknown parameter \(found 'lnik'; allowed: .*link_length"),
    ("friction_screen", "law_slope", "steep", "law_slope: a value of the wrong kind"),
    ("friction_screen", "law_slope", "1.24", "law_slope: a value of the wrong kind"),
    ("friction_screen", "law_slope", -1, r"'law_slope' must be above zero \(found -1"),
    ("friction_screen", "law_slope", 1e-300, "the friction law gives no voltage"),
    ("friction_screen", "law_base", [10, 2], "law_base: a value of the wrong kind"),
    ("friction_screen", "law_base", 1, r"'law_base' must be above 1 \(found 1"),
    ("friction_screen", "carrier_low", {"value": 60, "unit": "V"}, "unit of the wrong kind"),
    ("friction_screen", "span_factor", 0.5, "'span_factor' is too small"),
    ("pin_array", "rows", 7.5, "'rows' must be a whole number"),
    ("pin_array", "rows", "8", "rows: a value of the wrong kind"),
    ("pin_array", "rows", 1e6, "the number of channels differs"),
    ("pin_array", "pitch", {"value": 1.5, "unit": "deg"}, "unit of the wrong kind"),
    ("pin_array", "spread", None, "'spread' is missing"),
    ("pin_array", "delay", {"value": -1, "unit": "s"}, "'delay' is too small"),
    ("pin_array", "pin_radius", mm(2), "pins overlap"),
    ("thimble", "rod", [10], "rod: a value of the wrong kind"),
    ("thimble", "rod", mm(5), "the links cannot close"),
    ("thimble", "servo_speed", {"value": 10, "unit": "rad"}, "unit of the wrong kind"),
    ("thimble", "knee", "sideways", "unknown knee .*allowed: outwards, inwards"),
    ("thimble", "mount_position", mm([1, 2]), r"a list of 3 numbers in m\)"),
    ("thimble", "pulse_neutral", "1500", "pulse_neutral: a value of the wrong kind"),
    ("cable_platform", "joint_angles", {"value": [0, 1, 2], "unit": "deg"}, "'joint_angles' must surround the middle"),
    ("cable_platform", "joint_angles", {"value": [0, "a", 2], "unit": "deg"}, "not a finite number"),
    ("cable_platform", "cable_stiffness", {"value": 50, "unit": "N"}, "unit of the wrong kind"),
    ("cable_platform", "sweep_press", None, "'sweep_press' is missing"),
    ("cable_platform", "sweep_levels", 5.5, "'sweep_levels' must be a whole number"),
    ("cable_platform", "coupling", [[1, 2], [3]], r"coupling: a value of the wrong kind .*rows of numbers"),
    ("cable_platform", "coupling", [[1], [1], [1]], "the coupling does not fit the motors"),
    ("hexapod", "base_angles", {"value": [0, 60], "unit": "deg"}, "a list of 6 numbers in rad"),
    ("hexapod", "base_radius", mm(0), "'base_radius' must be above zero"),
    ("hexapod", "sweep_shift", mm([1, 1]), "sweep_shift: a value of the wrong kind"),
    ("hexapod", "friction", "wet", "friction: a value of the wrong kind"),
]


@pytest.mark.parametrize(("kind", "name", "value", "reason"), BAD, ids=[f"{b[0]}-{b[1]}-{b[2]}" for b in BAD])
def test_a_malformed_parameter_is_listed_with_its_reason(
    tmp_path: Path, kind: str, name: str, value: Any, reason: str
) -> None:
    put(tmp_path, "bad", changed(kind, name, value))
    put(tmp_path, "good", PRESETS[kind])
    library = Library(tmp_path)
    errors = {e.key: e.error for e in library.list("devices")}
    assert errors.pop("bad") is not None and set(errors.values()) == {None}
    with pytest.raises(DermisError, match=rf"(?s)the preset is broken: device preset 'bad'.*{reason}"):
        library.device("bad")
    assert library.device("good").kind == kind


@pytest.mark.parametrize(
    ("kind", "channels", "reason"),
    [
        ("shear_tactor", [{"name": "foo", "unit": "m"}], "no such channel of this kind"),
        ("shear_tactor", [{"name": "tactor_x", "unit": "N"}], r"'tactor_x': .*unit \(found 'N'; allowed: m\)"),
        ("friction_screen", [{"name": "amplitude", "unit": "V", "high": 300}], "no such channel"),
        ("friction_screen", [{"name": n, "unit": u} for n, u in (("amplitude", "V"), ("carrier", "Hz"))], "no voltage"),
        (
            "pin_array",
            [{"name": "pin_{}", "unit": "N", "repeat": 127}],
            r"the number of channels differs .*found 127; allowed: 128",
        ),
        ("cable_platform", [{"name": "m_{}", "unit": "rad", "low": 0, "high": 1, "repeat": 2}], "found 2; allowed: 3"),
        ("hexapod", [{"name": "leg_{}", "unit": "m", "low": 0, "repeat": 6}], "a motor needs a range"),
    ],
)
def test_channels_that_a_kind_cannot_fill(kind: str, channels: list[dict[str, Any]], reason: str) -> None:
    preset = {**copy.deepcopy(PRESETS[kind]), "channels": channels}
    preset["parameters"] = {k: v for k, v in preset["parameters"].items() if not k.startswith("range_disc")}
    with pytest.raises(DermisError, match=reason):
        check("devices", "bad", preset)


@pytest.mark.parametrize("kind", ["nonsense", "", None, 7, ["thimble"]])
def test_an_unknown_kind_is_broken(kind: Any) -> None:
    with pytest.raises(DermisError, match="unknown kind of device|'kind' is not a text"):
        check("devices", "bad", {**PRESETS["thimble"], "kind": kind})


def test_every_kind_has_its_table_its_renderer_and_known_units() -> None:
    assert set(KINDS) == set(PRESETS)
    si = {unit for unit, _ in UNITS.values()} | {"", "true or false", "a text", "a list of texts"}
    assert {p.unit for kind in KINDS.values() for p in kind.parameters.values()} <= si


@pytest.mark.parametrize(("field", "typo"), [("safe", "saef"), ("wire", "Wire")])
def test_a_field_that_nobody_reads_is_refused(field: str, typo: str) -> None:
    """Or a worn device with a mistyped 'safe' would be one that has none."""
    preset = copy.deepcopy(PRESETS["thimble"])
    preset[typo] = preset.pop(field, {})
    with pytest.raises(DermisError, match=rf"unknown field \(found '{typo}'; allowed: schema, name, .*safe"):
        check("devices", "bad", preset)


def test_a_channels_field_that_nobody_reads_is_refused() -> None:
    preset = copy.deepcopy(PRESETS["thimble"])
    preset["channels"][0]["slwe"] = preset["channels"][0].pop("slew")
    with pytest.raises(DermisError, match="channel 'servo_1': unknown field .found 'slwe'"):
        check("devices", "bad", preset)
    preset["channels"][0]["slew"] = preset["channels"][0].pop("slwe")
    preset["channels"][0]["description"] = "the one at the tip"
    check("devices", "good", {**preset, "description": "mine", "sources": ["a letter"], "display": {"colour": "red"}})


def test_what_is_stated_of_single_channels_is_known() -> None:
    preset = changed("thimble", "bandwidth.servo_1", {"value": 20, "unit": "Hz"})
    check("devices", "own", preset)
    preset["parameters"]["bandwidth.servo_9"] = {"value": 20, "unit": "Hz"}
    with pytest.raises(DermisError, match="unknown parameter .*bandwidth.servo_9"):
        check("devices", "own", preset)


def test_any_value_of_json_is_judged_and_never_breaks() -> None:
    """Every parameter of every kind, replaced in turn by every form that JSON has."""
    forms: list[Any] = [
        None,
        True,
        "",
        "x",
        [],
        ["x"],
        [[]],
        [[1]],
        {},
        -1,
        0,
        1e-300,
        1e8,
        10**400,
        [1e8, -1e8],
        mm(0),
        mm(-1),
        mm([]),
        mm([[1, 2], [3, 4]]),
        mm(1e11),
        mm("1"),
        {"value": 1},
        {"unit": "mm"},
    ]
    for kind, preset in PRESETS.items():
        for name in KINDS[kind].parameters:
            for form in forms:
                changed_one = copy.deepcopy(preset)
                changed_one["parameters"][name] = form
                try:
                    check("devices", "any", changed_one)
                except DermisError:
                    continue


def test_a_bake_loses_only_the_broken_device(tmp_path: Path) -> None:
    for number, (kind, name, value) in enumerate(
        [
            ("shear_tactor", "link_length", "5 mm"),
            ("shear_tactor", "tap_axis", "x"),
            ("friction_screen", "law_base", [1]),
        ]
    ):
        put(tmp_path, f"bad_{number}", changed(kind, name, value))
    frames, times = sample_frames(Fraction(24), (1, 3), 240.0)
    still = np.tile(np.eye(4), (2, len(times), 1, 1))
    plane = Mesh(np.array([[-1, -1, -1], [1, -1, -1], [0, 1, -1]], dtype=float), np.array([[0, 1, 2]], dtype=np.int32))
    bad = tuple(DeviceUse(f"bad_{n}") for n in range(3))
    fingers = (Finger("Thumb", bad), Finger("Index", (DeviceUse("haptip"),)))
    chunk = Chunk(frames, times, still, still[:1], still[:0])
    scene = TactileScene("Tap", Fraction(24), (1, 3), 240.0, fingers, (Body("Plane", plane),), (), (chunk,))
    bake = render.run(scene, Library(tmp_path))
    assert [(o.finger, o.device) for o in bake.outputs] == [("Index", "haptip")]
    lost = [f for f in bake.findings if f.code == "device-unavailable"]
    assert [f.severity for f in lost] == ["error"] * 3 and all("Thumb" in f.where for f in lost)
    assert all(f"bad_{n}.json: the preset is broken" in f.what for n, f in enumerate(lost))


@pytest.mark.parametrize("kind", KINDS)
def test_a_kinds_own_reading_refuses_what_a_file_may_hold(kind: str) -> None:
    """A device rebuilt from a track's header has not passed the table: its own reading must hold."""
    key = next(f.stem for f in (BUILT_IN / "devices").glob("*.json") if json.loads(f.read_text())["kind"] == kind)
    spec = Library().device(key)
    mechanism_of(spec)
    for name in KINDS[kind].parameters:
        if KINDS[kind].parameters[name].required and not name.startswith("sweep"):
            for value in ("x", ["x"], True, [], {}):
                worse = DeviceSpec(**{**spec.__dict__, "parameters": {**spec.parameters, name: value}})
                with pytest.raises(DermisError):
                    mechanism_of(worse)
