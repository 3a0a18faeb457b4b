"""Pin maps: one mark a pin at its place, areas as forces, and pictures that say the same as SVG and as PNG."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from PIL import Image

from core.images import read
from core.plot.canvas import PngCanvas, SvgCanvas
from core.plot.pins import HEIGHT, pin_map
from core.plot.track import TOP, write_png, write_svg
from core.presets import Library
from core.track.command_track import CommandTrack

CIRCLE = re.compile(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="([\d.]+)" fill="(#\w+)"/>')


def spec():
    return Library().device("pin_array_128")


def discs(forces, high=0.4):
    canvas = SvgCanvas(320, 160)
    pin_map(spec(), np.asarray(forces, float), high, 0, 0, 320, 160, canvas)
    return [(float(x), float(y), float(r), fill) for x, y, r, fill in CIRCLE.findall(canvas.to_bytes().decode())]


def test_pins_stand_row_by_row_with_the_tip_up():
    forces = np.zeros(128)
    places = discs(forces)
    assert len(places) == 128
    x, y = (np.array([p[k] for p in places]).reshape(8, 16) for k in (0, 1))
    np.testing.assert_allclose(x, np.tile(10 + 20 * np.arange(16), (8, 1)))
    np.testing.assert_allclose(y, np.tile((150 - 20 * np.arange(8))[:, None], (1, 16)))


def test_areas_follow_forces():
    forces = np.zeros(128)
    forces[[0, 17, 127]] = 0.1, 0.2, 0.4
    radii = sorted(r for _, _, r, _ in discs(forces))[-3:]
    np.testing.assert_allclose(np.square(radii) / radii[-1] ** 2, [0.25, 0.5, 1.0], atol=1e-3)
    assert len(discs(forces)) == 128 + 3


def test_a_disc_covers_its_area_in_pixels():
    canvas = PngCanvas(100, 100, 2.0)
    canvas.disc(41.3, 57.8, 20.0, "#000000")
    ink = 1.0 - np.asarray(Image.open(io.BytesIO(canvas.to_bytes())))[..., 0] / 255.0
    assert ink.sum() == pytest.approx(np.pi * 40.0**2, rel=2e-3)
    rows, columns = np.indices(ink.shape) + 0.5
    assert (ink * columns).sum() / ink.sum() == pytest.approx(82.6, abs=0.15)
    assert (ink * rows).sum() / ink.sum() == pytest.approx(115.6, abs=0.15)


def test_the_picture_of_a_track_has_its_size_and_its_figures(tmp_path):
    times = np.arange(241) / 240.0
    values = np.zeros((241, 128))
    values[:, 5] = 0.4 * times
    track = CommandTrack(spec(), times, values, {"finger": "Index", "method": "DM2"})
    write_png(track, tmp_path / "a.png", contact=(times > 0.5).astype(float))
    write_svg(track, tmp_path / "a.svg", contact=(times > 0.5).astype(float))
    assert len(read(tmp_path / "a.png").values) == round(2 * (TOP + HEIGHT))
    text = (tmp_path / "a.svg").read_text()
    assert "Index" in text and "DM2" in text and "largest pin force" in text and "force [N]" in text
    assert len(CIRCLE.findall(text)) == 6 * 129  # six maps, in each of them one pin presses
    write_svg(track, tmp_path / "b.svg", contact=(times > 0.5).astype(float))
    assert text == (tmp_path / "b.svg").read_text()


def test_an_empty_track_and_an_odd_number_of_pins_can_be_drawn(tmp_path):
    write_svg(CommandTrack(spec(), np.zeros(0), np.zeros((0, 128))), tmp_path / "a.svg")
    assert len(CIRCLE.findall((tmp_path / "a.svg").read_text())) == 6 * 128
    canvas = SvgCanvas(100, 100)
    pin_map(spec(), np.ones(7), 1.0, 0, 0, 100, 100, canvas)
    assert len(CIRCLE.findall(canvas.to_bytes().decode())) == 14
