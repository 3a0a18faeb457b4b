"""The same samples of a touch at other times, and the same touch in a longer or a shorter scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .setups import Setup

Rows = NDArray[np.intp]
# A setup, and for each of its samples the sample of the first setup that has the same poses; -1 where none has.
Retimed = Iterator[tuple[Setup, Rows]]
SLOWER, FASTER = 0.25, 2.0  # than the drawn rate
STOP = 11  # samples of a stop; strides have 2 or 4
EARLIER = 13  # samples in the air before the first one


def pace(setup: Setup) -> Retimed:
    """Give the same samples more time or less, and let the touch stop three times on its way."""
    rows, stops = np.arange(setup.count), np.linspace(0, setup.count - 1, 5).astype(int)[1:-1]
    for factor in (SLOWER, FASTER):
        yield replace(setup, rate=factor * setup.rate, looked=setup.looked / factor), rows
    stopped = np.repeat(rows, np.where(np.isin(rows, stops), STOP, 1))
    yield sampled(setup, stopped), stopped


def span(setup: Setup) -> Retimed:
    """Begin earlier, in the air, and end before the way is over: after a third and after two thirds of it."""
    rows = np.arange(setup.count)
    for part in (1, 2):
        until = rows[: part * setup.count // 3 + 1]
        yield sampled(setup, until), until
    before = np.arange(-EARLIER, 0)
    longer = sampled(setup, np.concatenate([np.zeros(EARLIER, int), rows]))
    for _, way in longer.bodies:
        way[:EARLIER, :3, 3] += before[:, None] * (way[EARLIER + 1, :3, 3] - way[EARLIER, :3, 3])
    yield longer, np.concatenate([np.full(EARLIER, -1), rows])


def sampled(setup: Setup, rows: Rows) -> Setup:
    """Return a setup whose samples are some of a setup's; stress is looked at in every sample where it was."""
    looked = np.isin(rows, np.rint(setup.looked * setup.rate).astype(int)).nonzero()[0]
    bodies = tuple((body, way[rows]) for body, way in setup.bodies)
    return replace(setup, bodies=bodies, looked=looked / setup.rate)
