"""One touch, every device: asked for in a panel, worked out by a child process."""

from .. import on_demand

on_demand.modules_of(globals())
