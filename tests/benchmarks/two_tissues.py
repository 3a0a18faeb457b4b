"""Touches on linear tissue and beside it on the same finger of neo-Hookean tissue, for the pages of figures.

A page has a section about the law. It can be computed anew alone, since the other figures of a page take long.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.contact.solver.law_skin import Fold
from core.errors import DermisError
from core.files import write_bytes
from core.skin.model import SkinModel
from core.skin.observation import stress_error, stress_vector, touch_of
from core.skin.stimulus import Stimulus
from tests import touches

HEADING = "## On neo-Hookean tissue"

Judged = tuple[Stimulus, Stimulus]  # the touch, and what the device made of it


class Felt(NamedTuple):
    """One frame of a touch on both tissues.

    Attributes:
        linear, law: state of the skin on linear and on neo-Hookean tissue.
        sound: whether the law converged, and found an equilibrium without a fold.
    """

    linear: Stimulus
    law: Stimulus
    sound: bool


def felt_on_both(law: SkinModel, touch: touches.Touch) -> Iterator[Felt]:
    """Yield what is felt of a touch, frame after frame, on linear tissue and on a skin that follows the law."""
    linear = law.linear
    soft, stiff = (touches.solver_on(skin) for skin in (linear, law))
    assert stiff.law is not None
    for i in range(len(touch.position)):
        one, other = soft.step(touch.bodies(i)), stiff.step(touch.bodies(i))
        sound = stiff.law.settled and stiff.law.fold is not Fold.KEPT
        yield Felt(touch_of(linear, one.nodal), touch_of(law, other.nodal, other.amounts), sound)


def left(judged: list[Judged]) -> float:
    """Return how much of the whole stress is left over all frames, relative to the touch."""
    sizes = np.array([np.linalg.norm(stress_vector(target)) for target, _ in judged])
    errors = np.array([stress_error(target, made) for target, made in judged])
    return float(np.linalg.norm(errors * sizes) / np.linalg.norm(sizes))


def renew(page: Path, section: str) -> None:
    """Write a page with another section about the law, and leave all else.

    Raises:
        DermisError: the page has no such section.
    """
    before, old, after = _cut(page.read_text(encoding="utf-8"))
    if not old:
        raise DermisError("no section to renew", where=str(page), limit=HEADING, remedy="Make the whole page once")
    write_bytes(page, (before + section + after).encode())


def _cut(text: str) -> tuple[str, str, str]:
    start = text.find(HEADING + "\n")
    if start < 0:
        return text, "", ""
    end = text.find("\n## ", start + len(HEADING))
    end = len(text) if end < 0 else end + 1
    return text[:start], text[start:end], text[end:]
