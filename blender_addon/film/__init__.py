"""Make objects for films and figures from the results of a bake.

They are made on request only, never by a handler.
"""

from .. import on_demand

on_demand.modules_of(globals())
