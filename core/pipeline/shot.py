"""render_shot: from a sampled scene to the files of its tracks.

It runs in this process, or as the job 'shot', which returns the files as bytes.
"""

from __future__ import annotations

import functools
import json
import tempfile
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from ..cache import Cache
from ..errors import DermisError, Finding
from ..files import read_bytes, write_bytes
from ..presets import SCHEMAS, Library
from ..scene import scene_file
from ..scene.tactile_scene import TactileScene
from ..steps import drain
from ..track.export import format_of, write
from ..track.file_names import FileNames
from ..work.jobs import Report
from ..work.parcel import array_from, bytes_of
from .bake import Bake, Progress
from .outputs import export, export_screen_maps, file_names, name_findings
from .render import render
from .share_job import findings_of, plain_findings

if TYPE_CHECKING:
    from ..work.executor import JobExecutor


SKIN_BYTES = 1 << 30  # [bytes] limit of a worker's cache of skins: some seventy skins with the standard mesh


@dataclass(frozen=True)
class Wanted:
    """Options of a shot's files.

    Attributes:
        plots: whether each track has a PNG plot.
        maps: whether maps of touch screens are written.
        formats: formats of the tracks beside CSV, see `FORMATS`.
        force: whether tracks with errors are written in these formats, too.
    """

    plots: bool = False
    maps: bool = False
    formats: tuple[str, ...] = ()
    force: bool = False


@dataclass(frozen=True)
class Shot:
    """Results of a scene.

    Attributes:
        names: names of the written files, in the order of writing.
        refused: one line for each track that was not written, with the reason.
        findings: findings of the bake and of the files.
        skipped: amounts of skipped work, by name.
        content_hash: hash of the bake's content, see `Bake`.
    """

    names: tuple[str, ...]
    refused: tuple[str, ...]
    findings: tuple[Finding, ...]
    skipped: Mapping[str, int]
    content_hash: str


def render_shot(
    scene: TactileScene,
    library: Library,
    folder: Path,
    wanted: Wanted,
    *,
    cache: Cache | None = None,
    executor: JobExecutor | None = None,
) -> Generator[Progress, None, Shot]:
    """Render a scene and write its files into a folder; yield progress.

    Raises:
        DermisError: see `render`, `export` and `export_screen_maps`, or a format is not known. The value of an error of
            `export` is the text of the bake's findings, if there are any.
    """
    bake = yield from render(scene, library, cache=cache, executor=executor)
    try:
        paths = [*export(bake, folder, plots=wanted.plots)]
    except DermisError as error:
        said = "; ".join(str(finding) for finding in bake.all_findings)
        raise error.changed(value=said or error.value) from error
    if wanted.maps:
        paths += export_screen_maps(scene, library, folder)
    told, refused = _write_formats(bake, folder, wanted, paths)
    names = tuple(path.relative_to(folder).as_posix() for path in paths)
    return Shot(
        names, tuple(refused), (*bake.all_findings, *name_findings(bake), *told), bake.skipped, bake.content_hash
    )


def _write_formats(bake: Bake, folder: Path, wanted: Wanted, paths: list[Path]) -> tuple[list[Finding], list[str]]:
    """Write the tracks in other formats.

    Args:
        bake: the tracks.
        folder: folder of the files.
        wanted: options.
        paths: list to which the written paths are appended.

    Returns:
        Findings of the checks, and one line for each refused track.
    """
    told: list[Finding] = []
    refused, names = [], FileNames()
    for form in dict.fromkeys(wanted.formats):
        for stem, output in zip(file_names(bake), bake.outputs, strict=True):
            path = folder / names.take(stem, format_of(form).suffix)
            try:
                told += write(output.track, path, form, force=wanted.force)
                paths.append(path)
            except DermisError as error:  # a refused track does not stop the other tracks
                refused.append(f"{output.finger}, {output.device}, {form}: {error}")
    return told, refused


def work(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report) -> dict[str, NDArray[Any]]:
    """Render a shot, as the job 'shot'.

    Args:
        arrays: 'scene' (bytes of the scene's file) if `parameters` has no path; 'skins/KEY' (files of a cache), if any.
        parameters: 'scene' (path of the file, or '' if `arrays` has its bytes), 'name' (name of the scene in errors),
            'presets' (texts of the user's own presets, see `presets_of`), 'wanted' (fields of `Wanted`), 'cache'
            (folder, and limit in bytes), if any.
        report: function that receives the progress.

    Returns:
        'head' (JSON), and the bytes of each file under its index in `Shot.names` ('0', '1', ...).

    Raises:
        DermisError: see `opened_shot` and `render_shot`, or the scene's file cannot be read.
    """
    wanted = Wanted(**{**parameters["wanted"], "formats": tuple(parameters["wanted"]["formats"])})
    with opened_shot(arrays, parameters) as given:
        steps = render_shot(scene_file.load(given.scene), given.library, given.scratch, wanted, cache=given.cache)
        made = drain(steps, lambda step: report(step.done, step.total))
        files = {str(i): array_from(read_bytes(given.scratch / name)) for i, name in enumerate(made.names)}
    head = {
        "names": made.names,
        "refused": made.refused,
        "findings": plain_findings(made.findings),
        "skipped": dict(made.skipped),
        "content_hash": made.content_hash,
    }
    return {"head": array_from(json.dumps(head).encode()), **files}


@dataclass(frozen=True)
class Given:
    """Inputs of a job on one scene.

    Attributes:
        scene: path of the scene's file.
        library: the presets.
        cache: cache of condensed skins; None if the job has none.
        scratch: temporary folder for the results.
    """

    scene: Path
    library: Library
    cache: Cache | None
    scratch: Path


@contextmanager
def opened_shot(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any]) -> Iterator[Given]:
    """Provide the inputs of a job on one scene from the arguments of `work`.

    The end of the block removes temporary files. An error from the block has the scene's name in place of the paths of
    the scene's file and of the temporary folder.

    Raises:
        DermisError: see `library_in`.
    """
    with tempfile.TemporaryDirectory(prefix="dermis-shot-", ignore_cleanup_errors=True) as home:
        place, scratch, name = Path(str(parameters["scene"])), Path(home, "out"), str(parameters["name"])
        try:
            if not parameters["scene"]:
                place = Path(home, "scene.npz")
                place.write_bytes(bytes_of(arrays["scene"]))
            library = library_in(Path(home, "presets"), parameters["presets"])
            yield Given(place, library, _cache(arrays, parameters), scratch)
        except DermisError as error:
            where = error.where.replace(str(place), name).replace(str(scratch), name)
            raise error.changed(where=where) from error


def shot_of(arrays: Mapping[str, NDArray[Any]]) -> tuple[Shot, list[bytes]]:
    """Return the shot from the result of the job 'shot', and its files.

    The bytes of the files are in the order of `Shot.names`.
    """
    head = json.loads(bytes_of(arrays["head"]))
    made = Shot(
        tuple(head["names"]),
        tuple(head["refused"]),
        findings_of(head["findings"]),
        head["skipped"],
        head["content_hash"],
    )
    return made, [bytes_of(arrays[str(i)]) for i in range(len(made.names))]


def presets_of(library: Library) -> dict[str, str]:
    """Return the texts of the user's own presets, by path in their folder.

    A process that cannot read this folder makes its library from these texts, see `library_in`.

    Raises:
        DermisError: a preset cannot be read.
    """
    texts: dict[str, str] = {}
    for folder in library.folders[1:]:
        for path in sorted(folder.glob("*/*.json")):
            texts[path.relative_to(folder).as_posix()] = read_bytes(path).decode("utf-8", "surrogateescape")
    return texts


def library_in(folder: Path, texts: Mapping[str, str]) -> Library:
    """Return the library of the shipped presets and of the user's own presets.

    Args:
        folder: folder to which the user's presets are written.
        texts: texts of the user's presets by path, see `presets_of`.

    Raises:
        DermisError: a path is not that of a preset, or the folder cannot be written.
    """
    for name, text in texts.items():
        group, _, file = str(name).partition("/")
        if group not in SCHEMAS or not file.endswith(".json") or Path(file).name != file:
            raise DermisError(
                "not the path of a preset", where="presets", value=str(name)[:80], limit="GROUP/NAME.json"
            )
        write_bytes(folder / group / file, str(text).encode("utf-8", "surrogateescape"))
    return Library(folder) if texts else Library()


def _cache(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any]) -> Cache | None:
    """Return the cache of condensed skins; None if the job has none.

    The cache is a folder that this process can read, or it is filled with the skins among the arrays.
    """
    if "cache" in parameters:
        folder, limit = parameters["cache"]
        return Cache(Path(str(folder)), int(limit))
    skins = {name.partition("/")[2]: array for name, array in arrays.items() if name.startswith("skins/")}
    if not skins:
        return None
    cache = Cache(Path(_home().name), SKIN_BYTES)
    for key, array in skins.items():
        if cache.get(key) is None:
            cache.put(key, functools.partial(_put, bytes_of(array)))
    return cache


def _put(data: bytes, path: Path) -> None:
    path.write_bytes(data)


@functools.cache
def _home() -> tempfile.TemporaryDirectory[str]:
    """Return the folder of the skins that came as arrays.

    It exists as long as the process, because the next shot usually needs the same skins.
    """
    return tempfile.TemporaryDirectory(prefix="dermis-skins-", ignore_cleanup_errors=True)
