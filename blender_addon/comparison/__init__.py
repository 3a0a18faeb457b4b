"""Compare all devices for one touch, in a child process."""

from .. import on_demand

on_demand.modules_of(globals())
