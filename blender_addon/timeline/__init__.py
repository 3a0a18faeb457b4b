"""Results of a bake along the frames: the strip in the timeline and its like."""

from .. import on_demand

on_demand.modules_of(globals())
