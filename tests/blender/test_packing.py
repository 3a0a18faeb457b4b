"""Cards in a view: exact places, and nothing over anything else whatever the sizes."""

from __future__ import annotations

import random
from itertools import combinations

import pytest

from blender_addon.viewport import cards, packing
from blender_addon.viewport.packing import Box

ROOM = Box(10, 10, 600, 400)


def test_a_column_stands_on_the_lower_edge_with_the_first_card_on_top() -> None:
    assert packing.columns([100, 50, 20], 200, ROOM, (), 6) == [
        Box(10, 92, 200, 100),
        Box(10, 36, 200, 50),
        Box(10, 10, 200, 20),
    ]


def test_what_does_not_go_into_a_column_begins_the_next() -> None:
    assert packing.columns([200, 194, 100], 200, ROOM, (), 6) == [
        Box(10, 210, 200, 200),
        Box(10, 10, 200, 194),
        Box(216, 10, 200, 100),
    ]
    assert packing.columns([400, 400, 400, 400], 200, ROOM, (), 6) == [Box(10, 10, 200, 400), Box(216, 10, 200, 400)]


def test_from_the_right_it_is_the_mirror_image() -> None:
    assert packing.columns([100, 350], 200, ROOM, (), 6, right=True) == [Box(410, 10, 200, 100), Box(204, 10, 200, 350)]


def test_a_column_stands_above_the_redo_panel_and_below_blenders_text() -> None:
    redo, text = Box(10, 0, 250, 150), Box(10, 360, 300, 60)
    assert packing.columns([100, 90, 10], 200, ROOM, (redo, text), 6) == [
        Box(10, 252, 200, 100),
        Box(10, 156, 200, 90),
        Box(216, 156, 200, 10),  # the panel is wider than a column
    ]


def test_a_strip_that_is_taken_whole_is_passed_over() -> None:
    assert packing.columns([50], 100, ROOM, (Box(0, 0, 150, 500),), 6) == [Box(156, 10, 100, 50)]
    assert packing.columns([50], 100, ROOM, (Box(0, 0, 700, 500),), 6) == []


def test_rows_end_at_the_right_in_order() -> None:
    assert packing.rows([100, 100, 100], 150, ROOM, (), 6) == [
        Box(298, 10, 100, 150),
        Box(404, 10, 100, 150),
        Box(510, 10, 100, 150),
    ]
    beside = packing.rows([100] * 5, 150, ROOM, (Box(10, 10, 260, 300),), 6)  # the devices
    assert [box.left for box in beside] == [298, 404, 510, 404, 510]
    assert [box.bottom for box in beside] == [10, 10, 10, 166, 166]


def test_only_as_many_as_it_takes_are_folded() -> None:
    narrow = Box(0, 0, 200, 300)

    def fold(count: int) -> tuple[int, list[Box]]:
        return packing.folding([100.0] * count, 20.0, lambda heights: packing.columns(heights, 200, narrow, (), 0))

    assert fold(3)[0] == 3
    assert fold(4) == (2, [Box(0, 140, 200, 100), Box(0, 40, 200, 100), Box(0, 20, 200, 20), Box(0, 0, 200, 20)])
    assert (fold(15)[0], len(fold(15)[1])) == (0, 15)
    assert (fold(20)[0], len(fold(20)[1])) == (0, 15)  # the last of them is for the words that five are missing
    assert packing.folding([1.0], 1.0, lambda _: []) == (0, [])


def test_nothing_lies_over_anything_else() -> None:
    for seed in range(500):
        in_a_random_view(random.Random(seed))


def in_a_random_view(draw: random.Random) -> None:
    """Place cards among random obstacles, and look at every pair."""
    room = Box(draw.uniform(0, 60), draw.uniform(0, 20), draw.uniform(50, 2500), draw.uniform(50, 1400))

    def box() -> Box:
        return Box(draw.uniform(-50, 1500), draw.uniform(-50, 900), draw.uniform(1, 500), draw.uniform(1, 500))

    taken = [box() for _ in range(draw.randrange(5))]
    gap = draw.uniform(0, 12)
    lengths = [draw.uniform(10, 300) for _ in range(draw.randrange(1, 12))]
    devices = packing.columns(lengths, draw.uniform(40, 300), room, taken, gap, right=draw.random() < 0.5)
    maps = packing.rows([draw.uniform(50, 200)] * 6, draw.uniform(50, 300), room, [*taken, *devices], gap)
    near = 1e-6
    for a, b in combinations([*devices, *maps], 2):
        assert not Box(a.left + near, a.bottom + near, a.width - 2 * near, a.height - 2 * near).meets(b)
    for place in (*devices, *maps):
        inner = Box(place.left + near, place.bottom + near, place.width - 2 * near, place.height - 2 * near)
        assert not any(inner.meets(other) for other in taken)
        assert place.left >= room.left - near and place.right <= room.right + near
        assert place.bottom >= room.bottom - near and place.top <= room.top + near
    assert [place.height for place in devices] == pytest.approx(lengths[: len(devices)])


def test_cards_stand_in_the_order_of_the_fingers() -> None:
    fingers = ("Index", "Probe", "Little", "Middle", "Ring", "Thumb", "Alpha")
    assert [fingers[i] for i in cards.order(fingers, fingers)] == [
        "Thumb",
        "Index",
        "Middle",
        "Ring",
        "Little",
        "Probe",
        "Alpha",
    ]
    names = ("Index", "Thumb", "Index: thimble", "Thumb: thimble")
    assert cards.order(names, fingers) == (1, 3, 0, 2)
    hands = ("Thumb.R", "Index.R", "Index.L", "Thumb.L")
    assert [hands[i] for i in cards.order(hands, hands)] == ["Thumb.L", "Index.L", "Thumb.R", "Index.R"]
