"""Put fingers on surfaces and along gestures."""

from .. import on_demand

on_demand.modules_of(globals())
