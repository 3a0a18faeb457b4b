"""Friction of a skin's nodes by the kernels: against NumPy, and what is refused; `test_compiled.py` has the bytes."""

from __future__ import annotations

import numpy as np
import pytest

from core.kernels import library, records
from tests.kernel_cases.case import opened
from tests.kernel_cases.contacts import drawn_friction


def test_damaged_records_are_refused() -> None:
    own = opened(library.kernels().path)
    assert drawn_friction(4).call(own) == [records.DONE] * 6
    assert drawn_friction(4).call(own, count=-1)[:5] == [records.BAD_RECORD] * 5
    for name, value in (("owner", 3), ("owner", -2), ("below", 3), ("below", -2)):
        drawn = drawn_friction(4)
        drawn.arrays[name][0] = value
        assert records.BAD_RECORD in drawn.call(own), name
    drawn = drawn_friction(9)
    drawn.arrays["entering"][0] = len(drawn.arrays["gap"])
    assert drawn.call(own)[3] == records.BAD_RECORD
    for name in ("poses", "image", "force"):
        drawn = drawn_friction(5)
        drawn.arrays[name].flat[1] = np.nan
        assert records.NOT_FINITE in drawn.call(own), name


@pytest.mark.parametrize("seed", range(12))
def test_anchors_offsets_and_shifts_are_those_of_numpy(seed: int) -> None:
    """The formulas of `history.py` and `within_frame.py`, in the fewest words."""
    drawn, was = drawn_friction(seed), drawn_friction(seed).arrays
    assert not any(drawn.call(opened(library.kernels().path)))
    rows = was["poses"][was["owner"]]
    turn, carry = rows[:, :9].reshape(-1, 3, 3), rows[:, 12:21].reshape(-1, 3, 3)
    anchors = np.einsum("nij,njk,nk->ni", turn, carry, was["material"]) + rows[:, 9:12]
    on = was["owner"] >= 0
    np.testing.assert_allclose(drawn.arrays["anchors"][on], anchors[on], rtol=1e-12, atol=1e-18)
    same, normal = on & (was["owner"] == was["below"]), was["facing"]
    b = np.where(same[:, None], was["points"] - anchors, 0.0)
    b += (np.where(was["below"] >= 0, was["gaps"], 0.0) - (b * normal).sum(axis=1))[:, None] * normal

    def across(v: np.ndarray) -> np.ndarray:
        return v - (v * normal).sum(axis=1)[:, None] * normal

    swept, force = across(b + was["image"]), across(was["force"])
    length, size = np.linalg.norm(force, axis=1), np.linalg.norm(was["slip"], axis=1)
    square = (was["swept"] ** 2).sum(axis=1) + 0.01 * size**2
    slip = np.clip((swept * was["swept"]).sum(axis=1) / square, 0.0, 2.0) * size
    x = np.maximum(slip / np.maximum(length * was["own"], 1e-300), 1e-2)
    slid = (was["loaded"] == 1) & (was["sticking"] == 0) & (was["owner"] == was["below"]) & (was["friction"] > 0.0)
    nodes = slid.nonzero()[0]
    shift = 0.7 * ((1.0 + 1.0 / x + 1.0 / np.expm1(-x)) * slip)[:, None] * force / np.maximum(length, 1e-300)[:, None]
    assert drawn.record.shifted == len(nodes)
    np.testing.assert_array_equal(drawn.arrays["nodes"][: len(nodes)], nodes)
    np.testing.assert_allclose(drawn.arrays["shift"][: len(nodes)], shift[nodes], rtol=1e-9, atol=1e-15)
    b[nodes] += shift[nodes]
    np.testing.assert_allclose(drawn.arrays["offset"], b, rtol=1e-9, atol=1e-15)


def test_a_frame_moves_the_anchors_of_all_that_do_not_stick() -> None:
    drawn, was = drawn_friction(3), drawn_friction(3).arrays
    assert not any(drawn.call(opened(library.kernels().path)))
    now, near = drawn.arrays, was["below"] >= 0
    np.testing.assert_array_equal(now["owner"], was["below"])
    np.testing.assert_array_equal(now["sticking"], near & (was["status"] == 1))
    stays = (was["status"] == 1) & (was["owner"] == was["below"])
    stays[now["nodes"][: drawn.record.shifted]] = stays[was["entering"]] = False
    np.testing.assert_array_equal(now["renewed"], near & ~stays)
    moved = now["renewed"] == 1
    rows = was["poses"][was["below"]]
    turn, back = rows[:, :9].reshape(-1, 3, 3), rows[:, 21:30].reshape(-1, 3, 3)
    own = np.einsum("nik,njk,nj->ni", back, turn, now["positions"] - rows[:, 9:12])
    np.testing.assert_allclose(now["material"][moved], own[moved], rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(now["material"][~moved], was["material"][~moved])
    np.testing.assert_allclose(now["gap"], np.maximum((was["moved"] * was["facing"]).sum(axis=1), 0.0), atol=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_sums_are_those_of_numpy(seed: int) -> None:
    drawn = drawn_friction(seed)
    assert not any(drawn.call(opened(library.kernels().path)))
    of, sums = drawn.arrays, drawn.sums
    press = (of["force"] * of["facing"]).sum(axis=1)
    tangential = (of["force"] - press[:, None] * of["facing"]).sum(axis=0)
    assert sums.normal == pytest.approx(press.sum(), rel=1e-12)
    assert sums.tangential == pytest.approx(np.linalg.norm(tangential), rel=1e-9)
    sizes = np.linalg.norm(of["force"], axis=1)
    assert sums.size == pytest.approx(sizes.sum(), rel=1e-12)
    np.testing.assert_allclose(sums.resultant, of["force"].sum(axis=0), atol=1e-12 * sums.size)
    np.testing.assert_allclose(sums.mean, sizes @ of["image"] / max(sizes.sum(), 1e-300), rtol=1e-9, atol=1e-18)
    assert (sums.sticking, sums.slipping) == ((of["status"] == 1).sum(), (of["status"] == 2).sum())
    up = press @ of["facing"]
    up /= max(np.linalg.norm(up), 1e-300)
    mean = press @ of["image"] / press.sum() if press.sum() > 0 else np.zeros(3)
    assert sums.slide == pytest.approx(np.linalg.norm(mean - (mean @ up) * up), rel=1e-9, abs=1e-15)
    if sums.from_rest:
        assert sums.depth == max(-of["gaps"].min(), 0.0)


def test_sums_without_force_are_zero() -> None:
    drawn = drawn_friction(0)
    drawn.arrays["force"][:] = 0.0
    assert not any(drawn.call(opened(library.kernels().path)))
    assert drawn.sums.size == 0.0 and not any(drawn.sums.resultant) and not any(drawn.sums.mean)
