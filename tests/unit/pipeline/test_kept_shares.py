"""Kept shares: a bake renders only the fingers that something has changed for, and not a byte tells."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.contact.skin_stepper import SkinStepper
from core.pipeline.bake import Bake
from core.pipeline.kept_shares import MOST, KeptShares, size_of
from core.pipeline.render import render, run
from core.presets import Library
from core.scene.tactile_scene import Chunk, DeviceUse, TactileScene
from core.steps import drain
from core.work.processes import ProcessExecutor
from tests.finger_rows import alone, holding, same, three

Change = Callable[[TactileScene], TactileScene]


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the fingers of all samples whose contact is solved."""
    seen: list[str] = []
    step = SkinStepper.step

    def noted(self: SkinStepper, *given: Any, **named: Any) -> Any:
        seen.append(self.name)
        return step(self, *given, **named)

    monkeypatch.setattr(SkinStepper, "step", noted)
    return seen


@pytest.fixture(scope="module")
def baked() -> KeptShares:
    """Return what came of three fingers, rendered once."""
    before = KeptShares()
    again(three(), before)
    return before


@pytest.fixture(scope="module")
def far_baked() -> KeptShares:
    """Return what came of three fingers beside an object ten metres away."""
    before = KeptShares()
    again(far(three()), before)
    return before


def copied(kept: KeptShares) -> KeptShares:
    """Return the same shares, whose counters begin anew."""
    other = KeptShares()
    other._shares = dict(kept._shares)
    return other


def again(scene: TactileScene, before: KeptShares, library: Library | None = None) -> Bake:
    return drain(render(scene, library or Library(), before=before))


def moved(chunks: Any, kind: str, index: int, along: int, by: float) -> list[Chunk]:
    """Return chunks in which one thing is elsewhere."""
    out = []
    for chunk in chunks:
        poses = getattr(chunk, kind).copy()
        poses[index, :, along, 3] += by
        out.append(replace(chunk, **{kind: poses}))
    return out


def test_the_same_scene_again_solves_nothing(solved: list[str]) -> None:
    before = KeptShares()
    first = again(three(), before)
    assert (before.found, before.made) == (0, 3) and "fingers_unchanged" not in first.skipped and solved
    solved.clear()
    second = again(three(), before)
    assert (before.found, before.made) == (3, 3) and second.skipped["fingers_unchanged"] == 3
    assert not solved and "skin contact" not in second.stage_seconds
    same(first, second)
    same(second, alone())


def given(scene: TactileScene, finger: int, **parameters: Any) -> TactileScene:
    fingers = list(scene.fingers)
    fingers[finger] = replace(fingers[finger], parameters={**fingers[finger].parameters, **parameters})
    return replace(scene, fingers=tuple(fingers))


def made_of(scene: TactileScene, body: int, **parameters: Any) -> TactileScene:
    bodies = list(scene.bodies)
    bodies[body] = replace(bodies[body], parameters={**bodies[body].parameters, **parameters})
    return replace(scene, bodies=tuple(bodies))


def animated(scene: TactileScene, name: str, value: float) -> TactileScene:
    chunks = [replace(c, animated={name: np.full(len(c.times), value)}) for c in scene.chunks]
    return replace(scene, chunks=chunks)


def lifted(scene: TactileScene, body: int) -> TactileScene:
    mesh = scene.bodies[body].mesh
    assert mesh is not None
    bodies = list(scene.bodies)
    bodies[body] = replace(bodies[body], mesh=replace(mesh, vertices=mesh.vertices + [0.0, 0.0, 0.1e-3]))
    return replace(scene, bodies=tuple(bodies))


def later(scene: TactileScene, **brought: Any) -> TactileScene:
    """Return the scene in chunks, of which those from the third on bring something."""
    chunks = cut(scene)
    late = [
        replace(c, **{name: {k: make(len(c.times)) for k, make in what.items()} for name, what in brought.items()})
        for c in chunks[2:]
    ]
    return replace(scene, chunks=[*chunks[:2], *late])


def higher(scene: TactileScene, body: int) -> TactileScene:
    """Return the scene in which an object gets higher later on."""
    mesh = lifted(scene, body).bodies[body].mesh
    return later(scene, surfaces={body: lambda n: (mesh,) * n})


def wearing(scene: TactileScene, finger: int, **parameters: Any) -> TactileScene:
    fingers = list(scene.fingers)
    fingers[finger] = replace(fingers[finger], devices=(DeviceUse("pin_array_128", parameters), DeviceUse("haptip")))
    return replace(scene, fingers=tuple(fingers))


CHANGES: dict[str, tuple[Change, set[str]]] = {
    "a material": (lambda s: made_of(s, 1, friction=0.9), {"Index"}),
    "a finger's path": (lambda s: replace(s, chunks=moved(s.chunks, "fingers", 1, 1, 1e-3)), {"Index"}),
    "an object's path": (lambda s: replace(s, chunks=moved(s.chunks, "bodies", 0, 1, 1e-3)), {"Thumb"}),
    "a mesh": (lambda s: lifted(s, 0), {"Thumb"}),
    "what it wears": (lambda s: wearing(s, 1, pin_method="FM2"), {"Index"}),
    "a skin": (lambda s: given(s, 2, contact="nodes"), {"Ring"}),
    "an animated friction": (lambda s: animated(s, "body/1/friction", 0.9), {"Index"}),
    "a friction that changes later": (
        lambda s: later(s, animated={"body/1/friction": lambda n: np.full(n, 0.9)}),
        {"Index"},
    ),
    "a mesh that changes later": (lambda s: higher(s, 0), {"Thumb"}),
    "an object that comes": (lambda s: replace(s, chunks=moved(s.chunks, "bodies", 2, 0, -40e-3)), {"Index", "Ring"}),
    "how far everybody looks": (lambda s: given(s, 2, touch_distance=1e-3), {"Thumb", "Index", "Ring"}),
    "a cut": (lambda s: replace(s, chunks=[*cut(s)]), set()),
    "a far object's friction": (lambda s: made_of(far(s), 3, friction=0.9), set()),
    "a far object's path": (lambda s: replace(far(s), chunks=moved(far(s).chunks, "bodies", 3, 1, 0.2)), set()),
}


def far(scene: TactileScene) -> TactileScene:
    """Return the scene with an object ten metres away."""
    chunks = []
    for chunk in scene.chunks:
        poses = chunk.bodies[:1].copy()
        poses[0, :, 1, 3] = 10.0
        chunks.append(replace(chunk, bodies=np.concatenate([chunk.bodies, poses])))
    return replace(scene, bodies=(*scene.bodies, replace(scene.bodies[0], name="far")), chunks=chunks)


def cut(scene: TactileScene) -> list[Chunk]:
    """Return the samples in chunks of seven."""
    out = []
    for c in scene.chunks:
        for i in range(0, len(c.times), 7):
            part = slice(i, i + 7)
            poses = (c.fingers[:, part], c.bodies[:, part], c.screens[:, part])
            out.append(Chunk(c.frames[part], c.times[part], *poses))
    return out


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("what", CHANGES)
def test_only_whom_a_change_concerns_is_rendered(
    what: str, baked: KeptShares, far_baked: KeptShares, solved: list[str]
) -> None:
    change, concerned = CHANGES[what]
    before = copied(far_baked if "far " in what else baked)
    changed = again(change(three()), before)
    assert before.made == len(concerned) and changed.skipped.get("fingers_unchanged", 0) == 3 - len(concerned)
    assert set(solved) <= {f"finger '{name}'" for name in concerned} and bool(solved) == bool(concerned)
    same(changed, run(change(three())))


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_who_holds_together_is_rendered_together() -> None:
    before = KeptShares()
    again(holding(), before)
    heavier = made_of(holding(), 0, mass=0.05)
    changed = again(heavier, before)
    assert (before.found, before.made) == (2, 4) and changed.skipped["fingers_unchanged"] == 2, "two of four"
    same(changed, run(heavier))


def test_a_preset_or_a_file_that_has_changed_counts(tmp_path: Path) -> None:
    (tmp_path / "devices").mkdir()
    preset = tmp_path / "devices" / "pin_array_128.json"
    table = tmp_path / "table.npz"
    table.write_bytes(b"one")
    scene = wearing(three(), 1, pin_method="FM2", pin_note=str(table))
    source = Library().load("devices", "pin_array_128")
    preset.write_text(json.dumps(source), encoding="utf-8")
    before = KeptShares()
    again(scene, before, Library(tmp_path))
    again(scene, before, Library(tmp_path))
    assert (before.found, before.made) == (3, 3)
    table.write_bytes(b"other")
    again(scene, before, Library(tmp_path))
    assert (before.found, before.made) == (5, 4)
    preset.write_text(json.dumps({**source, "rate": 60.0}), encoding="utf-8")
    changed = again(scene, before, Library(tmp_path))
    assert (before.found, before.made) == (7, 5)
    same(changed, drain(render(scene, Library(tmp_path))))


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_memory_is_bounded(baked: KeptShares) -> None:
    before = copied(baked)
    sizes = sorted(size for _, size in before._shares.values())
    assert before.size == sum(sizes) > 50_000 and len(before) == 3
    assert size_of(next(iter(before._shares.values()))[0]) in sizes
    small = KeptShares(sizes[-1])
    again(three(), small)
    again(made_of(three(), 1, friction=0.9), small)
    assert small.size <= sizes[-1] and 0 < len(small) < 3
    none = KeptShares(0)
    for key, (share, _) in baked._shares.items():
        none.put(key, share)
        assert none.get(key) is None
    assert len(none) == 0 and none.found == 0
    before.clear()
    assert (len(before), before.size) == (0, 0)


def test_what_was_used_last_stays(baked: KeptShares) -> None:
    share = next(iter(baked._shares.values()))[0]
    kept = KeptShares(2 * size_of(share))
    kept.put("a", share)
    kept.put("b", share)
    assert kept.get("a") is share
    kept.put("c", share)
    assert kept.get("b") is None and kept.get("a") is share and kept.get("c") is share
    many = KeptShares(1000 * size_of(share))
    for k in range(MOST + 2):
        many.put(str(k), share)
    assert len(many) == MOST and many.get("1") is None and many.get("2") is share


def test_what_other_processes_rendered_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    from core.pipeline import shares

    monkeypatch.setattr(shares, "SAVED", 1)
    before = KeptShares()
    with ProcessExecutor(2) as executor:
        first = drain(render(three(), Library(), executor=executor, before=before))
    second = again(three(), before)
    assert second.skipped["fingers_unchanged"] == 3
    same(first, second)
