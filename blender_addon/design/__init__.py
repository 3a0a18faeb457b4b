"""'How many motors?': settings, answers and their pictures."""

from .. import on_demand

on_demand.modules_of(globals())
