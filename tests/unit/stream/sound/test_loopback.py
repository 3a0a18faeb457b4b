"""A sound card with a cable from out to in, simulated: what is measured is what the card was made with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from core.__main__ import main
from core.errors import DermisError
from core.stream.sound.card import open_card
from core.stream.sound.loopback import lowest, measure
from core.stream.sound.measured_card import MeasuredCard

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")


def found(options: str = "", rate: int = 48_000) -> MeasuredCard:
    return measure(open_card(f"virtual:{options}", rate))


@pytest.mark.parametrize("rate", [48_000, 96_000])
def test_gain_latency_and_corner_are_those_of_the_card(rate: int) -> None:
    for options, gain, latency, corner in (
        ("", 0.8, 0.012, 2.0),
        ("?gain=0.3&latency_ms=37&corner=12", 0.3, 0.037, 12),
    ):
        card = found(options, rate)
        assert card.gain == pytest.approx(gain, rel=5e-3)
        assert card.latency == pytest.approx(latency, abs=2e-5) and card.jitter < 1e-5
        assert corner <= card.corner * 1.001 and card.corner == pytest.approx(corner, abs=0.5)
        assert card.loudest == 1.0 and card.rate == rate


def test_below_the_lowest_frequency_more_than_half_a_percent_is_lost() -> None:
    card = found("?corner=12")
    ratio = card.corner / lowest(card)
    assert (1.0 + ratio**2) ** -0.5 == pytest.approx(0.995) and lowest(card) == pytest.approx(
        10.0 * card.corner, rel=0.01
    )


def test_clipping_and_jitter_are_found() -> None:
    assert found("?clip=0.75").loudest == 0.7
    assert found("?clip=0.6").loudest == 0.5
    assert found("?jitter_ms=0.6").jitter == pytest.approx(0.6e-3, abs=0.1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("?gain=0", "received nothing.*Connect the card's output"),
        ("?drift=0.001", r"input and output run at different rates \(found '-?\+?\d+ ppm'"),
        ("?drift=-0.0003", "different rates"),
        ("?tears=1", "different rates|has gaps"),
        ("?noise=0.1", "different rates|has gaps"),
        ("?gone=20000", "the sound card is gone"),
        ("?volume=1", "no such option"),
        ("?gain=loud", "not a number"),
    ],
)
def test_a_card_that_cannot_be_measured_is_refused(options: str, words: str) -> None:
    with pytest.raises(DermisError, match=words):
        found(options)


def test_the_verb_prints_and_writes_what_it_found(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "card.json"
    assert main(["stream", "loopback", "--card", "virtual:?corner=1", "--out", str(path)]) == 0
    said = capsys.readouterr().out
    assert "latency 12.00 ms" in said and "gain 0.79" in said or "gain 0.80" in said
    card = MeasuredCard.load(path)
    assert card.name == "virtual:?corner=1" and card.rate == 48_000 and card.dumps() == path.read_text("utf-8")
    path.write_text(path.read_text("utf-8").replace('"jitter"', '"jiter"'), "utf-8")
    with pytest.raises(DermisError, match="no measured sound card"):
        MeasuredCard.load(path)
