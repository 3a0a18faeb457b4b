"""Bakes, kept beside the .blend, and their files."""

from .. import on_demand

on_demand.modules_of(globals())
