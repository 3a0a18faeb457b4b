"""Twin: what is drawn of a device on its finger."""

from __future__ import annotations

from typing import Any, NamedTuple

from .parts import Line, Part


class Twin(NamedTuple):
    """What is drawn of a device, in the finger's frame [m], finished: a draw callback only draws it.

    Attributes:
        solid: what it looks like. hidden: what shows of it where something is in front.
        covers: whether it hides what is drawn after it.
        lines: drawn over both.
        state: what its card in the corner reads: `Pins`, a thimble's `Joints`, a platform's `State`, or None.
    """

    solid: Part
    hidden: Part
    covers: bool = True
    lines: tuple[Line, ...] = ()
    state: Any = None
