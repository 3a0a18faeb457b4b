"""What a bake gave, as objects for films and figures; made when somebody asks, and never written by a handler."""

from .. import on_demand

on_demand.modules_of(globals())
