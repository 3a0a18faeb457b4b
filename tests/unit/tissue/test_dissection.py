"""The direct solver, against dense algebra."""

import numpy as np
from scipy.sparse import csr_array

from core.tissue.dissection import Dissection


def test_dissection_condenses_and_solves_like_dense_algebra():
    rng = np.random.default_rng(1)
    places, n = rng.random((300, 3)), 300
    near = np.linalg.norm(places[:, None] - places[None], axis=2) < 0.15
    a = np.where(near, rng.standard_normal((n, n)), 0.0)
    a = a + a.T + 40.0 * np.eye(n)
    negative = np.arange(n) % 4 == 3
    a = np.where(negative[:, None] & negative[None], -a, a)
    kept = np.zeros(n, bool)
    kept[:40:4] = True
    found = Dissection(csr_array(a), np.arange(n), negative, kept, places)
    rest = ~kept
    schur = a[np.ix_(kept, kept)] - a[np.ix_(kept, rest)] @ np.linalg.solve(
        a[np.ix_(rest, rest)], a[np.ix_(rest, kept)]
    )
    np.testing.assert_allclose(found.schur, schur, atol=1e-10)
    given = rng.standard_normal(kept.sum())
    inner = -np.linalg.solve(a[np.ix_(rest, rest)], a[np.ix_(rest, kept)] @ given)
    x, residual = found.solve(given)
    np.testing.assert_allclose(x[rest], inner, atol=1e-10)
    assert residual < 1e-10
