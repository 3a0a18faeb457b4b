"""What tests of every folder share."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import pytest

from core.design import trial
from core.design.interactions import interaction
from core.skin.model import SkinModel, fingertip_skin
from tests.clusters import MISSING, Cluster, has_dask


@pytest.fixture(scope="session")
def skin() -> SkinModel:
    """The average fingertip, coarse enough for a test."""
    return fingertip_skin(level="draft")


@pytest.fixture
def short_touches(monkeypatch: pytest.MonkeyPatch) -> None:
    """The six interactions once instead of three times, where it is not how often that matters."""
    monkeypatch.setattr(trial, "interaction", partial(interaction, repetitions=1))


@pytest.fixture(scope="session")
def cluster() -> Iterator[Cluster]:
    """A dask scheduler and two workers, as processes; it takes seconds to start, so all tests share it."""
    if not has_dask():
        pytest.skip(MISSING)
    with Cluster(2) as made:
        yield made
