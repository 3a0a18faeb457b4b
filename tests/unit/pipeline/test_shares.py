"""Shares of a bake: other processes render some fingers, and not a byte tells."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from core.cache import Cache
from core.contact.pad_sampler import PadSampler
from core.errors import DermisError
from core.pipeline import share_job, shares
from core.pipeline.bake import Progress
from core.pipeline.render import render, run
from core.pipeline.share_job import asked
from core.pipeline.shares import saved, shares_of
from core.presets import Library
from core.recent import Recent
from core.scene import scene_file
from core.scene.tactile_scene import DeviceUse
from core.skin import finger_skin
from core.steps import drain
from core.work.child import environment
from core.work.executor import InlineExecutor
from core.work.processes import ProcessExecutor
from tests.finger_rows import COUNT, alone, holding, same, three


@pytest.fixture(scope="module")
def processes() -> Iterator[ProcessExecutor]:
    with ProcessExecutor(2) as executor:
        yield executor


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shares, "SAVED", 1)  # scenes here are short


def test_processes_give_the_same_bytes(processes: ProcessExecutor, tmp_path: Path) -> None:
    cache, told = Cache(tmp_path, 10**9), list[Progress]()
    alone = drain(render(three("thimble_3rrs"), Library(), cache=cache))
    together = drain(render(three("thimble_3rrs"), Library(), cache=cache, executor=processes), told.append)
    assert len(alone.outputs) == 4 and alone.skins.keys() == {"Thumb", "Index", "Ring"}
    assert any(o.signals["contact"].any() for o in alone.outputs)
    same(alone, together)
    assert {"sampling", "fingers", "devices"} <= {step.stage for step in told}, "no process was asked"
    shares = [step for step in told if step.stage == "fingers"]
    assert {step.total for step in shares} == {shares[0].total} and shares[-1].done == shares[-1].total
    assert all(a.done <= b.done for a, b in zip(shares, shares[1:], strict=False)), "progress went back"
    assert "skin contact" in together.stage_seconds


def test_samples_between_are_the_same_bytes_in_processes(processes: ProcessExecutor, tmp_path: Path) -> None:
    """Fingers that press slowly at 240 samples a second are solved every other sample or so."""
    cache, scene = Cache(tmp_path, 10**9), three("thimble_3rrs", 0.5, 240, 26)
    alone = drain(render(scene, Library(), cache=cache))
    same(alone, drain(render(scene, Library(), cache=cache, executor=processes)))
    assert alone.skipped["skin_frames_between"] > 5


@pytest.mark.parametrize(("workers", "short", "children"), [(2, COUNT, 1), (2, COUNT - 1, 2), (3, COUNT, 3)])
def test_of_two_processes_this_is_one(workers: int, short: int, children: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three shares: one child renders one at least and this process one; of more, or for longer, this one waits."""
    monkeypatch.setattr(shares, "SHORT", short)
    here, rendered = [], shares._rendered_here
    monkeypatch.setattr(shares, "_rendered_here", lambda *given: (here.append(given[1]), rendered(*given))[1])
    with ProcessExecutor(workers) as executor:
        found = drain(render(three(), Library(), executor=executor))
        assert len(executor._threads) == children
    assert bool(here) == (children < workers) and len(here) < 3
    same(alone(), found)


def test_a_device_that_fails_in_a_process_is_told_as_ever() -> None:
    scene = three()
    broken = DeviceUse("pin_array_128", {"pin_method": "no such method"})
    fingers = (scene.fingers[1], replace(scene.fingers[0], devices=(broken,)), scene.fingers[2])
    scene = replace(scene, fingers=fingers)
    alone, together = run(scene), drain(render(scene, Library(), executor=InlineExecutor(2)))
    assert "device-unavailable" in [f.code for f in alone.findings]
    same(alone, together)


def test_what_may_be_held_stays_together(processes: ProcessExecutor) -> None:
    scene = holding()
    alone, pads = run(scene), PadSampler(scene)
    assert {"contact-on-nodes"} <= {f.code for f in alone.skins["Index"].findings}, "nothing was held"
    for chunk in scene.chunks:
        pads.add(chunk)
    found = shares_of(scene, pads.finish(), range(4))
    assert list(found)[0] == (0, 1) and found[0, 1] > COUNT, "they hold the block"
    assert 0 < found[2,] <= COUNT and found[3,] == 0, "one presses a table, one is far from all"
    same(alone, drain(render(scene, Library(), executor=processes)))


def test_what_saves_no_time_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    executor = InlineExecutor(2)
    monkeypatch.setattr(executor, "submit", lambda *_: pytest.fail("somebody was asked"))
    same(alone(), drain(render(three(), Library(), executor=executor)))
    assert saved({(0,): 1000, (1,): 400, (2,): 300}, 2) == 700 and saved({(0,): 1000, (1,): 1}, 1) == 0
    assert saved({}, 2) == 0


def test_what_deforms_is_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, executor = three(), InlineExecutor(2)
    monkeypatch.setattr(executor, "submit", lambda *_: pytest.fail("somebody was asked"))
    mesh = scene.bodies[2].mesh
    assert mesh is not None
    chunks = [replace(c, surfaces={2: (mesh,) * len(c.times)}) for c in scene.chunks]
    soft = replace(scene, bodies=(*scene.bodies[:2], replace(scene.bodies[2], mesh=None)), chunks=chunks)
    assert len(drain(render(soft, Library(), executor=executor)).skins) == 3


def test_the_work_of_a_process_that_dies_is_done_here() -> None:
    line = [sys.executable, "-c", "raise SystemExit(3)"]
    with ProcessExecutor(2, line=line) as dying:
        same(alone(), drain(render(three(), Library(), executor=dying)))


def test_a_process_reads_a_scene_and_makes_its_skins_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It renders several shares, and the skin with its tables serves fingers that are alike."""
    expected, read, made = alone(), list[Path](), list[str]()
    load, make = scene_file.load, finger_skin.finger_skin
    monkeypatch.setattr(share_job, "_opened", Recent(1))
    monkeypatch.setattr(scene_file, "load", lambda path: read.append(path) or load(path))
    monkeypatch.setattr(
        finger_skin, "finger_skin", lambda *given, where, **how: made.append(where) or make(*given, where=where, **how)
    )
    for k in (1, 2):
        executor = InlineExecutor(2)
        same(expected, drain(render(three(), Library(), cache=Cache(tmp_path, 10**9), executor=executor)))
        assert len(read) == k and len(made) == 2 * k, "one skin here and one there, for three fingers"


def test_a_process_that_finds_all_tables_kept_loads_no_scientific_library(tmp_path: Path) -> None:
    """SciPy takes a tenth of a second of every process; a thimble on a skin needs it only to make the tables."""
    scene_file.save(three("thimble_3rrs"), tmp_path / "scene.npz")
    given = asked(tmp_path / "scene.npz", Library(), Cache(tmp_path / "cache", 10**9), [0], [])
    code = (
        "import sys\nfrom core.pipeline.share_job import work\n"
        f"made = work({{}}, {given!r}, lambda *_: None)\nassert made['0/0/signal/contact'].any()\n"
        "print('scipy' in sys.modules)"
    )
    found = []
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found.append(done.stdout.strip())
    assert found == ["True", "False"]


def test_leaving_a_bake_ends_its_processes(processes: ProcessExecutor) -> None:
    steps = render(three(), Library(), executor=processes)
    while next(steps).stage != "fingers":
        pass
    steps.close()
    assert not processes._open, "a job went on"
    same(alone(), drain(render(three(), Library(), executor=processes)))


def test_what_a_process_refuses_is_raised(processes: ProcessExecutor, monkeypatch: pytest.MonkeyPatch) -> None:
    def elsewhere(path: Path, *given: Any) -> dict[str, Any]:
        return {**asked(path, *given), "scene": str(path) + ".gone"}

    monkeypatch.setattr(shares, "asked", elsewhere)
    with pytest.raises(DermisError, match="gone"):
        drain(render(three(), Library(), executor=processes))
