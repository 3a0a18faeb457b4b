"""Shares of a bake: other processes render some fingers, and not a byte tells."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.arrays import Array
from core.cache import Cache
from core.contact.pad_sampler import PadSampler
from core.errors import DermisError
from core.pipeline import shares
from core.pipeline.bake import Bake, Progress
from core.pipeline.render import render, run
from core.pipeline.share_job import asked
from core.pipeline.shares import saved, shares_of
from core.presets import Library
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene
from core.steps import drain
from core.surface.gap import Surface
from core.track import csv
from core.work.executor import InlineExecutor
from core.work.processes import ProcessExecutor
from tests.held_blocks import BLOCK, HALF, carried

RATE, COUNT = 60, 40
DRAFT = {"skin_level": "draft"}


@pytest.fixture(scope="module")
def processes() -> Iterator[ProcessExecutor]:
    with ProcessExecutor(2) as executor:
        yield executor


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shares, "SAVED", 1)  # scenes here are short


def scene_of(fingers: list[Finger], bodies: list[Body], depths: Array, apart: float = 40e-3) -> TactileScene:
    """Return fingers in a row, each above a block of its own, or above the only one, that press into it."""
    times = np.arange(COUNT) / RATE
    poses = np.tile(np.eye(4), (len(fingers), COUNT, 1, 1))
    blocks = np.tile(np.eye(4), (len(bodies), COUNT, 1, 1))
    poses[:, :, 0, 3] = apart * np.arange(len(fingers))[:, None]
    blocks[:, :, 0, 3] = apart * np.arange(len(bodies))[:, None]
    for pose, depth in zip(poses, depths, strict=True):
        pose[:, 2, 3] = 20e-3 - depth * np.sin(np.pi * np.arange(COUNT) / (COUNT - 1))
    cuts = [slice(i, i + 15) for i in range(0, COUNT, 15)]
    chunks = [Chunk(times[c] * RATE, times[c], poses[:, c], blocks[:, c], poses[:0, c]) for c in cuts]
    return TactileScene(
        "row", Fraction(RATE), (0, COUNT - 1), RATE, tuple(fingers), tuple(bodies), (), chunks, findings=()
    )


def three(first: str = "haptip") -> TactileScene:
    """Return fingers with a device, with pins and a shear tactor, and with a shear tactor and a skin that is shown."""
    block = Surface.block(30e-3, 30e-3, 20e-3).mesh
    lifted = replace(block, vertices=block.vertices + [0.0, 0.0, 20e-3 - block.vertices[:, 2].max()])
    fingers = [
        Finger("Thumb", (DeviceUse(first),), {**DRAFT, "skin_shown": True}),
        Finger("Index", (DeviceUse("pin_array_128"), DeviceUse("haptip")), DRAFT),
        Finger("Ring", (DeviceUse("haptip"),), {**DRAFT, "skin_shown": True}),
    ]
    bodies = [Body(f"block {i}", lifted, {"friction": 0.4}) for i in range(3)]
    return scene_of(fingers, bodies, np.array([1e-3, 0.8e-3, 6e-3]))


def same(one: Bake, other: Bake) -> None:
    assert one.content_hash == other.content_hash and one.skipped == other.skipped
    assert [str(f) for f in one.all_findings] == [str(f) for f in other.all_findings]
    assert [csv.dumps(o.track) for o in one.outputs] == [csv.dumps(o.track) for o in other.outputs]
    for mine, theirs in zip(one.outputs, other.outputs, strict=True):
        assert mine.track.spec == theirs.track.spec and list(mine.track.meta) == list(theirs.track.meta)
        assert mine.track.values.tobytes() == theirs.track.values.tobytes() and list(mine.signals) == list(
            theirs.signals
        )
        assert all(mine.signals[name].tobytes() == theirs.signals[name].tobytes() for name in mine.signals)
    assert list(one.skins) == list(other.skins)
    for name, skin in one.skins.items():
        for field in ("contact", "force", "normal_force", "depth", "slide", "sticking"):
            assert getattr(skin, field).tobytes() == getattr(other.skins[name], field).tobytes()
        assert (skin.points is None) == (other.skins[name].points is None)
        if skin.points is not None:
            assert skin.points.force.tobytes() == other.skins[name].points.force.tobytes()


def test_processes_give_the_same_bytes(processes: ProcessExecutor, tmp_path: Path) -> None:
    cache, told = Cache(tmp_path, 10**9), list[Progress]()
    alone = drain(render(three("thimble_3rrs"), Library(), cache=cache))
    together = drain(render(three("thimble_3rrs"), Library(), cache=cache, executor=processes), told.append)
    assert len(alone.outputs) == 4 and alone.skins.keys() == {"Thumb", "Index", "Ring"}
    assert any(o.signals["contact"].any() for o in alone.outputs)
    same(alone, together)
    assert {"sampling", "fingers", "devices"} <= {step.stage for step in told}, "no process was asked"
    assert "skin contact" in together.stage_seconds


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


def holding() -> TactileScene:
    """Return a block between two fingers, one finger on a table, and one in the air."""
    path = np.zeros((COUNT, 3))
    path[:, 0] = 0.01 * np.linspace(0.0, 1.0, COUNT) ** 2
    block, pair = carried(path)
    poses = np.concatenate([pair, np.tile(np.eye(4), (2, COUNT, 1, 1))])
    poses[2, :, 0, 3], poses[2, :, 2, 3] = 0.4, HALF[2] - 0.5e-3
    poses[3, :, 2, 3] = 0.8
    bodies = np.stack([block, np.tile(np.eye(4), (COUNT, 1, 1))])
    bodies[1, :, 0, 3] = 0.4
    fingers = tuple(Finger(name, (), {**DRAFT, "skin_shown": True}) for name in ("Index", "Thumb", "Ring", "Little"))
    given = {"friction": 0.6, "held_mode": "auto", "mass": 0.03}
    things = (Body("block", BLOCK, given), Body("table", BLOCK, {"friction": 0.6}))
    times = np.arange(COUNT) / RATE
    chunks = [Chunk(times * RATE, times, poses, bodies, poses[:0])]
    return TactileScene("hold", Fraction(RATE), (0, COUNT - 1), RATE, fingers, things, (), chunks)


def test_what_saves_no_time_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    executor = InlineExecutor(2)
    monkeypatch.setattr(executor, "submit", lambda *_: pytest.fail("somebody was asked"))
    same(run(three()), drain(render(three(), Library(), executor=executor)))
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
        same(run(three()), drain(render(three(), Library(), executor=dying)))


def test_leaving_a_bake_ends_its_processes(processes: ProcessExecutor) -> None:
    steps = render(three(), Library(), executor=processes)
    while next(steps).stage != "fingers":
        pass
    steps.close()
    assert not processes._open, "a job went on"
    same(run(three()), drain(render(three(), Library(), executor=processes)))


def test_what_a_process_refuses_is_raised(processes: ProcessExecutor, monkeypatch: pytest.MonkeyPatch) -> None:
    def elsewhere(path: Path, *given: Any) -> dict[str, Any]:
        return {**asked(path, *given), "scene": str(path) + ".gone"}

    monkeypatch.setattr(shares, "asked", elsewhere)
    with pytest.raises(DermisError, match="gone"):
        drain(render(three(), Library(), executor=processes))
