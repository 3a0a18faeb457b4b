"""Settings of a whole scene: bake and display."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from .. import compat
from .._core import core
from ..registration import registration
from .fields import declared, redrawn, touched, unfelt
from .skin_properties import DermisSkinView


class DermisThimbleView(bpy.types.PropertyGroup):
    """Display of thimbles in the 3D view beside their twin. A thimble's method is set on its device."""

    split: BoolProperty(
        name="Split View",
        description="Show the skin as the thimble renders it beside the target, as maps of the pad. "
        "Needs the finger's skin to be shown",
        default=True,
        options=set(),
        update=redrawn,
    )
    workspace: BoolProperty(
        name="Workspace",
        description="Draw the range of the pointer under the disc at several heights. Each loop is the largest tilt in "
        "every direction",
        default=False,
        options=set(),
        update=redrawn,
    )


FORMATS = tuple((name, form.title, form.text) for name, form in core.track.formats.FORMATS.items())
RANGES = (
    (
        "TOUCHED",
        "Touched Frames",
        "From the first to the last key of the fingers, the touched objects and all their parents, within the "
        "scene's range. If drivers, NLA strips, simulations or scripts move anything, the whole scene range",
    ),
    ("SCENE", "Scene", "The scene's frame range"),
    ("PREVIEW", "Preview", "The preview range while it is on, else the scene's"),
    ("OWN", "Own", "The frames set in Start and End"),
)
FILE_VERSION = 1  # raise it when a property is renamed or means something else, and migrate older files on loading


def _choose(settings: Any, own: bool) -> None:
    """Set the range from `use_range`, which scripts older than `bake_range` set."""
    settings.bake_range = "OWN" if own else "PREVIEW"


@declared(core.parameters.wave.WAVE, updates=dict.fromkeys(core.parameters.wave.WAVE, unfelt), override=set())
class DermisWave(bpy.types.PropertyGroup):
    """Settings of WAV files."""


class DermisScene(bpy.types.PropertyGroup):
    """Settings of the whole scene."""

    # 0: not used in this scene yet. Blender does not store defaults, so the default differs from every real version.
    file_version: IntProperty(description="Version of these settings in the file", default=0, options={"HIDDEN"})
    sample_rate: FloatProperty(
        name="Sampling",
        description="Number of samples per second of animation, independent of the frame rate",
        default=240.0,
        min=1.0,
        max=10_000.0,
        soft_min=60.0,
        soft_max=1000.0,
        unit="FREQUENCY",
        options=set(),
        update=touched,
    )
    # the default keeps the behaviour of files saved before this property existed; `begin` sets it for new scenes
    bake_range: EnumProperty(
        name="Range", description="Frames to bake", items=RANGES, default="PREVIEW", options=set(), update=touched
    )
    use_range: BoolProperty(
        name="Own Range",
        description="Old name of Range, kept for older files and scripts: on means Own, off means Preview",
        get=lambda settings: settings.bake_range == "OWN",
        set=_choose,
        options={"HIDDEN"},
    )
    frame_start: IntProperty(name="Start", description="First frame to bake", default=1, options=set(), update=touched)
    frame_end: IntProperty(name="End", description="Last frame to bake", default=250, options=set(), update=touched)
    output_dir: StringProperty(
        name="Output",
        description="Folder for exported tracks",
        default="//tracks/",
        subtype="DIR_PATH",
        options=compat.BLEND_RELATIVE,
        update=unfelt,
    )
    export_format: EnumProperty(
        name="Format",
        description="File format of exported tracks",
        items=FORMATS,
        default="csv",
        options=set(),
        update=unfelt,
    )
    wav: PointerProperty(description="Settings of WAV files", type=DermisWave)
    plots: BoolProperty(
        name="With Plots",
        description="Write a PNG plot beside each exported track",
        default=False,
        options=set(),
        update=unfelt,
    )
    skin_view: PointerProperty(description="Display of skins", type=DermisSkinView)
    thimble_view: PointerProperty(description="Display of thimbles", type=DermisThimbleView)
    live_preview: BoolProperty(
        name="Live Preview",
        description="Compute the current frame while you scrub, unless an up-to-date bake covers it",
        default=True,
        options=set(),
        update=redrawn,
    )
    show_twin: BoolProperty(
        name="Device Twin",
        description="Draw the device on the finger, with its commanded movement",
        default=True,
        options=set(),
        update=redrawn,
    )
    show_readout: BoolProperty(
        name="Readout", description="Show the devices' values in the view", default=True, options=set(), update=redrawn
    )
    show_strip: BoolProperty(
        name="Strip",
        description="Draw touch, error, limits and findings along the bottom of timeline, dope sheet and graph editor",
        default=True,
        options=set(),
        update=redrawn,
    )
    fold_cards: BoolProperty(
        name="Fold",
        description="Show each device and each pad in the view as one line. Cards for which there is no room are "
        "always folded",
        default=False,
        options=set(),
        update=redrawn,
    )
    twin_exaggeration: FloatProperty(
        name="Exaggeration",
        description="Factor by which the drawn movement of the tactor is enlarged",
        default=1.0,
        min=0.1,
        max=100.0,
        soft_min=1.0,
        soft_max=10.0,
        precision=1,
        options=set(),
        update=redrawn,
    )
    bake_key: StringProperty(description="Which stored result the last bake gave", options={"HIDDEN"})
    bake_owners: StringProperty(description="Fingers and devices of the last bake", options={"HIDDEN"})
    active_finding: IntProperty(description="Place in the list of findings", default=-1, options={"HIDDEN"})
    findings_step: IntProperty(
        description="Undo step that the listed findings belong to", options={"HIDDEN"}, update=unfelt
    )


def settle() -> None:
    """Set the range in files saved before `bake_range` existed."""
    for scene in bpy.data.scenes:
        if scene.is_editable and compat.taken(scene, "dermis", "use_range"):
            scene.dermis.bake_range = "OWN"


def begin(scene: bpy.types.Scene) -> None:
    """Set the default range of a scene that is new to Dermis, and store the version."""
    if not scene.dermis.file_version and scene.dermis.bake_range == "PREVIEW":
        scene.dermis.bake_range = "TOUCHED"
    stamp(scene)


def stamp(scene: bpy.types.Scene) -> None:
    """Store the version of these properties in a scene; a newer stored version is kept."""
    scene.dermis.file_version = max(scene.dermis.file_version, FILE_VERSION)


register, unregister = registration(
    (DermisSkinView, DermisThimbleView, DermisWave, DermisScene),
    (bpy.types.Scene, "dermis", PointerProperty(type=DermisScene, name="Dermis", description="Bake, export and view")),
)
