"""Attach fingers to existing hands: find fingertips, their bones and skin."""

from .. import on_demand

on_demand.modules_of(globals())

FINGERS = ("thumb", "index", "middle", "ring", "little")
LEFT, RIGHT = "L", "R"
