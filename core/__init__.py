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
    from .bake import Bake, Output, Progress
    from .cache import Cache, cache_key
    from .contact.gap import Surface
    from .devices.spec import Channel, DeviceSpec
    from .errors import DermisError, Finding, worst
    from .experiment import Match, Touch, fingertip, match, press
    from .formats.csv import read as read_csv
    from .formats.csv import write as write_csv
    from .outputs import export
    from .pipeline import render, run
    from .plot import write_png, write_svg
    from .presets import Library, PresetEntry
    from .scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene
    from .scene_file import load as load_scene
    from .scene_file import save as save_scene
    from .track import CommandTrack
    from .work import Worker

# name -> module, and the name there
_PUBLIC: dict[str, tuple[str, str]] = {
    # what went wrong, and what was noticed
    "DermisError": ("errors", "DermisError"),
    "Finding": ("errors", "Finding"),
    "worst": ("errors", "worst"),
    # a touch without a scene
    "fingertip": ("experiment", "fingertip"),
    "Surface": ("contact.gap", "Surface"),
    "press": ("experiment", "press"),
    "Touch": ("experiment", "Touch"),
    "match": ("experiment", "match"),
    "Match": ("experiment", "Match"),
    # a sampled scene
    "TactileScene": ("scene", "TactileScene"),
    "Finger": ("scene", "Finger"),
    "DeviceUse": ("scene", "DeviceUse"),
    "Body": ("scene", "Body"),
    "Screen": ("scene", "Screen"),
    "Mesh": ("scene", "Mesh"),
    "Chunk": ("scene", "Chunk"),
    "load_scene": ("scene_file", "load"),
    "save_scene": ("scene_file", "save"),
    # presets
    "Library": ("presets", "Library"),
    "PresetEntry": ("presets", "PresetEntry"),
    "DeviceSpec": ("devices.spec", "DeviceSpec"),
    "Channel": ("devices.spec", "Channel"),
    # scene -> tracks
    "render": ("pipeline", "render"),
    "run": ("pipeline", "run"),
    "export": ("outputs", "export"),
    "Bake": ("bake", "Bake"),
    "Output": ("bake", "Output"),
    "Progress": ("bake", "Progress"),
    # tracks, their files and pictures
    "CommandTrack": ("track", "CommandTrack"),
    "read_csv": ("formats.csv", "read"),
    "write_csv": ("formats.csv", "write"),
    "write_svg": ("plot", "write_svg"),
    "write_png": ("plot", "write_png"),
    # what long work needs
    "Cache": ("cache", "Cache"),
    "cache_key": ("cache", "cache_key"),
    "Worker": ("work", "Worker"),
}

__all__ = [
    "Bake", "Body", "Cache", "Channel", "Chunk", "CommandTrack", "DermisError", "DeviceSpec", "DeviceUse",
    "Finding", "Finger", "Library", "Match", "Mesh", "Output", "PresetEntry", "Progress", "Screen", "Surface",
    "TactileScene", "Touch", "Worker", "cache_key", "export", "fingertip", "load_scene", "match", "press",
    "read_csv", "render", "run", "save_scene", "worst", "write_csv", "write_png", "write_svg",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        module, attribute = _PUBLIC[name]
        return getattr(import_module(f".{module}", __name__), attribute)
    if name == "__version__":
        return import_module(".version", __name__).version()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
