"""Tables, skins, recordings and couplings that do not belong together are refused or told, never taken as they are."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from core.design import task
from core.design.answer import design
from core.design.collect import collect
from core.design.coupled_preset import preset
from core.design.interactions import interaction
from core.design.recorded_table import read_table
from core.design.recordings import Recording
from core.design.report import as_text
from core.design.synergies import reduce
from core.devices.coupling import coupling_of
from core.devices.spec import from_preset
from core.errors import DermisError
from core.matching.readings import readings_of
from core.matching.table import SkinTable, belongs, build
from core.presets import Library
from core.scene import scene_file
from core.skin.model import fingertip_skin
from core.skin.shape import FingertipShape
from tests.unit.command_line.test_design import run

CHANNELS = tuple(f"e{i + 1}" for i in range(19)) + ("pressure",)


@pytest.fixture(scope="module")
def spec():
    return Library().device("cable_platform")


@pytest.fixture(scope="module")
def table(spec, skin):
    return build(spec, skin, readings_of(skin), 512)


def drain(steps):
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value


def test_a_table_knows_its_device_and_skin(spec, skin, table, tmp_path):
    table.save(tmp_path / "t.npz")
    read = SkinTable.load(tmp_path / "t.npz")
    assert belongs(read, spec, skin) == ()
    # neither the name, nor the rule, nor how far it was swept says what a row means
    swept = {**spec.parameters, "knee_error": 0.2, "sweep_press": [0.0, 1e-3]}
    assert belongs(read, replace(spec, key="mine", parameters=swept), skin) == ()
    smaller = replace(spec, parameters={**spec.parameters, "pulley_radius": 4e-3})
    with pytest.raises(DermisError, match=r"of another device, or of one with other dimensions .*cable_platform"):
        belongs(read, smaller)
    for other in (skin.with_material(young=5e4), fingertip_skin(replace(FingertipShape(), width=0.021), level="draft")):
        (found,) = belongs(read, spec, other)
        assert found.code == "other-skin" and found.severity == "warning"


def test_a_recorded_table_is_told_from_one_to_render_with(tmp_path):
    (tmp_path / "t.csv").write_text("m1\n1\n")
    with pytest.raises(DermisError, match="--save-table"):
        SkinTable.load(tmp_path / "t.csv")


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_a_scene_is_felt_by_its_fingers_own_skin(skin, tmp_path):
    scene = interaction("flat", skin.positions, seed=0, repetitions=1)
    soft = {**Library().skin("index_medium"), "young": 5e4}
    for name, parameters in (("plain", {}), ("soft", {"skin": soft})):
        finger = replace(scene.fingers[0], parameters={**scene.fingers[0].parameters, **parameters})
        scene_file.save(replace(scene, fingers=(finger,)), tmp_path / f"{name}.npz")
    said = {}
    for name in ("plain", "soft"):
        made = run(tmp_path / f"{name}.npz", "--rows", 512, "--json", "--quiet", cwd=tmp_path)
        assert made.returncode == 0, made.stderr
        said[name] = json.loads(made.stdout)["joint"]["error"]
    assert said["plain"] != said["soft"]
    for arguments in (
        (tmp_path / "plain.npz", tmp_path / "soft.npz", "--skin", "index_medium"),
        (tmp_path / "soft.npz", "--skin", "index_small"),
    ):
        made = run(*arguments, "--quiet", cwd=tmp_path)
        assert made.returncode == 2 and "another skin" in made.stderr, made.stderr


def test_a_scene_that_fills_the_sensors_scale_is_refused_as_a_recording_is(spec, table):
    values = np.tile(np.rint(table.exact_readings[5]), (100, 1))
    values[:6, 3] = 4095
    with pytest.raises(DermisError, match=r"channel 4: .*saturated .*6 % of the time.*allowed: 5 %"):
        design(spec, table, {"deep": values})


def test_a_recordings_channels_are_the_recorded_tables_by_name_and_order(spec, table, tmp_path):
    values = np.column_stack([table.commands, table.readings])
    lines = [",".join(("m1", "m2", "m3", *CHANNELS)), *(",".join(f"{v:.9g}" for v in row) for row in values)]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    recorded = task.load_table(spec, tmp_path / "t.csv")
    readings = table.exact_readings[5:60]
    times = np.arange(len(readings)) / 100.0
    drain(task.answer(spec, recorded, {"a": Recording("a", times, readings, CHANNELS)}))
    swapped = (CHANNELS[1], CHANNELS[0], *CHANNELS[2:])
    with pytest.raises(DermisError, match=r"channel 1: .*another order .*found 'e2'; allowed: 'e1'"):
        drain(task.answer(spec, recorded, {"a": Recording("a", times, readings, swapped)}))
    with pytest.raises(DermisError, match=r"channel 20: .*not one of the table's .*temperature"):
        drain(task.answer(spec, recorded, {"a": Recording("a", times, readings, (*CHANNELS[:19], "temperature"))}))


def test_recorded_commands_in_other_units_are_refused(table, tmp_path):
    values = np.column_stack([np.degrees(table.commands), table.readings])
    lines = [",".join(("m1", "m2", "m3", *CHANNELS)), *(",".join(f"{v:.9g}" for v in row) for row in values)]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    ends = np.array([[0.0] * 3, [2.8] * 3])
    with pytest.raises(DermisError, match=r"m1: .*beyond the motor's range .*Write rad and m, or the unit"):
        read_table(tmp_path / "t.csv", np.ptp(ends, axis=0), ends)


def test_a_touch_that_all_motors_leave_is_doubted(spec, table):
    """Every channel 900 counts from what the table can make."""
    rng = np.random.default_rng(0)
    odd = table.exact_readings[5:60] + 900.0 * np.where(np.arange(20) % 2, 1, -1) + rng.normal(0, 2, (55, 20))
    found = design(spec, table, {"odd": np.clip(odd, 1, 4094)})
    assert [f.code for f in found.findings] == ["poorly-rendered"] and "poorly-rendered" not in as_text(found)
    assert "all motors together render this touch poorly" in as_text(found)
    assert design(spec, table, {"own": table.exact_readings[100:400] + rng.normal(0, 2, (300, 20))}).findings == ()


def test_a_touch_that_is_met_exactly_has_finite_percentages(spec, table):
    sensed = table.exact_readings[np.linspace(1, len(table.exact_readings) - 1, 60).astype(int)]
    reduction = reduce(table, [sensed], 0.1)
    assert reduction.error[0, -1] == 0.0
    whole_counts = np.sqrt(20 / 12)  # what reading in whole counts leaves
    np.testing.assert_allclose(reduction.percent("paper")[0], 100.0 * reduction.error[0] / whole_counts)
    assert design(spec, table, {"exact": sensed}).joint.motors("paper") > 1


def test_no_original_motor_goes_faster_than_it_could(spec, table):
    """All new motors at their limit at once, in every combination of directions."""
    rng = np.random.default_rng(3)
    found = design(spec, table, {"a": table.exact_readings[1:200] + rng.normal(0, 2, (199, 20))})
    for count in (1, 2, 3):
        made = from_preset("new", preset(found, motors=count))
        slews = np.array([c.slew for c in made.channels])
        fastest = np.abs(coupling_of(made).matrix) @ slews
        own = np.array([c.slew for c in spec.channels])
        assert (fastest <= own * (1 + 1e-9)).all() and (fastest / own).max() == pytest.approx(1.0)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_coupling_beyond_the_original_range_is_found(spec, skin, table, short_touches):
    from core.design.trial import felt
    from core.matching.lookup import render
    from core.scene.tactile_scene import DeviceUse

    tight = {
        "coupling": [[3.0], [3.0], [-1.0]],
        "coupling_offset": [0.0, 0.0, 0.1],
        "coupling_low": [0.0] * 3,
        "coupling_high": [c.high for c in spec.channels],
        "coupling_unit": "rad",
    }
    one = replace(
        spec,
        key="one",
        channels=(replace(spec.channels[0], unit="1", low=0.0, high=1.0, slew=None),),
        parameters={**spec.parameters, **tight},
    )
    touch = felt(skin, "flat", 0)
    scene = interaction("flat", skin.positions, seed=0, repetitions=1)
    found = render(None, scene, 0, DeviceUse("one", {"table_rows": 512}), one, touch)
    original = coupling_of(one).original(found.track.values)
    codes = {f.code: f for f in found.findings}
    assert original.min() < -0.2 and "original-range" in codes
    assert codes["original-range"].limit.startswith("0 to")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("flat", "--rows", -5), "--rows"),
        (("flat", "--seed", -1), "--seed"),
        (("--trial", 0), "--trial"),
        (("flat", "--noise", -3), "--noise"),
        (("flat", "--noise", "nan"), "--noise"),
        (("flat", "--motors", 9, "--out", "x"), "--motors"),
        (("flat", "--motors", 2), "--out"),
        (("flat", "--rule", "paper"), "--out"),
    ],
)
def test_arguments_that_cannot_be_meant_are_refused(arguments, words, tmp_path):
    made = run(*arguments, "--quiet", cwd=tmp_path)
    assert made.returncode == 2 and words in made.stderr and "Traceback" not in made.stderr, made.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_part_with_a_flipped_byte_is_pressed_again(spec, tmp_path):
    shape = FingertipShape()
    whole = drain(collect(spec, shape, tmp_path, rows=512))
    (part,) = tmp_path.rglob("*.npz")
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 0x40
    part.write_bytes(bytes(data))
    again = drain(collect(spec, shape, tmp_path, rows=512))
    np.testing.assert_array_equal(again.readings, whole.readings)
