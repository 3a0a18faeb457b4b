# mypy: disable-error-code="valid-type"
"""Settings of the extension, and the folders that it writes to."""

import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy
from bpy.props import IntProperty

from ._core import PACKAGE, core
from .registration import registration


def user_folder(name: str, *, create: bool = False) -> Path:
    """Return a folder of the extension in the user's profile, such as 'presets'.

    A source checkout has no such place. It uses a folder among the system's temporary files, one for each version of
    Blender.
    """
    if PACKAGE.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(PACKAGE, path=name, create=create))
    from hashlib import sha256
    from tempfile import gettempdir

    checkout = sha256(str(Path(__file__).resolve()).encode()).hexdigest()[:12]
    blender = "{}.{}".format(*bpy.app.version)
    folder = Path(gettempdir()) / f"dermis-source-checkout-{checkout}-{blender}" / name
    if create:
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def presets_folder() -> Path:
    """Return the folder of the user's own presets; it need not exist."""
    return user_folder("presets")


def library() -> "core.presets.Library":
    """Return the built-in presets and the user's own.

    A file is read again when it has changed.
    """
    return library_of(presets_folder())


@lru_cache(maxsize=2)
def library_of(folder: Path) -> "core.presets.Library":
    """Return the built-in presets and those of a folder; any thread may call this."""
    return core.presets.Library(folder)


class DermisPreferences(bpy.types.AddonPreferences):
    """What holds for every file."""

    bl_idname = PACKAGE

    cache_megabytes: IntProperty(
        name="Stored Results [MB]",
        description="Largest total size of stored bakes. The oldest are deleted first; they can be baked again",
        default=512,
        min=16,
        max=1_000_000,
    )

    bake_cores: IntProperty(
        name="Cores for Baking",
        description="Number of processes for a bake. Fingers that do not hold an object together are baked in "
        "parallel, with the same result. 0 takes all cores, up to eight; 1 bakes in Blender itself. Each process takes "
        "about 300 MB",
        default=0,
        min=0,
        max=64,
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the settings."""
        column = self.layout.column()
        column.use_property_split = True
        column.prop(self, "cache_megabytes")
        column.prop(self, "bake_cores")
        row = self.layout.row()
        row.operator("dermis.open_presets", icon="FILE_FOLDER")
        row.operator("dermis.clear_results", icon="TRASH")
        row.operator("dermis.clear_skins", icon="TRASH")


def setting(name: str) -> Any:
    """Return a preference, or its default if the add-on is not enabled."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    if addon is not None and addon.preferences is not None:
        return getattr(addon.preferences, name)
    return DermisPreferences.bl_rna.properties[name].default


_register, unregister = registration((DermisPreferences,))


def register() -> None:
    """Register the settings, and set the folder from which kernels are loaded.

    An extension loads copies of the kernels, because an update replaces the originals.
    """
    _register()
    if PACKAGE.startswith("bl_ext."):
        os.environ[core.kernels.COPIES] = str(user_folder("kernels"))
