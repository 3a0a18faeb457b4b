"""The trust band: what is changed by how much, in numbers, files and words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.comparison import trust_band
from core.comparison.scene_variants import shifted
from core.comparison.trust_band import DOUBT, SKIN, Band, trust_bands
from core.pipeline.render import run
from core.presets import Library
from core.scene import scene_file
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.steps import drain
from core.surface.gap import Surface
from core.track.command_track import CommandTrack

pytestmark = pytest.mark.one_line("3.11", "numbers alone, of one touch for the whole file")

FAR = 50e-6  # a shift that does matter [m]


@pytest.fixture(scope="module")
def scene() -> TactileScene:
    """A finger that presses a plate by a millimetre and slides 2 mm."""
    share = np.linspace(0.0, 1.0, 40)
    way = [(2e-3 * max(s - 0.5, 0.0), 0.0, 0.2e-3 - 1.2e-3 * min(2.0 * s, 1.0)) for s in share.tolist()]
    own = {"skin_level": "draft", "skin_shown": True}
    finger = Finger("Index", (DeviceUse("pin_array_128"), DeviceUse("haptip")), own)
    plate = Body("Plate", Surface.block(0.1, 0.1).mesh, {"friction": 0.4})
    return scene_from_poses(240.0, [(finger, way)], [(plate, (0.0, 0.0, 0.0))])


@pytest.fixture(scope="module")
def bands(scene: TactileScene) -> tuple[Band, ...]:
    return drain(trust_bands(scene, Library()))[1]


def test_a_plate_can_be_trusted(bands: tuple[Band, ...]) -> None:
    assert [(b.finger, b.device) for b in bands] == [("Index", "pin_array_128"), ("Index", "haptip"), ("Index", SKIN)]
    for band in bands:
        assert band.share.max() < 0.02 and band.finding is None, (band.device, band.share.max())
    assert bands[2].felt.min() > 0.1, "something is felt [N]"


def test_a_change_is_the_difference_of_two_bakes(scene: TactileScene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trust_band, "VARIANTS", {"shifted": (lambda s: shifted(s, FAR), "shifted far", True)})
    own, found = drain(trust_bands(scene, Library()))
    other = run(shifted(scene, FAR))
    for band, one, two in zip(found, own.outputs, other.outputs, strict=False):
        np.testing.assert_array_equal(band.spread, np.abs(two.track.values - one.track.values))
    skin = found[-1]
    change = np.abs(other.skins["Index"].normal_force - own.skins["Index"].normal_force)
    np.testing.assert_array_equal(skin.spread[:, 0], change)
    assert skin.share.max() > DOUBT and skin.finding is not None
    assert skin.finding.code == "not-reproduced" and "shifted far" in str(skin.finding) and "Index" in str(skin.finding)


def test_files_hold_values_and_changes(bands: tuple[Band, ...], tmp_path: Path) -> None:
    paths = trust_band.write(bands, tmp_path, plots=True)
    assert sorted(p.name for p in paths) == sorted(
        [f"Index.{d}_trust.{e}" for d in ("pin_array_128", "haptip") for e in ("csv", "png")] + ["Index.skin_trust.csv"]
    )
    lines = (tmp_path / "Index.skin_trust.csv").read_text().splitlines()
    assert lines[0] == "# dermis-trust-band 1"
    assert lines[3] == "t_s,normal_force[N],normal_force_spread[N],tangential_force[N],tangential_force_spread[N]"
    rows = np.loadtxt(lines[4:], delimiter=",")
    np.testing.assert_allclose(rows[:, 1::2], bands[2].values, rtol=1e-8)
    np.testing.assert_allclose(rows[:, 2::2], bands[2].spread, rtol=1e-8)
    assert "of peak" in trust_band.table(bands) and len(trust_band.table(bands).splitlines()) == 4


def test_the_picture_shows_the_band() -> None:
    from core.plot.track import png

    spec = Library().device("haptip")
    times = np.arange(200) / spec.rate
    values = np.tile(np.sin(40 * times)[:, None] * 1e-3, (1, len(spec.channels)))
    track = CommandTrack(spec, times, values)
    widths = (None, np.zeros_like(values), np.full_like(values, 0.5e-3))
    assert len({png(track, spread=width) for width in widths}) == 3


def test_the_command_says_it(scene: TactileScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from core.__main__ import main

    scene_file.save(scene, tmp_path / "plate.npz")
    assert main(["trust", str(tmp_path / "plate.npz"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "normal_force" in said or "tangential_force" in said
    assert (tmp_path / "out" / "Index.skin_trust.csv").exists()
