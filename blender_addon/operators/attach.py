# mypy: disable-error-code="valid-type"
"""Attach fingers to the hand of an armature.

The panel of the last operation corrects the result.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from .. import layouts, reporting
from .._core import DermisError, Finding
from ..hands import FINGERS, LEFT, RIGHT, armatures, attachment, rig
from ..polls import needs
from ..preferences import library
from ..properties import scene_properties
from ..properties.fields import device_name
from .work import Work, counted, select_only, zoom

if TYPE_CHECKING:
    from ..hands.skeleton import Hand

REDO_PANEL = 300.0  # [px at scale 1] width of the redo panel, whatever its contents
COLUMNS = (0.29, 0.45)  # share of it for a finger's name, and share of the rest for the width
SIDES = {LEFT: "left hand", RIGHT: "right hand", "": "hand"}


def has_hand(context: bpy.types.Context) -> bool:
    """Return whether fingers can be attached to the hand of the active object."""
    return context.mode in ("OBJECT", "POSE") and armatures.part_of_hand(context.object)


class DermisTip(bpy.types.PropertyGroup):
    """A finger of a hand, and the bone that carries its tip; its name is the finger's."""

    side: StringProperty(name="Side", description="L or R; empty if the side is unknown")
    bone: StringProperty(name="Bone", description="Last bone of this finger")
    use: BoolProperty(name="Attach", description="Add a fingertip to this bone", default=True)
    flip: BoolProperty(
        name="Flip", description="Turn the fingertip by 180 degrees about the bone, so that pad and nail change sides"
    )


class DermisTipSize(bpy.types.PropertyGroup):
    """How large a finger of a hand is. By itself, since scripts have to give all that `DermisTip` has."""

    width_mm: FloatProperty(
        name="Width [mm]",
        description="Width of the finger, measured on the hand unless you set it here. 0 measures it again",
        min=0.0,
        soft_max=40.0,
        precision=1,
        step=10,
    )
    found_mm: FloatProperty(name="Found Width [mm]", description="Width measured on the hand", options={"HIDDEN"})

    @property
    def said(self) -> float:
        """Width that a person has set [m]; 0 if it is the width that was found."""
        return 0.0 if abs(self.width_mm - self.found_mm) < 1e-3 else 1e-3 * float(self.width_mm)


@needs(
    has_hand, "Select an armature, one of its bones in pose mode, a mesh that it moves, or a part that hangs on another"
)
class DERMIS_OT_attach_fingers(Work, bpy.types.Operator):
    """Add a fingertip to each finger of the selected armature's hand. Each has the size of the hand's finger and is
    parented to its bone"""

    bl_idname = "dermis.attach_fingers"
    bl_label = "Attach Fingers to Hand"
    bl_options = {"REGISTER", "UNDO"}

    hand: EnumProperty(
        name="Hand",
        description="Hands that get fingertips",
        items=(
            ("AUTO", "Auto", "The hand of the active bone; without one, the right hand, unless only the left has skin"),
            (LEFT, "Left", "The left hand"),
            (RIGHT, "Right", "The right hand"),
            ("BOTH", "Both", "Both hands"),
        ),
        options={"SKIP_SAVE"},
    )
    reading: IntProperty(
        name="Interpretation",
        description="Interpretation of the bones. 1 fits best; the others take other bones, or name the fingers "
        "differently",
        default=1,
        min=1,
        options={"SKIP_SAVE"},
    )
    device: StringProperty(name="Device", description="Key of a device preset; empty for none", options={"HIDDEN"})
    device_name: device_name("device", "Device for each finger. If empty, no device is added")
    skin: BoolProperty(name="Show Skin", description="Simulate and show the skin of each finger")
    tips: CollectionProperty(
        name="Fingertips", description="Fingers and their bones", type=DermisTip, options={"SKIP_SAVE"}
    )
    sizes: CollectionProperty(
        name="Sizes", description="Width of each finger", type=DermisTipSize, options={"SKIP_SAVE"}
    )
    fits: StringProperty(
        name="Fits", description="Distance between pad and skin of each fingertip", options={"HIDDEN", "SKIP_SAVE"}
    )
    found_for: StringProperty(
        name="Found For",
        description="Armature and hand to which the fingertips belong",
        options={"HIDDEN", "SKIP_SAVE"},
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
        while len(self.sizes) < len(self.tips):
            self.sizes.add()
        for side, hand in hands.items():
            used = [k for k, t in enumerate(self.tips) if t.use and (t.side == side or not (t.side and side))]
            rows = ((self.tips[k], self.sizes[k]) for k in used)
            tips = [attachment.Tip(t.name, t.bone, t.flip, size.said) for t, size in rows]
            fingers, said, fits = attachment.attach(context, hung, hand, tips, side)
            for k, fitted in zip(used, fits, strict=True):
                lines[k] = attachment.where(fitted, short=True)
                if not self.sizes[k].said:
                    self.sizes[k].width_mm = self.sizes[k].found_mm = 1e3 * fitted.width
            made += fingers
            doubts += said
        self.fits = "\n".join(lines)
        self._dress(context, made)
        what = f"Attached {counted(len(made), 'finger')} to the {' and '.join(SIDES[side] for side in hands)}"
        reporting.report_findings(self, doubts, self.bl_label, f"{what}.")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a heading, and two rows for each finger.

        The first has its switch, its width and its distance from the skin. The second has its bone, over the whole
        width since names of bones are long, and its flip.
        """
        layout: Any = self.layout
        armature: Any = armatures.armature_of(context.object)
        layout.row(align=True).prop(self, "hand", expand=True)
        layout.prop(self, "reading")
        for line in self.told.splitlines():
            layouts.words(layout, line, REDO_PANEL)
        column = layout.column(align=True)
        lines = self.fits.split("\n")
        head = column.split(factor=COLUMNS[0])
        head.label(text="")
        head = head.split(factor=COLUMNS[1])
        for text in ("Width [mm]", "Pad"):
            head.label(text=text)
        for k, tip in enumerate(self.tips):
            row = column.split(factor=COLUMNS[0])
            row.prop(tip, "use", text=f"{tip.name.title()} {tip.side}".rstrip())
            if tip.use and k < min(len(lines), len(self.sizes)) and lines[k]:
                row = row.split(factor=COLUMNS[1])
                row.prop(self.sizes[k], "width_mm", text="")
                row.label(text=lines[k], icon="NONE" if lines[k] == attachment.ON_SKIN else "ERROR")
            bone = column.row(align=True)
            bone.active = tip.use
            if armature is None or (tip.bone and tip.bone not in armature.data.bones):  # of several parts
                bone.prop(tip, "bone", text="")
            else:
                bone.prop_search(tip, "bone", armature.data, "bones", text="")
            bone.prop(tip, "flip", text="", icon="UV_SYNC_SELECT", toggle=True)
        column = layout.column()
        column.use_property_split = True
        column.prop(self, "device_name", placeholder="None")
        column.prop(self, "skin")

    def _hands(self, hung: "rig.Rig") -> "dict[str, Hand]":
        """Return the chosen hands, by their side.

        Raises:
            DermisError: there is no hand, or none on the chosen side.
        """
        sides = hung.by_side()
        if not sides:
            raise DermisError(
                "no hand was found: neither by names of fingers, nor three to five chains that leave one bone",
                where=hung.where,
                value=counted(len(hung.bones), "bone" if hung.has_bones else "part"),
                remedy="In pose mode, select the last bone of a finger and attach to that. Where each finger has an "
                "armature of its own, select them all"
                if hung.has_bones
                else "Parent each finger's links to one another and its first one to the palm, or add single fingers",
            )
        if self.hand == "BOTH":
            return sides
        if self.hand == "AUTO":
            if not hung.picked:
                sides = {side: hand for side, hand in sides.items() if hung.has_skin(hand)} or sides
            side = next(iter(sides)) if hung.picked or RIGHT not in sides else RIGHT
            return {side: sides[side]}
        only = next(iter(sides.values()))
        if len(hung.hands) == 1 and not only.side:  # no name gives the side: the person does
            rivals = tuple(replace(rival, side=self.hand, given=True) for rival in only.rivals)
            return {self.hand: replace(only, side=self.hand, rivals=rivals, given=True)}
        if self.hand not in sides:
            raise DermisError(
                f"it has no {SIDES[self.hand]}", where=hung.where, limit=" and ".join(SIDES[side] for side in sides)
            )
        return {self.hand: sides[self.hand]}

    def _read(self, hung: "rig.Rig", hands: "dict[str, Hand]") -> "dict[str, Hand]":
        """Return the chosen reading of each hand, by its side; keep words about it.

        The panel draws these words. If no names give the side, another reading may be of the other side: its thumb is
        then the little finger of the first reading.

        Raises:
            DermisError: no hand has so many readings, or both hands are read as the same side.
        """
        most = max(len(hand.readings) for hand in hands.values())
        if self.reading > most:
            raise DermisError(
                "there is no such interpretation of the bones",
                where=hung.where,
                value=self.reading,
                limit=f"1 to {most}",
            )
        chosen: dict[str, Hand] = {}
        lines = []
        for asked, hand in hands.items():
            count = len(hand.readings)
            number = min(self.reading, count)
            reading = hand.readings[number - 1]
            side = asked if number == 1 else hung.side_of(reading) or asked
            if side in chosen:
                raise DermisError(
                    f"both hands are read as a {SIDES[side]}",
                    where=hung.where,
                    value=f"interpretation {self.reading}",
                    remedy="Choose one hand, or another value of Interpretation",
                )
            chosen[side] = reading
            lines += [f"{SIDES[side].capitalize()}: interpretation {number} of {count}", reading.told]
            if number < count:
                lines.append(f"Interpretation {number + 1}: {reading.difference(hand.readings[number])}")
        self.told = "\n".join(lines)
        return chosen

    def _fill(self, hung: "rig.Rig", hands: "dict[str, Hand]") -> None:
        self.tips.clear()
        self.sizes.clear()
        for side, hand in hands.items():
            for finger in FINGERS:
                chain = hand.chains.get(finger)
                tip: Any = self.tips.add()
                tip.name, tip.side, tip.bone = finger, side, chain.last if chain is not None else ""
                tip.use = chain is not None and chain.last not in hung.fingers

    def _dress(self, context: bpy.types.Context, made: list[bpy.types.Object]) -> None:
        """Give fingers the device and the skin; in object mode, select them."""
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


CLASSES: tuple[type, ...] = (DermisTip, DermisTipSize, DERMIS_OT_attach_fingers)
