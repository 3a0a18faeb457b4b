"""Plots: pixels and coordinates where they must be, readable by others, the same bytes every time."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.plot import axes
from core.plot import track as plot
from core.plot.axes import Axes
from core.plot.canvas import PngCanvas, SvgCanvas
from core.track.command_track import CommandTrack

SPEC = DeviceSpec(
    "d", "Dev <&>", "k", 100.0, (Channel("x", "m", -0.002, 0.002), Channel("volts", "V")), stated_hash="0"
)
TRACK = CommandTrack(
    SPEC,
    np.arange(101) / 100,
    np.stack([np.linspace(-0.002, 0.002, 101), np.full(101, 3.0)], axis=1),
    {"finger": "Index", "scene": "Tap"},
    {"x.range": 4},
)


def pixels(data: bytes) -> NDArray[np.uint8]:
    """Decode a PNG, as another program would."""
    image = Image.open(io.BytesIO(data))
    assert (image.format, image.mode) == ("PNG", "RGB")
    return np.asarray(image)


def ink(canvas: PngCanvas) -> NDArray[np.int64]:
    return 255 - pixels(canvas.to_bytes())[:, :, 0].astype(int)


def test_rectangles_lie_on_whole_pixels_and_are_never_lost() -> None:
    canvas = PngCanvas(4, 3, scale=1)
    canvas.rectangle(1, 1, 2, 1, "#000000")
    canvas.rectangle(0.2, 0.1, 0.1, 1, "#000000")
    assert ink(canvas).tolist() == [[255, 0, 0, 0], [0, 255, 255, 0], [0, 0, 0, 0]]


def test_what_lies_outside_is_left_out() -> None:
    canvas = PngCanvas(4, 3, scale=1)
    canvas.rectangle(-5, -5, 2, 2, "#000000")
    canvas.path(np.array([-3.0, 9.0]), np.array([50.0, 60.0]), "#000000", 1.0)
    canvas.disc(1e6, 1.0, 5.0, "#000000")
    canvas.text(100, 100, "far", 7, "#000000")
    assert not ink(canvas).any()


def test_a_level_path_has_its_width_and_place() -> None:
    for points in ([0.0, 40.0], [10.0, 10.0]), ([20.0, 20.0], [0.0, 20.0]):
        canvas = PngCanvas(40, 20, scale=1)
        canvas.path(*np.array(points), "#000000", 4.0)
        across = ink(canvas)[:, 20] if points[1][0] == 10.0 else ink(canvas)[10, 10:30]
        assert across.tolist() == [0] * 8 + [255] * 4 + [0] * 8


def test_a_slanting_path_is_smoothed() -> None:
    canvas = PngCanvas(40, 40, scale=1)
    canvas.path(np.array([0.0, 40.0]), np.array([0.0, 30.0]), "#000000", 1.5)
    shades = ink(canvas)
    assert len(np.unique(shades)) > 6
    assert shades.sum() / 255 == pytest.approx(50 * 1.5, rel=0.1), "its length times its width"


def test_a_peak_one_sample_wide_is_seen() -> None:
    canvas = PngCanvas(100, 50, scale=1)
    y = np.zeros(100_001)
    y[50_000] = 4.0
    Axes(canvas, (0, 5, 100, 40), (0.0, 100.0), (0.0, 4.0)).curve(np.linspace(0, 100, 100_001), y, "#000000", 1.0)
    assert ink(canvas)[7, 49:52].max() > 120 and not ink(canvas)[6, :45].any()


def test_letters_stand_on_their_base_line_and_are_as_high_as_asked() -> None:
    drawn = {}
    for letter in [*map(chr, range(33, 127)), "é", "µ", "中", "文"]:
        canvas = PngCanvas(60, 60, scale=1)
        canvas.text(20, 40, letter, 20, "#000000")
        drawn[letter] = ink(canvas)
    rows = np.flatnonzero(drawn["H"].any(axis=1))
    assert rows[-1] == 39 and len(rows) == pytest.approx(20, abs=1)
    ascii_letters = [drawn[letter].tobytes() for letter in map(chr, range(33, 127))]
    assert len(set(ascii_letters)) == len(ascii_letters)
    same = ("é", "e"), ("µ", "u"), ("中", "文")
    assert all((drawn[a] == drawn[b]).all() for a, b in same), "an accent goes; what the font lacks is one box"


def test_anchors() -> None:
    edges = []
    for anchor in ("start", "middle", "end"):
        canvas = PngCanvas(80, 20, scale=1)
        canvas.text(40, 15, "HHH", 8, "#000000", anchor)  # type: ignore[arg-type]
        columns = np.flatnonzero(ink(canvas).any(axis=0))
        edges.append((columns[0] - 40, columns[-1] - 40))
    assert edges[0][0] >= 0 and edges[2][1] <= 0 and sum(edges[1]) == pytest.approx(0, abs=2)


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0.0, 1.0, 5, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
        (-2.28, 2.28, 4, [-2.0, 0.0, 2.0]),
        (0.0, 5.0, 8, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]),
        (99.9, 100.1, 4, [99.9, 99.95, 100.0, 100.05, 100.1]),
        (-3e-7, 8e-7, 4, [0.0, 5e-7]),
    ],
)
def test_ticks_are_round(low: float, high: float, most: int, expected: list[float]) -> None:
    assert axes.ticks(low, high, most) == pytest.approx(expected, abs=1e-15)


def test_thinning_keeps_every_peak_and_the_ends() -> None:
    y = np.random.default_rng(2).normal(size=50_000)
    y[31_234], y[7] = 99.0, -99.0
    x, thin = axes.thinned(np.arange(50_000.0), y, 1000)
    assert len(x) <= 1000 and (thin.max(), thin.min()) == (99.0, -99.0)
    assert (x[0], x[-1]) == (0.0, 49_999.0) and (np.diff(x) > 0).all() and (y[x.astype(int)] == thin).all()


def test_svg_is_well_formed_and_its_curve_lies_where_it_should(tmp_path: Path) -> None:
    plot.write_svg(TRACK, tmp_path / "p.svg", contact=np.r_[np.zeros(50), np.ones(51)])
    root = ElementTree.parse(tmp_path / "p.svg").getroot()
    space = "{http://www.w3.org/2000/svg}"
    texts = [t.text for t in root.iter(f"{space}text")]
    assert "Index · Dev <&>" in texts and "x [mm]" in texts and "volts [V]" in texts and "time [s]" in texts
    assert "Tap · 101 samples · 100 Hz · 1 s · 4 values limited" in texts
    first = next(root.iter(f"{space}polyline"))
    points = np.array([[float(v) for v in p.split(",")] for p in first.attrib["points"].split()])
    assert points[0, 0] == plot.LEFT and points[-1, 0] == plot.WIDTH - plot.RIGHT
    # the range -2..2 mm with 7 % of 4 mm around it: the ends lie 0.28/4.56 of the panel inside
    inside = plot.PANEL * 0.28 / 4.56
    assert points[0, 1] == pytest.approx(plot.TOP + plot.PANEL - inside, abs=2e-3)
    assert points[-1, 1] == pytest.approx(plot.TOP + inside, abs=2e-3)
    shade = [r.attrib for r in root.iter(f"{space}rect") if r.attrib["fill"] == axes.TOUCH]
    width = plot.WIDTH - plot.LEFT - plot.RIGHT
    panels = [r for r in shade if float(r["height"]) == plot.PANEL]
    assert len(panels) == 2 and float(panels[0]["x"]) == pytest.approx(plot.LEFT + width * 0.495, abs=2e-3)
    assert float(panels[0]["width"]) == pytest.approx(width * 0.505, abs=2e-3)


def test_png_shows_the_curve_and_the_limits(tmp_path: Path) -> None:
    plot.write_png(TRACK, tmp_path / "p.png", scale=2.0)
    image = pixels((tmp_path / "p.png").read_bytes()).astype(int)
    height = plot.TOP + 2 * (plot.PANEL + plot.GAP)
    assert image.shape == (round(2 * height), round(2 * plot.WIDTH), 3)

    def away(row: float, column: float, colour: str) -> int:
        ink = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
        return int(abs(image[round(row), round(column)] - ink).max())

    centre = plot.LEFT + plot.WIDTH - plot.RIGHT
    assert away(2 * plot.TOP + plot.PANEL, centre, plot.LINES[0]) < 10, "the line crosses zero in the panel's middle"
    assert away(2 * plot.TOP + plot.PANEL - 12, centre, plot.LINES[0]) > 100
    top = 2 * plot.TOP + 2 * plot.PANEL * 0.28 / 4.56
    dashes = [away(row, column, axes.LIMIT) < 40 for row in (top - 1, top, top + 1) for column in range(400, 1600)]
    assert 0.45 * 1200 < sum(dashes) < 1.55 * 1200
    volts = 2 * (plot.TOP + plot.PANEL + plot.GAP)
    ink = [min(away(volts + row, column, plot.LINES[1]) for row in range(2 * int(plot.PANEL))) for column in (300, 900)]
    assert max(ink) < 10, "the second panel has its own line"


@pytest.mark.parametrize("write", [plot.write_png, plot.write_svg])
def test_same_bytes_twice_and_odd_tracks(tmp_path: Path, write: object) -> None:
    odd = [
        TRACK,
        replace(TRACK, times=np.empty(0), values=np.empty((0, 2))),
        replace(TRACK, times=np.zeros(1), values=np.array([[0.001, 2.0]])),
        replace(TRACK, values=np.where(np.arange(202).reshape(101, 2) % 7 == 0, np.nan, TRACK.values)),
        replace(TRACK, values=np.full((101, 2), np.nan)),
        replace(TRACK, meta={"finger": "Ring\x00\n" * 20}),
    ]
    for track in odd:
        data = []
        for name in "ab":
            write(track, tmp_path / name, contact=np.ones(len(track.times)))  # type: ignore[operator]
            data.append((tmp_path / name).read_bytes())
        assert data[0] == data[1]
        if data[0].startswith(b"<svg"):
            ElementTree.fromstring(data[0])
        else:
            pixels(data[0])


def test_small_units_read_well(tmp_path: Path) -> None:
    for size, unit in ((0.5, "m"), (0.004, "mm"), (4e-6, "µm")):
        small = replace(
            TRACK,
            spec=replace(SPEC, channels=(Channel("x", "m"), SPEC.channels[1])),
            values=TRACK.values * [size / 0.002, 1],
        )
        plot.write_svg(small, tmp_path / "p.svg")
        assert f">x [{unit}]<" in (tmp_path / "p.svg").read_text(encoding="utf-8")


def test_like_channels_are_shown_in_like_units(tmp_path: Path) -> None:
    alike = replace(SPEC, channels=(Channel("x", "m"), Channel("y", "m")))
    plot.write_svg(replace(TRACK, spec=alike, values=TRACK.values * [1.0, 1e-6]), tmp_path / "p.svg")
    text = (tmp_path / "p.svg").read_text(encoding="utf-8")
    assert ">x [mm]<" in text and ">y [mm]<" in text


def test_axes_place_values_and_number_both_sides() -> None:
    canvas = SvgCanvas(200, 100)
    made = Axes(canvas, (20.0, 10.0, 100.0, 50.0), (1.0, 3.0), (-2e-3, 2e-3))
    assert made.x([1.0, 2.0, 3.0]).tolist() == [20.0, 70.0, 120.0] and made.y([-2e-3, 0.0]).tolist() == [60.0, 35.0]
    made.bands(np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.0, 0.0]))
    made.grid("time [s]", "x [mm]", most=(2, 4), factor=1e-3)
    made.level(5e-3)
    made.curve(np.arange(5.0), np.array([0.0, np.nan, 1e-3, 2e-3, np.nan]), "#000000")
    root = ElementTree.fromstring(canvas.to_bytes())
    assert [t.text for t in root if t.tag.endswith("text")] == [*"123", "-2", "-1", "0", "1", "2", "x [mm]", "time [s]"]
    (shade,) = (r for r in root if r.tag.endswith("rect"))
    assert (shade.attrib["x"], shade.attrib["width"]) == ("45", "50"), "half way to the samples beside"
    assert [e.tag.rpartition("}")[2] for e in root][-2:] == ["circle", "polyline"], "a mark, a gap, a line"
    assert not [e for e in root if "stroke-dasharray" in e.attrib], "a limit outside is not drawn"


def test_svg_numbers_have_no_minus_zero() -> None:
    canvas = SvgCanvas(10, 10)
    canvas.rectangle(-0.0001, 100.0, 0.5, 1200.0, "#000000")
    assert b'x="0" y="100" width="0.5" height="1200"' in canvas.to_bytes()


def test_a_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "f").write_text("")
    with pytest.raises(DermisError, match="the file cannot be written"):
        plot.write_png(TRACK, tmp_path / "f" / "p.png")


def test_like_channels_have_like_scales_and_others_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What moves half as far is drawn half as high; a channel of the same unit that means another thing is not."""
    names, sizes = ("tactor_x", "tactor_y", "distance", "servo_1"), np.array([2e-3, 1e-3, 20e-3, 2e-3])
    channels = tuple(Channel(n, "rad" if n.startswith("servo") else "m") for n in names)
    wave = np.sin(np.linspace(0.0, 6.0, 101))[:, None]
    limits: list[tuple[float, float]] = []
    monkeypatch.setattr(plot, "Axes", lambda canvas, box, x, y: limits.append(y) or Axes(canvas, box, x, y))
    track = CommandTrack(replace(SPEC, channels=channels), TRACK.times, wave * sizes)
    plot.write_svg(track, tmp_path / "p.svg")
    assert limits[0] == limits[1] and limits[0][1] == pytest.approx(2e-3 * 1.14, rel=0.01)
    assert limits[2][1] == pytest.approx(10 * limits[0][1]) and limits[3] == pytest.approx(limits[0])


def test_tracks_of_one_device_share_units_and_scales() -> None:
    """The plot of a finger that hardly moves has the axes of the one that moves, and the bytes of a file of its own."""
    free = replace(SPEC, channels=(Channel("x", "m"), Channel("volts", "V")))
    loud, faint = (CommandTrack(free, TRACK.times, size * TRACK.values) for size in (1.0, 0.01))

    def numbers(track: CommandTrack, *alike: CommandTrack) -> list[str | None]:
        canvas = SvgCanvas(plot.WIDTH, 500.0)
        plot._picture(track, None, canvas, alike)
        root = ElementTree.fromstring(canvas.to_bytes())
        return [t.text for t in root.iter("{http://www.w3.org/2000/svg}text")]

    assert "x [mm]" in numbers(loud) and "x [µm]" in numbers(faint)
    assert numbers(faint, loud, faint) == numbers(loud)
    assert plot.png(faint, alike=(loud,)) != plot.png(faint)
