"""The one place that knows where the engine lives."""

from typing import TYPE_CHECKING

if TYPE_CHECKING or not __package__.startswith("bl_ext."):
    import core  # source checkout, pytest: sibling of this package
else:
    from . import core  # installed extension: build_addon.py puts core/ inside the package

PACKAGE: str = __package__  # of the add-on; the three-part name in an installed extension, and no other will do there
