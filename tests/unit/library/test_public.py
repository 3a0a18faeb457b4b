"""What `dermis` shows: its names, their docstrings, the doctests in them, and one line for each thing."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import core

from .conftest import Installed

# Every module that a public name lives in, with the library installed under its own name.
RUN_DOCTESTS = """
import doctest, json, sys
import dermis
modules = {dermis.__name__} | {f"dermis.{module}" for module, _ in dermis._PUBLIC.values()}
tried = failed = 0
for name in sorted(modules):
    __import__(name)
    result = doctest.testmod(sys.modules[name], optionflags=doctest.NORMALIZE_WHITESPACE)
    tried, failed = tried + result.attempted, failed + result.failed
print(json.dumps([tried, failed]))
"""


def test_the_doctests_hold(library: Installed) -> None:
    *failures, counts = library.run("-c", RUN_DOCTESTS).splitlines()
    tried, failed = map(int, re.findall(r"\d+", counts))
    assert failed == 0, "\n".join(failures)
    assert tried > 40


def test_dir_is_what_people_use() -> None:
    assert dir(core) == sorted({*core.__all__, "__version__"}, key=dir(core).index)
    assert core.__all__ == sorted(core._PUBLIC), "one list for the reader, one for the loader, the same names"
    for name in core.__all__:
        module, attribute = core._PUBLIC[name]
        assert getattr(core, name).__module__.startswith("core."), name
        assert getattr(core, name).__name__ == attribute, name
    with pytest.raises(AttributeError, match="no attribute 'pickle'"):
        core.pickle  # noqa: B018


@pytest.mark.parametrize("name", core.__all__)
def test_every_public_thing_says_what_it_is(name: str) -> None:
    """A docstring each, for its public methods too; and what a function may raise where it refuses."""
    thing = getattr(core, name)
    assert inspect.getdoc(thing), name
    for key, member in vars(thing).items() if inspect.isclass(thing) else ():
        if key.startswith("_") or not (callable(member) or isinstance(member, property | classmethod | staticmethod)):
            continue
        assert inspect.getdoc(getattr(thing, key)), f"{name}.{key}"


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """One of everything that a script may hold, larger than a line would take."""
    skin = core.fingertip(level="draft")
    touch = core.press(skin, core.Surface.sphere(5e-3, 5_000), 0.5e-3)
    block = core.Surface.block()
    mesh = block.mesh
    pins = core.Finger("Index", (core.DeviceUse("pin_array_128"),), {"skin_level": "draft"})
    volts = core.Finger("Middle", (core.DeviceUse("electrovibration"),))
    screen = core.Screen("Panel", (0.2, 0.1), np.eye(100, 200, dtype=np.float32), 1e-3)
    table = core.Body("Table", mesh, core.Library().material("wood"))
    ways = [[(x, 0.0, -1e-3 + i * 2e-4) for i in range(20)] for x in (0.0, 0.5)]
    scene = core.scene_from_poses(
        240.0, list(zip((pins, volts), ways, strict=True)), [(table, (0, 0, 0))], [(screen, (0.5, 0, 0))]
    )
    folder = tmp_path_factory.mktemp("things")
    core.save_scene(scene, folder / "scene.npz")
    bake = core.run(scene)
    assert len(bake.outputs) == 2 and len(bake.skins) == 1
    library = core.Library(folder)
    spec = library.device("pin_array_128")
    findings = [*bake.all_findings, core.Finding("warning", "odd", "too odd", "here", 3.0, "2", "Do less", 7.0)]
    with core.ProcessExecutor() as executor:
        shown = [repr(executor), repr(core.Cache(folder, 1_000_000))]
    step = next(core.render(scene, library))
    return [
        core.curved_mesh(mesh),
        *(skin, skin.mesh, skin.material, touch, core.match(touch), core.match(touch).rendered, block),
        *(scene, *scene.chunks, core.load_scene(folder / "scene.npz"), core.load_scene(folder / "scene.npz").chunks),
        *(mesh, pins, pins.devices[0], volts, screen, table, bake, *bake.outputs, *bake.skins.values()),
        *(bake.outputs[0].track, library, spec, spec.channels[0], *library.list("skins"), step, *findings, *shown),
    ]


def test_one_line_shows_each_thing_and_arrays_never_spill(things: list[Any]) -> None:
    kinds = {type(thing).__name__ for thing in things}
    classes = {name for name in core.__all__ if inspect.isclass(getattr(core, name))}
    assert classes - kinds <= {"DermisError", "ProcessExecutor", "Cache"}
    for thing in things:
        line = thing if isinstance(thing, str) else repr(thing)
        assert "\n" not in line and len(line) < 300 and "array(" not in line, line
        assert not re.search(r" at 0x[0-9a-f]+", line), line


def test_from_poses_says_what_it_cannot_place() -> None:
    """Still things are still, moving ones move, frames are samples; what does not fit is refused by name."""
    pose = np.eye(4)
    pose[:3, 3] = (1.0, 2.0, 3.0)
    table = core.Body("Table", core.Surface.block().mesh)
    finger = core.Finger("Index")
    scene = core.scene_from_poses(50.0, [(finger, [(0, 0, 0.1), (0, 0, 0.2), (0, 0, 0.3)])], [(table, pose)])
    (chunk,) = scene.chunks
    assert scene.sample_count == 3 and scene.duration == pytest.approx(0.04)
    assert chunk.fingers[0, :, 2, 3].tolist() == [0.1, 0.2, 0.3] and (chunk.bodies[0] == pose).all()
    assert chunk.screens.shape == (0, 3, 4, 4) and chunk.frames.tolist() == [1.0, 2.0, 3.0]
    for wrong, said in (
        ([(0, 0, 0)], "nothing moves"),
        ([(0, 0)] * 3, "Index: neither positions nor poses"),
        ([(0, 0, np.nan)] * 3, "Index: neither positions nor poses"),
        (np.zeros((3, 3, 4)), "Index: neither positions nor poses"),
    ):
        with pytest.raises(core.DermisError, match=said):
            core.scene_from_poses(50.0, [(finger, wrong)], [(table, pose)])
    for rate in (0.0, -1.0, np.nan):
        with pytest.raises(core.DermisError, match="rate must be positive"):
            core.scene_from_poses(rate, [(finger, [(0, 0, 0)] * 3)], [(table, pose)])
    with pytest.raises(core.DermisError, match="same number of samples.*2, 3"):
        core.scene_from_poses(50.0, [(finger, [(0, 0, 0)] * 3)], [(table, [pose] * 2)])


def test_paths_may_be_plain_text(tmp_path: Path) -> None:
    track = core.CommandTrack(core.Library().device("haptip"), np.arange(3) / 1e3, np.zeros((3, 4)))
    core.write_csv(track, str(tmp_path / "a.csv"))
    assert core.read_csv(str(tmp_path / "a.csv")).spec.key == "haptip"
