"""Show results of a bake along the frames, as the strip in the timeline."""

from .. import on_demand

on_demand.modules_of(globals())
