"""Many sampled scenes to files, side by side: a job a scene, on this machine or on others, to the same bytes.

Scenes and skins go to whoever needs them once: as paths where files are shared, else as bytes by their content's hash.
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

CACHE_BYTES = 1 << 40  # of the folder that holds skins while the shots are rendered: it goes with them


@dataclass(frozen=True)
class Rendered:
    """One scene: its file, and either its results and the written paths, or the reason for their absence."""

    scene: Path
    shot: Shot | None
    paths: tuple[Path, ...] = ()
    error: DermisError | None = None


def render_shots(
    scenes: Sequence[Path], library: Library, folder: Path, wanted: Wanted, executor: JobExecutor
) -> Generator[Progress | Rendered, None, None]:
    """Render scenes, each into a folder of its own, named as its file; yield progress, and each scene as it is done.

    A scene that is refused takes no other down. Files appear when a scene is done: in a new folder all at once, in
    one that is there already each whole. Leaving early drops unfinished work.

    Raises:
        DermisError: presets that cannot be read, or a folder that cannot be written.
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
    """Write the results of a scene."""
    error = future.exception()
    if isinstance(error, DermisError):
        return Rendered(scene, None, error=error)
    made, files = shot_of(future.result())
    put_together(folder, dict(zip(made.names, files, strict=True)))
    return Rendered(scene, made, tuple(folder / name for name in made.names))


class Skins:
    """Skins of scenes, condensed once for all who render them.

    Args:
        stack: exit stack that closes the skins. They are in a folder if files are shared, else in memory, by the key of
            their file.
    """

    def __init__(self, executor: JobExecutor, stack: ExitStack) -> None:
        self._executor = executor
        self._folder = ""
        if executor.shares_files:
            self._folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="dermis-skins-"))
        self._files: dict[str, Mapping[str, NDArray[Any]]] = {}  # by skin: its files

    def make(self, wanted: Iterable[str]) -> Generator[Progress, None, None]:
        """Condense skins that are not there yet; one that is refused is told where it is used."""
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
        """Return the job 'shot' of a scene, with its inputs: read when it is asked for, since many are large."""
        arrays, place = self.given(scene, skins)
        return Asked("shot", arrays, {**parameters, **place})

    def given(self, scene: Path, skins: Sequence[str]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return a scene and its skins as a job is given them: arrays, and parameters."""
        if self._folder:
            return {}, {"scene": os.path.abspath(scene), "cache": [self._folder, CACHE_BYTES]}
        arrays: dict[str, NDArray[Any]] = {"scene": array_from(_bytes(scene))}
        for skin in skins:
            arrays |= {f"skins/{key}": file for key, file in self._files.get(skin, {}).items()}
        return arrays, {"scene": ""}


def skins_of(scene: TactileScene, library: Library) -> Iterator[str]:
    """Yield the skins that rendering a scene needs, as the JSON of the job's parameters 'skin' and 'level'."""
    needed = {f for f, _, spec in usable(scene, library, []) if spec.follows_skin}
    for f, finger in enumerate(scene.fingers):
        if f in needed or SKIN_CONTACT["skin_shown"].of(finger.parameters):
            skin = dict(finger.parameters.get("skin") or library.skin(DEFAULT_SKIN))
            yield json.dumps(
                {"skin": skin, "level": str(SKIN_CONTACT["skin_level"].of(finger.parameters))}, sort_keys=True
            )


def put_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder: all of them at once where it is new, else one by one, each whole.

    Raises:
        DermisError: the folder cannot be written.
    """
    if not folder.exists() and files:
        with suppress(OSError):  # somebody made it meanwhile, or nobody can: the files below tell
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
    """Return a scene's file; nothing where it cannot be read, which its job then tells."""
    try:
        return read_bytes(path)
    except DermisError:
        return b""
