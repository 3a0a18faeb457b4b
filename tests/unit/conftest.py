"""What tests of every folder share."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from functools import partial

import pytest

from core.design import trial
from core.design.interactions import interaction
from core.skin.model import SkinModel, fingertip_skin
from tests.clusters import MISSING, Cluster, has_dask


@pytest.fixture(autouse=True)
def signals_as_they_were() -> Iterator[None]:
    """Put signals back as they were: a stream that one has ended ignores all others until its program has ended.

    Programs that later tests start would ignore them too.
    """
    before = {number: signal.getsignal(number) for number in signal.valid_signals()}
    yield
    for number, handler in before.items():
        if signal.getsignal(number) is not handler and handler is not None:
            signal.signal(number, handler)


@pytest.fixture(scope="session")
def skin() -> SkinModel:
    """The average fingertip, coarse enough for a test."""
    return fingertip_skin(level="draft")


@pytest.fixture
def short_touches(monkeypatch: pytest.MonkeyPatch) -> None:
    """The six interactions once instead of three times, where it is not how often that matters."""
    monkeypatch.setattr(trial, "interaction", partial(interaction, repetitions=1))


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """A dask scheduler and two workers, as processes.

    It takes 3 s of processor time to start, and 2 % of a processor as long as it is there: one for each file is cheaper
    than one for a run of 20 minutes.
    """
    if not has_dask():
        pytest.skip(MISSING)
    with Cluster(2) as made:
        yield made
