"""Which preset, skin and table an item of the scene uses, prepared for the engine."""

from .. import on_demand

on_demand.modules_of(globals())
