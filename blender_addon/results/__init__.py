"""Keep bakes, store them in the user folder, and export them to files."""

from .. import on_demand

on_demand.modules_of(globals())
