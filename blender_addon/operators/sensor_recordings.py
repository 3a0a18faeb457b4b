# mypy: disable-error-code="valid-type"
"""A recording of a sensor as the track of the active finger's device."""

from math import ceil
from pathlib import Path
from typing import Any

import bpy
from bpy.props import FloatProperty, IntProperty, StringProperty

from .. import baking, identity, reporting, scene_time
from .._core import DermisError, core
from ..devices import active_presets
from ..layouts import properties, words
from ..polls import active_finger, needs
from ..preferences import library
from ..results import store
from ..sampling import frames
from .work import File, listed

MOST_FRAMES = 1_048_574  # the last frame that Blender's scenes can have


def _followers(finger: bpy.types.Object | None) -> list[Any]:
    """Return settings of a finger's platforms and thimbles, the active one first.

    A look-up table can give their commands.
    """
    if finger is None:
        return []
    families: tuple[active_presets.Family, ...] = ("platform", "thimble")
    devices = [item for _, item in identity.worn(finger)]
    found = [item for item in devices if any(active_presets.spec_of(item.preset, own) is not None for own in families)]
    own = finger.dermis.finger
    active = own.devices[own.active_device] if own.active_device < len(own.devices) else None
    return sorted(found, key=lambda item: item != active)


@needs(
    lambda context: bool(_followers(active_finger(context))) and context.mode == "OBJECT",
    "Select a finger with a platform or a thimble",
)
class DERMIS_OT_import_sensor(File, bpy.types.Operator):
    """Let the active finger's platform or thimble follow a recording of a tactile sensor, by a look-up table"""

    bl_idname = "dermis.import_sensor"
    bl_label = "Import Recorded Sensor"
    bl_options = {"REGISTER", "UNDO"}
    suffix = ".csv"

    filter_glob: listed("*.csv;*.txt;*.tsv")
    table: StringProperty(
        name="Table",
        description="Look-up table with one row per configuration: motor commands, or a thimble's pitch, roll and "
        "distance, and the readings of this sensor. If empty, the device's own table",
        subtype="FILE_PATH",
    )
    motors: IntProperty(
        name="Motors",
        description="Number of principal components of the motors' commands that are used. With 0, each motor moves by "
        "itself",
        default=0,
        min=0,
        max=6,
    )
    rest: FloatProperty(
        name="Rest",
        description="Time from the first sample during which nothing is touched. It gives the noise, and the readings "
        "at rest are shifted to those of the table. With 0, noise and rest are those of the table",
        default=0.0,
        min=0.0,
        soft_max=10.0,
        unit="TIME_ABSOLUTE",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw how the file is read."""
        followers = _followers(active_finger(context))
        whose = f" It moves '{followers[0].preset}'." if len(followers) > 1 else ""
        text = f"A column 'time' and one a channel, in any unit; channels are those of the table.{whose}"
        words(self.layout, text, 230.0, "INFO")
        properties(self.layout, self, "table", "motors", "rest", keys=False)
        if store.state(context.scene) != "none":
            words(self.layout, "Its track takes the place of this scene's bake.", 230.0, "ERROR")

    def work(self, context: bpy.types.Context) -> str | None:
        """Follow the recording, and keep its track as the scene's result."""
        scene, finger, path = context.scene, active_finger(context), self.path()
        assert finger is not None
        item = _followers(finger)[0]
        spec = library().device(item.preset)
        given = self.table or str(getattr(item, "table", ""))
        if not given:
            raise DermisError(
                "a look-up needs a table of this device and this sensor",
                where=f"finger '{finger.name}'",
                value=item.preset,
                remedy="Choose one in the file browser's Table",
            )
        follow, file = core.design.follow, Path(bpy.path.abspath(given))
        table = follow.table_of(spec, file)
        rest = (0.0, self.rest) if self.rest else None
        recording = core.design.recordings.read_recording(path, rest)
        start = frames.frame_range(scene)[0]
        last = ceil(scene_time.clock(scene, start).frames(recording.times[-1:] - recording.times[0])[0])
        if last > MOST_FRAMES:
            raise DermisError(
                "the recording is longer than a scene can be",
                where=str(path),
                value=f"its last frame would be {last:,}",
                limit=f"{MOST_FRAMES:,}",
                remedy="Cut it, or take a lower frame rate; the command 'follow' makes its track without a scene",
            )
        found = follow.follow(spec, table, recording, motors=self.motors or None)
        last = ceil(scene_time.clock(scene, start).frames(found.track.times[-1:])[0])
        if not scene.use_preview_range:
            scene.frame_end = max(scene.frame_end, last)
        taken = store.Taken.of(scene)
        touched = core.interpolate.interpolate(found.times, found.touched.astype(float)[:, None], found.track.times)
        bake = core.pipeline.bake
        output = bake.Output(finger.name_full, spec.key, found.track, {"contact": touched[:, 0]}, found.findings)
        made = found.track.times.tobytes().hex(), found.track.values.tobytes().hex()
        key = core.cache.cache_key("dermis-recorded-sensor 1", spec.hash, recording.name, *made)
        findings = baking.keep(scene, bake.Bake((output,), (), {}, key), taken)
        done = f"{spec.name}: {found.words()}; frames {start} to {last}"
        reporting.report_findings(self, findings, self.bl_label, done)
        return None


CLASSES: tuple[type, ...] = (DERMIS_OT_import_sensor,)
