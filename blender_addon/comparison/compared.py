"""Compare the output of every device for a finger's touch.

A child process does the work. The comparison is kept for the session.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from .. import identity
from .._core import core
from ..devices import skin_models
from ..film import film_objects
from ..identity import Place
from ..jobs import Steps
from ..preferences import library, presets_folder
from ..results import same_inputs
from ..sampling import scene_sweep


@dataclass(frozen=True)
class Compared:
    """One comparison.

    Attributes:
        table: table of the panel, see the engine's `comparison.report.as_dict`. csv, html: contents of the files.
        inputs: the contents of the scene when it was kept; None before.
        place: place of the finger, which finds it under another name as well.
    """

    table: Mapping[str, Any]
    csv: bytes
    html: bytes
    inputs: same_inputs.Inputs | None
    place: Place | None = None

    @property
    def stem(self) -> str:
        """Name of its files without suffix."""
        safe, names = core.track.file_names.safe, core.track.file_names.FileNames()
        return str(names.take(f"{safe(self.table['finger']) or 'finger'}.devices"))


_compared: dict[int, Compared] = {}


def current(scene: bpy.types.Scene) -> Compared | None:
    """Return the scene's last comparison in this session."""
    return _compared.get(scene.session_uid)


def holds(scene: bpy.types.Scene, made: Any) -> bool:
    """Return whether the scene is as it was when a result was kept, see `same_inputs.hold`.

    Args:
        made: a `Compared` or a `Told`.
    """
    return made.inputs is not None and same_inputs.hold(scene, made.inputs)


def keep(scene: bpy.types.Scene, made: Compared) -> None:
    """Keep a comparison for the session."""
    _compared[scene.session_uid] = replace(made, inputs=same_inputs.of(scene))


def find(scene: bpy.types.Scene, finger: str, *, floors: bool = False) -> Steps:
    """Sample a scene and render a finger's touch on all devices that fit.

    Yields progress, and returns a `Compared`. Closing the generator ends the child process.

    Args:
        floors: also find the best match that any pose of a device could have.

    Raises:
        DermisError: the scene cannot be sampled or rendered, or no device fits.
    """
    place = place_of(scene, finger)
    made = yield from asked("compare", "comparing", scene, finger, floors=floors)
    return Compared(json.loads(made["table"]), made["csv"], made["html"], None, place)


def place_of(scene: bpy.types.Scene, finger: str) -> Place | None:
    """Return the place of the finger that has this name now; None without one."""
    obj = identity.named(scene, finger)
    return Place.of(obj) if obj is not None else None


def called(scene: bpy.types.Scene, table: Mapping[str, Any], place: Place | None) -> str:
    """Return the present name of a table's finger.

    If the finger is gone, return its former name and '(gone)'.
    """
    obj = place.finger(scene) if place is not None else None
    return obj.name_full if obj is not None else f"{table['finger']} (gone)"


def asked(job_name: str, stage: str, scene: bpy.types.Scene, finger: str, **options: Any) -> Steps:
    """Sample a scene and let a child process do a job with it.

    Yields progress, and returns the job's results as bytes, by name. Closing the generator ends the child process.

    Args:
        options: further parameters of the job.

    Raises:
        DermisError: the scene cannot be sampled, or the job refuses it.
    """
    import tempfile  # imported late, so that registration is quick

    yield core.pipeline.bake.Progress("preparing", 0, 1)
    with film_objects.paused(scene):
        tactile = yield from sampled(scene)
    yield from skin_models.make_tables(tactile, library(), (finger,))
    with tempfile.TemporaryDirectory(prefix="dermis-compare-", ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "scene.npz"
        core.scene.scene_file.save(tactile, path)
        given = {
            **options,
            "scene": str(path),
            "finger": finger,
            "presets": str(presets_folder()),
            "cache": str(skin_models.cache().folder),
            "cache_bytes": skin_models.LIMIT_BYTES,
        }
        with core.work.processes.ProcessExecutor() as executor:
            job = executor.submit(job_name, {}, given)
            for done, total in job.follow():
                yield core.pipeline.bake.Progress(stage, done, max(total, 1))
            return {name: array.tobytes() for name, array in job.result().items()}


def sampled(scene: bpy.types.Scene) -> Steps:
    """Sample a scene; yield progress, return it with all its chunks."""
    tactile = scene_sweep.sample(scene)
    sweep = tactile.chunks
    chunks: list[Any] = []
    try:
        while True:
            if not sweep.advance():
                yield core.pipeline.bake.Progress("sampling", sweep.done, sweep.total)
                continue
            chunk = next(sweep, None)
            if chunk is None:
                return replace(tactile, chunks=chunks)
            chunks.append(chunk)
    finally:
        sweep.close()


def save(made: Compared, folder: Path) -> list[Path]:
    """Write the table as CSV and the page as HTML; return their paths.

    Raises:
        DermisError: the folder cannot be written.
    """
    paths = [folder / f"{made.stem}.csv", folder / f"{made.stem}.html"]
    for path, content in zip(paths, (made.csv, made.html), strict=True):
        core.files.write_bytes(path, content)
    return paths
