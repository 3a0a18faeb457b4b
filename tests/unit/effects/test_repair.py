"""Height maps and their repairs: holes, staircases, meanings; what is right is not touched."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from core.effects.depth_map import from_array, read
from core.effects.map_repair import no_data_of
from core.effects.repair import filled, smoothed, staircase
from core.errors import DermisError
from tests.unit.images.test_images import png, put


def waves(rows=60, columns=80):
    x, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    return 0.3 * x + 0.2 * y + 0.05 * np.sin(5 * x) * np.cos(4 * y)


def test_clean_map_is_not_touched():
    made = from_array(waves())
    np.testing.assert_array_equal(made.heights, waves().astype(np.float32))
    assert made.findings == ()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e10])
def test_holes_are_filled_within_their_rims_and_counted(value):
    exact = waves()
    broken = exact.copy()
    broken[20:32, 30:50] = value
    broken[0, :7] = value
    made = from_array(broken)
    np.testing.assert_array_equal(made.heights[broken == exact], exact.astype(np.float32)[broken == exact])
    hole = made.heights[20:32, 30:50]
    rim = exact[19:33, 29:51]
    assert rim.min() <= hole.min()
    assert hole.max() <= rim.max()
    assert np.abs(hole - exact[20:32, 30:50]).max() < 0.05 * np.ptp(exact)
    (finding,) = made.findings
    assert (finding.code, finding.severity, finding.count) == ("holes-filled", "warning", 12 * 20 + 7)


def test_filling_meets_a_plane_and_makes_no_cliff():
    x, y = np.meshgrid(np.arange(64.0), np.arange(64.0))
    plane = 2 * x - y
    hole = (x - 30) ** 2 + (y - 33) ** 2 < 12**2
    found = filled(np.where(hole, 0.0, plane), hole)
    assert np.abs(found - plane).max() < 0.03 * np.ptp(plane)
    assert np.abs(np.diff(found, axis=1)).max() < 2 * 2.0


def test_nothing_but_holes_is_refused_and_one_pixel_is_enough():
    with pytest.raises(DermisError, match="every pixel is a hole"):
        from_array(np.full((3, 3), np.nan))
    with pytest.raises(DermisError, match="map 2 of 2"):
        from_array(np.stack([np.zeros((3, 3)), np.full((3, 3), np.inf)]))
    single = np.full((9, 5), np.nan)
    single[8, 0] = 0.7
    np.testing.assert_allclose(from_array(single).heights, 0.7, rtol=1e-6)


def test_a_depth_cameras_own_hole_value():
    depth = np.full((8, 8), 1.5, np.float32)
    depth[3, 3], depth[4, 4] = 0.0, 0.1
    made = from_array(depth, meaning="depth", no_data=0.1)
    assert made.heights[4, 4] == pytest.approx(-1.5, abs=0.4)
    assert {f.code: f.count for f in made.findings}["holes-filled"] == 1
    assert made.heights[3, 3] == 0.0


def test_depth_is_negated_so_that_near_is_high():
    made = from_array(np.array([[1.0, 2.0, 3.5]]), meaning="depth")
    np.testing.assert_array_equal(made.heights, [[-1.0, -2.0, -3.5]])


def test_first_row_at_the_top_is_turned_over():
    values = np.arange(12.0).reshape(4, 3) ** 1.5
    np.testing.assert_array_equal(from_array(values, first_row="top").heights, values[::-1].astype(np.float32))
    stack = np.stack([values, 2 * values])
    np.testing.assert_array_equal(from_array(stack, first_row="top").heights, stack[:, ::-1].astype(np.float32))


def bump(n=256, sigma=0.12):
    x, y = np.meshgrid((np.arange(n) + 0.5) / n - 0.5, (np.arange(n) + 0.5) / n - 0.5)
    return np.exp(-(x**2 + y**2) / (2 * sigma**2))


def slope_error(found, exact):
    return np.sqrt(np.mean((np.diff(found, axis=1) - np.diff(exact, axis=1)) ** 2))


@pytest.mark.parametrize("levels", [255, 100, 30])
def test_staircases_are_smoothed_by_half_a_level_at_most(levels):
    exact = bump()
    stored = np.rint(exact * levels) / levels
    made = from_array(stored.astype(np.float32), levels=256)
    assert np.abs(made.heights - stored).max() <= 0.5 / levels * (1 + 1e-4)
    assert slope_error(made.heights, exact) < slope_error(stored, exact) / 3
    (finding,) = made.findings
    assert (finding.code, finding.count, finding.value) == ("staircase-smoothed", 1, f"{len(np.unique(stored))} levels")
    kept = from_array(stored, steps="keep", levels=256)
    np.testing.assert_array_equal(kept.heights, stored.astype(np.float32))
    assert [f.code for f in kept.findings] == ["staircase-kept"]


def test_smoothing_keeps_cliffs():
    stored = np.rint(bump() * 255)
    stored[:, 128:] += 100
    found = smoothed(stored, 1.0)
    assert np.abs(np.diff(found, axis=1)[:, 127] - np.diff(stored, axis=1)[:, 127]).max() <= 1.0


def test_only_staircases_count_as_such():
    rng = np.random.default_rng(4)
    assert not staircase(bump()).found, "a smooth map in floating point"
    assert not staircase(np.rint(bump() * 65535)).found, "16 bit"
    assert not staircase((bump() > 0.5).astype(float)).found, "a mask is meant as it is"
    assert not staircase(rng.integers(0, 256, (64, 64)) / 255).found, "a rough texture has no flats"
    assert not staircase(np.ones((5, 5))).found
    irregular = np.sort(rng.uniform(0, 1, 40))[np.rint(bump() * 39).astype(int)]
    assert not staircase(irregular).found, "levels that are no multiples of a step"
    assert staircase(1000 + 0.01 * np.rint(bump() * 200)).found


def test_eight_bit_png_from_file_is_smoothed_and_sixteen_bit_is_not(tmp_path):
    exact = bump(96)
    eight = read(put(tmp_path, png(np.rint(exact * 255).astype(int)[..., None], 8, 0, itertools.cycle((4, 1)))))
    sixteen = read(put(tmp_path, png(np.rint(exact * 65535).astype(int)[..., None], 16, 0, itertools.cycle((3, 2)))))
    assert [f.code for f in eight.findings] == ["staircase-smoothed"]
    assert sixteen.findings == ()
    assert np.abs(sixteen.heights - exact[::-1]).max() < 1e-5
    assert np.abs(eight.heights - exact[::-1]).max() < 1.0 / 255


def test_flat_maps_and_masks_are_noticed():
    assert [f.code for f in from_array(np.full((4, 4), 0.3)).findings] == ["flat-map"]
    assert [f.code for f in from_array(bump(32) > 0.5).findings] == ["few-levels"]
    exact = from_array((bump(32) > 0.5).astype(float))
    assert exact.findings == (), "numbers in floating point are no 8-bit image, however few"


def test_floating_point_is_exact_and_never_smoothed(tmp_path):
    # A tent of 21 heights one step apart, and a texture of half steps: both climb in single steps, both as meant.
    tent = np.tile(np.minimum(np.arange(40), 40 - np.arange(40)).astype(np.float32) * 1e-4, (40, 3))
    texture = np.tile((np.arange(64) // 2 + 2.0 * (np.arange(64) % 2)).astype(np.float32) * 1e-4, (64, 1))
    for exact in (tent, texture):
        assert staircase(exact).found, "it looks like a staircase: only its format tells that it is none"
        np.save(tmp_path / "f.npy", exact[::-1])
        put(tmp_path, b"Pf\n%d %d\n-1\n" % exact.shape[::-1] + exact.astype("<f4").tobytes(), "f.pfm")
        made = [read(tmp_path / "f.npy"), read(tmp_path / "f.pfm"), from_array(exact)]
        for m in made:
            np.testing.assert_array_equal(m.heights, exact)
            assert m.findings == ()
    steps = np.rint(bump(96) * 100)
    np.save(tmp_path / "i2.npy", steps.astype(np.uint16))
    assert read(tmp_path / "i2.npy").findings == (), "16 bit"
    np.save(tmp_path / "i1.npy", steps.astype(np.uint8))
    assert [f.code for f in read(tmp_path / "i1.npy").findings] == ["staircase-smoothed"]
    assert [f.code for f in from_array(steps.astype(np.uint8)).findings] == ["staircase-smoothed"]


@pytest.mark.parametrize(
    ("values", "options", "message"),
    [
        (np.zeros((0, 0)), {}, "no pixels"),
        (np.zeros((3, 0)), {}, "no pixels"),
        (np.zeros(4), {}, "no pixels"),
        (np.zeros((2, 2), complex), {}, "real numbers"),
        (np.array([["a"]]), {}, "real numbers"),
        (np.zeros((2, 2)), {"meaning": "colour"}, "unknown kind of map"),
        (np.zeros((2, 2)), {"steps": "no"}, "unknown kind of map"),
        (np.zeros((2, 2)), {"first_row": "left"}, "first row"),
        (np.zeros((2, 2)), {"declared": np.zeros((3, 2), bool)}, "do not fit"),
    ],
)
def test_refuses_arrays_that_are_no_map(values, options, message):
    with pytest.raises(DermisError, match=message):
        from_array(values, **options)


def camera(rows=40, columns=60):
    """Return a depth camera's picture in millimetres, 0 where it measured nothing."""
    depths = np.rint(600 + 200 * waves(rows, columns)).astype(np.uint16)
    depths[5:12, 20:30] = 0
    return depths


def test_zeros_of_a_depth_camera_are_offered_as_holes():
    (offered,) = from_array(camera(), meaning="depth").findings
    assert offered.code == "zeros-like-holes" and offered.severity == "warning" and offered.count == 70
    assert "no_data=0" in offered.remedy and offered.value == "2.92 %"
    taken = from_array(camera(), meaning="depth", no_data=0)
    assert [f.code for f in taken.findings] == ["holes-filled"] and taken.heights.max() < -500


@pytest.mark.parametrize(
    ("depths", "meaning"),
    [
        (camera(), "height"),  # ground that a relief stands on
        (np.rint(255 * waves() / waves().max()).astype(np.uint16), "depth"),  # comes down to 0 in small steps
        (np.kron(np.eye(6), np.full((8, 8), 255)).astype(np.uint8), "depth"),  # a mask, engraved
        (np.zeros((9, 9)), "depth"),
    ],
)
def test_zeros_that_are_meant_are_not_offered(depths, meaning):
    assert "zeros-like-holes" not in {f.code for f in from_array(depths, meaning=meaning).findings}


@pytest.mark.parametrize(("kind", "unit"), [(np.uint16, 1e-3), (np.int32, 1e-3), (np.int64, 1e-6), (np.uint8, 1.0)])
def test_whole_numbers_with_a_unit_are_lengths(tmp_path, kind, unit):
    heights = (waves() * 200).astype(kind)
    np.save(tmp_path / "map.npy", heights[::-1])
    made = read(tmp_path / "map.npy", unit=unit, steps="keep")
    np.testing.assert_allclose(made.heights * made.height_unit, heights * unit, rtol=1e-6)


def test_floats_with_a_unit_are_lengths_and_without_one_have_none(tmp_path):
    np.save(tmp_path / "map.npy", waves())
    assert read(tmp_path / "map.npy").height_unit == 0.0
    assert read(tmp_path / "map.npy", unit=1e-3).height_unit == 1e-3


def test_measures_without_a_unit_are_asked_for_one(tmp_path):
    np.save(tmp_path / "map.npy", (waves() * 3000).astype(np.int32))
    with pytest.raises(
        DermisError, match=r"their unit is not stated \(found '.* of 2147483647'\). State the unit of the numbers"
    ) as caught:
        read(tmp_path / "map.npy")
    assert caught.value.code == "no-unit" and "unit=1e-3" in caught.value.remedy
    np.save(tmp_path / "map.npy", (waves() * 2**31).astype(np.int32))  # scaled to its type: white is there
    assert read(tmp_path / "map.npy").heights.max() == pytest.approx(waves().max())


@pytest.mark.parametrize("unit", [0.0, -1.0, np.nan, 1e300, 10**400, "mm"])
def test_a_unit_is_a_length(tmp_path, unit):
    np.save(tmp_path / "map.npy", waves())
    with pytest.raises(
        DermisError, match=r"image 'map.npy': the unit (of the numbers is out of range|must be a number)"
    ):
        read(tmp_path / "map.npy", unit=unit)


@pytest.mark.parametrize(("kind", "hole"), [(np.uint8, 255), (np.uint16, 65535), (np.int32, -7)])
def test_a_hole_is_the_stored_number_where_a_unit_says_so(tmp_path, kind, hole):
    stored = (waves() * 200).astype(kind)
    stored[20:24, 30:37] = hole
    np.save(tmp_path / "map.npy", stored)
    made = read(tmp_path / "map.npy", no_data=hole, unit=1e-3, steps="keep")
    (found,) = [f for f in made.findings if f.code == "holes-filled"]
    assert found.count == 28 and made.heights.max() * made.height_unit < 0.2


def test_a_hole_that_no_pixel_has_is_told(tmp_path):
    stored = (waves() * 200).astype(np.uint16) + 1
    stored[20:24, 30:37] = 65535
    np.save(tmp_path / "map.npy", stored)
    (found,) = [f for f in read(tmp_path / "map.npy", no_data=65534).findings if f.code == "no-such-hole"]
    assert found.severity == "warning" and found.value == "65534" and "as the file stores it" in found.remedy
    (found,) = [f for f in read(tmp_path / "map.npy", no_data=0).findings if f.code == "no-such-hole"]
    assert found.severity == "info"  # a camera that missed nothing
    for absent in (0.5, -1, 256 + int(stored[0, 0])):  # none of them is rounded or wrapped to one that is there
        assert "no-such-hole" in {f.code for f in from_array(stored.astype(np.uint8), no_data=absent).findings}
    for beyond in (np.nan, np.inf):
        assert from_array(waves(), no_data=beyond).heights.max() < 1
    assert "no-such-hole" not in {f.code for f in from_array(waves(), no_data=np.nan).findings}


@pytest.mark.parametrize("hole", ["a", ["a"], [None], 1j])
def test_a_hole_is_a_number(hole):
    with pytest.raises(DermisError, match="the no_data must be a number"):
        from_array(waves(), no_data=hole)


def measured(kind, number, rows=40, columns=60):
    """Return heights in millimetres, one number where nothing was measured."""
    heights = np.rint(600 + 200 * waves(rows, columns)).astype(kind)
    heights[5:12, 20:30] = number
    return heights


NO_DATA = [
    (np.int16, -9999), (np.int16, -32768), (np.int16, 32767), (np.uint16, 65535), (np.int32, -9999),
    (np.int32, -(2**31)), (np.float32, -9999.0), (np.float32, 65535.0), (np.float64, -32768.0), (np.float64, 5000.25),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "number"), NO_DATA)
@pytest.mark.parametrize("meaning", ["height", "depth"])
def test_a_number_apart_from_all_others_is_asked_about(tmp_path, kind, number, meaning):
    np.save(tmp_path / "map.npy", measured(kind, number))
    made = read(tmp_path / "map.npy", unit=1e-3, meaning=meaning)
    (asked,) = made.findings
    assert (asked.severity, asked.code, asked.count) == ("warning", "no-data-likely", 70)
    assert (
        asked.value == str(int(number) if number == int(number) else number)
        and f"--no-data {asked.value} or --no-data none" in asked.remedy
    )
    assert np.abs(made.heights * made.height_unit).max() > 3.0  # a cliff of metres until somebody answers
    filled = read(tmp_path / "map.npy", unit=1e-3, meaning=meaning, no_data=number)
    assert [f.code for f in filled.findings] == ["holes-filled"] and filled.findings[0].count == 70
    heights = np.abs(filled.heights * filled.height_unit)
    assert 0.39 < heights.min() and heights.max() < 0.81
    np.testing.assert_array_equal(filled.holes, measured(kind, number)[::-1] == np.array(number, kind))
    assert not read(tmp_path / "map.npy", unit=1e-3, meaning=meaning, no_data="none").findings


@pytest.mark.parametrize("meaning", ["height", "depth"])
def test_no_data_of_brightness_is_its_stored_number_too(tmp_path, meaning):
    bright = measured(np.uint16, 0) * np.uint16(70)
    bright[bright == 0] = 65535
    np.save(tmp_path / "map.npy", bright)
    (asked,) = read(tmp_path / "map.npy", meaning=meaning).findings
    assert (asked.code, asked.value) == ("no-data-likely", "65535")
    assert read(tmp_path / "map.npy", meaning=meaning, no_data=65535).heights.max() < 0.9


@pytest.mark.parametrize(
    "values",
    [
        (waves() * 65535 / waves().max()).astype(np.uint16),  # white is its peak
        np.minimum(waves() * 80000, 65535).astype(np.uint16),  # a plateau that the slopes reach
        np.kron(np.eye(6), np.full((8, 8), 65535)).astype(np.uint16),  # a mask
        np.where(waves() > 0.5, 255, 10 + 40 * waves()).astype(np.uint8),  # letters in 8 bit
        np.where(waves() > 0.5, 0.0, 1.0 + waves()),  # ground
        np.random.default_rng(0).normal(0.0, 9999.0, (40, 60)),
        np.kron(np.arange(12).reshape(3, 4), np.full((8, 8), 65535 / 11)).astype(np.uint16),  # terraces up to white
        np.where(waves() > 0.5, 32767, 0).astype(np.int16),  # a mask of signed numbers
        np.linspace(0, 65535, 12).reshape(3, 4).astype(np.uint16),  # a ramp of few pixels
        np.linspace(-9999, 9999, 40).reshape(4, 10),
    ],
)
def test_heights_are_not_taken_for_no_data(tmp_path, values):
    np.save(tmp_path / "map.npy", values)
    assert "no-data-likely" not in {f.code for f in read(tmp_path / "map.npy").findings}


def test_a_sequence_counts_no_data_over_its_maps(tmp_path):
    for i in (1, 2, 3):
        np.save(tmp_path / f"map_{i}.npy", measured(np.int16, -9999))
    (asked,) = read([tmp_path / f"map_{i}.npy" for i in (1, 2, 3)], unit=1e-3).findings
    assert (asked.code, asked.value, asked.count) == ("no-data-likely", "-9999", 210)


@pytest.mark.parametrize(
    ("kind", "meaning", "first", "second"),
    [
        (np.uint16, "depth", 65535, 0),  # depth cameras of two makers
        (np.int16, "height", -32768, -9999),  # mosaics of two tiles
        (np.float32, "height", -32768, -9999),
        (np.int32, "depth", -(2**31), -9999),
    ],
)
def test_after_an_answer_the_rest_is_looked_at_again(tmp_path, kind, meaning, first, second):
    heights = measured(kind, first)
    heights[20:24, 40:50] = second
    np.save(tmp_path / "map.npy", heights)

    def found(no_data):
        made = read(tmp_path / "map.npy", unit=1e-3, meaning=meaning, no_data=no_data)
        return made, [f for f in made.findings if f.code != "holes-filled"]

    (asked,) = found(None)[1]
    assert (asked.code, asked.value, asked.count) == ("no-data-likely", str(first), 70)
    for one, other, count in ((first, second, 40), (second, first, 70)):
        (asked,) = found(one)[1]
        assert asked.code == ("no-data-likely" if other else "zeros-like-holes") and asked.count == count
        assert f"No Data {one}; {other} or {one}; none in" in asked.remedy
        assert f"--no-data {one} --no-data {other} or --no-data {one} --no-data none on" in asked.remedy
        assert f"no_data=({one}, {other}) or no_data=({one}, 'none') in" in asked.remedy
        made, left = found((one, other))
        assert not left and 0.39 < np.abs(made.heights * 1e-3 * (np.iinfo(kind).max if kind != np.float32 else 1)).min()
        np.testing.assert_array_equal(made.holes, (heights[::-1] == first) | (heights[::-1] == second))
        made, left = found((one, "none"))
        assert not left
        np.testing.assert_array_equal(made.holes, heights[::-1] == one)
    (absent,) = found((first, second, -7))[1]
    assert (absent.code, absent.value) == ("no-such-hole", "-7")


@pytest.mark.parametrize("pixels", [1, 2, 20])
@pytest.mark.parametrize(
    ("kind", "number"), [(np.int16, -32768), (np.float32, -9999.0), (np.uint16, 65535), (np.float64, -32768.0)]
)
def test_an_end_of_its_type_is_asked_about_in_few_pixels_too(tmp_path, kind, number, pixels):
    heights = measured(kind, 600, 200, 200)
    heights.ravel()[np.random.default_rng(1).choice(heights.size, pixels, replace=False)] = number
    np.save(tmp_path / "map.npy", heights)
    (asked,) = read(tmp_path / "map.npy", unit=1e-3).findings
    assert (asked.code, asked.value, asked.count) == ("no-data-likely", str(int(number)), pixels)


@pytest.mark.parametrize("levels", [1, 2, 12])
def test_an_end_of_its_type_is_asked_about_beside_few_heights_too(tmp_path, levels):
    heights = np.repeat(5 + np.arange(40) * levels // 40, 60).reshape(40, 60).astype(np.int16)
    heights[5:7, 20:30] = -9999
    np.save(tmp_path / "map.npy", heights)
    (asked,) = read(tmp_path / "map.npy", unit=1e-3).findings
    assert (asked.code, asked.value, asked.count) == ("no-data-likely", "-9999", 20)


def test_few_zeros_of_a_depth_camera_are_asked_about_too(tmp_path):
    depths = np.rint(600 + 200 * waves()).astype(np.uint16)
    depths[7, 9] = 0
    np.save(tmp_path / "map.npy", depths)
    (asked,) = read(tmp_path / "map.npy", unit=1e-3, meaning="depth").findings
    assert (asked.code, asked.count) == ("zeros-like-holes", 1)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None), (" none ", "none"), ("-9999", -9999.0), ("0,5", 0.5), ("65535; 0", (65535.0, 0.0)),
        ("0, 65535", (0.0, 65535.0)), ("-9999 None", (-9999.0, "none")), ("7;", 7.0),
    ],
)  # fmt: skip
def test_words_on_no_data(text, value):
    assert no_data_of(text, "here") == value
    with pytest.raises(DermisError, match="here: not a number that can mean 'no data'"):
        no_data_of("far away", "here")


def test_declared_holes_may_be_a_list_of_booleans():
    declared = np.zeros(waves().shape, bool)
    declared[3, 4] = True
    assert from_array(waves(), declared=declared.tolist()).findings[0].count == 1
    for wrong in ([[True], [True, False]], declared.tolist()[1:], waves(), "all"):
        with pytest.raises(DermisError, match="holes do not fit"):
            from_array(waves(), declared=wrong)


@pytest.mark.filterwarnings("error")
def test_what_single_precision_cannot_hold_is_a_hole(tmp_path):
    values = waves()
    values[5, 5] = 1e300
    np.save(tmp_path / "map.npy", values)
    made = read(tmp_path / "map.npy", no_data=1e300)
    assert [f.code for f in made.findings] == ["holes-filled"] and made.findings[0].count == 1
    assert from_array(values, no_data=-1e300).heights.max() < 1


def test_a_sequence_has_one_type_of_numbers(tmp_path):
    np.save(tmp_path / "map_1.npy", np.full((4, 4), 3, np.uint16))
    np.save(tmp_path / "map_2.npy", np.full((4, 4), 3, np.int32))
    with pytest.raises(DermisError, match="numbers' type"):
        read([tmp_path / "map_1.npy", tmp_path / "map_2.npy"], unit=1e-3)
