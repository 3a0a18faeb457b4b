"""The exact law of a fingertip's tissue in a few fields, from touches of its mesh that are solved exactly."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..arrays import Array
from ..skin.material import Elastic
from ..skin.model import SkinModel, fingertip_skin
from ..skin.shape import FingertipShape
from ..steps import in_words
from .exact_finger import ExactFinger
from .held_tissue import HeldTissue
from .neo_hookean import NeoHookean
from .sampled_fit import SampledSize, fit_bases, fit_elements
from .sampled_table import SampledTable
from .stiffening_fit import reach_of
from .touches import Ranges, Touch, shown, touches

STEPS = 100  # that making one is told in
TOUCHED = 92  # of the steps: touches
SEED = 7700  # of the touches
# Presses and slides of every length, and slides as long as friction holds, that begin before the pad and end behind it.
TOUCHES = Ranges(depths=(1.0e-3, 2.6e-3), slides=(0.0, 7e-3))
DRAGS = Ranges(depths=(1.4e-3, 2.6e-3), slides=(4e-3, 9e-3), frictions=(0.3, 0.6, 0.6), back=0.4)
KEPT = 2  # every which of a touch's poses is kept, and the last
TOLERANCE = 1e-5  # of the exact balance, over the forces
MARGIN = 1.05  # of what touches bring, up to which the law is asked


@dataclass(frozen=True)
class TableSize:
    """How much is seen and kept.

    Attributes:
        level: of the mesh. touches, drags: solved exactly. fields: what is kept of them.
    """

    level: str = "standard"
    touches: int = 85
    drags: int = 46
    fields: SampledSize = field(default_factory=SampledSize)


STANDARD = TableSize()


def fit_table(
    shape: FingertipShape, poisson: float, size: TableSize | None = None, *, seed: int = SEED, key: str = ""
) -> Generator[tuple[int, int], None, SampledTable]:
    """Return the table of a fingertip's tissue; yields (done, STEPS).

    Args:
        seed: of the touches; the next is that of the drags. key: that the result is to have.

    Raises:
        DermisError: a shape that cannot be meshed.
    """
    size = size or STANDARD
    yield 0, STEPS
    skin = fingertip_skin(shape, Elastic(poisson=poisson), level=size.level)
    drawn = touches(skin, size.touches, seed, TOUCHES) + touches(skin, size.drags, seed + 1, DRAGS)
    seen = shown(drawn, partial(states_of, ExactFinger(skin, TOLERANCE)))
    states = yield from in_words(seen, lambda step: (TOUCHED * step[0] // step[1], STEPS))
    yield TOUCHED, STEPS
    return table_of(skin, np.concatenate(states), size.fields, key=key)


def states_of(finger: ExactFinger, touch: Touch) -> Array:
    """Return displacements of all nodes along a touch, as far as Newton's method follows it, shape (s, n, 3) [m]."""
    finger.reset()
    out, before = [], None
    for n, bodies in enumerate(touch.poses()):
        try:
            held = finger.step(bodies, before)
        except ArithmeticError:  # tissue gives way there, or an element turns inside out
            break
        before = bodies
        if held.force.any() and (n % KEPT == KEPT - 1 or n == len(touch.ways) - 1):
            out.append(held.displacement)
    return np.array(out).reshape(-1, *finger.displacement.shape)


def table_of(skin: SkinModel, states: Array, size: SampledSize, *, key: str = "") -> SampledTable:
    """Return the table of a skin that was seen in some states, displacements of all nodes [m], shape (s, n, 3)."""
    stiffness = np.linalg.inv(skin.unit_compliance)
    tissue = NeoHookean(skin.mesh, skin.material.poisson)
    bases = fit_bases(HeldTissue(tissue), 0.5 * (stiffness + stiffness.T), states, size)
    elements, weights = fit_elements(tissue, bases, size)
    return SampledTable(
        bases.pad.astype(np.float32),
        bases.beneath.reshape(len(bases.beneath), -1).astype(np.float32),
        bases.pressure.astype(np.float32),
        elements,
        weights.astype(np.float32),
        MARGIN * reach_of(bases.amounts[:, : len(bases.pad)]),
        key,
    )
