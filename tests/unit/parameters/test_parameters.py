"""The table of parameters: complete, consistent, held by what is made from it, and clear where a value is refused."""

from __future__ import annotations

import math
from dataclasses import fields
from fractions import Fraction
from typing import Any, get_args

import numpy as np
import pytest

from core.command_line.verbs import parser
from core.devices.kinds import KINDS
from core.effects.weight import SIGNS
from core.errors import DermisError
from core.matching.deformation import METHODS
from core.matching.pins import Weighting
from core.parameters.device import DEVICE
from core.parameters.finger import FINGER
from core.parameters.material import BODY, MATERIAL
from core.parameters.parameter import Parameter
from core.parameters.skin import LENGTHS, SKIN, SKIN_CONTACT, TISSUE
from core.parameters.stream import STREAM
from core.presets import check
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
from core.skin.fingertip import LEVELS
from core.skin.shape import FingertipShape
from core.stream.protocols.adapters import NAMES, OTHER
from core.stream.request import StreamRequest
from core.stream.virtual.device import DEVICES
from core.units import UNITS
from tests import parameters_page as page

ROWS = [(title, row) for title, _, _, rows in page.GROUPS for row in rows.values()]
SI = {unit for unit, _ in UNITS.values()}


@pytest.mark.parametrize(("title", "row"), ROWS, ids=[f"{title}-{row.name}" for title, row in ROWS])
def test_every_row_is_whole(title: str, row: Parameter) -> None:
    assert row.text and row.source
    if row.numeric:
        assert row.unit in SI and UNITS[row.window_unit][0] == row.unit
    for value in (row.default, row.absent):
        if value is not None:
            row.check(value, title)
    if row.absent != row.default:
        assert row.note, "where the engine and the window begin differently, the row says why"
    for soft in row.soft:
        assert soft is None or row.low <= soft <= row.high
    assert row.saved == row.name or row.saved.startswith(row.name) or row.name.endswith(row.saved) or row.file


def test_names_of_properties_are_their_own() -> None:
    for title, _, path, _ in page.GROUPS:
        saved = [r.saved for t, _, p, rows in page.GROUPS if p == path for r in rows.values() if r.label]
        assert len(saved) == len(set(saved)), title


def test_choices_are_those_that_the_engine_has() -> None:
    assert set(DEVICE["pin_method"].keys) == set(METHODS)
    assert set(DEVICE["pin_nodes"].keys) == set(get_args(Weighting))
    assert set(DEVICE["weight_sign"].keys) == set(SIGNS)
    assert set(SKIN_CONTACT["skin_level"].keys) == set(LEVELS)
    assert set(STREAM["protocol"].keys) - {OTHER} == set(NAMES) == set(DEVICES)
    assert tuple(LENGTHS) == tuple(field.name for field in fields(FingertipShape))


def test_a_stream_begins_as_its_rows_say_and_keeps_to_their_ranges() -> None:
    assert {name: getattr(StreamRequest(), name) for name in STREAM} == {n: row.absent for n, row in STREAM.items()}
    StreamRequest(**{name: row.default for name, row in STREAM.items()}).check()
    for name, row in STREAM.items():
        beyond = [row.low - 1, row.high + 1, math.nan, True] if row.numeric else ["waltz"]
        for value in beyond:
            with pytest.raises(DermisError, match=name.replace("_", "[_ ]")) as error:
                StreamRequest(**{name: value}).check()
            assert error.value.limit


@pytest.mark.parametrize("name", ["rate", "look_ahead", "ramp"])
def test_the_command_line_takes_a_number_of_a_stream_from_its_row(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    row, words = STREAM[name], ["stream", "play", "a.csv", "--url", "virtual:"]
    option = f"--{name.replace('_', '-')}"
    assert getattr(parser("core").parse_args(words), name) == row.default
    for value in (row.low, row.high):
        assert getattr(parser("core").parse_args([*words, f"{option}={value}"]), name) == value
    with pytest.raises(SystemExit):
        parser("core").parse_args([*words, f"{option}={row.high + 1}"])
    assert f"{option}: {row.high + 1} is not allowed: {row.allowed}" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        parser("core").parse_args(["stream", "play", "--help"])
    assert row.text[1:] in " ".join(capsys.readouterr().out.split())


def test_every_setting_of_a_device_is_read_by_some_kind() -> None:
    assert {name for kind in KINDS.values() for name in kind.settings} == set(DEVICE)


REFUSED: list[tuple[Parameter, Any, str]] = [
    (FINGER["touch_distance"], -1e-3, r"F: 'touch_distance' is too small \(found '-1 mm'; allowed: 0 to 1000 mm\)"),
    (FINGER["touch_distance"], 2.0, r"is too large \(found '2000 mm'; allowed: 0 to 1000 mm\)"),
    (
        FINGER["touch_distance"],
        "1",
        r"F, touch_distance: a value of the wrong kind \(found '1'; allowed: one number in m\)",
    ),
    (FINGER["touch_distance"], math.nan, r"'touch_distance' must be a finite number .*0 to 1000 mm"),
    (FINGER["pattern"], "waltz", r"F, pattern: unknown pattern \(found 'waltz'; allowed: none, orientation, "),
    (FINGER["pattern_play"], "on", r"a value of the wrong kind \(found 'on'; allowed: true or false\)"),
    (FINGER["pattern_play"], 2, "a value of the wrong kind"),
    (TISSUE["young"], 1e10, r"'young' is too large \(found '1e\+07 kPa'; allowed: <= 1e\+06 kPa\)"),
    (TISSUE["young"], 0.0, r"'young' is too small \(found '0 kPa'; allowed: >= 0.001 kPa\)"),
    (DEVICE["table_rows"], 100.5, r"'table_rows' must be a whole number \(found 100.5; allowed: 8 to 2e\+06\)"),
    (DEVICE["carrier"], True, "a value of the wrong kind"),
]


@pytest.mark.parametrize(("row", "value", "words"), REFUSED, ids=[f"{r.name}-{v}" for r, v, _ in REFUSED])
def test_what_is_refused_is_said_with_unit_and_range(row: Parameter, value: Any, words: str) -> None:
    with pytest.raises(DermisError, match=words):
        row.of({row.name: value}, "F")


def test_what_nobody_says_is_what_the_row_says() -> None:
    assert BODY["mass"].of({}) == 1.0 and BODY["mass"].of({"mass": 0.2}) == 0.2
    assert DEVICE["carrier"].of({}) is None
    assert MATERIAL["friction"].of({}) == 0.6


def scene(finger: dict[str, Any], body: dict[str, Any]) -> TactileScene:
    plane = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], dtype=float), np.array([[0, 1, 2]], dtype=np.int32))
    chunks: tuple[Chunk, ...] = ()
    fingers, bodies = (Finger("Index", (), finger),), (Body("Plate", plane, body),)
    return TactileScene("S", Fraction(24), (1, 3), 240.0, fingers, bodies, (), chunks)


def test_a_scene_is_held_to_the_same_ranges() -> None:
    scene({"touch_distance": 1e-3, "of_a_script": 7}, {"friction": 0.4, "texture_on": 1.0}).validate()
    with pytest.raises(DermisError, match=r"object 'Plate': 'friction' is too small \(found -0.1; allowed: 0 to 10\)"):
        scene({}, {"friction": -0.1}).validate()
    with pytest.raises(DermisError, match=r"finger 'Index', pattern: unknown pattern"):
        scene({"pattern": "waltz"}, {}).validate()


@pytest.mark.parametrize(
    ("group", "parameters", "words"),
    [
        ("materials", {"friction": 11}, r"'friction' is too large \(found 11.0; allowed: 0 to 10\)"),
        ("materials", {"texture_period_x": {"value": 0, "unit": "mm"}}, r"found '0 mm'; allowed: 0.001 to 1e\+06 mm"),
        ("skins", {"width": {"value": 3, "unit": "m"}}, r"'width' is too large .*'3000 mm'; allowed: 0.05 to 2000 mm"),
        ("skins", {"colour": "pink"}, "unknown parameter .*'colour'; allowed: width, thickness"),
        ("skins", {"young": {"value": 1, "unit": "mm"}}, "a unit of the wrong kind .*converts to Pa"),
    ],
)
def test_presets_are_held_to_the_same_ranges(group: str, parameters: dict[str, Any], words: str) -> None:
    schema = {"materials": "dermis-material 1", "skins": "dermis-skin 1"}[group]
    with pytest.raises(DermisError, match=words):
        check(group, "own", {"schema": schema, "name": "Own", "parameters": parameters})


def test_skin_presets_may_hold_what_a_skin_has() -> None:
    assert {"mesh", "width", "alpha"} <= set(SKIN)


def test_the_page_is_current() -> None:
    assert page.PAGE.read_text(encoding="utf-8") == page.page(), "run python3 build_addon.py docs"
