"""What is no number is held at the last good one, chunk after chunk, and told once with its first frame."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.errors import DermisError
from core.parameters.material import BODY
from core.scene.tactile_scene import Body, Chunk, TactileScene
from core.surface.repairs import Repairs

N = 8
FRAMES = 1.0 + np.arange(N) / 10
BAD = np.array([True, False, True, True, False, False, True, False])
SCENE = TactileScene("scene", Fraction(24), (1, 2), 24.0, (), (Body("ball", None),), (), ())
HELD = [1, 1, 1, 1, 4, 5, 5, 7]  # the sample that stands in; before the first good one that one does


def chunk(values: np.ndarray, i: int, j: int) -> Chunk:
    none = np.zeros((0, j - i, 4, 4))
    return Chunk(FRAMES[i:j], FRAMES[i:j], none, none, none, {}, {"body/0/friction": values[i:j]})


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("cuts", [(), (3,), (1, 2, 6)])
def test_an_animated_value_is_held(wrong: float, cuts: tuple[int, ...]) -> None:
    values = np.arange(N) ** 2 + 0.5
    edges = [0, *cuts, N]
    chunks = [chunk(np.where(BAD, wrong, values), i, j) for i, j in zip(edges, edges[1:], strict=False)]
    repairs = Repairs()
    np.testing.assert_array_equal(repairs.animated(chunks, FRAMES, SCENE)["body/0/friction"], values[HELD])
    (found,) = repairs.findings()
    assert (found.code, found.severity, found.frame, found.count) == ("not-finite", "error", 1.0, int(BAD.sum()))


@pytest.mark.parametrize("cuts", [(), (2,), (6,), (2, 3, 4, 7)])
def test_a_pose_is_held_across_chunks(cuts: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    good = rng.normal(size=(2, N, 4, 4))
    given = good.copy()
    given[1, BAD, 2, 3] = np.nan
    repairs, edges = Repairs(), [0, *cuts, N]
    mended = [
        repairs.poses("finger", ["thumb", "index"], given[:, i:j], FRAMES[i:j])
        for i, j in zip(edges, edges[1:], strict=False)
    ]
    got = np.concatenate(mended, axis=1)
    np.testing.assert_array_equal(got[0], good[0])
    np.testing.assert_array_equal(got[1], good[1, HELD])
    assert np.isnan(given[1, 0, 2, 3]), "what was handed over stays as it is"
    (found,) = repairs.findings()
    assert "finger 'index'" in str(found) and (found.frame, found.count) == (1.0, int(BAD.sum()))


def test_a_pose_that_never_was_a_number_is_nowhere_in_particular() -> None:
    got = Repairs().poses("object", ["ball"], np.full((1, 3, 4, 4), np.nan), FRAMES[:3])
    np.testing.assert_array_equal(got, np.tile(np.eye(4), (1, 3, 1, 1)))


def test_values_that_cannot_be_joined_are_refused() -> None:
    values = np.arange(float(N))
    whole = chunk(values, 0, N)
    with pytest.raises(DermisError, match="never a finite number"):
        Repairs().animated([chunk(values * np.nan, 0, N)], FRAMES, SCENE)
    with pytest.raises(DermisError, match="one number per sample"):
        Repairs().animated([whole], FRAMES[:-1], SCENE)
    other = Chunk(FRAMES, FRAMES, whole.fingers, whole.bodies, whole.screens, {}, {})
    nobody = replace(SCENE, bodies=())
    with pytest.raises(DermisError, match="missing from some"):
        Repairs().animated([whole, other], np.tile(FRAMES, 2), nobody)


@pytest.mark.parametrize("parameters", [{"friction": 0.75}, {}])
def test_where_a_chunk_brings_no_value_that_of_the_header_holds(parameters: dict[str, float]) -> None:
    scene = replace(SCENE, bodies=(Body("ball", None, parameters),))
    values = np.arange(float(N))
    late = chunk(values, 4, N)
    early = replace(chunk(values, 0, 4), animated={})
    constant = parameters.get("friction", BODY["friction"].absent)
    got = Repairs().animated([early, late], FRAMES, scene)["body/0/friction"]
    np.testing.assert_array_equal(got, [constant] * 4 + [4, 5, 6, 7])
