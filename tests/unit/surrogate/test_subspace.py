"""Principal components against what is known of them: rank, the singular value decomposition, and the error curve."""

from __future__ import annotations

import numpy as np
import pytest

from core.errors import DermisError
from core.surrogate.subspace import principal_components


def kept(space, samples):
    """Return what a subspace keeps of samples."""
    return space.project(samples) @ space.basis + space.mean


@pytest.mark.parametrize("shape", [(200, 12), (10, 40)])
def test_the_curve_is_the_relative_rms_that_is_left(shape):
    rng = np.random.default_rng(0)
    samples = rng.normal(size=shape) * np.geomspace(1, 1e-2, shape[1]) + 5.0
    centred = samples - samples.mean(axis=0)
    whole = np.linalg.norm(centred)
    _, singular, vectors = np.linalg.svd(centred, full_matrices=False)
    for size in (1, 3, 6):
        space = principal_components(samples, size=size)
        np.testing.assert_allclose(space.basis @ space.basis.T, np.eye(size), atol=1e-12)
        np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", space.basis, vectors[:size])), 1.0, atol=1e-8)
        left = np.linalg.norm(samples - kept(space, samples)) / whole
        assert left == pytest.approx(np.sqrt((singular[size:] ** 2).sum()) / whole, rel=1e-9)
        assert space.curve[size] == pytest.approx(left, rel=1e-9)
    assert space.curve[0] == pytest.approx(1.0) and space.curve[-1] == 0.0
    assert (np.diff(space.curve) <= 1e-15).all()


def test_the_tolerance_is_of_the_residual_not_of_the_variance():
    """10 % of the variance is 32 % of the residual: with singular values 1 and 0.2 the second is still wanted."""
    samples = np.array([[1, 0], [-1, 0], [0, 0.2], [0, -0.2]], float)
    assert principal_components(samples, tolerance=0.10).size == 2
    assert principal_components(samples, tolerance=0.20).size == 1  # sqrt(0.08 / 2.08) = 0.196


def test_exact_rank_is_found_and_signs_are_settled():
    rng = np.random.default_rng(1)
    samples = rng.normal(size=(60, 3)) @ rng.normal(size=(3, 20)) + 1.0
    space = principal_components(samples, tolerance=1e-6)
    assert space.size == 3
    np.testing.assert_allclose(kept(space, samples), samples, atol=1e-10)
    again = principal_components(samples[::-1], tolerance=1e-6)
    np.testing.assert_allclose(again.basis, space.basis, atol=1e-8)


@pytest.mark.parametrize(
    ("samples", "keys", "words"),
    [
        (np.zeros((1, 4)), {}, "two samples"),
        (np.ones((5, 4)), {}, "alike"),
        (np.full((5, 4), np.nan), {}, "not finite"),
        (np.eye(4), {"size": 9}, "out of range"),
    ],
)
def test_what_has_no_components_is_refused(samples, keys, words):
    with pytest.raises(DermisError, match=words):
        principal_components(samples, **keys)
