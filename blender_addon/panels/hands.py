"""The way from a hand to its fingers, where a hand is selected."""

from typing import Any

import bpy

from ..hands import armatures


def button(layout: Any, context: bpy.types.Context) -> None:
    """Draw the button that attaches fingers, where an armature or what it moves is active."""
    if armatures.armature_of(context.object) is not None:
        layout.operator("dermis.attach_fingers", icon="BONE_DATA")
