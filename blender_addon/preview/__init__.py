"""The state of skins and devices at the current frame.

It is computed in handlers and timers, never while drawing.
"""

from .. import on_demand

on_demand.modules_of(globals())
