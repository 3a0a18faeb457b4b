"""Hands that people own: which bones are fingertips, where their skin is, and fingers that are attached there."""

from .. import on_demand

on_demand.modules_of(globals())

FINGERS = ("thumb", "index", "middle", "ring", "little")
LEFT, RIGHT = "L", "R"
