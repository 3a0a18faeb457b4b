"""Write the tracks of a bake, and maps of touch screens, into a folder."""

from __future__ import annotations

from pathlib import Path

from ..arrays import Array
from ..errors import DermisError, Finding
from ..parameters.device import DEVICE
from ..presets import Library
from ..scene.tactile_scene import TactileScene
from ..track.file_names import FileNames, safe
from .bake import Bake, Output


def export(bake: Bake, folder: Path | str, *, plots: bool = False) -> tuple[Path, ...]:
    """Write one CSV per finger and device into a folder; return the paths.

    A track that cannot be written does not stop the others.

    Args:
        bake: the tracks.
        folder: folder of the files.
        plots: whether each CSV gets a PNG plot beside it.

    Raises:
        DermisError: the bake has no tracks, or some cannot be written; then the error is that of the first.
    """
    from ..track import csv

    if not bake.outputs:
        raise DermisError("no tracks to export", where=str(folder), remedy="Give a finger a device and bake again")
    written: list[Path] = []
    refused: list[DermisError] = []
    for name, output in zip(file_names(bake), bake.outputs, strict=True):
        path = Path(folder) / f"{name}.csv"
        try:
            csv.write(output.track, path)
            written.append(path)
        except DermisError as error:
            refused.append(error)
    if refused:
        raise refused[0]
    return (*written, *(write_plots(bake, folder) if plots else ()))


def write_plots(bake: Bake, folder: Path | str) -> tuple[Path, ...]:
    """Write a PNG plot of every track, named like its CSV; return the paths.

    Raises:
        DermisError: the folder cannot be written.
    """
    from ..files import write_bytes

    written = []
    for name, output in zip(file_names(bake), bake.outputs, strict=True):
        path = Path(folder) / f"{name}.png"
        write_bytes(path, plot_of(bake, output))
        written.append(path)
    return tuple(written)


def plot_of(bake: Bake, output: Output, *, scale: float = 2.0, spread: Array | None = None) -> bytes:
    """Return the PNG plot of a track.

    Units and scales are those of all tracks of the same device in the bake, so that the plots can be compared.

    Args:
        bake: the bake.
        output: the track, one of the bake's outputs.
        scale: pixels per point.
        spread: half the width of a band about each curve, in the curve's unit, shape (n, channels).
    """
    from ..plot.track import png

    alike = [o.track for o in bake.outputs if o.track.spec.key == output.track.spec.key]
    return png(output.track, contact=output.signals.get("contact"), alike=alike, scale=scale, spread=spread)


def export_screen_maps(scene: TactileScene, library: Library, folder: Path) -> tuple[Path, ...]:
    """Write map and law of every screen device, for use with a real finger.

    Only the first chunk of the scene is read. The matrices in it determine the size of the screens.

    Args:
        scene: the scene.
        library: the presets.
        folder: folder of the files.

    Raises:
        DermisError: no finger has a screen device, a preset or map cannot be used, or the folder cannot be written.
    """
    from ..matching.friction_screen import screen_maps

    wanted = []
    for finger in scene.fingers:
        for use in finger.devices:
            spec = library.device(use.preset)
            # A relief that is read from the mesh itself needs no map.
            if spec.kind == "friction_screen" and DEVICE["relief"].of(use.parameters) != "mesh":
                wanted.append((finger.name, use, spec))
    if not wanted:
        raise DermisError(
            "no finger has a screen device",
            where=f"scene '{scene.name}'",
            remedy="Add a touch screen, and an electrovibration device to the finger that touches it",
        )
    chunk = next(iter(scene.chunks))
    names = FileNames()
    written: list[Path] = []
    for who, use, spec in wanted:
        for index, screen_map in screen_maps(scene, chunk.screens, use, spec).items():
            stem = f"{safe(who)}.{safe(scene.screens[index].name)}.{safe(use.preset)}"
            path = Path(folder) / names.take(stem, ".map.npz")
            screen_map.save(path)
            written.append(path)
    return tuple(written)


def file_names(bake: Bake) -> tuple[str, ...]:
    """Return a file stem per output, from the names of finger and device.

    The stems are unique, and safe on every file system.
    """
    return _named(bake)[0]


def name_findings(bake: Bake) -> tuple[Finding, ...]:
    """Return a finding for each of the `file_names` that was shortened."""
    return _named(bake)[1].findings()


def _named(bake: Bake) -> tuple[tuple[str, ...], FileNames]:
    names = FileNames()
    stems = (f"{safe(output.finger) or 'finger'}.{safe(output.device)}" for output in bake.outputs)
    return tuple(names.take(stem) for stem in stems), names
