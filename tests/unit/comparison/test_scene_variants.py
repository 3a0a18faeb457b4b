"""Scenes with something changed that must not matter: what is changed, and that nothing else is."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.comparison.scene_variants import SHIFT, denser, mirrored, shifted
from core.motion.rotation import matrices
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
from core.surface.gap import Surface

RATE = 24.0


def scene(count: int, frames: tuple[int, int], cut: int) -> TactileScene:
    """Return a finger and a scaled, turning body with a surface that deforms, in chunks of some samples."""
    rng = np.random.default_rng(5)
    times = np.arange(count) / RATE
    block = Surface.block(0.02, 0.01).mesh
    poses = np.tile(np.eye(4), (2, count, 1, 1))
    poses[:, :, :3, 3] = rng.normal(size=(2, count, 3))
    turns = matrices(np.cumsum(rng.normal(size=(count, 4)), axis=0) + [9.0, 0.0, 0.0, 0.0])
    poses[:, :, :3, :3] = turns
    poses[1, :, :3, :3] *= np.linspace(1.0, 2.0, count)[:, None, None]
    meshes = [Mesh(block.vertices * (1.0 + 0.1 * i), block.triangles) for i in range(count)]
    friction, pattern = np.linspace(0.2, 0.7, count), (np.arange(count) // 3).astype(float)
    cuts = [slice(i, i + cut) for i in range(0, count, cut)]
    chunks = [
        Chunk(
            frames[0] + times[c] * 24.0,
            times[c],
            poses[:1, c],
            poses[1:, c],
            poses[:0, c],
            {0: tuple(meshes[c])},
            {"body/0/friction": friction[c], "finger/0/pattern": pattern[c]},
        )
        for c in cuts
    ]
    fingers, bodies = (Finger("Index"),), (Body("Block", block, {}),)
    return TactileScene("s", Fraction(24), frames, RATE, fingers, bodies, (), chunks)


def whole(made: TactileScene) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Return all chunks of a scene end to end, and the vertices of its surface."""
    chunks = list(made.chunks)
    series = {n: np.concatenate([getattr(c, n) for c in chunks]) for n in ("frames", "times")}
    series |= {n: np.concatenate([getattr(c, n) for c in chunks], axis=1) for n in ("fingers", "bodies")}
    series |= {n: np.concatenate([c.animated[n] for c in chunks]) for n in chunks[0].animated}
    return series, [mesh.vertices for c in chunks for mesh in c.surfaces[0]]


def test_half_the_step_keeps_every_sample_and_halves_between() -> None:
    of = scene(9, (1, 9), 4)
    own, shapes = whole(of)
    made, halves = whole(denser(of))
    assert len(made["times"]) == 17 == denser(of).sample_count
    for name, values in own.items():
        kept = made[name][..., ::2, :, :] if values.ndim == 4 else made[name][::2]
        np.testing.assert_array_equal(kept, values, err_msg=name)
    np.testing.assert_allclose(made["times"], np.arange(17) / (2 * RATE), atol=1e-15)
    np.testing.assert_allclose(halves[5], 0.5 * (shapes[2] + shapes[3]))
    np.testing.assert_array_equal(made["finger/0/pattern"][1::2], own["finger/0/pattern"][:-1])
    np.testing.assert_allclose(
        made["body/0/friction"][3], 0.5 * (own["body/0/friction"][1] + own["body/0/friction"][2])
    )


def posed(places: np.ndarray, angles: np.ndarray, scales: np.ndarray, cut: int = 4) -> TactileScene:
    """Return a scene whose body is somewhere, turned about an axis [rad] and scaled, sample by sample."""
    of = scene(len(places), (1, len(places)), cut)
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    quaternion = np.concatenate([np.cos(angles / 2)[:, None], np.sin(angles / 2)[:, None] * axis], axis=1)
    poses = np.tile(np.eye(4), (1, len(places), 1, 1))
    poses[0, :, :3, :3], poses[0, :, :3, 3] = matrices(quaternion) * scales[:, None, None], places
    starts = np.cumsum([0, *(len(c.times) for c in of.chunks)])
    parts = zip(of.chunks, starts[:-1], strict=True)
    return replace(of, chunks=[replace(c, bodies=poses[:, i : i + len(c.times)]) for c, i in parts])


def motion(times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a smooth motion: places [m], angles [rad] and scales."""
    places = np.stack([np.sin(3.0 * times), np.cos(2.0 * times), times], axis=1)
    return places, 2.0 * np.sin(2.0 * times), 1.0 + 0.3 * np.sin(times)


def test_smooth_motion_goes_on_between_samples_and_keeps_its_acceleration() -> None:
    times, fine = np.arange(25) / RATE, np.arange(49) / (2 * RATE)
    (truth,) = (whole(posed(*motion(fine)))[0]["bodies"],)
    made, _ = whole(denser(posed(*motion(times))))
    straight = np.abs(truth[:, :-2:2] - 2.0 * truth[:, 1::2] + truth[:, 2::2]).max() / 2.0
    assert straight > 1.5e-3 and np.abs(made["bodies"] - truth).max() < straight / 10.0
    speeding, truly = (np.diff(b[0, 3:-3, :3, 3], 2, axis=0) * (2 * RATE) ** 2 for b in (made["bodies"], truth))
    assert np.abs(truly).max() > 8.0 and np.abs(speeding - truly).max() < 0.6  # [m/s^2]; straight: all or nothing
    finer = np.abs(whole(denser(posed(*motion(times / 2))))[0]["bodies"] - whole(posed(*motion(fine / 2)))[0]["bodies"])
    assert finer[0, 3:-3].max() < np.abs(made["bodies"] - truth)[0, 3:-3].max() / 7.0  # the third order of the step


def test_motion_that_stops_at_once_does_not_overshoot_and_steady_motion_is_straight() -> None:
    times = np.arange(13) / RATE
    stops = np.minimum(times, times[6])
    made, _ = whole(denser(posed(stops[:, None] * [1.0, -2.0, 0.5], stops, 1.0 + stops)))
    fine = np.minimum(np.arange(25) / (2 * RATE), times[6])
    truth, _ = whole(posed(fine[:, None] * [1.0, -2.0, 0.5], fine, 1.0 + fine))
    np.testing.assert_allclose(made["bodies"], truth["bodies"], rtol=0.0, atol=1e-14)


def test_a_pose_of_scale_nothing_has_neighbours_all_the_same() -> None:
    times = np.arange(9) / RATE
    scales = np.where(np.arange(9) == 4, 0.0, 1.0)
    made, _ = whole(denser(posed(np.zeros((9, 3)), times, scales)))
    assert np.isfinite(made["bodies"]).all()
    np.testing.assert_array_equal(made["bodies"][0, 7, :3, :3], 0.5 * made["bodies"][0, 6, :3, :3])
    fine, _ = whole(posed(np.zeros((17, 3)), np.arange(17) / (2 * RATE), np.ones(17)))
    np.testing.assert_allclose(made["bodies"][0, :6], fine["bodies"][0, :6], atol=1e-14)


@pytest.mark.parametrize("cut", [1, 2, 5, 9])
def test_chunks_do_not_matter(cut: int) -> None:
    one, other = whole(denser(scene(9, (1, 9), 4))), whole(denser(scene(9, (1, 9), cut)))
    for name, values in one[0].items():
        np.testing.assert_allclose(values, other[0][name], rtol=0.0, atol=1e-14)  # numpy sums in other orders
    for a, b in zip(one[1], other[1], strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_comes_in_some_chunks_only_is_half_way_as_it_was_before() -> None:
    of = scene(9, (1, 9), 3)
    chunks = [c if k == 1 else replace(c, surfaces={}, animated={}) for k, c in enumerate(of.chunks)]
    made = list(denser(replace(of, chunks=chunks)).chunks)
    assert sum(len(c.times) for c in made) == 17
    meshes = [m for c in made for m in c.surfaces.get(0, [None] * len(c.times))]
    values = [v for c in made for v in c.animated.get("body/0/friction", [None] * len(c.times))]
    assert meshes[:6] == [None] * 6 and values[:6] == [None] * 6  # the header's, up to the sample that brings others
    assert meshes[6] is chunks[1].surfaces[0][0] and values[6] == chunks[1].animated["body/0/friction"][0]
    assert meshes[10] is meshes[11] is chunks[1].surfaces[0][2] and values[10] == values[11] is not None
    assert meshes[12:] == [None] * 5 and values[12:] == [None] * 5


def test_a_range_that_ends_half_a_step_after_its_last_sample_is_covered() -> None:
    of = replace(scene(3, (1, 6), 2), fps=Fraction(48))  # 5/48 s at 24 Hz: samples at 0, 2/48 and 4/48 s
    assert of.sample_count == 3 and denser(of).sample_count == 6
    made, _ = whole(denser(of))
    assert len(made["times"]) == 6 and made["times"][-1] == pytest.approx(5 / 48)
    np.testing.assert_array_equal(made["fingers"][:, -1], made["fingers"][:, -2])


def test_a_shift_moves_fingers_and_nothing_else() -> None:
    of = scene(5, (1, 5), 2)
    own, made = whole(of)[0], whole(shifted(of))[0]
    moved = made["fingers"][:, :, :3, 3] - own["fingers"][:, :, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=2), SHIFT, rtol=1e-6)
    np.testing.assert_array_equal(made["bodies"], own["bodies"])


def test_two_mirrors_give_the_scene_back_and_one_keeps_solids_solid() -> None:
    of = scene(5, (1, 5), 2)
    own, once, twice = whole(of), whole(mirrored(of)), whole(mirrored(mirrored(of)))
    for name in ("fingers", "bodies"):
        np.testing.assert_array_equal(twice[0][name], own[0][name])
        assert (np.linalg.det(once[0][name][:, :, :3, :3]) > 0.0).all()
    body = mirrored(of).bodies[0].mesh
    assert body is not None and Surface.build(body.vertices, body.triangles).volume > 0.0
