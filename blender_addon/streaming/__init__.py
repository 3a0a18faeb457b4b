"""The live link to hardware: session, devices, calibrations and tracks."""

from .. import on_demand

on_demand.modules_of(globals())
