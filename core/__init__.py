"""Dermis' engine: what skin would feel in an animated scene, and what a tactile device should do about it.

From a sampled scene to files for the devices::

    import core

    scene = core.load_scene("scene.npz")
    bake = core.run(scene, core.Library())
    core.export(bake, Path("out"))

One touch, without a scene::

    skin = core.fingertip(level="draft")
    touch = core.press(skin, core.Surface.sphere(5e-3), depth=1.5e-3, friction=0.5)
    pins = core.match(touch, device="pin_array_128", method="DM2")

From a file back to commands::

    track = core.read_csv("out/Finger.haptip.csv")
    for finding in track.check():
        print(finding)

Everything in SI (m, N, Pa, s, rad). Names load when they are first used: importing this package imports nothing
heavier than numpy.
"""

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
    from .scene.scene_file import load as load_scene
    from .scene.scene_file import save as save_scene
    from .scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene
    from .surface.gap import Surface
    from .track.command_track import CommandTrack
    from .track.csv import read as read_csv
    from .track.csv import write as write_csv
    from .work.processes import ProcessExecutor

# name -> module, and the name there
_PUBLIC: dict[str, tuple[str, str]] = {
    # what went wrong, and what was noticed
    "DermisError": ("errors", "DermisError"),
    "Finding": ("errors", "Finding"),
    "worst": ("errors", "worst"),
    # a touch without a scene
    "fingertip": ("experiment", "fingertip"),
    "Surface": ("surface.gap", "Surface"),
    "press": ("experiment", "press"),
    "Touch": ("experiment", "Touch"),
    "match": ("experiment", "match"),
    "Match": ("experiment", "Match"),
    # a sampled scene
    "TactileScene": ("scene.tactile_scene", "TactileScene"),
    "Finger": ("scene.tactile_scene", "Finger"),
    "DeviceUse": ("scene.tactile_scene", "DeviceUse"),
    "Body": ("scene.tactile_scene", "Body"),
    "Screen": ("scene.tactile_scene", "Screen"),
    "Mesh": ("scene.tactile_scene", "Mesh"),
    "Chunk": ("scene.tactile_scene", "Chunk"),
    "load_scene": ("scene.scene_file", "load"),
    "save_scene": ("scene.scene_file", "save"),
    # presets
    "Library": ("presets", "Library"),
    "PresetEntry": ("presets", "PresetEntry"),
    "DeviceSpec": ("devices.spec", "DeviceSpec"),
    "Channel": ("devices.spec", "Channel"),
    # scene -> tracks
    "render": ("pipeline.render", "render"),
    "run": ("pipeline.render", "run"),
    "export": ("pipeline.outputs", "export"),
    "Bake": ("pipeline.bake", "Bake"),
    "Output": ("pipeline.bake", "Output"),
    "Progress": ("pipeline.bake", "Progress"),
    # tracks, their files and pictures
    "CommandTrack": ("track.command_track", "CommandTrack"),
    "read_csv": ("track.csv", "read"),
    "write_csv": ("track.csv", "write"),
    "write_svg": ("plot.track", "write_svg"),
    "write_png": ("plot.track", "write_png"),
    # what long work needs
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
    "Surface",
    "TactileScene",
    "Touch",
    "cache_key",
    "export",
    "fingertip",
    "load_scene",
    "match",
    "press",
    "read_csv",
    "render",
    "run",
    "save_scene",
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
    return sorted({*globals(), *__all__})
