"""The sweep of methods: its figures are those of the report on each stimulus alone; refusals, files and the verb."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.__main__ import main
from core.contact.skin_sampler import SkinSampler
from core.errors import DermisError
from core.matching.pin_report import compare
from core.presets import Library
from core.scene.sliding import sliding_plane
from core.skin.model import SkinModel, fingertip_skin
from core.steps import drain
from core.studies.method_sweep import MOST, Swept, csv, picture, sweep_methods

SPEC = Library().device("pin_array_128")
SLIDE = 0.1


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip_skin(level="draft")


@pytest.fixture(scope="module")
def found(skin: SkinModel) -> tuple[Swept, ...]:
    return drain(sweep_methods(SPEC, skin, [1e-3], [0.0, 0.5], methods=("DM2", "FM2"), slide=SLIDE))


def test_every_stimulus_is_reported_as_if_it_were_alone(found: tuple[Swept, ...], skin: SkinModel) -> None:
    assert [(each.depth, each.friction, each.direction) for each in found] == [(1e-3, 0.0, 0.0), (1e-3, 0.5, 0.0)]
    sampler = SkinSampler(sliding_plane(1e-3, 0.5, slide=SLIDE), {0: skin})
    for chunk in sliding_plane(1e-3, 0.5, slide=SLIDE).chunks:
        sampler.add(chunk)
    alone = compare(sampler.finish()[0], SPEC, methods=("DM2", "FM2"))
    assert list(map(repr, alone)) == list(map(repr, found[1].reports))
    dm2, fm2 = found[1].reports
    assert dm2.displacement_error < fm2.displacement_error  # best by construction
    assert dm2.target_ratio > found[0].reports[0].target_ratio  # friction drags the skin along


def test_the_table_has_a_row_for_each_stimulus_and_method(found: tuple[Swept, ...], skin: SkinModel) -> None:
    rows = [line.split(",") for line in csv(found, SPEC, skin).splitlines() if not line.startswith("#")]
    assert rows[0][:4] == ["depth_m", "friction", "direction_rad", "method"] and len(rows) == 5
    at = rows[0].index("displacement_error")
    told = [float(row[at]) for row in rows[1:]]
    assert told == pytest.approx([r.displacement_error for each in found for r in each.reports], rel=1e-8)
    assert picture(found, "a").startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"depths": [9e-3]}, r"depth out of range .*9.0; allowed: 0.1 to 4 mm"),
        ({"frictions": [-0.1]}, "friction out of range"),
        ({"frictions": [float("nan")]}, "friction out of range"),
        ({"directions": []}, "stimuli of a sweep"),
        ({"frictions": [0.1] * (MOST + 1)}, "stimuli of a sweep"),
        ({"spec": Library().device("haptip")}, "pin arrays"),
    ],
)
def test_what_cannot_be_swept_is_refused(skin: SkinModel, more: dict[str, object], why: str) -> None:
    given = {"spec": SPEC, "skin": skin, "depths": [1e-3], "frictions": [0.5], "directions": [0.0], **more}
    with pytest.raises(DermisError, match=why):
        drain(sweep_methods(**given))  # type: ignore[arg-type]


def test_the_verb_tells_how_far_it_is_and_writes_both_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sweep", "--depth", "1", "--friction", "0.3", "--method", "FM1", "--slide", "0.05"]
    assert main([*words, "--direction", "90", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert "stimuli: 1 of 1" in said.err and "90 deg" in said.out and "FM1" in said.out
    assert (tmp_path / "pin_array_128.sweep.csv").read_text().startswith("# dermis-method-sweep 1\n")
    assert (tmp_path / "pin_array_128.sweep.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["sweep", "--depth", "40"]) == 2
    assert "depth out of range" in capsys.readouterr().err


def test_directions_turn_the_movement() -> None:
    moved = [next(iter(sliding_plane(direction=angle).chunks)).bodies[0, -1, :3, 3] for angle in (0.0, np.pi / 2)]
    np.testing.assert_allclose(moved[1][:2], [-0.0, moved[0][0]], atol=1e-12)
