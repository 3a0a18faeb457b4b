"""What a sweep is asked for: the values of what varies, scenes beside the file, and refusals that name the place."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.errors import DermisError
from core.presets import Library
from core.sweep import devices, motors
from core.sweep.spec import read
from core.sweep.variant import dimensions
from tests.reader_examples import SWEEP

HEAD = 'schema = "dermis-sweep 1"\nstudy = "motors"\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "a.toml"
    path.write_text(text)
    return path


def test_every_combination_is_there_and_the_last_varies_fastest(tmp_path: Path) -> None:
    spec = read(written(tmp_path, SWEEP))
    variants = list(spec.variants())
    assert len(variants) == 2 * 2 * 3 and spec.rows == 500
    first, second = variants[:2]
    assert first == {"device": "cable_platform", "device.disc_radius": 10, "seed": 1, "wobble": 0.5}
    assert second == {**first, "seed": 2} and variants[-1]["device"] == "hexapod"


def test_scenes_are_found_beside_the_file_once_each(tmp_path: Path) -> None:
    for name in ("b.npz", "a.npz", "other.txt"):
        (tmp_path / name).touch()
    head = 'schema = "dermis-sweep 1"\nstudy = "devices"\n'
    spec = read(written(tmp_path, f'{head}scenes = ["*.npz", "a.npz"]\n[vary]\ndevice = "haptip"\n'))
    assert spec.scenes == (tmp_path / "a.npz", tmp_path / "b.npz")
    spec = read(written(tmp_path, f"{head}scenes = ['{tmp_path / 'a.npz'}']\n[vary]\ndevice = 'haptip'\n"))
    assert spec.scenes == (tmp_path / "a.npz",)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("schema = ", "not TOML"),
        ('schema = "dermis-sweep 2"', "newer version"),
        ('schema = "dermis-scene 1"', "unknown schema"),
        (HEAD.replace("motors", "birds"), "no such study"),
        (f"{HEAD}seeds = 3\n[vary]\nseed = 1", "unknown key"),
        (HEAD, "nothing varies"),
        (f"{HEAD}[vary]\nseed = []", "no value, or one twice"),
        (f"{HEAD}[vary]\nseed = [1, 1]", "no value, or one twice"),
        (f"{HEAD}[vary]\ndevice.disc_radius = [1]", "quotes"),
        (f"{HEAD}[vary]\nwobble = nan", "not a finite number"),
        (f"{HEAD}[vary]\nseed = 1979-05-27", "not a value"),
        (f"{HEAD}rows = 0\n[vary]\nseed = 1", "not a number of rows"),
        (f'{HEAD}level = "fine"\n[vary]\nseed = 1', "no such level"),
        (f"{HEAD}finger = 1.5\n[vary]\nseed = 1", "a name or a number"),
        (f'{HEAD}scenes = ["a.npz"]\n[vary]\nseed = 1', "scenes are of the study 'devices'"),
        (f'{HEAD.replace("motors", "devices")}[vary]\ndevice = "haptip"', "which needs some"),
        (f'{HEAD.replace("motors", "devices")}scenes = ["gone.npz"]\n[vary]\nx = 1', "no such scene"),
        (f"{HEAD.replace('motors', 'devices')}scenes = [3]\n[vary]\nx = 1", "a list of files"),
        (f"{HEAD}[vary]\nseed = {list(range(1000))}\nwobble = {[i / 100 for i in range(101)]}", "too many rows"),
    ],
)
def test_what_is_no_sweep_is_refused_with_the_place(text: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(DermisError, match=why) as caught:
        read(written(tmp_path, text))
    assert "a.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("vary", "why"),
    [
        ("colour = 1", "'colour' cannot vary"),
        ('"body.friction" = 0.2', "'body.friction' cannot vary"),
        ('"device." = 1', "'device.' cannot vary"),
        ('device = "hexapod"\n"device.wings" = 2', "no such parameter"),
        ('device = "hexapod"\n"device.disc_radius" = -2', "hexapod"),
        ('device = "gone"', "no such preset"),
        ('touch = "poke"', "no such interaction"),
        ("seed = -1", "not a seed"),
        ("seed = 0.5", "not a seed"),
        ("wobble = 11", "not a share"),
        ("wobble = true", "not a share"),
    ],
)
def test_what_cannot_vary_is_refused_before_any_work(vary: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(DermisError, match=why):
        motors.rows(read(written(tmp_path, f"{HEAD}[vary]\n{vary}\n")), Library())


def test_dimensions_are_in_the_presets_own_unit(tmp_path: Path) -> None:
    preset = dimensions({"device": "cable_platform", "device.disc_radius": 10}, Library(), "here")
    assert preset is not None and preset["parameters"]["disc_radius"]["value"] == 10
    assert preset["parameters"]["disc_radius"]["unit"] == "mm"
    with pytest.raises(DermisError, match="need a named device"):
        dimensions({"device.disc_radius": 10}, Library(), "here")
    assert dimensions({"device": "cable_platform"}, Library(), "here") is None
    assert Library().load("devices", "cable_platform")["parameters"]["disc_radius"]["value"] == 12


def test_a_rows_hash_is_of_all_that_its_figures_depend_on(tmp_path: Path) -> None:
    def keys(vary: str, head: str = HEAD) -> list[str]:
        return [row.key for row in motors.rows(read(written(tmp_path, f"{head}[vary]\n{vary}\n")), Library())]

    one = keys('touch = "flat"\nseed = [1, 2]')
    assert len(set(one)) == 2 and keys('seed = [2, 1]\ntouch = "flat"') == one[::-1]
    assert keys("seed = [1, 2]")[0] == one[0] and len(keys("seed = 1")) == 6
    for other in (
        keys('touch = "flat"\nseed = 1\nwobble = 0.5'),
        keys('touch = "flat"\nseed = 1\ndevice = "hexapod"'),
        keys('touch = "flat"\nseed = 1\ndevice = "cable_platform"\n"device.disc_radius" = 11'),
        keys('touch = "flat"\nseed = 1', f"{HEAD}rows = 400\n"),
        keys('touch = "flat"\nseed = 1', f'{HEAD}level = "standard"\n'),
    ):
        assert not set(other) & set(one)


def test_settings_of_the_study_devices_are_those_of_the_parameters() -> None:
    assert "friction" in devices.SETTINGS["body"] and "pin_method" in devices.SETTINGS["use"]
    assert {"skin_level", "tissue"} <= set(devices.SETTINGS["finger"])
