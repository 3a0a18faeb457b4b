"""Dermis' engine: touch in animated scenes, and haptic device commands.

It computes the tactile contact of fingertips with objects, and the commands with which devices reproduce it. Installed
with pip it is called `dermis`; in the source tree the same folder is called `core`.

One touch, without a scene: a ball presses a fingertip of soft tissue, and a pin array reproduces the touch.

>>> import dermis
>>> skin = dermis.fingertip(level="draft")
>>> touch = dermis.press(skin, dermis.Surface.sphere(5e-3), depth=1e-3, friction=0.5)
>>> print(f"{touch.normal_force:.2f} N, up to {abs(touch.probe_stress).max() / 1e3:.0f} kPa at the receptors")
0.40 N, up to 45 kPa at the receptors
>>> pins = dermis.match(touch, device="pin_array_128", method="DM2")
>>> print(f"{1e6 * pins.error:.0f} um off, the strongest pin at {max(pins.commands.values()):.2f} N")
37 um off, the strongest pin at 0.12 N

From a sampled scene to files for the devices, and from a file back to commands::

    scene = dermis.load_scene("scene.npz")
    bake = dermis.run(scene)
    dermis.export(bake, "out")
    track = dermis.read_csv("out/Finger.haptip.csv")
    for finding in track.check():
        print(finding)

Everything is in SI (m, N, Pa, s, rad). A finger's frame has its origin at the pad's centre, +Y towards the tip and +Z
towards the nail. Each public name is imported when it is first used; importing the package alone loads no library.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .cache import Cache, cache_key
    from .devices.spec import Channel, DeviceSpec
    from .errors import DermisError, Finding, worst
    from .experiment import Match, Touch, fingertip, match, press
    from .pipeline.bake import Bake, Output, Progress
    from .pipeline.outputs import export
    from .pipeline.render import render, run
    from .plot.track import write_png, write_svg
    from .presets import Library, PresetEntry
    from .scene.from_poses import scene_from_poses
    from .scene.scene_file import load as load_scene
    from .scene.scene_file import save as save_scene
    from .scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene
    from .skin.model import SkinModel
    from .skin.stimulus import Stimulus
    from .surface.curved import CurvedMesh, curved_mesh
    from .surface.gap import Surface
    from .track.command_track import CommandTrack
    from .track.csv import read as read_csv
    from .track.csv import write as write_csv
    from .work.processes import ProcessExecutor

# Public name -> module, and name in this module. The comments below are the groups of API.md, in the same order.
_PUBLIC: dict[str, tuple[str, str]] = {
    # one touch: press a fingertip and match a device
    "fingertip": ("experiment", "fingertip"),
    "Surface": ("surface.gap", "Surface"),
    "press": ("experiment", "press"),
    "Touch": ("experiment", "Touch"),
    "match": ("experiment", "match"),
    "Match": ("experiment", "Match"),
    # scenes: build, load and save
    "TactileScene": ("scene.tactile_scene", "TactileScene"),
    "Finger": ("scene.tactile_scene", "Finger"),
    "DeviceUse": ("scene.tactile_scene", "DeviceUse"),
    "Body": ("scene.tactile_scene", "Body"),
    "Screen": ("scene.tactile_scene", "Screen"),
    "Mesh": ("scene.tactile_scene", "Mesh"),
    "curved_mesh": ("surface.curved", "curved_mesh"),
    "CurvedMesh": ("surface.curved", "CurvedMesh"),
    "Chunk": ("scene.tactile_scene", "Chunk"),
    "scene_from_poses": ("scene.from_poses", "scene_from_poses"),
    "load_scene": ("scene.scene_file", "load"),
    "save_scene": ("scene.scene_file", "save"),
    # bake and export
    "run": ("pipeline.render", "run"),
    "render": ("pipeline.render", "render"),
    "export": ("pipeline.outputs", "export"),
    "Bake": ("pipeline.bake", "Bake"),
    "Output": ("pipeline.bake", "Output"),
    "Progress": ("pipeline.bake", "Progress"),
    # tracks: read, write and plot
    "CommandTrack": ("track.command_track", "CommandTrack"),
    "read_csv": ("track.csv", "read"),
    "write_csv": ("track.csv", "write"),
    "write_svg": ("plot.track", "write_svg"),
    "write_png": ("plot.track", "write_png"),
    # devices and presets
    "Library": ("presets", "Library"),
    "PresetEntry": ("presets", "PresetEntry"),
    "DeviceSpec": ("devices.spec", "DeviceSpec"),
    "Channel": ("devices.spec", "Channel"),
    # skin and stimulus
    "SkinModel": ("skin.model", "SkinModel"),
    "Stimulus": ("skin.stimulus", "Stimulus"),
    # errors and findings
    "DermisError": ("errors", "DermisError"),
    "Finding": ("errors", "Finding"),
    "worst": ("errors", "worst"),
    # cache and processes
    "Cache": ("cache", "Cache"),
    "cache_key": ("cache", "cache_key"),
    "ProcessExecutor": ("work.processes", "ProcessExecutor"),
}

__all__ = [
    "Bake",
    "Body",
    "Cache",
    "Channel",
    "Chunk",
    "CommandTrack",
    "CurvedMesh",
    "DermisError",
    "DeviceSpec",
    "DeviceUse",
    "Finding",
    "Finger",
    "Library",
    "Match",
    "Mesh",
    "Output",
    "PresetEntry",
    "ProcessExecutor",
    "Progress",
    "Screen",
    "SkinModel",
    "Stimulus",
    "Surface",
    "TactileScene",
    "Touch",
    "cache_key",
    "curved_mesh",
    "export",
    "fingertip",
    "load_scene",
    "match",
    "press",
    "read_csv",
    "render",
    "run",
    "save_scene",
    "scene_from_poses",
    "worst",
    "write_csv",
    "write_png",
    "write_svg",
]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        module, attribute = _PUBLIC[name]
        return getattr(import_module(f".{module}", __name__), attribute)
    if name == "__version__":
        return import_module(".version", __name__).version()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


# An editable install and its source tree are one folder under two names. If both names were imported, each class would
# exist twice: `except` and `isinstance` with a class of one name would not recognise objects of the other name.
_other = {"core": "dermis", "dermis": "core"}.get(__name__, "")
if "TactileScene" in getattr(sys.modules.get(_other), "__all__", ()):
    raise ImportError(f"Dermis is loaded as '{_other}' already: import it under one name only")
