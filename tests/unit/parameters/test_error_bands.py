"""What a model of tissue is said to be off by."""

from __future__ import annotations

import pytest

from core.errors import DermisError
from core.parameters import error_bands
from core.parameters.error_bands import DEPTHS, LINEAR, NEO_HOOKEAN, SLID_AT, SLIDES, error_band, validated

TISSUES = (LINEAR, NEO_HOOKEAN)


@pytest.mark.parametrize("tissue", TISSUES)
def test_the_measured_errors_are_told_where_they_were_measured(tissue: str) -> None:
    for depth, (median, p90) in zip(DEPTHS, error_bands._BY_DEPTH[tissue]["stress"], strict=True):
        assert error_band(tissue, depth).stress == pytest.approx((median, p90))
    row = error_bands._BY_SLIDE[tissue]["force"]
    pressed = error_bands._BY_DEPTH[tissue]["force"][DEPTHS.index(SLID_AT)]
    for slide, (median, _) in zip(SLIDES, row, strict=True):
        assert error_band(tissue, SLID_AT, slide).force.median == pytest.approx(pressed[0] + median - row[0][0])


@pytest.mark.parametrize("tissue", TISSUES)
def test_at_rest_there_is_no_error_and_it_is_continuous_beyond_the_last_depth(tissue: str) -> None:
    assert error_band(tissue, 0.0) == ((0.0, 0.0), (0.0, 0.0))
    between = error_band(tissue, 0.5 * (DEPTHS[0] + DEPTHS[1])).stress.median
    ends = error_band(tissue, DEPTHS[0]).stress.median, error_band(tissue, DEPTHS[1]).stress.median
    assert between == pytest.approx(0.5 * sum(ends))
    for beyond, last in zip(error_band(tissue, 9e-3, 9e-3), error_band(tissue, DEPTHS[-1], SLIDES[-1]), strict=True):
        assert beyond == pytest.approx(last)
    for band in (error_band(tissue, d, s) for d in (1e-4, 1e-3, 2e-3, 5e-3) for s in (0.0, 1e-3, 7e-3)):
        assert 0.0 <= band.stress.median <= band.stress.p90
        assert 0.0 <= band.force.median <= band.force.p90


def test_stiffening_tissue_is_said_to_be_nearer_than_linear_tissue_where_it_was_measured() -> None:
    for depth in DEPTHS:
        assert error_band(NEO_HOOKEAN, depth).stress.median < error_band(LINEAR, depth).stress.median
        assert error_band(NEO_HOOKEAN, depth).force.median < error_band(LINEAR, depth).force.median


def test_what_lies_beyond_the_measured_depths_and_slides_is_said() -> None:
    assert validated(LINEAR, DEPTHS[-1], SLIDES[-1])
    assert not validated(NEO_HOOKEAN, DEPTHS[-1] * 1.01)
    assert not validated(NEO_HOOKEAN, 1e-3, SLIDES[-1] * 1.01)


@pytest.mark.parametrize("given", [("rubber", 1e-3, 0.0), (LINEAR, -1e-3, 0.0), (LINEAR, 1e-3, float("nan"))])
def test_what_is_no_tissue_or_no_length_is_refused(given: tuple[str, float, float]) -> None:
    with pytest.raises(DermisError):
        error_band(*given)
