"""One sampled scene to the files of its tracks: in this process, or as a job whose files come back as bytes."""

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


SKIN_BYTES = 1 << 30  # that a worker keeps of skins: some seventy of the standard mesh


@dataclass(frozen=True)
class Wanted:
    """Options of a shot's files: pictures, maps of touch screens, other formats, and those in spite of errors."""

    plots: bool = False
    maps: bool = False
    formats: tuple[str, ...] = ()
    force: bool = False


@dataclass(frozen=True)
class Shot:
    """Results of a scene.

    Attributes:
        names: names of the written files, in the order of writing.
        refused: tracks that were not written, with the reason.
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
        DermisError: see `render` and `export`; where there is nothing to export, with the findings.
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
    """Write tracks in other formats; return the findings of their checks, and the tracks that were refused."""
    told: list[Finding] = []
    refused, names = [], FileNames()
    for form in dict.fromkeys(wanted.formats):
        for stem, output in zip(file_names(bake), bake.outputs, strict=True):
            path = folder / names.take(stem, format_of(form).suffix)
            try:
                told += write(output.track, path, form, force=wanted.force)
                paths.append(path)
            except DermisError as error:  # one finger's track does not take the others down
                refused.append(f"{output.finger}, {output.device}, {form}: {error}")
    return told, refused


def work(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report) -> dict[str, NDArray[Any]]:
    """Render a shot: the job 'shot'.

    Args:
        arrays: 'scene' (the file's bytes) where there is no path; 'skins/KEY' (files of a cache), if any.
        parameters: 'scene' (a path, or '' where its bytes came), 'name' (of the scene, for errors), 'presets' (a
            person's own: path in the folder -> text), 'wanted' (see `Wanted`), 'cache' (folder and bytes), if any.

    Returns:
        'head' (JSON) and the files' bytes, by their numbers.

    Raises:
        DermisError: see `render_shot`.
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
    """Inputs of a job for a scene: the scene's file, presets, skins, and a folder of its own to write to."""

    scene: Path
    library: Library
    cache: Cache | None
    scratch: Path


@contextmanager
def opened_shot(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any]) -> Iterator[Given]:
    """Give a job its scene, as `work` is given it; refusals inside the block name it as whoever asked does."""
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
    """Return the results of the job 'shot': the shot, and the bytes of its files in the order of their names."""
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
    """Return a person's own presets as texts, by path in their folder, to travel to where that folder is not.

    Raises:
        DermisError: one cannot be read.
    """
    texts: dict[str, str] = {}
    for folder in library.folders[1:]:
        for path in sorted(folder.glob("*/*.json")):
            texts[path.relative_to(folder).as_posix()] = read_bytes(path).decode("utf-8", "surrogateescape")
    return texts


def library_in(folder: Path, texts: Mapping[str, str]) -> Library:
    """Return the presets that ship, and a person's own that travelled as texts."""
    for name, text in texts.items():
        group, _, file = str(name).partition("/")
        if group not in SCHEMAS or not file.endswith(".json") or Path(file).name != file:
            raise DermisError("not a preset's place", where="presets", value=str(name)[:80], limit="GROUP/NAME.json")
        write_bytes(folder / group / file, str(text).encode("utf-8", "surrogateescape"))
    return Library(folder) if texts else Library()


def _cache(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any]) -> Cache | None:
    """Return where condensed skins are: in a folder that this process sees, or among the arrays."""
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
    """Return where skins that came as arrays lie as long as this process runs: the next shot has the same ones."""
    return tempfile.TemporaryDirectory(prefix="dermis-skins-", ignore_cleanup_errors=True)
