"""Device presets become specs in SI; what cannot be a device is refused with its place."""

from __future__ import annotations

import copy
import hashlib
from typing import Any

import pytest

from core.devices.spec import Channel, DeviceSpec, from_preset, range_disc
from core.errors import DermisError

PRESET: dict[str, Any] = {
    "schema": "dermis-device 1",
    "name": "Tester",
    "kind": "shear_tactor",
    "rate": {"value": 1, "unit": "kHz"},
    "channels": [
        {
            "name": "x",
            "unit": "m",
            "low": {"value": -2, "unit": "mm"},
            "high": {"value": 2, "unit": "mm"},
            "slew": {"value": 150, "unit": "mm/s"},
            "rest": {"value": 1, "unit": "mm"},
            "actuator": "m1",
        },
        {"name": "y", "unit": "m", "low": -0.001},
    ],
    "parameters": {
        "link": {"value": 5, "unit": "mm"},
        "mode": "fast",
        "on": True,
        "names": ["a"],
        "list": {"value": [1, 2], "unit": "deg"},
    },
    "wire": {"bandwidth": {"value": 115.2, "unit": "kbit/s"}, "bits_per_sample": 8},
}


def changed(path: str, value: Any) -> dict[str, Any]:
    """Return the preset with one field set, or removed where value is KeyError."""
    preset = copy.deepcopy(PRESET)
    *parents, last = [int(p) if p.isdigit() else p for p in path.split("/")]
    place: Any = preset
    for p in parents:
        place = place[p]
    if value is KeyError:
        del place[last]
    else:
        place[last] = value
    return preset


def test_everything_is_read_in_si() -> None:
    spec = from_preset("tester", PRESET)
    assert (spec.key, spec.name, spec.kind, spec.rate) == ("tester", "Tester", "shear_tactor", 1000.0)
    assert spec.channels == (
        Channel("x", "m", -0.002, 0.002, 0.15, 0.001, "m1"),
        Channel("y", "m", -0.001, None, None, 0.0, ""),
    )
    degree = 3.141592653589793 / 180
    assert spec.parameters == {"link": 0.005, "mode": "fast", "on": True, "names": ["a"], "list": [degree, 2 * degree]}
    assert spec.link_budget == {"bandwidth": 115200.0, "bits_per_sample": 8.0}


def test_hash_is_the_presets_and_not_the_order_of_its_keys() -> None:
    turned = dict(reversed(PRESET.items()))
    assert from_preset("a", PRESET).hash == from_preset("b", turned).hash
    assert from_preset("a", changed("name", "Other")).hash != from_preset("a", PRESET).hash
    tiny = DeviceSpec("k", "n", "k", 1.0, (), source={"b": "é", "a": 1})
    assert tiny.hash == hashlib.sha256('{"a": 1, "b": "é"}'.encode()).hexdigest()[:16]
    assert DeviceSpec("k", "n", "k", 1.0, (), source={"a": 1}, stated_hash="feed").hash == "feed"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("schema", "dermis-device 2", r"preset 't': .*'dermis-device 2'; allowed: dermis-device 1\)"),
        ("name", KeyError, "'name' is missing"),
        ("channels", KeyError, "'channels' is missing"),
        ("channels", [], "'channels' must be a list of objects, at least one"),
        ("channels", {"x": 1}, "'channels' must be a list"),
        ("channels", ["x"], "'channels' must be a list"),
        ("rate", 0, r"rate: must be above zero \(found 0.0; allowed: > 0\)"),
        ("rate", {"value": [1, 2], "unit": "Hz"}, "needs one number, not a list"),
        (
            "rate",
            {"value": 10.1, "unit": "kHz"},
            r"rate: the rate is higher .* \(found 10100.0; allowed: <= 10000 Hz\)",
        ),
        ("rate", "fast", "rate: not a finite number"),
        ("channels/1/name", "x", r"two channels have one name \(found 'x, x'\)"),
        ("channels/1/name", "a,b", r"a character that is not allowed \(found 'a,b'; allowed: letters"),
        ("channels/1/name", 7, "a channel's 'name' is not a text"),
        ("channels/1/name", KeyError, "a channel has no 'name'"),
        ("channels/1/unit", "mm", r"channel 'y': a channel's unit must be SI \(found 'mm'; allowed: m,"),
        ("channels/0/low", {"value": 3, "unit": "mm"}, r"'x': low is above high \(found 0.003; allowed: <= 0.002"),
        ("channels/0/rest", 0.5, r"rest is outside the range \(found 0.5; allowed: -0.002 to 0.002\)"),
        ("channels/0/slwe", 0.1, r"channel 'x': unknown field \(found 'slwe'; allowed: name, unit, .*slew"),
        ("channels/0/slew", 0, r"channel 'x', slew: must be above zero"),
        ("channels/0/slew", {"value": 1, "unit": "mm"}, r"slew: a unit .* \(found 'mm'; .* converts to m/s\)"),
        ("channels/0/high", {"value": 1, "unit": "deg"}, r"high: a unit of the wrong kind \(found 'deg'"),
        ("parameters", [1], "'parameters' must be an object"),
        ("parameters/link", {"value": 1}, "link: a quantity needs 'value' and 'unit'"),
        ("wire", "serial", "'wire' must be an object"),
        ("wire/speed", 3, r"wire speed: unknown field \(allowed: bandwidth,"),
        ("wire/bandwidth", -1, r"must not be below zero \(found -1.0; allowed: >= 0\)"),
        ("wire/bits_per_sample", 0, "a bandwidth needs 'bits_per_sample' or 'bits_per_channel'"),
        ("parameters/range_disc", ["x"], r"must name two channels .* allowed: x, y"),
        ("parameters/range_disc", ["x", "z"], "must name two channels"),
        ("parameters/range_disc", ["x", "y"], "needs 'range_disc_radius', one number"),
    ],
)
def test_refusals(path: str, value: Any, message: str) -> None:
    with pytest.raises(DermisError, match=message):
        from_preset("t", changed(path, value))


def test_round_range() -> None:
    preset = changed("parameters/range_disc", ["y", "x"])
    preset["parameters"]["range_disc_radius"] = {"value": 2, "unit": "mm"}
    assert range_disc(from_preset("t", preset)) == (1, 0, 0.002)
    assert range_disc(from_preset("t", PRESET)) is None
    preset["channels"][1]["unit"], preset["channels"][1]["low"] = "N", None
    with pytest.raises(DermisError, match="different units"):
        from_preset("t", preset)


def test_channel_by_name() -> None:
    spec = from_preset("t", PRESET)
    assert spec.channel("y").low == -0.001
    with pytest.raises(DermisError, match=r"Tester: no such channel \(found 'z'; allowed: x, y\)"):
        spec.channel("z")


def repeated(**entry: Any) -> dict[str, Any]:
    """Return the preset with pins in place of its channels."""
    pin = {"name": "pin_{}", "repeat": 12, "unit": "N", "actuator": "pin_{}", "low": 0, "high": 0.4}
    return {**changed("channels", [{**pin, **entry}]), "parameters": {}}


def test_a_repeated_channel_is_spelled_out_with_padded_numbers() -> None:
    spec = from_preset("pins", repeated())
    assert [c.name for c in spec.channels] == [f"pin_{i:02d}" for i in range(1, 13)]
    assert spec.channels[11] == Channel("pin_12", "N", 0.0, 0.4, actuator="pin_12")
    alone = from_preset("pins", repeated(repeat=1))
    assert [c.name for c in alone.channels] == ["pin_1"]


def test_repeated_and_single_channels_stand_beside_each_other_in_order() -> None:
    preset = repeated(repeat=2)
    preset["channels"].insert(0, {"name": "valve", "unit": "Pa"})
    assert [c.name for c in from_preset("pins", preset).channels] == ["valve", "pin_1", "pin_2"]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"repeat": 0}, "repeat"),
        ({"repeat": 2.5}, "repeat"),
        ({"repeat": True}, "repeat"),
        ({"repeat": 10_000}, "4096"),
        ({"name": "pin"}, "needs {}"),
        ({"name": "pin_{}_{}"}, "needs {}"),
    ],
)
def test_repetitions_that_make_no_sense_are_refused(entry: dict[str, Any], words: str) -> None:
    with pytest.raises(DermisError, match=words):
        from_preset("pins", repeated(**entry))
