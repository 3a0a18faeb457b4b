"""Task-driven design from scenes and recordings.

The command line and the panel use these functions.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contact.skin_contact import SkinContact
from ..contact.skin_sampler import SkinSampler
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..files import write_bytes
from ..interpolate import interpolate
from ..matching.adaptive_sweep import LEAST, build_adaptive
from ..matching.platforms import ends_of, mechanism, original_channels, scale_of
from ..matching.readings import readings_of
from ..matching.table import SkinTable, belongs
from ..parameters.error_bands import LINEAR
from ..scene.tactile_scene import TactileScene
from ..skin.finger_skin import of_tissue
from ..skin.material import Elastic
from ..skin.model import SkinModel, fingertip_skin
from ..skin.shape import FingertipShape
from ..steps import in_words
from ..work.executor import JobExecutor
from .answer import Design, design
from .collect import collect, reversed_spread
from .coupled_preset import preset, write_preset
from .interactions import NOISE, RATE
from .picture import write_picture
from .recorded_table import read_table, rest_finding
from .recordings import Recording, read_recording, same_channels
from .report import as_json, as_text
from .synergies import Rule
from .trial import sense

ROWS = 9261  # default number of rows of a table: 21 steps for each of three motors, a few seconds
Sensed = Mapping[str, NDArray[Any] | Recording]


@dataclass(frozen=True)
class Step:
    """Progress of a design: `done` steps of a stage out of `total`."""

    stage: str
    done: int
    total: int


def sense_scene(
    scene: TactileScene, skin: SkinModel, finger: int = 0, *, noise: float = NOISE, seed: int = 0
) -> Generator[Step, None, NDArray[np.uint16]]:
    """Return the virtual sensor's readings of one finger during a scene.

    The rate is 100 Hz.

    Args:
        scene: the scene.
        skin: skin of the finger.
        finger: index of the finger.
        noise: standard deviation of one channel [counts].
        seed: seed of the noise.

    Raises:
        DermisError: the scene has no such finger, or cannot be rendered.
    """
    scene.validate()
    if not 0 <= finger < len(scene.fingers):
        raise DermisError(
            "no such finger", where=f"scene '{scene.name}'", value=finger, limit=f"0 to {len(scene.fingers) - 1}"
        )
    sampler = SkinSampler(scene, {finger: skin})
    done = 0
    for chunk in scene.chunks:
        sampler.add(chunk)
        done += len(chunk.times)
        yield Step("touch", done, scene.sample_count)
    return sense_touch(sampler.finish()[finger], noise=noise, seed=seed)


def sense_touch(touch: SkinContact, *, noise: float = NOISE, seed: int = 0) -> NDArray[np.uint16]:
    """Return the virtual sensor's readings of a touch at 100 Hz.

    The touch consists of states of a skin, such as those of a bake.
    """
    sensed = sense(touch, noise, seed)
    if len(touch.times) < 2 or np.abs(np.diff(touch.times) * RATE - 1.0).max() < 1e-6:
        return sensed
    times = np.arange(int(touch.times[-1] * RATE + 1e-9) + 1) / RATE
    return np.rint(interpolate(touch.times, sensed.astype(float), times)).astype(np.uint16)


def load_table(spec: DeviceSpec, file: Path, rest_rows: Sequence[int] = ()) -> SkinTable:
    """Load a device's table from a file.

    A recorded table is read from .csv, a collected one from any other file.

    Args:
        rest_rows: rows of a recorded table in which nothing is touched, counted from 1 below the line of names.

    Raises:
        DermisError: the file cannot be read, the table belongs to another device, or `rest_rows` are given for a
            collected table.
    """
    if file.suffix.lower() == ".csv":
        ends = np.array([ends_of(channel) for channel in original_channels(spec)]).T
        table = read_table(file, scale_of(spec), ends, mechanism(spec).rest, rest_rows)
    else:
        if rest_rows:
            raise DermisError("a collected table states its untouched row itself", where=str(file), limit=".csv")
        table = SkinTable.load(file)
    belongs(table, spec, where=str(file))
    return table


def table_for(
    spec: DeviceSpec,
    shape: FingertipShape,
    folder: Path,
    *,
    level: str = "draft",
    rows: int | None = ROWS,
    executor: JobExecutor | None = None,
    material: Mapping[str, float] | None = None,
    tissue: str = LINEAR,
    adaptive: bool = False,
    noise: float = NOISE,
) -> Generator[Step, None, SkinTable]:
    """Compute a device's table by a sweep.

    For the arguments that are not described here, see `collect`.

    Args:
        adaptive: whether the rows are placed where the device touches and where its readings are curved. An adaptive
            sweep runs in this process, and does not use `folder` and `executor`.
        noise: standard deviation of one channel [counts]; an adaptive sweep does not resolve smaller differences.

    Raises:
        DermisError: the sweep fails, or `rows` is None for an adaptive sweep.
    """
    if adaptive:
        if rows is None:
            raise DermisError("an adaptive table needs a number of rows", where="--rows", limit=f">= {LEAST}")
        skin = of_tissue(fingertip_skin(shape, Elastic(**(material or {})), level=level), tissue)
        made = build_adaptive(spec, skin, readings_of(skin), rows, noise)
        return in_words(made, lambda step: Step("table", *step))
    steps = collect(spec, shape, folder, level=level, rows=rows, executor=executor, material=material, tissue=tissue)
    return in_words(steps, lambda step: Step("table", *step))


def answer(
    spec: DeviceSpec,
    table: SkinTable,
    sensed: Sensed,
    *,
    noise: float = NOISE,
    recorded_noise: float | None = None,
    skin: SkinModel | None = None,
    spread: bool = False,
) -> Generator[Step, None, Design]:
    """Find how many motors the sensed interactions need.

    Args:
        noise: standard deviation of one channel of the virtual sensor [counts].
        recorded_noise: standard deviation of one channel of the recordings, in their own unit; None to estimate it from
            each recording.
        skin: skin of the interactions, if they are simulated. A table made with another skin is then reported.
        spread: whether to compute `reversed_spread` on this skin as well, which takes about a second.

    Raises:
        DermisError: see `answer.design`; also if the channels of a recording are not those of the table.
    """
    yield Step("components", 0, 1)
    targets, sensors, noises = {}, {}, []
    for name, given in sensed.items():
        if isinstance(given, Recording):
            same_channels(given, table)
            targets[name] = given.tared(table.exact_readings[table.rest])
            noises.append(given.noise if recorded_noise is None else recorded_noise)
            sensors[name] = f"recorded, {len(given.channels)} channels, noise {noises[-1]:.3g} a channel"
        else:
            targets[name] = np.asarray(given, np.float64)
            noises.append(noise)
    found = design(spec, table.heard_with(max(noises, default=0.0)), targets, sensors)
    doubts: tuple[Finding, ...] = (*belongs(table, spec, skin), *rest_finding(table), *found.findings)
    reversed_sweep = reversed_spread(spec, skin) if spread and skin is not None else {}
    yield Step("components", 1, 1)
    return replace(found, findings=doubts, reversed_sweep=reversed_sweep)


def read_sensed(paths: Sequence[Path], rest: tuple[float, float] | None = None) -> dict[str, Recording]:
    """Read recordings into a dictionary by the names of their files.

    Args:
        rest: start and end of the interval of each recording in which nothing is touched [s].

    Raises:
        DermisError: a recording cannot be used, or two recordings have the same name.
    """
    found: dict[str, Recording] = {}
    for path in paths:
        recording = read_recording(path, rest)
        if recording.name in found:
            raise DermisError("two recordings have one name", where=str(path), value=recording.name)
        found[recording.name] = recording
    return found


def write(found: Design, folder: Path, *, rule: Rule = "touch", motors: int | None = None) -> tuple[Path, ...]:
    """Write the reports and the new preset; return their paths.

    The files are report.txt, report.json, report.png and the preset. No preset is written if `motors` is None and
    an interaction is rendered so poorly that the rule gives no number.

    Raises:
        DermisError: `motors` is out of range, or the folder cannot be written.
    """
    folder = Path(folder)
    made = preset(found, rule, motors) if motors is not None or not found.poor else None
    names = ["report.txt", "report.json", "report.png"]
    if made is not None:
        names.append(f"{found.spec.key}_{len(made['channels'])}_motors.json")
    paths = tuple(folder / name for name in names)
    write_bytes(paths[0], as_text(found).encode())
    text = json.dumps(as_json(found), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_bytes(paths[1], text.encode())
    write_picture(found, paths[2], rule)
    if made is not None:
        write_preset(made, paths[3])
    return paths
