"""Methods side by side for a whole scene: what it asks for, whom it leaves out, and what would prove nothing."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.__main__ import main
from core.contact.pad_sampler import PadSampler
from core.contact.skin_sampler import SkinSampler
from core.errors import DermisError
from core.matching import pin_report
from core.presets import Library
from core.scene import scene_file
from core.scene.sliding import sliding_plane
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene
from core.skin.model import fingertip_skin, skin_from_parameters
from tests.tissue import save_mesh

PINS = (DeviceUse("pin_array_128", {}),)
DRAFT = {"skin_level": "draft"}


def plane(**parameters):
    """The sliding plane under a finger with pins, on a draft skin."""
    scene = sliding_plane(1e-3, slide=0.05, devices=PINS)
    return replace(scene, fingers=(replace(scene.fingers[0], parameters={**DRAFT, **parameters}),))


def with_far_finger(scene, *, first=0.0):
    """The scene with a second finger a metre away, and the first moved as far as said."""
    chunks = []
    for chunk in scene.chunks:
        fingers = np.repeat(chunk.fingers, 2, axis=0)
        fingers[0, :, 2, 3] += first
        fingers[1, :, 2, 3] += 1.0
        chunks.append(replace(chunk, fingers=fingers))
    idle = replace(scene.fingers[0], name="Little")
    return replace(scene, fingers=(*scene.fingers, idle), chunks=chunks)


def pinched(devices=(PINS, PINS), **parameters):
    """Two fingers that hold a block of 30 g between them, standing still."""
    half, count = np.array([0.01, 0.015, 0.01]), 12
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    block = Mesh(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32))
    fingers = np.tile(np.eye(4), (2, count, 1, 1))
    fingers[1, :, :3, :3] = np.diag([-1.0, 1.0, -1.0])
    fingers[:, :, 2, 3] = np.array([[1.0], [-1.0]]) * (half[2] - 1e-3)
    times = np.arange(count) / 240.0
    chunk = Chunk(1 + 24 * times, times, fingers, np.tile(np.eye(4), (1, count, 1, 1)), np.zeros((0, count, 4, 4)))
    who = tuple(Finger(n, d, {**DRAFT, **parameters}) for n, d in zip(("index", "thumb"), devices, strict=True))
    body = Body("block", block, {"friction": 0.6, "mass": 0.03})
    return TactileScene("s", Fraction(24), (1, 2), 240.0, who, (body,), (), (chunk,), (0.0, -9.81, 0.0))


@pytest.mark.parametrize("second", [PINS, ()])
def test_what_is_held_is_compared_as_it_is_baked(second):
    """The contacts carry the block's weight, also where the other finger's skin is only shown."""
    scene = pinched((PINS, second), skin_shown=True)
    skins = {f: fingertip_skin(level="draft") for f in range(2)}
    pads, sampler = PadSampler(scene), SkinSampler(scene, skins)
    for chunk in scene.chunks:
        pads.add(chunk)
        sampler.add(chunk)
    felt = sampler.finish(pads.finish())
    weight = sum(t.force_at(11).sum(axis=0)[1] for t in felt.values())
    assert weight == pytest.approx(-0.03 * 9.81, rel=1e-5)
    found = pin_report.compare_scene(scene, Library())
    assert list(found.reports) == [f"{n}, Pin array 128" for n in (("index", "thumb") if second else ("index",))]
    expected = pin_report.compare(felt[0], Library().device("pin_array_128"))
    assert pin_report.table(found.reports["index, Pin array 128"]) == pin_report.table(expected)


def test_a_finger_that_touches_nothing_is_left_out_by_name():
    alone = pin_report.compare_scene(plane(), Library())
    both = pin_report.compare_scene(with_far_finger(plane()), Library())
    assert list(both.reports) == list(alone.reports) == ["Index, Pin array 128"]
    assert [pin_report.table(r) for r in both.reports.values()] == [pin_report.table(r) for r in alone.reports.values()]
    assert [(f.severity, f.where) for f in both.findings if f.code == "idle-finger"] == [("info", "finger 'Little'")]


def test_a_scene_in_which_no_finger_touches_is_refused():
    with pytest.raises(DermisError, match="finger 'Index', finger 'Little'.*nothing was touched"):
        pin_report.compare_scene(with_far_finger(plane(), first=0.5), Library())


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_finer_mesh_must_be_finer(tmp_path):
    with pytest.raises(DermisError, match="finger 'Index'.*not finer"):
        pin_report.compare_scene(plane(), Library(), finer="draft")
    save_mesh(fingertip_skin(level="draft").mesh, tmp_path / "own.npz")
    own = plane(skin={"mesh": str(tmp_path / "own.npz")})
    with pytest.raises(DermisError, match="finger 'Index'.*has no finer mesh to judge"):
        pin_report.compare_scene(own, Library(), finer="standard")
    (reports,) = pin_report.compare_scene(own, Library()).reports.values()
    assert not np.isfinite([r.finer_error for r in reports]).any()
    (reports,) = pin_report.compare_scene(plane(), Library(), finer="standard").reports.values()
    assert np.isfinite([r.finer_error for r in reports]).all()


def test_a_scene_is_compared_from_the_command_line(tmp_path, capsys):
    scene = sliding_plane(1e-3, slide=0.1, devices=(DeviceUse("pin_array_128", {"pin_nodes": "surface"}),))
    finger = replace(scene.fingers[0], parameters={"skin_level": "draft"})
    path = tmp_path / "scene.npz"
    scene_file.save(replace(scene, fingers=(finger,)), path)
    assert main(["compare", str(path)]) == 0
    said = capsys.readouterr()
    direct = pin_report.compare_scene(scene_file.load(path), Library())
    assert said.out == f"Index, Pin array 128\n{pin_report.table(direct.reports['Index, Pin array 128'])}\n"
    assert said.err == f"{direct.findings[0]}\n" and direct.findings[0].code == "coarse-skin"
    sampler = SkinSampler(scene, {0: skin_from_parameters(Library().skin("index_medium"), level="draft")})
    for chunk in scene.chunks:
        sampler.add(chunk)
    own = pin_report.compare(sampler.finish()[0], Library().device("pin_array_128"), weighting="surface")
    assert pin_report.table(own) == pin_report.table(direct.reports["Index, Pin array 128"])


def test_comparing_a_scene_without_pins_is_refused():
    with pytest.raises(DermisError, match="no finger wears a pin array"):
        pin_report.compare_scene(sliding_plane(), Library())
