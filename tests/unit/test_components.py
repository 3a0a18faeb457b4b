"""Connected components are numbered as SciPy numbers them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.components import components


def expected(count: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


@pytest.mark.parametrize("edges", [0, 1, 30, 90, 120, 400])
def test_random_graphs_fall_into_the_same_components(edges: int) -> None:
    rng = np.random.default_rng(edges)
    for _ in range(20):
        one, other = rng.integers(0, 100, (2, edges))  # with loops, and some edges several times
        np.testing.assert_array_equal(components(100, one, other), expected(100, one, other))


@pytest.mark.parametrize("order", ["rising", "falling", "shuffled"])
def test_a_long_chain_is_one_component(order: str) -> None:
    nodes = np.arange(2000)
    if order != "rising":
        nodes = nodes[::-1] if order == "falling" else np.random.default_rng(1).permutation(nodes)
    found = components(2001, nodes[1:], nodes[:-1])
    np.testing.assert_array_equal(found, np.append(np.zeros(2000), 1))
