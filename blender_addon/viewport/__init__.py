"""The drawings of the 3D view.

`shown` keeps their contents, and draw callbacks only read these.
"""

from .. import on_demand

on_demand.modules_of(globals())
