"""The way from a hand to its fingers, where a hand is selected."""

from typing import Any

import bpy

from ..hands import armatures


def button(layout: Any, context: bpy.types.Context) -> None:
    """Draw the button that attaches fingers, where an armature, its mesh, or a part of a hand is active."""
    if armatures.part_of_hand(context.object):
        layout.operator("dermis.attach_fingers", icon="BONE_DATA")
