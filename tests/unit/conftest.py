"""What tests of every folder share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from core.skin.model import SkinModel, fingertip_skin
from tests.clusters import MISSING, Cluster, has_dask


@pytest.fixture(scope="session")
def skin() -> SkinModel:
    """The average fingertip, coarse enough for a test."""
    return fingertip_skin(level="draft")


@pytest.fixture(scope="session")
def cluster() -> Iterator[Cluster]:
    """A dask scheduler and two workers, as processes; it takes seconds to start, so all tests share it."""
    if not has_dask():
        pytest.skip(MISSING)
    with Cluster(2) as made:
        yield made
