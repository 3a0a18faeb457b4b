"""Touches of one scene told apart: which are found, what real and rendered ones score, the reports and the verb."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.__main__ import main
from core.comparison import told_apart, told_report
from core.comparison.afferents import Afferents
from core.contact.skin_contact import SkinContact
from core.errors import DermisError, Finding
from core.pipeline.render import run
from core.presets import Library
from core.scene import scene_file
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.steps import drain
from core.surface.gap import Surface

pytestmark = pytest.mark.one_line("3.13", "numbers alone, of one touch for the whole file")

RATE = 60.0
SKIN = {"skin_level": "draft", "contact": "nodes"}


def scene(depths: tuple[float, ...], devices: tuple[DeviceUse, ...] = ()) -> TactileScene:
    """Return a finger that comes down on a block as deep as asked, once after the other, half a second each."""
    one = np.sin(np.linspace(0.0, np.pi, 31)[:-1]) ** 2
    z = np.concatenate([[1e-3], *(1e-3 - (1e-3 + depth) * one for depth in depths), [1e-3]])
    block = Surface.block().mesh
    top = np.array([0.0, 0.0, float(block.vertices[:, 2].max())])
    table = Body("Table", replace(block, vertices=block.vertices - top), Library().material("wood"))
    way = np.column_stack([0.0 * z, 0.0 * z, z])
    return scene_from_poses(RATE, [(Finger("Index", devices, SKIN), way)], [(table, (0.0, 0.0, 0.0))])


@pytest.fixture(scope="module")
def found() -> told_apart.Told:
    return drain(told_apart.tell_apart(scene((0.5e-3, 0.5e-3, 1.0e-3)), Library(), "Index"))


def test_touches_are_parted_where_the_finger_lifts(found: told_apart.Told) -> None:
    assert [round(touch.start / 0.5 - 0.2) for touch in found.touches] == [0, 1, 2]
    assert all(0.1 < touch.end - touch.start < 0.45 for touch in found.touches)
    assert found.pairs == ((0, 1), (0, 2), (1, 2))


def test_equal_touches_are_not_told_apart_and_unequal_ones_are(found: told_apart.Told) -> None:
    same, deeper, again = found.real
    assert same.apart < 1e-3 and deeper.apart > 3.0 and deeper.right > 0.9
    assert again.apart == pytest.approx(deeper.apart, rel=1e-4)
    assert [answer.as_real for answer in found.real] == [answer.apart for answer in found.real]


def test_every_device_that_presses_is_judged_by_each_of_its_methods(found: told_apart.Told) -> None:
    rows = {(row.device, row.method): row for row in found.rows}
    assert {method for device, method in rows if device == "thimble_3rrs"} == {"stress", "force", "geometry"}
    assert {method for device, method in rows if device == "pin_array_128"} == {"DM2", "FM2"}
    assert {"haptip", "electrovibration"} <= {s.device for s in found.skipped}
    # a deeper press is a matter of force and of place alike: no method misses it
    for method in ("stress", "force", "geometry"):
        assert rows["thimble_3rrs", method].answers[1].as_real > 1.0
        assert rows["thimble_3rrs", method].answers[0].apart < 1.0


def test_the_method_that_a_finger_uses_is_among_them() -> None:
    worn = scene((0.5e-3, 1e-3), (DeviceUse("pin_array_128", {"pin_method": "FM1"}),))
    made, _ = told_apart._wearing(worn, Library(), 0)
    methods = [use.parameters["pin_method"] for use in made.fingers[0].devices if use.preset == "pin_array_128"]
    assert methods == ["FM1", "DM2", "FM2"]


def test_what_playing_a_track_finds_is_in_all_reports(found: told_apart.Told) -> None:
    finding = Finding("warning", "law-unsettled", "the law did not converge", remedy="Touch less deeply")
    made = replace(found, findings=(finding,))
    assert found.findings == () and told_report.as_dict(found)["findings"] == []
    assert str(finding) in told_report.text(made).splitlines() and f"# {finding}" in told_report.csv(made).splitlines()
    assert told_report.as_dict(made)["findings"] == ["the law did not converge. Touch less deeply"]


def test_one_touch_and_too_many_are_refused() -> None:
    with pytest.raises(DermisError, match=r"compared in pairs .*found '1 touch'; allowed: 2 to 8"):
        drain(told_apart.tell_apart(scene((0.5e-3,)), Library(), 0))
    with pytest.raises(DermisError, match="no such finger"):
        drain(told_apart.tell_apart(scene((0.5e-3, 0.5e-3)), Library(), "Thumb"))


def test_reports_say_the_same(found: told_apart.Told) -> None:
    text, table = told_report.text(found), told_report.csv(found)
    assert "touch 3:" in text and "the real touches" in text and "skipped: HapTip" in text
    rows = [line.split(",") for line in table.splitlines() if not line.startswith("#")]
    assert rows[0] == ["device", "method", "first", "second", "d_any", "d_as_real", "right"]
    assert len(rows) == 1 + 3 * (1 + len(found.rows))
    real = [row for row in rows[1:] if not row[0]]
    assert [float(row[4]) for row in real] == pytest.approx([a.apart for a in found.real], rel=1e-8)


def test_the_verb_prints_the_table_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.npz"
    scene_file.save(scene((0.5e-3, 1e-3)), path)
    assert main(["tell-apart", str(path), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert "1 or 2" in capsys.readouterr().out
    assert (tmp_path / "out" / "Index.told-apart.csv").read_text().startswith("# dermis-told-apart 1\n")


def test_what_is_over_strains_nothing() -> None:
    """A touch that is over while another lasts is read as no strain, not as what comes after it."""
    contact = felt_in(scene((0.5e-3, 1.5e-3)))
    touches = told_apart.touches_of(contact)
    longer = (replace(touches[0], end=touches[0].start + 0.1), touches[1])
    looked = told_apart.looked_at(contact, longer)
    times = contact.times[looked.first[0][looked.first[0] >= 0]]
    assert times.max() <= longer[0].end and (looked.first[0] < 0).any() and (looked.first[1][:3] >= 0).all()
    read = looked.read(Afferents.of(contact.model), told_apart.real_states(contact, looked.samples))
    assert np.linalg.norm(read[0][-1]) < np.linalg.norm(read[1][0])


def test_real_touches_on_points_are_read_as_devices_are() -> None:
    """By forces on nodes: what is read of points nearer to the skin would differ from any device's by itself."""
    contact = felt_in(scene((0.5e-3,)), "points")
    samples = contact.contact[3:6]
    states = told_apart.real_states(contact, samples)
    assert contact.points is not None and all(state.points is None for state in states)
    afferents = Afferents.of(contact.model)
    own = afferents.strain([contact.stimulus_at(int(i)) for i in samples])
    assert np.abs(afferents.strain(states) / own - 1.0).max() > 1e-3  # the two do differ


def felt_in(given: TactileScene, where: str = "nodes") -> SkinContact:
    """Return what the skin feels in a scene, solved at nodes or on points."""
    shown = replace(given.fingers[0], parameters={**SKIN, "contact": where, "skin_shown": True})
    return run(replace(given, fingers=(shown,))).skins["Index"]
