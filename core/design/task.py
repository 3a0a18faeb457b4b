"""From scenes and recordings to an answer: what the command line and the panel run."""

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
from ..matching.platforms import ends_of, original_channels, scale_of
from ..matching.table import SkinTable, belongs
from ..scene.tactile_scene import TactileScene
from ..skin.model import SkinModel
from ..skin.shape import FingertipShape
from ..steps import in_words
from ..stiffening.stiffening import Stiffening
from ..work.executor import JobExecutor
from .collect import collect, reversed_spread
from .coupled_preset import preset, write_preset
from .interactions import NOISE, RATE
from .picture import write_picture
from .recordings import Recording, read_recording, read_table, same_channels
from .report import Design, as_json, as_text, design
from .synergies import Rule
from .trial import sense

ROWS = 9261  # of the table where nobody says: 21 steps a motor, a few seconds
Sensed = Mapping[str, NDArray[Any] | Recording]


@dataclass(frozen=True)
class Step:
    """How far the work is: `done` of `total` of the named stage."""

    stage: str
    done: int
    total: int


def sense_scene(
    scene: TactileScene, skin: SkinModel, finger: int = 0, *, noise: float = NOISE, seed: int = 0
) -> Generator[Step, None, NDArray[np.uint16]]:
    """Return what the virtual sensor of one finger reads along a scene, at 100 Hz.

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
    """Return what the virtual sensor reads along what a skin felt, such as a bake's, at 100 Hz."""
    sensed = sense(touch, noise, seed)
    if len(touch.times) < 2 or np.abs(np.diff(touch.times) * RATE - 1.0).max() < 1e-6:
        return sensed
    times = np.arange(int(touch.times[-1] * RATE + 1e-9) + 1) / RATE
    return np.rint(interpolate(touch.times, sensed.astype(float), times)).astype(np.uint16)


def load_table(spec: DeviceSpec, file: Path) -> SkinTable:
    """Return a device's table from a file: .npz collected, .csv recorded.

    Raises:
        DermisError: a file that cannot be read, or a table of another device.
    """
    if file.suffix.lower() == ".csv":
        ends = np.array([ends_of(channel) for channel in original_channels(spec)]).T
        table = read_table(file, scale_of(spec), ends)
    else:
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
    stiffening: Stiffening | None = None,
) -> Generator[Step, None, SkinTable]:
    """Return a device's table, swept by an executor and kept in a folder.

    Raises:
        DermisError: a sweep that fails.
    """
    steps = collect(
        spec, shape, folder, level=level, rows=rows, executor=executor, material=material, stiffening=stiffening
    )
    return in_words(steps, lambda step: Step("table", *step))


def answer(
    spec: DeviceSpec,
    table: SkinTable,
    sensed: Sensed,
    *,
    noise: float = NOISE,
    skin: SkinModel | None = None,
    spread: bool = False,
) -> Generator[Step, None, Design]:
    """Return how many motors the sensed interactions need.

    Args:
        skin: what the interactions were sensed with, where they are simulated: tells a table of another skin.
        spread: tell the spread of the reversed sweep on that skin too; a second.

    Raises:
        DermisError: see `report.design`; or a recording whose channels are not those of a recorded table.
    """
    yield Step("components", 0, 1)
    targets = {}
    for name, given in sensed.items():
        if isinstance(given, Recording):
            same_channels(given, table)
        targets[name] = np.asarray(given.readings if isinstance(given, Recording) else given, np.float64)
    found = design(spec, table.heard_with(noise), targets)
    doubts: tuple[Finding, ...] = belongs(table, spec, skin) + found.findings
    reversed_sweep = reversed_spread(spec, skin) if spread and skin is not None else {}
    yield Step("components", 1, 1)
    return replace(found, findings=doubts, reversed_sweep=reversed_sweep)


def read_sensed(paths: Sequence[Path]) -> dict[str, Recording]:
    """Read recordings, by the names of their files.

    Raises:
        DermisError: one that cannot be used, or two of one name.
    """
    found: dict[str, Recording] = {}
    for path in paths:
        recording = read_recording(path)
        if recording.name in found:
            raise DermisError("two recordings have one name", where=str(path), value=recording.name)
        found[recording.name] = recording
    return found


def write(found: Design, folder: Path, *, rule: Rule = "touch", motors: int | None = None) -> tuple[Path, ...]:
    """Write report.txt, report.json, report.png and the new preset into a folder; return their paths.

    Raises:
        DermisError: more motors than the device has, or a folder that cannot be written.
    """
    folder = Path(folder)
    made = preset(found, rule, motors)
    count = len(made["channels"])
    paths = tuple(
        folder / name for name in ("report.txt", "report.json", "report.png", f"{found.spec.key}_{count}_motors.json")
    )
    write_bytes(paths[0], as_text(found).encode())
    text = json.dumps(as_json(found), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_bytes(paths[1], text.encode())
    write_picture(found, paths[2], rule)
    write_preset(made, paths[3])
    return paths
