"""From poses to gaps: exact on boxes and planes, in stretched, mirrored, turning and deforming space."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from core.contact.encounter import Encounter
from core.contact.pad_contact import PadContact
from core.contact.pad_sampler import PadSampler
from core.contact.surfaces import bounds_in_world, boxes_in_world
from core.errors import DermisError
from core.motion import matrices
from core.parameters.finger import FINGER
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene, sample_frames
from core.surface.centre import centre_of

RATE = 240.0


def cuboid(x: float, y: float, z: float) -> Mesh:
    corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (-z, z)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32))


def sheet(size: float) -> Mesh:
    corners = np.array([[-size, -size, 0], [size, -size, 0], [size, size, 0], [-size, size, 0]], dtype=float)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))


def poses(positions: np.ndarray, linear: np.ndarray | None = None) -> np.ndarray:
    out = np.tile(np.eye(4), (len(positions), 1, 1))
    out[:, :3, 3] = positions
    if linear is not None:
        out[:, :3, :3] = linear
    return out


def times(seconds: float = 1.0) -> np.ndarray:
    return sample_frames(Fraction(24), (1, 1 + round(24 * seconds)), RATE)[1]


def sampled(
    fingers: list[np.ndarray],
    bodies: list[tuple[Body, np.ndarray]],
    *,
    size: int = 97,
    surfaces: dict[int, tuple[Mesh, ...]] | None = None,
    animated: dict[str, np.ndarray] | None = None,
) -> PadContact:
    count = len(fingers[0])
    t = np.arange(count) / RATE
    frames = 1 + 24 * t
    scene = TactileScene(
        "s",
        Fraction(24),
        (1, 25),
        RATE,
        tuple(Finger(f"f{i}") for i in range(len(fingers))),
        tuple(b for b, _ in bodies),
        (),
        (),
    )
    sampler = PadSampler(scene)
    for i in range(0, count, size):
        k = slice(i, i + size)
        sampler.add(
            Chunk(
                frames[k],
                t[k],
                np.stack(fingers)[:, k],
                np.stack([p for _, p in bodies])[:, k],
                np.zeros((0, len(t[k]), 4, 4)),
                {b: m[k] for b, m in (surfaces or {}).items()},
                {c: v[k] for c, v in (animated or {}).items()},
            )
        )
    return sampler.finish()


def test_gap_normal_and_point_of_a_turned_and_stretched_box() -> None:
    t = times()
    turn = matrices(np.array([[0.9, 0.1, -0.3, 0.2]]))[0]
    local = np.stack([0.05 * np.sin(t), 0.02 * np.cos(t), 0.03 + 0.02 * np.sin(9 * t)], axis=1)  # top face at 0.02
    place = np.array([0.4, -0.2, 1.0])
    body = poses(np.tile(place, (len(t), 1)), turn @ np.diag([2.0, 1.0, 0.5]))
    touch = sampled([poses(place + local @ turn.T)], [(Body("b", cuboid(0.05, 0.1, 0.04)), body)])
    assert touch.pairs[0, 0].gap == pytest.approx(local[:, 2] - 0.02, abs=1e-12)
    assert touch.pairs[0, 0].normal == pytest.approx(np.tile(turn[:, 2], (len(t), 1)), abs=1e-9)
    assert touch.pairs[0, 0].point == pytest.approx(np.stack([local[:, 0], local[:, 1], 0 * t + 0.02], 1), abs=1e-12)


def test_mirrored_object_keeps_its_outside() -> None:
    t = times()
    finger = poses(np.stack([0 * t + 0.01, 0 * t, 0.05 + 0.01 * t], axis=1))
    body = poses(np.zeros((len(t), 3)), np.diag([-1.0, 1.0, 1.0]))
    touch = sampled([finger], [(Body("b", cuboid(0.03, 0.03, 0.04)), body)])
    assert touch.pairs[0, 0].gap == pytest.approx(0.01 + 0.01 * t, abs=1e-12)
    assert touch.pairs[0, 0].normal == pytest.approx(np.tile([0, 0, 1.0], (len(t), 1)))


def test_animated_scale_is_followed_sample_by_sample() -> None:
    t = times()
    grow = 1.0 + 0.5 * t
    linear = np.eye(3)[None] * grow[:, None, None]
    touch = sampled(
        [poses(np.tile([0, 0, 0.08], (len(t), 1)))],
        [(Body("b", cuboid(0.05, 0.05, 0.04)), poses(np.zeros((len(t), 3)), linear))],
    )
    assert touch.pairs[0, 0].gap == pytest.approx(0.08 - 0.04 * grow, abs=1e-6)


def test_chunk_length_does_not_matter() -> None:
    t = times()
    finger = poses(np.stack([0.3 * t - 0.1, 0 * t, 0.04 + 0.06 * np.cos(7 * t)], axis=1))
    body = (Body("b", cuboid(0.05, 0.05, 0.04)), poses(np.zeros((len(t), 3))))
    one, many = (sampled([finger], [body], size=s) for s in (10_000, 7))
    for name in ("gap", "normal", "point"):
        assert np.array_equal(getattr(one.pairs[0, 0], name), getattr(many.pairs[0, 0], name))


def test_a_chunk_of_one_sample_has_the_bytes_of_any_other() -> None:
    t = times()[:40]
    q = np.stack([np.cos(t), 0.3 * np.sin(t), 0.4 * np.sin(t), np.sin(t)], axis=1)
    turned = poses(np.zeros((len(t), 3)))
    turned[:, :3, :3] = matrices(q / np.linalg.norm(q, axis=1)[:, None]) * np.array([1.3, 0.7, 1.1])
    finger = poses(np.stack([0.3 * t - 0.02, 0 * t, 0.05 + 0 * t], axis=1))
    surfaces = {0: (cuboid(0.05, 0.05, 0.04),) * len(t)}
    many, each = (sampled([finger], [(Body("b", None), turned)], size=s, surfaces=surfaces) for s in (7, 1))
    for name in ("gap", "normal", "point"):
        assert np.array_equal(getattr(many.pairs[0, 0], name), getattr(each.pairs[0, 0], name))


def test_far_objects_cost_no_query_and_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    t = times()
    asked: list[int] = []
    from core.surface.gap import Surface

    plain = Surface.query
    monkeypatch.setattr(Surface, "query", lambda self, p, reach=np.inf: asked.append(len(p)) or plain(self, p, reach))
    finger = poses(np.stack([0 * t, 0 * t, np.where(t < 0.5, 0.01, 5.0)], axis=1))
    body = Body("near", cuboid(0.01, 0.01, 0.01))
    far = (replace(body, name="far"), poses(np.full((len(t), 3), 9.0)))
    touch = sampled([finger], [(body, poses(np.zeros((len(t), 3)))), far])
    near = int((t < 0.5).sum())
    assert sum(asked) == near
    assert touch.skipped["pair_samples_far"] == 2 * len(t) - near
    assert (0, 1) not in touch.pairs
    assert np.isfinite(touch.pairs[0, 0].gap).sum() == near


def test_bounds_over_a_chunk_hold_the_boxes_of_all_its_samples() -> None:
    random = np.random.default_rng(5)
    linear = random.normal(size=(7, 20, 3, 3)) * 10.0 ** random.uniform(-3, 3, (7, 1, 1, 1))
    moving = np.stack([poses(random.normal(size=(20, 3)), each) for each in linear])
    boxes = np.sort(random.normal(size=(7, 2, 3)), axis=1)
    low, high = bounds_in_world(moving, boxes)
    middle, half = boxes_in_world(moving, boxes[:, None])
    assert (low <= (middle - half).min(axis=1)).all() and (high >= (middle + half).max(axis=1)).all()
    # No farther than a box that is turned about its corner in every way would reach.
    reach = np.abs(linear).max(axis=1) @ np.abs(boxes).max(axis=1)[..., None]
    np.testing.assert_allclose(high - moving[:, :, :3, 3].max(axis=1), reach[..., 0], rtol=1e-9)


def test_open_sheet_can_be_touched_from_the_side_the_finger_came_from() -> None:
    t = times()
    path = np.stack([0 * t, 0 * t, 0.02 - 0.03 * t], axis=1)
    below = poses(-path, np.diag([1.0, -1.0, -1.0]))  # upside down, coming from below
    table = (Body("table", sheet(0.5)), poses(np.zeros((len(t), 3))))
    touch = sampled([poses(path), below], [table])
    for f in range(2):
        assert touch.pairs[f, 0].gap == pytest.approx(0.02 - 0.03 * t, abs=1e-12)
    assert touch.pairs[0, 0].normal[0] == pytest.approx([0, 0, 1]) and touch.pairs[1, 0].normal[0] == pytest.approx(
        [0, 0, -1]
    )


def test_deforming_surface_brings_its_own_velocity() -> None:
    t = times()
    plain = cuboid(0.05, 0.05, 0.04)
    up = np.array([0, 0, 1.0]) * (plain.vertices[:, 2:] > 0)
    meshes = tuple(Mesh(plain.vertices + 0.01 * x * up, plain.triangles) for x in t)
    touch = sampled(
        [poses(np.tile([0, 0, 0.06], (len(t), 1)))],
        [(Body("soft", None), poses(np.zeros((len(t), 3))))],
        surfaces={0: meshes},
    )
    pair = touch.pairs[0, 0]
    assert pair.gap == pytest.approx(0.02 - 0.01 * t, abs=1e-12)
    assert pair.surface_velocity is not None
    assert pair.surface_velocity[1:] == pytest.approx(np.tile([0, 0, 0.01], (len(t) - 1, 1)), abs=1e-12)
    assert not pair.surface_velocity[0].any()


@pytest.mark.parametrize("first", [64, 128])
def test_a_body_may_begin_to_deform_in_a_later_chunk(first: int) -> None:
    """Nothing differs from a body whose surface comes with every chunk; its centre of gravity does not, either."""
    t = times()
    still = cuboid(0.05, 0.05, 0.04)
    up = np.array([0, 0, 1.0]) * (still.vertices[:, 2:] > 0)
    moved = [Mesh(still.vertices + 0.01 * (x - t[first - 1]) * up, still.triangles) for x in t]
    meshes = tuple(still if k < first else mesh for k, mesh in enumerate(moved))
    finger = poses(np.tile([0, 0, 0.06], (len(t), 1)))[None]
    thing = poses(np.zeros((len(t), 3)))[None]
    made = []
    for mesh in (still, None):
        body = Body("late", mesh, {"weight_on": True})
        sampler = PadSampler(TactileScene("s", Fraction(24), (1, 25), RATE, (Finger("f"),), (body,), (), ()))
        for i in range(0, len(t), 64):
            k = slice(i, i + 64)
            surfaces = {0: meshes[k]} if mesh is None or i >= first else {}
            none = np.zeros((0, len(t[k]), 4, 4))
            sampler.add(Chunk(1 + 24 * t[k], t[k], finger[:, k], thing[:, k], none, surfaces))
        made.append(sampler.finish())
    late, whole = made
    pair, other = late.pairs[0, 0], whole.pairs[0, 0]
    assert pair.gap == pytest.approx(other.gap, abs=1e-15)
    assert pair.gap[-1] == pytest.approx(0.02 - 0.01 * (t[-1] - t[first - 1]))
    np.testing.assert_array_equal(pair.surface_velocity, other.surface_velocity)
    assert pair.surface_velocity is not None and pair.surface_velocity[first] == pytest.approx([0, 0, 0.01])
    np.testing.assert_array_equal(late.centres[0], whole.centres[0])


@pytest.mark.parametrize("size", [97, 1])
@pytest.mark.parametrize("sheared", [False, True])
def test_an_animated_scale_brings_the_velocity_of_the_surface(sheared: bool, size: int) -> None:
    """The point of a growing block below a pad that stands still: material x0 moves along x at x0 times the rate."""
    t = times()
    rot = matrices(np.array([[0.9, 0.3, -0.2, 0.1]]))[0]
    linear = np.tile(np.diag([1.0, 1.0, 1.0]), (len(t), 1, 1))
    linear[:, 0, 0] += 0.2 * t
    if sheared:
        linear[:, 1, 0] = 0.1 * t
    x = 0.03
    touch = sampled(
        [poses(np.tile([x, 0, 0.06], (len(t), 1)) @ rot.T, rot)],
        [(Body("b", cuboid(0.05, 0.05, 0.04)), poses(np.zeros((len(t), 3)), rot @ linear))],
        size=size,
    )
    met = Encounter(touch, 0, 0, t, 0.05)
    material = x / linear[:, 0, 0]
    exact = np.stack([-0.2 * material, -(0.1 if sheared else 0.0) * material, 0 * t], axis=1)
    body = touch.body_motion(0).at(t).rotation
    velocity = np.einsum("nij,nj->ni", np.broadcast_to(body, (len(t), 3, 3)), met.velocity) @ rot  # in the block's axes
    # the rate is that since the sample before, half a sample late; the first sample has none before it
    assert velocity[1:] == pytest.approx(exact[1:], abs=2e-5)


def test_growing_towards_the_pad_is_an_onset_of_that_speed() -> None:
    t = times()
    linear = np.tile(np.eye(3), (len(t), 1, 1))
    linear[:, 2, 2] += 0.5 * t
    touch = sampled(
        [poses(np.tile([0, 0, 0.05], (len(t), 1)))],
        [(Body("b", cuboid(0.05, 0.05, 0.04)), poses(np.zeros((len(t), 3)), linear))],
    )
    met = Encounter(touch, 0, 0, COMMANDS, 0.0005)
    assert met.onsets == pytest.approx([(0.05 - 0.0005 - 0.04) / 0.02], abs=1e-9)
    assert met.onset_velocities == pytest.approx(np.array([[0, 0, -0.02]]), abs=1e-9)


def test_scale_and_shape_add_up() -> None:
    """A block whose vertices rise at 10 mm/s in its own space, stretched threefold and more so by 0.5 1/s."""
    t = times()
    plain = cuboid(0.05, 0.05, 0.02)
    up = np.array([0, 0, 1.0]) * (plain.vertices[:, 2:] > 0)
    meshes = tuple(Mesh(plain.vertices + 0.01 * x * up, plain.triangles) for x in t)
    linear = np.tile(np.eye(3), (len(t), 1, 1))
    linear[:, 2, 2] = 3.0 + 0.5 * t
    touch = sampled(
        [poses(np.tile([0, 0, 0.11], (len(t), 1)))],
        [(Body("b", None), poses(np.zeros((len(t), 3)), linear))],
        surfaces={0: meshes},
    )
    velocity = touch.pairs[0, 0].surface_velocity
    assert velocity is not None
    exact = 0.01 * (3.0 + 0.5 * t) + 0.5 * (0.02 + 0.01 * t)  # product rule
    assert velocity[1:, 2] == pytest.approx(exact[1:], abs=1e-4)


def test_a_constant_scale_of_a_turning_object_is_no_motion_of_its_own() -> None:
    t = times()
    angle = 3.0 * t
    turn = matrices(np.stack([np.cos(angle / 2), 0 * t, 0 * t, np.sin(angle / 2)], axis=1))
    rounded = (turn @ np.diag([1.7, 0.6, 1.1])).astype(np.float32).astype(float)
    touch = sampled(
        [poses(np.tile([0.01, 0, 0.05], (len(t), 1)))],
        [(Body("b", cuboid(0.05, 0.05, 0.04)), poses(np.zeros((len(t), 3)), rounded))],
    )
    assert touch.pairs[0, 0].surface_velocity is None


def test_scale_zero_is_reported_and_the_rest_is_kept() -> None:
    t = times()
    linear = np.tile(np.eye(3), (len(t), 1, 1))
    linear[100:120, 2, 2] = 0.0
    touch = sampled(
        [poses(np.tile([0, 0, 0.05], (len(t), 1)))],
        [(Body("b", cuboid(0.05, 0.05, 0.04)), poses(np.zeros((len(t), 3)), linear))],
    )
    [finding] = [f for f in touch.findings if f.code == "zero-scale"]
    assert finding.count == 20 and finding.frame == pytest.approx(11.0) and finding.severity == "error"
    known = np.isfinite(touch.pairs[0, 0].gap)
    assert not known[100:120].any() and known[:100].all() and known[120:].all()
    with pytest.raises(DermisError, match="object 'b', frame 1: the scale is too large .*1e\\+200"):
        huge = poses(np.zeros((3, 3)), np.tile(1e200 * np.eye(3), (3, 1, 1)))
        sampled([poses(np.zeros((3, 3)))], [(Body("b", cuboid(1, 1, 1)), huge)])
    with pytest.raises(DermisError, match="finger 'f0', frame 1:"):
        sampled([poses(np.zeros((3, 3)), np.zeros((3, 3, 3)))], [(Body("b", cuboid(1, 1, 1)), poses(np.zeros((3, 3))))])


def test_values_that_are_not_numbers_are_held_and_reported() -> None:
    t = times()
    finger = poses(np.stack([0 * t, 0 * t, 0.05 + 0.01 * t], axis=1))
    finger[50:60] = np.nan
    switch = t.copy()
    switch[[0, 7]] = np.nan
    touch = sampled(
        [finger],
        [(Body("b", cuboid(0.05, 0.05, 0.04)), poses(np.zeros((len(t), 3))))],
        animated={"body/0/held": switch},
    )
    assert touch.pairs[0, 0].gap[50:60] == pytest.approx(touch.pairs[0, 0].gap[49])
    found = [(f.where, f.count) for f in touch.findings if f.code == "not-finite"]
    assert found == [("finger 'f0'", 10), ("body/0/held", 2)]
    assert touch.animated["body/0/held"][[0, 7]] == pytest.approx(t[[1, 6]])


def test_chunks_that_do_not_fit_are_refused() -> None:
    scene = TactileScene("s", Fraction(24), (1, 25), RATE, (Finger("f"),), (Body("b", cuboid(1, 1, 1)),), (), ())
    empty: Any = np.zeros((0, 2, 4, 4))
    with pytest.raises(DermisError, match="fingers do not fit"):
        PadSampler(scene).add(Chunk(np.zeros(2), np.zeros(2), empty, empty, empty))
    with pytest.raises(DermisError, match="no samples"):
        PadSampler(scene).finish()


def test_centre_of_gravity() -> None:
    box = cuboid(0.1, 0.2, 0.3)
    assert centre_of(Mesh(box.vertices + [1, 2, 3], box.triangles)) == pytest.approx([1, 2, 3])
    pyramid = Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 4.0]]),
                   np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32))  # fmt: skip
    assert centre_of(pyramid) == pytest.approx([0.25, 0.25, 1.0])
    assert centre_of(sheet(1.0)) == pytest.approx([0, 0, 0])


# -- at the device's rate ----------------------------------------------------------------------------------------------

COMMANDS = np.arange(1001) / 1000.0


@pytest.mark.parametrize("turned", [False, True])
def test_onset_is_found_between_samples_and_commands(turned: bool) -> None:
    """A parabola onto a moving plane: the instant has a closed form."""
    t = times()
    rot = matrices(np.array([[0.9, 0.3, -0.2, 0.1]]))[0] if turned else np.eye(3)
    height = 0.05 + 0.02 * t - 9.81 * t**2 / 2
    lift = 0.03 * t
    body = poses(np.stack([0 * t, 0 * t, lift], 1) @ rot.T, rot)
    finger = poses(np.stack([0.1 * t, 0 * t, height + 0.04], 1) @ rot.T)
    touch = sampled([finger], [(Body("b", cuboid(0.5, 0.5, 0.04)), body)])
    met = Encounter(touch, 0, 0, COMMANDS, 0.0005)
    # 0.05 - 0.01 t - 4.905 t^2 = 0.0005
    exact = (-0.01 + np.sqrt(0.01**2 + 4 * 4.905 * 0.0495)) / (2 * 4.905)
    assert met.onsets == pytest.approx([exact], abs=1e-9)
    assert met.onset_velocities @ rot == pytest.approx(np.array([[0.1, 0, 0.02 - 9.81 * exact - 0.03]]), abs=1e-7)


def test_each_tap_of_a_tapping_finger_is_one_onset() -> None:
    t = times()
    touch = sampled(
        [poses(np.stack([0 * t, 0 * t, 0.04 + 0.005 * np.cos(2 * np.pi * 4 * t)], 1))],
        [(Body("b", cuboid(0.1, 0.1, 0.04)), poses(np.zeros((len(t), 3))))],
    )
    met = Encounter(touch, 0, 0, COMMANDS, 0.0005)
    first = np.arccos(0.1) / (2 * np.pi * 4)
    assert met.onsets == pytest.approx(first + 0.25 * np.arange(4), abs=2e-7)
    assert met.onset_velocities[:, 2] == pytest.approx(-0.005 * 8 * np.pi * np.sqrt(1 - 0.01), rel=1e-4)


def test_touching_from_the_start_is_no_contact_made() -> None:
    t = times()
    touch = sampled(
        [poses(np.tile([0, 0, 0.04], (len(t), 1)))], [(Body("b", cuboid(0.1, 0.1, 0.04)), poses(np.zeros((len(t), 3))))]
    )
    met = Encounter(touch, 0, 0, COMMANDS, 0.0005)
    assert met.touching.all() and met.onsets.size == 0


def test_path_over_a_turning_body_is_that_of_the_finger_in_its_frame() -> None:
    t = times()
    half = 0.4 * np.sin(3 * t)
    rot = matrices(np.stack([np.cos(half), 0 * t, np.sin(half), 0 * t], 1))
    slide = np.stack([0.03 * np.sin(5 * t), 0.02 * np.cos(4 * t), 0.04 + 0 * t], 1)
    shift = np.stack([0.2 * t, -0.1 * t**2, 0 * t], 1)
    touch = sampled(
        [poses(shift + np.einsum("nij,nj->ni", rot, slide))], [(Body("b", cuboid(0.1, 0.1, 0.04)), poses(shift, rot))]
    )
    met = Encounter(touch, 0, 0, COMMANDS, 0.0005)
    c = COMMANDS
    assert met.touching.all()
    assert met.point == pytest.approx(np.stack([0.03 * np.sin(5 * c), 0.02 * np.cos(4 * c), 0.04 + 0 * c], 1), abs=1e-7)
    rate = np.stack([0.15 * np.cos(5 * c), -0.08 * np.sin(4 * c), 0 * c], 1)
    assert met.velocity == pytest.approx(rate, abs=2e-4)
    assert met.normal == pytest.approx(np.tile([0, 0, 1.0], (1001, 1)), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "value"), [("touch_distance", -1.0), ("pattern_frequency", -1.0), ("pattern_amplitude", 1e9)]
)
def test_a_finger_animated_out_of_range_is_refused_with_its_frame(name: str, value: float) -> None:
    good, t = FINGER[name].default, times()
    still = poses(np.zeros((len(t), 3)))
    keyed = np.where(np.arange(len(t)) == 30, value, good)
    keyed[:3] = np.nan  # mended
    with pytest.raises(DermisError, match=f"finger 'f0', frame 4: '{name}' is too"):
        sampled([still], [(Body("b", sheet(0.1)), still)], animated={f"finger/0/{name}": keyed})
