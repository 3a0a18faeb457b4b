"""Lessons: movements for training, and movements for testing.

Both sets have movements of the same kinds. Whole movements are held out for testing, because samples of one movement
are too similar to be split between training and test. The movements for testing are chosen before training.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice
from ..skin.observation import Observer
from ..steps import in_words
from .dataset import Dataset, joined, record, split
from .table import Fit, SampleTable, movement_errors, relative_rms


@dataclass(frozen=True)
class Movements:
    """One kind of movements.

    Attributes:
        share: number of movements of this kind, relative to the requested number of trajectories.
        pressed: number of configurations in the skin in each movement, see `record`.
        learned: share of the movements that are used for training.
    """

    share: float
    pressed: int
    learned: float


# Source: [S0] 4.2, half of straight presses to train and half to test; the other kind is what devices do in use
KINDS = {"straight": Movements(1.0, 1, 0.5), "in_use": Movements(0.35, 3, 0.75)}
FEWEST = 4  # least number of movements of a kind


@dataclass(frozen=True, eq=False)
class Lessons:
    """Movements for training and for testing.

    Attributes:
        data: training set, with movements of all kinds.
        held_out: test set of each kind, by its name in `KINDS`.
    """

    data: Dataset
    held_out: dict[str, Dataset]


def lessons(
    device: DiscDevice, contact: DiscContact, trajectories: int, seed: int = 0, observer: Observer | None = None
) -> Generator[tuple[int, int], None, Lessons]:
    """Record movements of both kinds and hold some out.

    Yields (finished, all) movements and returns the lessons.

    Args:
        device: the mechanism.
        contact: contact of the device's disc with the skin.
        trajectories: number of straight presses; the numbers of other movements are relative to it.
        seed: seed of the movements and of the choice of test movements.
        observer: observer of the components of stress, see `record`; None for none.

    Raises:
        DermisError: the servo limits exclude contact, or nothing is recorded.
    """
    counts = {name: max(round(kind.share * trajectories), FEWEST) for name, kind in KINDS.items()}
    total, before = sum(counts.values()), 0
    parts, held_out = [], {}
    for number, (name, kind) in enumerate(KINDS.items()):
        steps = record(device, contact, counts[name], seed=seed + number, pressed=kind.pressed, observer=observer)
        data = yield from in_words(steps, partial(_of_all, before, total))
        before += counts[name]
        learned, rest = split(data.trajectory, kind.learned, seed)
        parts.append(data.rows(learned))
        held_out[name] = data.rows(rest)
    return Lessons(joined(parts), held_out)


def _of_all(before: int, total: int, step: tuple[int, int]) -> tuple[int, int]:
    return before + step[0], total


def judged(fit: Fit, tables: Mapping[str, SampleTable]) -> dict[str, dict[str, float]]:
    """Return the errors of a fit on held-out tables.

    Returns:
        For each table: 'error', see `relative_rms`; 'most', the 90 % quantile of the movements' errors; and the numbers
        of 'movements' and 'samples'.
    """
    out = {}
    for name, table in tables.items():
        each = movement_errors(fit, table)
        out[name] = {
            "error": relative_rms(fit, table),
            "most": float(np.quantile(each, 0.9)),
            "movements": len(each),
            "samples": len(table.x),
        }
    return out
