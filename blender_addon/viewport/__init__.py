"""The drawings of the 3D view: `shown` has them worked out and keeps them; draw callbacks only read."""

from .. import on_demand

on_demand.modules_of(globals())
