"""Compare with Stored Tracks: a bake's commands and those of older files."""

from __future__ import annotations

from typing import Any

import bpy

from .. import reporting
from .._core import core
from ..polls import needs
from ..results import store
from .work import Folder

TEXT = "Migration Report"


@needs(lambda context: store.current(context.scene) is not None, "Bake first")
class DERMIS_OT_migrate_report(Folder, bpy.types.Operator):
    """Compare the baked commands with tracks that were exported from this scene before, by finger, device and frame. A warning lists each device whose commands changed by more than 0.1 % of their range; a text has all channels"""  # noqa: E501

    bl_idname = "dermis.migrate_report"
    bl_label = "Compare with Stored Tracks"
    bl_options = {"REGISTER"}

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the folder's tracks, compare, and show what changed."""
        migration, result = core.comparison.migration, store.current(context.scene)
        assert result is not None
        stored, unread = migration.stored_tracks([self.folder()])
        found, doubts = migration.migrations(result.bake, stored)
        text = bpy.data.texts.get(TEXT) or bpy.data.texts.new(TEXT)
        text.from_string(migration.table(found) + "\n")
        told = [one.finding(migration.CHANGED) for one in found]
        changed: list[Any] = [finding for finding in told if finding is not None]
        reporting.show([*changed, *doubts, *unread], f"Stored tracks of {context.scene.name}")
        return f"{len(changed)} of {len(found)} tracks changed; the text '{TEXT}' has every channel"


CLASSES: tuple[type, ...] = (DERMIS_OT_migrate_report,)
