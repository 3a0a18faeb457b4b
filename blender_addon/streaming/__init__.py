"""The live link to the hardware: the session, its devices, calibrations and tracks."""

from .. import on_demand

on_demand.modules_of(globals())
