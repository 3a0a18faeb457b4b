"""A sender, a host, or both are suspended in the middle of a stream: nothing goes on by itself at the receiver."""

from __future__ import annotations

import pytest

from tests import exits, suspensions
from tests.unit.stream.stream_box import posix

pytestmark = [pytest.mark.real_time, posix]

serial = pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")


@pytest.mark.parametrize("kind", sorted(suspensions.KINDS))
@pytest.mark.parametrize("protocol", exits.PROTOCOLS)
def test_nothing_goes_on_by_itself(kind: str, protocol: str) -> None:
    with exits.Receiver(protocol) as receiver:
        found = suspensions.KINDS[kind](receiver, 0.7)
        assert suspensions.went_on(protocol, "", found) == "", found


@pytest.mark.parametrize("silence", ["retracts", "keeps"])
def test_the_way_to_safety_begins_where_the_board_is(silence: str) -> None:
    with exits.Receiver("maestro") as receiver:
        found = suspensions.of_sender(receiver, 0.7, f"silence={silence}")
        assert found["commands"], "the safe state was said"
        assert suspensions.went_on("maestro", silence, found) == "", found
