"""MouseTouch: a window in place of the screen, a mouse for the finger."""

from __future__ import annotations

from typing import Any

from .. import clock
from ..errors import DermisError
from .protocols.adapter import Touch
from .touch_input import TouchInput

LONGER_SIDE = 800  # [pixels] of the window
REPEAT = 0.05  # [s] The touch of a finger that rests is repeated after this time, as a panel does.


class MouseTouch(TouchInput):
    """A window in the screen's proportions, touched by the mouse.

    Each call of `finger` handles the window's events. Closing the window ends the touches.

    Args:
        size: size of the screen [m].

    Raises:
        DermisError: no window can be opened here.
    """

    def __init__(self, size: tuple[float, float]) -> None:
        super().__init__("the mouse in the window: press to touch")
        try:
            import tkinter
        except ImportError as error:
            raise _no_window(error) from error
        try:
            self._root: Any = tkinter.Tk()
        except tkinter.TclError as error:
            raise _no_window(error) from error
        self._lost = tkinter.TclError
        self._size, scale = size, LONGER_SIDE / max(size)
        self._pixels = (max(round(size[0] * scale), 1), max(round(size[1] * scale), 1))
        self._root.title("Dermis: press to touch")
        self._root.resizable(False, False)
        canvas = tkinter.Canvas(self._root, width=self._pixels[0], height=self._pixels[1], highlightthickness=0)
        canvas.pack()
        for event in ("<ButtonPress-1>", "<B1-Motion>"):
            canvas.bind(event, lambda e: self._touch(True, e.x, e.y))
        canvas.bind("<ButtonRelease-1>", lambda e: self._touch(False, e.x, e.y))
        self._root.protocol("WM_DELETE_WINDOW", self.close)
        self._root.update()

    def finger(self, now: float) -> Touch | None:
        """Handle the window's events, and return the last touch."""
        if not self.ended:
            try:
                self._root.update()
            except self._lost as error:
                self.ended, self.fault = True, str(error)
        touch = super().finger(now)
        if touch is not None and touch.down and touch.at is not None and clock.now() - touch.at > REPEAT:
            self._take((True, touch.x, touch.y))
        return super().finger(now)

    def close(self) -> None:
        """Close the window; safe to call twice."""
        if not self.ended:
            super().close()
            self._root.destroy()

    def _touch(self, down: bool, px: float, py: float) -> None:
        (width, height), (columns, rows) = self._size, self._pixels
        self._take((down, ((px + 0.5) / columns - 0.5) * width, (0.5 - (py + 0.5) / rows) * height))


def _no_window(error: Exception) -> DermisError:
    return DermisError(
        "no window can be opened here",
        where="--touch mouse",
        value=str(error),
        remedy="Run it on a desktop with tkinter, or send touches by osc://:PORT",
    )
