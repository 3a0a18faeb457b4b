"""SkinState: one finger's skin at one frame.

The state is the same for forces from a bake, a live preview or a rendering device.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .._core import Array, core

DRAGGED = 0.1e-3  # [m] a skin with at least this slide counts as dragged


@dataclass(frozen=True, eq=False)
class SkinState:
    """One finger's skin at one frame.

    Attributes:
        finger: name of the object; for a rendered skin, a label that consists of the object's name and the form of the
            device that renders the touch.
        model: model of the skin; None while it is being made, or if it cannot be made (`note` has the reason).
        force: forces on the pad nodes in the finger's frame [N], shape (m, 3).
        normal_force, tangential_force: total forces on the pad [N].
        depth, lift: penetration and displacement of the bone [m], see the engine's `SkinStep`.
        sticking, slipping: number of sticking and of slipping nodes.
        source: 'bake', 'live', 'stale', 'earlier' or 'none'.
        note: remark on the state for the user.
        work: kind of work of the contact solver: 'solved', 'unchanged', 'same', 'idle' or 'baked'; 'rendered' for the
            skin as a device renders it.
        converged: whether the residual of contact is within the solver's tolerance.
        counters: counts of solved and skipped work, by name.
        points: the same forces on the points of the smooth skin at which they act; None if contact is solved at nodes.
        amounts: displacement of the pad nodes in linear skin minus that in nonlinear skin [m], see the engine's
            `Stimulus.given`, shape (3 m,); None for linear skin.
        slide: mean tangential displacement of the loaded skin by friction [m].
        coarse: whether the frame was reached in fewer steps than contact needs.
        waits: whether a table of the skin is being made.
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
        """Return the state of a skin from a sample of the engine."""
        return cls(finger, model, source=source, note=note, counters=counters, **vars(step))

    @property
    def tissue(self) -> str:
        """The law of the tissue: 'linear' or 'neo_hookean'."""
        return "linear" if self.model is None else str(self.model.tissue)

    @property
    def dragged(self) -> bool:
        """Whether friction drags the skin far enough to inform the user."""
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
