"""render_shots: from many sampled scenes to files, one job per scene.

The jobs run in parallel, on this machine or on others. The files are the same to the byte as those of one process. If
the executor shares files, the jobs get the paths of scenes and skins. Otherwise they get the bytes, which a cluster
identifies by a hash of the content and sends only once.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..errors import DermisError
from ..files import read_bytes, write_bytes
from ..parameters.skin import DEFAULT_SKIN, SKIN_CONTACT
from ..presets import Library
from ..scene import scene_file
from ..scene.tactile_scene import TactileScene
from ..track.file_names import FileNames
from ..work.executor import JobExecutor, JobFuture
from ..work.parcel import array_from
from ..work.spread import Asked, spread
from .bake import Progress
from .device_tracks import usable
from .shot import Shot, Wanted, presets_of, shot_of

CACHE_BYTES = 1 << 40  # [bytes] limit of the folder of skins: practically none, because the folder is temporary


@dataclass(frozen=True)
class Rendered:
    """Outcome of one scene.

    Attributes:
        scene: path of the scene's file.
        shot: results of the scene; None if it was refused.
        paths: paths of the written files.
        error: reason of the refusal; None if the scene was rendered.
    """

    scene: Path
    shot: Shot | None
    paths: tuple[Path, ...] = ()
    error: DermisError | None = None


def render_shots(
    scenes: Sequence[Path], library: Library, folder: Path, wanted: Wanted, executor: JobExecutor
) -> Generator[Progress | Rendered, None, None]:
    """Render scenes, each into its own folder.

    A folder is named like the scene's file. The generator yields progress, and each scene when it is done. A refused
    scene does not stop the others. The files of a scene are written when the scene is done, see `put_together`. Closing
    the generator early drops unfinished scenes.
    Args:
        scenes: paths of the scenes' files.
        library: the presets.
        folder: folder of the scenes' folders.
        wanted: options of the files.
        executor: executor of the jobs.

    Raises:
        DermisError: presets cannot be read, or a folder cannot be written.
    """
    names = FileNames()
    places = [folder / names.take(path.stem) for path in scenes]
    base = {"presets": presets_of(library), "wanted": asdict(wanted)}
    needed: dict[int, list[str]] = {}
    refused: list[Rendered] = []
    for i, path in enumerate(scenes):
        try:
            needed[i] = list(dict.fromkeys(skins_of(scene_file.load(path), library)))
        except DermisError as error:
            refused.append(Rendered(path, None, error=error))
    yield from refused
    with ExitStack() as stack:
        skins = Skins(executor, stack)
        yield from skins.make(skin for own in needed.values() for skin in own)
        asked = ((i, skins.shot(scenes[i], needed[i], {**base, "name": str(scenes[i])})) for i in needed)
        done = len(refused)
        yield Progress("shots", done, len(scenes))
        for item in spread(executor, asked):
            if item is None:
                continue
            i, future = item
            done += 1
            yield _rendered(scenes[i], places[i], future)
            yield Progress("shots", done, len(scenes))


def _rendered(scene: Path, folder: Path, future: JobFuture) -> Rendered:
    """Write the files that a scene's job has returned."""
    error = future.exception()
    if isinstance(error, DermisError):
        return Rendered(scene, None, error=error)
    made, files = shot_of(future.result())
    put_together(folder, dict(zip(made.names, files, strict=True)))
    return Rendered(scene, made, tuple(folder / name for name in made.names))


class Skins:
    """Skins of scenes, each condensed once for all scenes.

    Args:
        executor: executor of the jobs. If it shares files, the skins are in a temporary folder. Otherwise the files of
            the skins are in memory, by their keys in a cache.
        stack: exit stack that removes the folder.
    """

    def __init__(self, executor: JobExecutor, stack: ExitStack) -> None:
        self._executor = executor
        self._folder = ""
        if executor.shares_files:
            self._folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="dermis-skins-"))
        self._files: dict[str, Mapping[str, NDArray[Any]]] = {}  # files of each skin; none if they are in the folder

    def make(self, wanted: Iterable[str]) -> Generator[Progress, None, None]:
        """Condense skins that have not been condensed yet; yield progress.

        A refused skin gives no error here. The shots that use the skin report the error.
        """
        missing = sorted(set(wanted) - self._files.keys())
        more = {"folder": self._folder, "limit": CACHE_BYTES} if self._folder else {}
        name = "skin" if self._folder else "skin-files"
        asked = ((skin, Asked(name, {}, {**json.loads(skin), **more})) for skin in missing)
        done = 0
        if missing:
            yield Progress("skins", done, len(missing))
        for item in spread(self._executor, asked):
            if item is not None:
                skin, future = item
                made = {} if future.exception() is not None or self._folder else future.result()
                for file in made.values():
                    file.flags.writeable = False  # shared by many jobs
                self._files[skin] = made
                done += 1
                yield Progress("skins", done, len(missing))

    def shot(self, scene: Path, skins: Sequence[str], parameters: Mapping[str, Any]) -> Asked:
        """Return the job 'shot' of a scene with its inputs.

        The inputs may be large, and are read by this call. Call it only when the job is about to be submitted.
        """
        arrays, place = self.given(scene, skins)
        return Asked("shot", arrays, {**parameters, **place})

    def given(self, scene: Path, skins: Sequence[str]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return a scene and its skins as inputs of a job: arrays and parameters."""
        if self._folder:
            return {}, {"scene": os.path.abspath(scene), "cache": [self._folder, CACHE_BYTES]}
        arrays: dict[str, NDArray[Any]] = {"scene": array_from(_bytes(scene))}
        for skin in skins:
            arrays |= {f"skins/{key}": file for key, file in self._files.get(skin, {}).items()}
        return arrays, {"scene": ""}


def skins_of(scene: TactileScene, library: Library) -> Iterator[str]:
    """Yield the skins that a scene needs, as JSON.

    The JSON has the parameters 'skin' and 'level' of the job that condenses the skin.
    """
    needed = {f for f, _, spec in usable(scene, library, []) if spec.follows_skin}
    for f, finger in enumerate(scene.fingers):
        if f in needed or SKIN_CONTACT["skin_shown"].of(finger.parameters):
            skin = dict(finger.parameters.get("skin") or library.skin(DEFAULT_SKIN))
            yield json.dumps(
                {"skin": skin, "level": str(SKIN_CONTACT["skin_level"].of(finger.parameters))}, sort_keys=True
            )


def put_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder.

    In a new folder, all files appear at once. In an existing folder, the files appear one by one, each when it is
    complete.

    Args:
        folder: the folder; it is made if it does not exist.
        files: bytes of the files by name.

    Raises:
        DermisError: the folder cannot be written.
    """
    if not folder.exists() and files:
        # Another process may make the folder meanwhile, or nobody can make it. Then the loop below writes the files, or
        # gives the reason.
        with suppress(OSError):
            folder.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=f".{folder.name[:80]}.", dir=folder.parent) as scratch:
                new = Path(scratch) / "new"
                for name, data in files.items():
                    write_bytes(new / name, data)
                os.rename(new, folder)
            return
    for name, data in files.items():
        write_bytes(folder / name, data)


def _bytes(path: Path) -> bytes:
    """Return the bytes of a scene's file; none if it cannot be read.

    The scene's job then reports the error.
    """
    try:
        return read_bytes(path)
    except DermisError:
        return b""
