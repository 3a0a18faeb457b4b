# mypy: disable-error-code="valid-type"
"""Add > Dermis: example scenes, each built in a new scene and shown in the view."""

from typing import Any

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

from .. import choices
from ..demos import demo_motors, demo_pins, demo_scene, demo_skin, demo_stage, demo_thimble, touches
from ..properties.fields import device_name
from .work import Work


class _Demo(Work):
    """Builds a scene, shows it in the window, and names the next step."""

    bl_options = {"REGISTER", "UNDO"}
    next_step = ""

    def build(self) -> bpy.types.Scene:
        """Return the new scene."""
        raise NotImplementedError

    def look(self, context: bpy.types.Context) -> None:
        """Turn the views to it."""
        demo_stage.look_at_skins(context)

    def work(self: Any, context: bpy.types.Context) -> str | None:
        """Build the scene, and turn the views to it."""
        choices.refresh()
        scene = self.build()
        if context.window is None:
            self.report({"WARNING"}, f"No window: the demo is in scene '{scene.name}'")
            return None
        context.window.scene = scene
        self.look(context)
        return str(self.next_step)


class DERMIS_OT_demo_scene(_Demo, bpy.types.Operator):
    """Open an example in a new scene: fingers stroke a plate, lift a box and feel a touch screen"""

    bl_idname = "dermis.demo_scene"
    bl_label = "Demo Scene"
    next_step = "Play the animation, then press Bake in the Dermis tab"

    def build(self) -> bpy.types.Scene:
        """Return the scene with the first devices that fit."""
        return demo_scene.build(choices.first_of_kind("shear_tactor"), choices.first_of_kind("friction_screen"))

    def look(self, context: bpy.types.Context) -> None:
        """Turn the views to it."""
        demo_scene.look(context)


class DERMIS_OT_demo_skin_scene(_Demo, bpy.types.Operator):
    """Open an example in a new scene: fingertips press and slide over a sphere, an edge and a ribbed plate"""

    bl_idname = "dermis.demo_skin_scene"
    bl_label = "Demo Skin Scene"
    next_step = "Play the animation to see the skin; Bake in the Dermis tab keeps its forces"

    fingers: EnumProperty(
        name="Fingers",
        description="Fingers of the scene and their objects",
        items=(
            ("ONE", "One", "One finger touches one object after the other"),
            ("FIVE", "Five", "Five fingers touch five objects at once"),
            (
                "TISSUES",
                "Two Tissues",
                "A finger of linear and one of neo-Hookean tissue press into one block, side by side",
            ),
        ),
    )

    def build(self) -> bpy.types.Scene:
        """Return the scene."""
        return demo_skin.build({"ONE": 1, "TISSUES": 2, "FIVE": 5}[self.fingers])


class DERMIS_OT_demo_pins_scene(_Demo, bpy.types.Operator):
    """Open the paper's experiment in a new scene: a plane is pressed into the finger and then slides"""

    bl_idname = "dermis.demo_pins_scene"
    bl_label = "Demo Pin Array Scene"
    next_step = "Bake in the Dermis tab, then play: pins, target and rendered skin"

    depth: FloatProperty(
        name="Depth [mm]", description="Depth to which the plane is pressed", default=2.0, min=0.01, max=4.0
    )
    friction: FloatProperty(
        name="Friction",
        description="Coefficient of friction between skin and surface",
        default=0.6,
        min=0.0,
        max=10.0,
        soft_max=1.0,
    )
    direction: FloatProperty(
        name="Direction",
        description="Direction of the slide: 0 is to the finger's right, 90 to its tip",
        default=0.0,
        subtype="ANGLE",
    )

    def build(self) -> bpy.types.Scene:
        """Return the scene."""
        return demo_pins.build(1e-3 * self.depth, self.friction, self.direction)


class DERMIS_OT_demo_thimble_scene(_Demo, bpy.types.Operator):
    """Open one of the paper's touches in a new scene"""

    bl_idname = "dermis.demo_thimble_scene"
    bl_label = "Demo Thimble Scene"
    next_step = "Play the animation: twin, target and rendered skin. Bake keeps the servo angles"

    touch: EnumProperty(
        name="Touch", description="Object that the finger touches", items=touches.items(touches.THIMBLE)
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Return what this touch is."""
        return touches.THIMBLE[properties.touch][1]

    def build(self) -> bpy.types.Scene:
        """Return the scene."""
        return demo_thimble.build(self.touch)


class DERMIS_OT_demo_motors_scene(_Demo, bpy.types.Operator):
    """Open one of the paper's six interactions in a new scene: a flat surface, moved by a trembling hand, touches the
    finger three times"""

    bl_idname = "dermis.demo_motors_scene"
    bl_label = "Demo Interaction"
    next_step = "Bake in the Dermis tab, then ask How Many Motors? there"

    touch: EnumProperty(
        name="Touch", description="Movement of the finger over a flat surface", items=touches.items(touches.MOTORS)
    )
    device: StringProperty(
        name="Device", description="Device preset, by its file name", default=touches.PLATFORM, options={"HIDDEN"}
    )
    device_name: device_name("device", "Device of the finger")
    seed: IntProperty(name="Seed", description="Seed of the hand's tremor", default=0, min=0, soft_max=100)

    def build(self) -> bpy.types.Scene:
        """Return the scene."""
        return demo_motors.build(self.touch, self.device, self.seed)


CLASSES: tuple[type, ...] = (
    DERMIS_OT_demo_scene,
    DERMIS_OT_demo_skin_scene,
    DERMIS_OT_demo_pins_scene,
    DERMIS_OT_demo_thimble_scene,
    DERMIS_OT_demo_motors_scene,
)
