"""Render README's moving picture: five fingers of the skin demo from above, and their pads from below.

`python -m tests.benchmarks.moving_picture --out presets/pictures` writes hand.webp, in some five minutes: *Demo Skin
Scene, Five Fingers* with a thimble on the index finger, baked, then *Skin as Mesh* and *Twin as Objects*, rendered by
Cycles. It needs no screen.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector
from PIL import Image

import blender_addon
from core.files import write_bytes

WIDE, ABOVE, BELOW = 720, 330, 200  # of the picture and of its two parts [pixels]
SAMPLES = 8  # of each pixel, before Cycles removes the noise
FINGERS = "Thumb", "Index", "Middle", "Ring", "Little"
FRAMES = range(1, 73, 2)  # of the demo
LIMIT = 3_000_000  # of the file [bytes]
BACKGROUND = (0.30, 0.31, 0.33, 1.0)


def scene() -> tuple[bpy.types.Scene, dict[str, bpy.types.Object]]:
    """Return the demo scene, baked, with its skins and the thimble as objects, and its two cameras."""
    bpy.ops.dermis.demo_skin_scene(fingers="FIVE")
    made = bpy.context.scene
    for name in FINGERS:
        skin = made.objects[name].dermis.finger.skin
        skin.level, skin.contact = "standard", "points"
    made.objects["Index"].dermis.finger.devices.add().preset = "thimble_3rrs"
    bpy.ops.dermis.bake()
    cameras = {
        "above": camera(made, (-0.068, 0.205, 0.092), (-0.006, 0.0, 0.010), 62.0),
        "below": camera(made, (-0.035, -0.0039, -0.150), (-0.035, -0.004, 0.012), 30.0),
    }
    made.camera, made.render.resolution_x, made.render.resolution_y = cameras["below"], WIDE, BELOW
    bpy.ops.dermis.film_skin(show="stress", with_legend=True)
    bpy.ops.dermis.film_twins()
    return made, cameras


def prepare(made: bpy.types.Scene) -> None:
    """Set the renderer, two lights and a grey background."""
    render: Any = made.render
    render.engine, made.cycles.samples, made.cycles.use_denoising = "CYCLES", SAMPLES, True
    render.resolution_percentage = 100
    render.image_settings.file_format = "PNG"
    made.view_settings.view_transform = "Standard"
    world = bpy.data.worlds.new("Grey")
    if world.node_tree is None:
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = BACKGROUND
    made.world = world
    light: Any = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy, light.data.angle = 2.5, 0.2
    light.rotation_euler = (-0.6, -0.4, 0.0)
    made.collection.objects.link(light)


def camera(made: bpy.types.Scene, at: Sequence[float], target: Sequence[float], lens: float) -> bpy.types.Object:
    """Add a camera that looks from a place to a target [m]."""
    data = bpy.data.cameras.new("Picture")
    data.clip_start, data.lens = 0.005, lens
    obj = bpy.data.objects.new("Picture", data)
    obj.location = at
    obj.rotation_euler = (Vector(target) - Vector(at)).to_track_quat("-Z", "Y").to_euler()
    made.collection.objects.link(obj)
    return obj


def rendered(
    made: bpy.types.Scene, cameras: dict[str, bpy.types.Object], frames: Sequence[int], folder: Path
) -> Iterator[Image.Image]:
    """Yield the picture at each frame: the scene above, the pads alone below."""
    hidden = [obj for obj in made.objects if obj.get("dermis_film") not in ("skin", "legend") and not obj.hide_render]
    for frame in frames:
        made.frame_set(frame)
        picture = Image.new("RGB", (WIDE, ABOVE + BELOW))
        for view, high, place in (("above", ABOVE, 0), ("below", BELOW, ABOVE)):
            for obj in hidden:
                obj.hide_render = view == "below" and obj.type == "MESH"
            made.camera, made.render.resolution_y = cameras[view], high
            made.render.filepath = str(folder / "part.png")
            bpy.ops.render.render(write_still=True)
            with Image.open(folder / "part.png") as part:
                picture.paste(part.convert("RGB"), (0, place))
        yield picture


def encoded(pictures: Sequence[Image.Image]) -> bytes:
    """Return the pictures as an animated WebP of the demo's pace."""
    file = BytesIO()
    first, *rest = pictures
    step = FRAMES.step * 1000 // 24
    first.save(file, "WEBP", save_all=True, append_images=rest, duration=step, loop=0, quality=70, method=6)
    if file.tell() > LIMIT:
        raise SystemExit(f"the picture has {file.tell()} bytes, allowed: {LIMIT}")
    return file.getvalue()


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    out = parser.parse_args(arguments).out
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    made, cameras = scene()
    prepare(made)
    with tempfile.TemporaryDirectory() as folder:
        pictures = list(rendered(made, cameras, FRAMES, Path(folder)))
    write_bytes(out / "hand.webp", encoded(pictures))


if __name__ == "__main__":
    main()
