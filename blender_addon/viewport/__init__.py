"""The drawings of the 3D view: `shown` keeps their contents; draw callbacks only read."""

from .. import on_demand

on_demand.modules_of(globals())
