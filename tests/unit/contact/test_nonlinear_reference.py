"""The unseen touches and the file of their exact answers: what is kept is what was solved."""

from __future__ import annotations

from pathlib import Path as File

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.model import fingertip_skin
from tests.benchmarks.nonlinear_paths import COUNTS, MOVES, STEP, paths, rib
from tests.benchmarks.nonlinear_reference import FILE, Beneath, Kept, Reference, lowest
from tests.exact.exact_finger import ExactFinger
from tests.nonlinear import difference

SKIN = fingertip_skin(level="draft")


def test_there_are_forty_touches_that_first_touch_at_rest_and_go_on_as_they_say() -> None:
    all_paths = paths(lowest(SKIN))
    assert len(all_paths) == sum(map(sum, COUNTS.values())) == 40
    assert len({path.name for path in all_paths}) == 40
    for path in all_paths:
        frames = path.frames(SKIN.positions)
        first, last = (frames[i][0].translation for i in (0, -1))
        body = frames[0][0]
        at_touch = body.translation - STEP * body.rotation[:, 2]
        gap = body.surface.query((SKIN.positions - at_touch) @ body.rotation).gap.min()
        assert gap == pytest.approx(0.0, abs=1e-8)
        depth, slide = path.way[-1]
        assert np.linalg.norm(last - at_touch) == pytest.approx(np.hypot(depth, slide), rel=1e-9)
        assert float((last - first) @ body.rotation[:, 2]) == pytest.approx(depth - STEP, abs=1e-12)
        assert path.move in MOVES


def test_the_gap_to_a_rib_is_a_distance_and_its_normal_the_slope() -> None:
    points = np.random.default_rng(4).uniform(-2e-3, 2e-3, (400, 3))
    solid, h = rib(1.7e-3, 0.2e-3), 1e-8
    query = solid.query(points)
    slope = np.stack([(solid.query(points + h * e).gap - solid.query(points - h * e).gap) / (2 * h) for e in np.eye(3)])
    kinks = np.abs(np.abs(points[:, 1]) - 0.65e-3 - points[:, 2] - 0.2e-3) < 1e-6
    assert np.abs(slope.T - query.normal)[~kinks].max() < 1e-6
    assert np.allclose(np.linalg.norm(query.normal, axis=1), 1.0)


def test_what_is_kept_of_a_frame_gives_its_stress_back(tmp_path: File) -> None:
    finger, beneath, kept = ExactFinger(SKIN), Beneath(SKIN), Kept()
    path = paths(lowest(SKIN))[3]
    for bodies in path.frames(SKIN.positions)[:6]:
        held = finger.step(bodies)
    kept.add(3, 5, held.displacement, held.force, beneath)
    kept.write(tmp_path / "one.npz", SKIN)
    with np.load(tmp_path / "one.npz") as archive:
        beyond = archive["beyond"][0].astype(float) * float(archive["quantum"][0])
        back = beneath.whole(archive["pad"][0].astype(float), beyond)
    assert difference(finger.stress(back), finger.stress(held.displacement), SKIN.mesh.volumes) < 2e-3


def test_the_file_holds_forces_that_its_displacements_ask_for() -> None:
    """Of some frames: the law's own forces at the kept displacement, free of what the rounding of the inside brings."""
    truth = Reference()
    finger = ExactFinger(truth.skin)
    for number in (0, 13, 29):
        rows = np.flatnonzero(truth._arrays["path"] == number)[-1:]
        for i in rows:
            beyond = truth._arrays["beyond"][i].astype(float) * float(truth._arrays["quantum"][i])
            moved = truth.beneath.whole(truth._arrays["pad"][i].astype(float), beyond)
            force = truth._arrays["force"][i].astype(float)
            assert np.linalg.norm((finger.reaction(moved) - force).sum(axis=0)) < 0.02 * np.linalg.norm(
                force.sum(axis=0)
            )
    assert FILE.stat().st_size < 2.5e6
    assert sorted({path.kind for path in truth.paths}) == sorted(COUNTS)
