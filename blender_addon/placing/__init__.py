"""Where fingers are put: on surfaces, along gestures, by recordings."""

from .. import on_demand

on_demand.modules_of(globals())
