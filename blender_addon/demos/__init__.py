"""Example scenes that show what Dermis does, built from nothing."""

from .. import on_demand

on_demand.modules_of(globals())
