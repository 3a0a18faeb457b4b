# mypy: disable-error-code="valid-type"
"""Attach fingers to the hand of an armature; what was found can be corrected in the panel of the last operation."""

from typing import TYPE_CHECKING, Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, IntProperty, StringProperty

from .. import choices, reporting
from .._core import DermisError, Finding
from ..hands import armatures, attachment, rig
from ..hands.bone_names import FINGERS, LEFT, RIGHT
from ..polls import needs
from ..preferences import library
from ..properties import scene_properties
from .work import Work, counted, select_only, zoom

if TYPE_CHECKING:
    from ..hands.skeleton import Hand

SIDES = {LEFT: "left hand", RIGHT: "right hand"}


def has_hand(context: bpy.types.Context) -> bool:
    """Return whether an armature is selected, or what it moves, where fingers can be attached."""
    return context.mode in ("OBJECT", "POSE") and armatures.part_of_hand(context.object)


class DermisTip(bpy.types.PropertyGroup):
    """A finger of a hand, and the bone that carries its tip; its name is the finger's."""

    side: StringProperty(name="Side", description="L or R")
    bone: StringProperty(name="Bone", description="The last bone of this finger")
    use: BoolProperty(name="Attach", description="Put a finger on this bone", default=True)
    flip: BoolProperty(name="Flip", description="Turn it half round: the nail comes where the pad is")


@needs(
    has_hand, "Select an armature, one of its bones in pose mode, a mesh that it moves, or a part that hangs on another"
)
class DERMIS_OT_attach_fingers(Work, bpy.types.Operator):
    """Put a finger on each fingertip of the selected armature's hand, as large as the hand, so that it moves along"""

    bl_idname = "dermis.attach_fingers"
    bl_label = "Attach Fingers to Hand"
    bl_options = {"REGISTER", "UNDO"}

    hand: EnumProperty(
        name="Hand",
        description="Which hand of the armature",
        items=(
            ("AUTO", "Auto", "The hand of the active bone, else the right one"),
            (LEFT, "Left", "The left hand"),
            (RIGHT, "Right", "The right hand"),
            ("BOTH", "Both", "Both hands"),
        ),
        options={"SKIP_SAVE"},
    )
    reading: IntProperty(
        name="Reading",
        description="Which reading of the bones: 1 explains most, the next ones are other bones or other fingers",
        default=1,
        min=1,
        options={"SKIP_SAVE"},
    )
    device: StringProperty(
        name="Device",
        description="Preset of a device to put on each finger; empty for none",
        search=lambda _self, _context, text: choices.search("devices", text),
    )
    skin: BoolProperty(name="Show Skin", description="Solve and show what the skin of each finger feels")
    tips: CollectionProperty(
        name="Fingertips", description="Fingers and their bones", type=DermisTip, options={"SKIP_SAVE"}
    )
    fits: StringProperty(
        name="Fits",
        description="A line for each fingertip: how wide it is, and how far its pad is off the skin",
        options={"HIDDEN", "SKIP_SAVE"},
    )
    found_for: StringProperty(
        name="Found For", description="Armature and hand that the fingertips are of", options={"HIDDEN", "SKIP_SAVE"}
    )

    def work(self, context: bpy.types.Context) -> None:
        """Find the fingertips, unless they are given, and attach fingers."""
        if self.device:
            library().device(self.device)  # refuse an unknown one before anything is made
        hung = rig.read(context)
        hands = self._read(hung, self._hands(hung))
        key = f"{hung.where} {self.hand} {self.reading}"
        if not self.tips or (self.found_for and self.found_for != key):
            self._fill(hung, hands)
            self.found_for = key
        if not any(tip.use for tip in self.tips):
            raise DermisError(
                "no finger is chosen",
                where=hung.where,
                value=", ".join(hung.fingers.values()) + " are there already" if hung.fingers else None,
                remedy="Switch on a finger and choose its bone",
            )
        made: list[bpy.types.Object] = []
        doubts: list[Finding] = []
        lines = [""] * len(self.tips)
        for side, hand in hands.items():
            used = [k for k, t in enumerate(self.tips) if t.use and t.side == side]
            tips = [attachment.Tip(t.name, t.bone, t.flip) for t in (self.tips[k] for k in used)]
            fingers, said, fits = attachment.attach(context, hung, hand, tips)
            for k, fitted in zip(used, fits, strict=True):
                lines[k] = attachment.told(fitted)
            made += fingers
            doubts += said
        self.fits = "\n".join(lines)
        self._dress(context, made)
        what = f"Attached {counted(len(made), 'finger')} to the {' and '.join(SIDES[side] for side in hands)}"
        reporting.report_findings(self, doubts, self.bl_label, f"{what}.")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a row for each finger: whether, which bone, and which way round."""
        layout: Any = self.layout
        armature: Any = armatures.armature_of(context.object)
        layout.row(align=True).prop(self, "hand", expand=True)
        column = layout.column(align=True)
        column.prop(self, "reading")
        for line in self.told.splitlines():
            column.label(text=line)
        column = layout.column(align=True)
        lines = self.fits.split("\n")
        for k, tip in enumerate(self.tips):
            row = column.row(align=True)
            row.prop(tip, "use", text=f"{tip.name.title()} {tip.side}")
            bone = row.row(align=True)
            bone.active = tip.use
            if armature is None or (tip.bone and tip.bone not in armature.data.bones):  # of several parts
                bone.prop(tip, "bone", text="")
            else:
                bone.prop_search(tip, "bone", armature.data, "bones", text="")
            bone.prop(tip, "flip", text="", icon="UV_SYNC_SELECT", toggle=True)
            if tip.use and k < len(lines) and lines[k]:
                said = column.row()
                said.active = False
                said.label(text=lines[k], icon="BLANK1" if " off" not in lines[k] else "ERROR")
        column = layout.column()
        column.use_property_split = True
        column.prop(self, "device")
        column.prop(self, "skin")

    def _hands(self, hung: "rig.Rig") -> "dict[str, Hand]":
        """Return the hands that are asked for, by their side.

        Raises:
            DermisError: there is none, or none on this side.
        """
        sides = hung.by_side()
        if not sides:
            raise DermisError(
                "no hand was found: neither by names of fingers, nor three to five chains that leave one bone",
                where=hung.where,
                value=counted(len(hung.bones), "bone" if hung.has_bones else "part"),
                remedy="In pose mode, select the last bone of a finger and attach to that"
                if hung.has_bones
                else "Parent each finger's links to one another and its first one to the palm, or add single fingers",
            )
        if self.hand == "BOTH":
            return sides
        if self.hand == "AUTO":
            side = next(iter(sides)) if hung.picked or RIGHT not in sides else RIGHT
            return {side: sides[side]}
        if self.hand not in sides:
            raise DermisError(
                f"it has no {SIDES[self.hand]}", where=hung.where, limit=" and ".join(SIDES[side] for side in sides)
            )
        return {self.hand: sides[self.hand]}

    def _read(self, hung: "rig.Rig", hands: "dict[str, Hand]") -> "dict[str, Hand]":
        """Return the reading of each hand that is asked for, and keep words about it and the next one for the panel.

        Raises:
            DermisError: no hand has so many readings.
        """
        most = max(len(hand.readings) for hand in hands.values())
        if self.reading > most:
            raise DermisError(
                "there is no such reading of the bones", where=hung.where, value=self.reading, limit=f"1 to {most}"
            )
        chosen, lines = {}, []
        for side, hand in hands.items():
            count = len(hand.readings)
            number = min(self.reading, count)
            chosen[side] = hand.readings[number - 1]
            lines.append(f"{SIDES[side].capitalize()}, reading {number} of {count}: {chosen[side].told}")
            if number < count:
                lines.append(f"Next: {chosen[side].difference(hand.readings[number])}")
        self.told = "\n".join(lines)
        return chosen

    def _fill(self, hung: "rig.Rig", hands: "dict[str, Hand]") -> None:
        self.tips.clear()
        for side, hand in hands.items():
            for finger in FINGERS:
                chain = hand.chains.get(finger)
                tip: Any = self.tips.add()
                tip.name, tip.side, tip.bone = finger, side, chain.last if chain is not None else ""
                tip.use = chain is not None and chain.last not in hung.fingers

    def _dress(self, context: bpy.types.Context, made: list[bpy.types.Object]) -> None:
        """Give fingers device and skin, and select them where that leaves the mode as it is."""
        for obj in made:
            if self.device:
                obj.dermis.finger.devices.add().preset = self.device
            obj.dermis.finger.skin.shown = self.skin
        if context.mode == "OBJECT":
            select_only(context, made[0])
            for obj in made:
                obj.select_set(True)
            zoom(context)
        scene_properties.begin(context.scene)


CLASSES: tuple[type, ...] = (DermisTip, DERMIS_OT_attach_fingers)
