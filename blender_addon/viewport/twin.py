"""Twin: the drawing of a device on its finger."""

from __future__ import annotations

from typing import Any, NamedTuple

from .parts import Line, Part


class Twin(NamedTuple):
    """The finished drawing of a device, in the finger's frame [m].

    Attributes:
        solid: the device itself. hidden: the part that is drawn where something is in front.
        covers: whether it hides later drawings.
        lines: drawn over both.
        state: for its card in the corner: `Pins`, a thimble's `Joints`, a platform's `State`, or None.
    """

    solid: Part
    hidden: Part
    covers: bool = True
    lines: tuple[Line, ...] = ()
    state: Any = None
