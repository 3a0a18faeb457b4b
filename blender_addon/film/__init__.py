"""Results of a bake as objects for films and figures; made on request, and never written by a handler."""

from .. import on_demand

on_demand.modules_of(globals())
