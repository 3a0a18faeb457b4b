"""What a skin's stiffening is, in a file: what is written is read, and what does not fit is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.files import write_npz
from core.npz import read_npz
from core.stiffening.cubic import Cubic
from core.stiffening.energy import Energy
from core.stiffening.features import Features
from core.stiffening.following import Following, Learned
from core.stiffening.patterns import Patterns
from core.stiffening.stiffening import Stiffening
from core.stiffening.stress_series import StressSeries
from core.stiffening.symmetric import entries, packed_cubic, packed_forms, rising, side, whole_cubic, whole_forms
from tests.made_up_tissue import no_cubes

EVEN, ODD, RANK, NODES = 3, 2, 4, 7
COUNT, FORMS = EVEN + ODD, 6
MORE, SEEN = 2, 9


def features(rng: np.random.Generator, size: float) -> Features:
    """Return random features, two of them odd."""
    forms = size * rng.normal(size=(FORMS, COUNT, COUNT))
    return Features.of((forms + forms.transpose(0, 2, 1)).astype(np.float32), EVEN, 2)


def small() -> Stiffening:
    """Return a stiffening of random numbers."""
    rng = np.random.default_rng(3)
    energy = Energy(
        Cubic.of(whole_cubic(1e4 * rng.normal(size=entries(COUNT, 3))), EVEN),
        features(rng, 1e4),
        rng.choice([-1.0, 1.0], FORMS),
        rng.uniform(1.0, 2.0, COUNT),
        np.eye(COUNT)[1],
    )
    centres = rng.normal(size=(6, 3)) * 1e-3
    nodes = rng.normal(size=(NODES, 3)) * 1e-3
    stress = StressSeries(
        nodes,
        np.array([[0, 1, 2, 3], [3, 4, 5, 6]]),
        rng.normal(size=(2, 6, RANK)).astype(np.float32),
        (1e9 * rng.normal(size=(RANK, entries(COUNT, 2)))).astype(np.float32),
        (1e13 * rng.normal(size=(RANK, FORMS, COUNT))).astype(np.float32),
        features(rng, 1.0),
    )
    following = Following(
        rng.normal(size=(NODES, 4, RANK + MORE)).astype(np.float32),
        stress.squares.copy(),
        stress.cubes.copy(),
        stress.features,
        Learned(
            (1e4 * rng.normal(size=(SEEN, COUNT))).astype(np.float32), rng.normal(size=(SEEN, MORE)).astype(np.float32)
        ),
    )
    return Stiffening(energy, Patterns.through(centres, rng.normal(size=(6, 3, COUNT))), stress, "a" * 64, following)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    made = small()
    made.write(tmp_path / "one.npz")
    read = Stiffening.read(tmp_path / "one.npz")
    q = 1e-4 * np.random.default_rng(4).normal(size=COUNT)
    places = made.stress.nodes
    assert read.key == made.key and read.count == COUNT
    np.testing.assert_array_equal(read.energy.signs, made.energy.signs)
    np.testing.assert_allclose(read.energy.cubic, made.energy.cubic, rtol=1e-6)
    off = np.abs(read.energy.force(q) - made.energy.force(q)).max()
    assert off <= 2e-3 * np.abs(made.energy.force(q)).max()  # features are told to half precision
    assert read.energy.reach is not None and made.energy.reach is not None
    np.testing.assert_array_equal(read.energy.reach, made.energy.reach)
    assert read.energy.press is not None and made.energy.press is not None
    np.testing.assert_array_equal(read.energy.press, made.energy.press)
    np.testing.assert_allclose(read.patterns.at(places), made.patterns.at(places), atol=1e-5)
    np.testing.assert_array_equal(read.stress.nodes, made.stress.nodes)
    np.testing.assert_array_equal(read.stress.tetrahedra, made.stress.tetrahedra)
    assert np.abs(read.stress.fields - made.stress.fields).max() <= 2.0**-11 * np.abs(made.stress.fields).max()
    assert read.stress.nodal.shape == (NODES, 6, RANK)
    assert read.following is not None and made.following is not None
    moved = made.following.fields
    assert np.abs(read.following.fields - moved).max() <= 2.0**-11 * np.abs(moved).max()
    amounts = made.following.amounts(q)
    assert np.abs(read.following.amounts(q) - amounts).max() <= 2e-3 * np.abs(amounts).max()
    amounts = made.stress.amounts(q)
    assert np.abs(read.stress.amounts(q) - amounts).max() <= 2e-3 * np.abs(amounts).max()


def test_fields_around_a_node_are_averaged_by_volume() -> None:
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -3.0]])
    fields = np.stack([np.full((6, 1), 4.0), np.full((6, 1), 8.0)]).astype(np.float32)
    one = np.ones((1, 1), np.float32)
    series = StressSeries(nodes, np.array([[0, 1, 2, 3], [0, 2, 1, 4]]), fields, one, *no_cubes(1, 1))
    np.testing.assert_allclose(series.nodal[:, 0, 0], [7.0, 7.0, 7.0, 4.0, 8.0])


def test_the_same_numbers_make_the_same_bytes(tmp_path: Path) -> None:
    small().write(tmp_path / "one.npz")
    small().write(tmp_path / "other.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "other.npz").read_bytes()


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("version", np.array(99), "another version"),
        ("version", np.array([2, 2]), "another version"),
        ("cubic", np.ones(34), "do not fit"),
        ("cubic_across", np.ones((EVEN + 1, 3)), "do not fit"),
        ("cubic_across", np.ones((EVEN, 2)), "do not fit"),
        ("signs", np.ones(FORMS - 1), "do not fit"),
        ("energy_first", np.ones((FORMS - 1, 6), np.float16), "do not fit"),
        ("energy_second", np.full((FORMS - 2, 3), np.nan, np.float16), "do not fit"),
        ("energy_across", np.ones((2, 5), np.float16), "do not fit"),
        ("series_first", np.ones((FORMS - 2, 5), np.float16), "do not fit"),
        ("series_across_scale", np.zeros(2, np.float32), "do not fit"),
        ("reach", np.ones(COUNT + 1), "do not fit"),
        ("reach", np.zeros(COUNT), "do not fit"),
        ("displacement", np.ones((6, 3, COUNT + 1), np.float32), "do not fit"),
        ("centres", np.zeros((6, 3)), "places that differ"),
        ("tetrahedra", np.array([[0, 1, 2, NODES]]), "do not fit"),
        ("tetrahedra", np.array([[0, 1, 2, -1]]), "do not fit"),
        ("fields", np.ones((RANK, 6), np.float16), "do not fit"),
        ("squares", np.ones((RANK + 1, entries(COUNT, 2)), np.float16), "do not fit"),
        ("squares_scale", np.zeros(RANK, np.float32), "do not fit"),
        ("cubes", np.ones((RANK, 2), np.float16), "do not fit"),
        ("key", np.ones(3), "do not fit"),
        ("following", np.ones((RANK, 6 * NODES), np.float16), "do not fit"),
        ("following_cubes", np.ones((RANK + 1, FORMS * COUNT), np.float16), "do not fit"),
        ("press", np.ones(COUNT - 1), "do not fit"),
        ("learned_centres", np.ones((SEEN, COUNT - 1), np.float32), "do not fit"),
        ("learned_weights", np.ones((SEEN - 1, MORE), np.float32), "do not fit"),
        ("learned_weights", np.ones((SEEN, MORE + 1), np.float32), "do not fit"),
        ("learned_weights", np.full((SEEN, MORE), np.nan, np.float32), "do not fit"),
        ("following_cubes", np.full((RANK, FORMS * COUNT), np.nan), "do not fit"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, name: str, value: np.ndarray, said: str) -> None:
    small().write(tmp_path / "one.npz")
    write_npz(tmp_path / "bad.npz", {**read_npz(tmp_path / "one.npz"), name: value})
    with pytest.raises(DermisError, match=said):
        Stiffening.read(tmp_path / "bad.npz")


def test_a_number_where_an_array_belongs_is_refused_by_words(tmp_path: Path) -> None:
    small().write(tmp_path / "one.npz")
    whole = read_npz(tmp_path / "one.npz")
    for name in whole.keys() - {"version", "key"}:
        write_npz(tmp_path / "bad.npz", {**whole, name: whole[name].flat[0]})
        with pytest.raises(DermisError, match="do not fit"):
            Stiffening.read(tmp_path / "bad.npz")


def test_a_file_cut_short_is_refused(tmp_path: Path) -> None:
    small().write(tmp_path / "one.npz")
    whole = (tmp_path / "one.npz").read_bytes()
    (tmp_path / "bad.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DermisError):
        Stiffening.read(tmp_path / "bad.npz")


@pytest.mark.parametrize(("count", "power"), [(1, 4), (4, 2), (5, 3), (6, 4)])
def test_rising_choices_are_all_and_in_order(count: int, power: int) -> None:
    from itertools import combinations_with_replacement

    want = np.array(list(combinations_with_replacement(range(count), power)))
    np.testing.assert_array_equal(rising(count, power).T, want)
    assert entries(count, power) == len(want) and side(len(want), power) == count
    assert side(len(want) + 1, power) == 0 or power == 1


def test_packed_tensors_come_back_whole() -> None:
    rng = np.random.default_rng(5)
    cubic, forms = rng.normal(size=entries(4, 3)), rng.normal(size=(3, entries(4, 2)))
    tensor, whole = whole_cubic(cubic), whole_forms(forms)
    for axes in ((0, 2, 1), (1, 0, 2), (2, 1, 0)):
        np.testing.assert_array_equal(tensor, tensor.transpose(axes))
    np.testing.assert_array_equal(whole, whole.transpose(0, 2, 1))
    np.testing.assert_array_equal(packed_cubic(tensor), cubic)
    np.testing.assert_array_equal(packed_forms(whole), forms)


def test_a_file_of_the_version_before_is_refused_with_its_remedy(tmp_path: Path) -> None:
    small().write(tmp_path / "one.npz")
    found = read_npz(tmp_path / "one.npz")
    old = {name: found[name] for name in ("key", "cubic", "reach", "fields")}
    write_npz(tmp_path / "old.npz", {**old, "version": np.array(1)})
    with pytest.raises(DermisError, match="another version") as refused:
        Stiffening.read(tmp_path / "old.npz")
    assert "made again" in str(refused.value)
