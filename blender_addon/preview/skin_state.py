"""One finger's skin at one frame, wherever its forces come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .._core import Array, core

DRAGGED = 0.1e-3  # [m] slide from which on a skin counts as dragged


@dataclass(frozen=True, eq=False)
class SkinState:
    """One finger's skin at one frame.

    Attributes:
        finger: the object's name; for a rendered skin, a label of the object's name and the device that renders it.
        model: the skin; None while it is being made, or if it cannot be made (`note` has the reason).
        force: on the pad nodes in the finger's frame [N], shape (m, 3).
        normal_force, tangential_force: totals [N]. depth, lift: [m], see the engine's `SkinContact`.
        sticking, slipping: number of nodes.
        source: 'bake', 'live', 'stale', 'earlier' or 'none'. note: a remark on it for the reader.
        work: kind of work of the contact solver: 'solved', 'unchanged', 'same', 'idle' or 'baked'; 'rendered' for the
            skin as a device renders it.
        converged: whether the frame passed the solver's own check.
        counters: counts of solved and skipped work, by name.
        points: the same forces on the points of the smooth skin at which they act; None if contact is solved on nodes.
        amounts: the state of stiffening tissue that a touch keeps, see the engine's `Stimulus.given`; None if linear.
        slide: how far friction has drawn the loaded skin along itself [m].
        coarse: the frame was reached in fewer steps than contact needs. waits: a table of the skin is being made.
    """

    finger: str
    model: Any  # the engine's `SkinModel`; `Any`, so that code for touched skins need not test for None
    force: Array
    normal_force: float = 0.0
    tangential_force: float = 0.0
    depth: float = 0.0
    lift: float = 0.0
    sticking: int = 0
    slipping: int = 0
    source: str = "none"
    note: str = ""
    work: str = "idle"
    converged: bool = True
    counters: Mapping[str, int] = field(default_factory=dict)
    points: core.skin.point_forces.PointForces | None = None
    amounts: Array | None = None
    slide: float = 0.0
    coarse: bool = False
    waits: bool = False

    @classmethod
    def of(
        cls,
        finger: str,
        model: Any,
        step: core.contact.skin_contact.SkinStep,
        source: str,
        note: str,
        counters: Mapping[str, int],
    ) -> SkinState:
        """Return the state of a skin from one sample of the engine's."""
        return cls(finger, model, source=source, note=note, counters=counters, **vars(step))

    @property
    def tissue(self) -> str:
        """The law of the tissue: 'linear' or 'neo_hookean'."""
        return "linear" if self.model is None else str(self.model.tissue)

    @property
    def dragged(self) -> bool:
        """Whether friction drags the skin so far that the person should know."""
        return self.slide >= DRAGGED

    @property
    def too_deep(self) -> bool:
        """Whether the skin is pressed deeper than its tissue is trusted."""
        return self.depth > core.contact.trusted.trusted(self.tissue).depth

    @property
    def too_far(self) -> bool:
        """Whether the skin is dragged farther than its tissue is trusted."""
        return self.slide > core.contact.trusted.trusted(self.tissue).slide

    @property
    def touching(self) -> bool:
        """Whether any node carries force."""
        return self.normal_force > 0.0
