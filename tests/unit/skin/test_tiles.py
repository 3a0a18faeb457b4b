"""Tiles: squares and bars of a pad, how they are cut, and what they share."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.pad_chart import PadChart
from core.skin.shape import FingertipShape
from core.skin.tiles import ALONG, AROUND, BOTH
from tests.overlaps import overlap


@pytest.fixture(scope="module")
def chart():
    return PadChart.of(FingertipShape())


def test_every_tile_is_found_where_it_lies(chart):
    tiles = chart.tiles
    every = np.arange(len(chart.places))
    np.testing.assert_array_equal(tiles.find(tiles.root, tiles.halved, tiles.place), every)
    np.testing.assert_allclose(chart.halves, chart.halves[tiles.root] / (1 << tiles.halved))
    places = chart.places[tiles.root] + chart.halves * (2 * tiles.place + 1) - chart.halves[tiles.root]
    np.testing.assert_allclose(chart.places, places, atol=1e-13)


def test_parts_cover_what_they_are_cut_from(chart):
    tiles = chart.tiles
    whole = np.array([5, chart.starts[1] + 87, tiles.first[0, 1] + 91, tiles.first[1, 2] + 803])
    for way in (ALONG, AROUND, BOTH):
        parts, owner = tiles.cut(whole, tiles.ways[tiles.halved[whole, 0], tiles.halved[whole, 1], way])
        assert len(np.unique(owner)) == len(whole)
        areas = np.bincount(owner, chart.cells.areas[parts])
        np.testing.assert_allclose(areas, chart.cells.areas[whole], rtol=3e-3)
        one, two, share = overlap(tiles, whole, parts)
        np.testing.assert_allclose(np.bincount(one, share), 1.0)
        np.testing.assert_array_equal(np.sort(owner), np.sort(one))
        assert len(np.unique(two)) == len(parts)
    children, _ = tiles.cut(whole[:2], np.array([BOTH, BOTH]))
    assert set(children) == set(chart.children(whole[:2]).ravel())


def test_bars_are_rows_of_squares(chart):
    tiles = chart.tiles
    bars = np.array([tiles.first[0, 3] + 11, tiles.first[2, 1] + 4, chart.starts[2]])
    squares, owner = tiles.squares(bars)
    assert np.bincount(owner).tolist() == [8, 2, 1]
    assert (np.diff(tiles.halved[squares], axis=1) == 0).all()
    for k in range(2):
        np.testing.assert_allclose(np.bincount(owner, chart.places[squares, k]) / [8, 2, 1], chart.places[bars, k])
