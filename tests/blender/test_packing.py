"""Cards in a view: exact places, and nothing over anything else whatever the sizes."""

from __future__ import annotations

import random
from itertools import combinations

import pytest

from blender_addon.hands import bone_names
from blender_addon.viewport import cards, packing
from blender_addon.viewport.packing import Box

pytestmark = pytest.mark.shared_tests("cards are packed by numbers")

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


TACTORS = [145.0] * 5
LARGE = Box(70, 12, 1500, 900)
NARROW = Box(70, 12, 440, 700)


def test_in_a_large_view_everything_is_open() -> None:
    plan = cards.Plan.of(TACTORS[:3], 5, 180, LARGE, (), folded=False)
    assert plan.open_devices == 4 and plan.open_pads and len(plan.devices) == 4 and len(plan.pads) == 5
    assert plan.devices[1] == Box(70, 12 + 2 * 151, 260, 145)
    assert {box.bottom for box in plan.pads} == {12} and plan.pads[-1].right == pytest.approx(1570)


def test_devices_are_folded_where_pads_would_have_no_room() -> None:
    plan = cards.Plan.of(TACTORS, 4, 180, NARROW, (), folded=False)
    assert plan.open_devices == 1 and plan.open_pads
    assert [box.height for box in plan.devices] == [22] * 6
    alone = cards.Plan.of(TACTORS, 0, 180, NARROW, (), folded=False)
    assert alone.open_devices == 3 and len(alone.devices) == 6  # the line, and two devices


def test_what_shall_be_folded_is() -> None:
    plan = cards.Plan.of(TACTORS, 3, 180, LARGE, (), folded=True)
    assert (plan.open_devices, plan.open_pads) == (1, False)
    assert [box.height for box in (*plan.devices, *plan.pads)] == [22] * 9
    assert cards.Plan.of(None, 0, 180, LARGE, (), folded=False) == ([], 0, [], True)
    assert cards.Plan.of([], 0, 180, LARGE, (), folded=False) == ([Box(70, 12, 260, 22)], 1, [], True)


def test_any_number_of_cards_keeps_apart_in_any_view() -> None:
    draw = random.Random(3)
    for _ in range(300):
        room = Box(60, 12, draw.uniform(100, 2000), draw.uniform(60, 1300))
        redo = Box(60, 0, draw.uniform(1, 320), draw.uniform(1, 400))
        heights = [draw.choice([85.0, 145.0, 240.0]) for _ in range(draw.randrange(7))]
        plan = cards.Plan.of(heights, draw.randrange(11), draw.uniform(60, 600), room, (redo,), folded=False)
        for a, b in combinations([*plan.devices, *plan.pads, redo], 2):
            assert not a._replace(left=a.left + 1e-6, width=a.width - 2e-6).meets(b._replace(height=b.height - 1e-6))


def test_cards_stand_in_the_order_of_the_fingers() -> None:
    fingers = ("Index", "Probe", "Little", "Middle", "Ring", "Thumb", "Alpha")
    assert [fingers[i] for i in bone_names.order(fingers, fingers)] == [
        "Thumb",
        "Index",
        "Middle",
        "Ring",
        "Little",
        "Probe",
        "Alpha",
    ]
    names = ("Index", "Thumb", "Index: thimble", "Thumb: thimble")
    assert bone_names.order(names, fingers) == (1, 3, 0, 2)
    hands = ("Thumb.R", "Index.R", "Index.L", "Thumb.L")
    assert [hands[i] for i in bone_names.order(hands, hands)] == ["Thumb.L", "Index.L", "Thumb.R", "Index.R"]
