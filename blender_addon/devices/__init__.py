"""Prepare presets, skins and tables of devices in a scene for the engine."""

from .. import on_demand

on_demand.modules_of(globals())
