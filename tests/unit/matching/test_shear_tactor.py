"""A whole finger: [S3] eq. 1 to 8 in world poses, eq. 6 in both readings, the rule for sums, and what is skipped."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from core.contact.pad_contact import PadContact
from core.contact.pad_sampler import PadSampler
from core.devices.shear_tactor import ShearTactor
from core.errors import DermisError
from core.matching.effect_sum import EffectSum
from core.matching.rendered import Rendered
from core.matching.shear_tactor import projected, render
from core.motion import matrices
from core.presets import Library
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene, device_times, sample_frames

SPEC = Library().device("haptip")
TACTOR = ShearTactor.from_spec(SPEC)
FPS, RANGE = Fraction(24), (1, 25)
FRAMES, T = sample_frames(FPS, RANGE, 240.0)
C = np.arange(1001) / 1000.0
QUIET = {"transient_on": False, "texture_on": False, "weight_on": False, "content_on": False}
THUMB = np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]])  # +Z (nail) towards +X: a pad that presses on a face at -X
INDEX = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])


def cuboid(x: float, y: float, z: float) -> Mesh:
    corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (-z, z)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32))


def poses(positions: Any, linear: np.ndarray | None = None) -> np.ndarray:
    out = np.tile(np.eye(4), (len(T), 1, 1))
    out[:, :3, 3] = positions
    if linear is not None:
        out[:, :3, :3] = linear
    return out


def path(x: Any = 0.0, y: Any = 0.0, z: Any = 0.0) -> np.ndarray:
    return np.stack(np.broadcast_arrays(x, y, z, T)[:3], axis=1)


def baked(
    fingers: list[np.ndarray],
    bodies: list[tuple[Body, np.ndarray]],
    use: Mapping[str, Any] | None = None,
    finger: Mapping[str, Any] | None = None,
    animated: Mapping[str, np.ndarray] | None = None,
    which: int = 0,
    spec: Any = SPEC,
) -> Rendered:
    device = DeviceUse("haptip", use or {})
    touch, scene = swept(fingers, bodies, device, finger, animated)
    return render(touch, scene, which, device, spec)


def swept(
    fingers: list[np.ndarray],
    bodies: list[tuple[Body, np.ndarray]],
    device: DeviceUse,
    finger: Mapping[str, Any] | None = None,
    animated: Mapping[str, np.ndarray] | None = None,
) -> tuple[PadContact, TactileScene]:
    """Sample a scene in which every finger wears the same device."""
    chunk = Chunk(
        FRAMES, T, np.stack(fingers), np.stack([p for _, p in bodies]), np.zeros((0, len(T), 4, 4)), {}, animated or {}
    )
    scene = TactileScene(
        "s",
        FPS,
        RANGE,
        240.0,
        tuple(Finger(f"f{i}", (device,), finger or {}) for i in range(len(fingers))),
        tuple(b for b, _ in bodies),
        (),
        (chunk,),
    )
    sampler = PadSampler(scene)
    sampler.add(chunk)
    return sampler.finish(), scene


def cap(rendered: Rendered) -> np.ndarray:
    return np.stack([rendered.track.column("tactor_x"), rendered.track.column("tactor_y")], axis=1)


TABLE = cuboid(0.5, 0.5, 0.04)  # its top is at z = 0.04


# -- eq. 6 -------------------------------------------------------------------------------------------------------------


def test_equation_6_keeps_the_magnitude_and_as_printed_weakens_it_twice() -> None:
    d = np.array([[0.3, 0.0, 0.4], [0.0, 0.6, 0.0], [3.0, 4.0, 0.0], [0.6, 0.0, 12.0], [0, 0, 0.7]])
    p, length, limited = projected(d, 2e-3)
    assert p == pytest.approx(2e-3 * np.array([[0.3, 0], [0, 0.6], [0.6, 0.8], [0.6, 0], [0, 0]]))
    assert length == pytest.approx([0.3, 0.6, 5.0, 0.6, 0.0]) and limited == 1
    printed, _, limited = projected(d, 2e-3, "printed")
    assert printed[0] == pytest.approx([2e-3 * 0.3 * (0.3 / 0.5), 0])  # |d| = 0.5
    assert printed[1] == pytest.approx([0, 2e-3 * 0.6]) and printed[2] == pytest.approx([1.2e-3, 1.6e-3])
    assert printed[3] == pytest.approx([2e-3 * 0.6 * 0.6 / math.hypot(0.6, 12), 0]) and limited == 1


@pytest.mark.parametrize("method", ["magnitude", "printed"])
def test_nothing_to_show_is_the_centre_and_not_zero_by_zero(method: str) -> None:
    with np.errstate(all="raise"):
        p, length, limited = projected(np.zeros((4, 3)), 2e-3, method)
    assert not p.any() and not length.any() and limited == 0


def test_unknown_methods_are_refused() -> None:
    with pytest.raises(DermisError, match="projection"):
        projected(np.zeros((1, 3)), 1.0, "sideways")
    for name in ("projection", "transient_axis", "weight_sign"):
        with pytest.raises(DermisError, match=name):
            baked([poses(path(z=0.5))], [(Body("b", TABLE), poses(path()))], {name: "sideways"})


# -- each effect through world poses -----------------------------------------------------------------------------------


def tap(**use: Any) -> tuple[Rendered, float]:
    """A finger, turned about Z, that comes down into a table at 0.2 m/s."""
    material = QUIET | {
        "transient_on": True,
        "transient_amplitude": 0.8,
        "transient_decay": 60.0,
        "transient_frequency": 30.0,
    }
    turn = matrices(np.array([[math.cos(0.35), 0, 0, math.sin(0.35)]]))[0]
    rendered = baked([poses(path(z=0.09 - 0.2 * T), turn)], [(Body("b", TABLE, material), poses(path()))], use)
    return rendered, (0.05 - 0.0005) / 0.2


def test_straight_tap_shows_on_the_declared_axis() -> None:
    rendered, onset = tap()
    s = C - onset
    wave = np.where(s > 0, -0.8 * np.exp(-60 * s) * np.sin(2 * np.pi * 30 * s) * 0.2, 0.0)
    assert cap(rendered) == pytest.approx(2e-3 * wave[:, None] * np.array([0.0, 1.0]), abs=1e-10)
    inside = (C >= onset) & (C <= 0.6525)  # at -0.0405 m it has left through the other side
    assert np.array_equal(rendered.signals["contact"] > 0, inside)


def test_straight_tap_as_printed_shows_nothing() -> None:
    rendered, _ = tap(transient_axis="printed")
    assert np.abs(cap(rendered)).max() < 1e-12


def stroke(turn: np.ndarray, place: np.ndarray, **use: Any) -> Rendered:
    """A finger that strokes along a turned table's X at 40 mm/s."""
    material = QUIET | {
        "texture_on": True,
        "friction": 0.7,
        "texture_amplitude_x": 0.3,
        "texture_amplitude_y": 0.0,
        "texture_period_x": 0.004,
        "texture_speed_threshold": 0.005,
    }
    along = place + path(x=0.04 * T - 0.01, z=0.04) @ turn.T
    return baked([poses(along, turn)], [(Body("b", TABLE, material), poses(np.tile(place, (len(T), 1)), turn))], use)


def test_texture_follows_the_place_along_the_direction_of_movement() -> None:
    x = 0.04 * C - 0.01
    want = -0.7 * 0.3 * np.sin(2 * np.pi * x / 0.004)
    turn = matrices(np.array([[0.7, 0.4, -0.5, 0.3]]))[0]
    for rotation in (np.eye(3), turn):  # the whole scene turned: the finger feels the same
        rendered = stroke(rotation, np.array([0.1, -0.3, 0.2]))
        assert cap(rendered) == pytest.approx(2e-3 * want[:, None] * np.array([1.0, 0.0]), abs=1e-9)


def test_back_and_forth_over_one_place_has_one_phase() -> None:
    material = QUIET | {"texture_on": True, "friction": 1.0, "texture_amplitude_x": 0.3}
    x = 0.01 * np.sin(2 * np.pi * T)  # forth, back over the same places, and at rest twice
    p = cap(baked([poses(path(x=x, z=0.04))], [(Body("b", TABLE, material), poses(path()))]))[:, 0]
    wave = -0.3 * np.sin(2 * np.pi * 0.01 * np.sin(2 * np.pi * C) / 0.004) * 2e-3
    forth = (C < 0.2) | (C > 0.8)
    back = (C > 0.3) & (C < 0.7)
    assert p[forth] == pytest.approx(wave[forth], abs=2e-8) and p[back] == pytest.approx(-wave[back], abs=2e-8)


@pytest.mark.parametrize("switch", ["body/0/texture_on", "device/0/0/use_texture"])
@pytest.mark.parametrize("header", [True, False])
def test_texture_switch_stops_the_texture_while_it_is_off_and_not_before_or_after(switch: str, header: bool) -> None:
    """Keyed while the finger slides: each sample of the sweep holds until the next; the place goes on behind it."""
    material = QUIET | {"texture_on": True, "friction": 0.7, "texture_amplitude_x": 0.3, "texture_amplitude_y": 0.2}
    sliding = [poses(path(x=0.04 * T - 0.01, y=0.01 * T, z=0.04))]

    def shown(**animated: np.ndarray) -> EffectSum:
        body = material if not animated or switch.startswith("device") else material | {"texture_on": header}
        use = DeviceUse("haptip", {"use_texture": header} if animated and switch.startswith("device") else {})
        touch, scene = swept(sliding, [(Body("b", TABLE, body), poses(path()))], use, animated=animated)
        effects = EffectSum(touch, scene, 0, use, TACTOR.tap_axis, C)
        effects.add_body(0)
        return effects

    plain = shown().sum
    assert plain is not None and (np.abs(plain[1:]).max(axis=1) > 0).all()
    keyed = np.where((T >= 0.25) & (T < 0.5) | (T >= 0.75), 0.0, 1.0)
    found = shown(**{switch: keyed}).sum
    assert found is not None
    off = (C >= 0.25) & (C < 0.5) | (C >= 0.75)  # all are samples of the sweep as well
    assert not found[off].any()
    np.testing.assert_array_equal(found[~off], plain[~off])
    nothing = shown(**{switch: np.zeros(len(T))})
    assert nothing.sum is None and nothing.skipped["effects_off"] > 0


def test_a_finger_that_creeps_from_the_start_feels_no_texture_before_it_moves() -> None:
    """Slower than the threshold there is no direction yet: [S3] eq. 3 begins with a movement."""
    material = QUIET | {"texture_on": True, "friction": 1.0, "texture_amplitude_x": 0.4, "texture_period_x": 0.01}
    x = 0.0025 + 0.001 * T + 0.05 * np.maximum(T - 0.5, 0.0) ** 2  # 1 mm/s, and from 0.54 s on faster than 5 mm/s
    p = cap(baked([poses(path(x=x, z=0.04))], [(Body("b", TABLE, material), poses(path()))]))[:, 0]
    assert not p[C < 0.53].any()
    assert np.abs(p[C > 0.6]).max() > 5e-4


def test_direction_is_zero_before_the_first_movement_and_held_after_the_last() -> None:
    material = QUIET | {"texture_on": True, "friction": 1.0, "texture_amplitude_y": 0.4, "texture_period_y": 0.01}
    move = np.clip(T - 0.3, 0.0, 0.3)
    y = 0.0025 + 0.02 * np.sin(np.pi * move / 0.6)  # smooth enough; rests at 2.5 mm, then at 22.5 mm
    p = cap(baked([poses(path(y=y, z=0.04))], [(Body("b", TABLE, material), poses(path()))]))[:, 1]
    assert not p[C < 0.25].any()
    assert p[C > 0.7] == pytest.approx(-0.4 * 2e-3, rel=1e-3)  # sin(2 pi 2.25) = 1


def grip(
    shift: np.ndarray,
    use: Mapping[str, Any] | None = None,
    which: int = 0,
    animated: Any = None,
    more: Any = (),
    content: tuple[str, ...] = (),
    **material: Any,
) -> Rendered:
    """Thumb and index hold a cube of 4 cm, and everything moves along `shift`."""
    cube = (Body("cube", cuboid(0.02, 0.02, 0.02), QUIET | material, content), poses(shift))
    fingers = [poses(shift + [-0.02, 0, 0], THUMB), poses(shift + [0.02, 0, 0], INDEX)]
    return baked(fingers, [cube, *more], use, animated=animated, which=which)


def test_weight_in_the_pad_of_both_fingers() -> None:
    shift = path(y=0.01 * np.sin(6 * T))
    a = -0.36 * np.sin(6 * C)
    for which, rotation in ((0, THUMB), (1, INDEX)):
        rendered = grip(shift, which=which, weight_on=True, weight_acceleration=0.5, weight_gravity=0.05)
        world = np.stack([0 * C, 0.5 * a, np.full_like(C, -0.05 * 9.81)], axis=1)
        assert cap(rendered)[2:-2] == pytest.approx(2e-3 * (world @ rotation)[2:-2, :2], abs=2e-6)
        assert rendered.signals["held"].all()


def test_weight_s_sign_is_an_option() -> None:
    shift = path(y=0.01 * np.sin(6 * T))
    material = {"weight_on": True, "weight_acceleration": 0.5, "weight_gravity": 0.0}
    assert cap(grip(shift, **material)) == pytest.approx(-cap(grip(shift, {"weight_sign": "inertia"}, **material)))


def test_weight_needs_holding() -> None:
    material = {"weight_on": True, "weight_gravity": 0.05, "held_mode": "never"}
    rendered = grip(path(), **material)
    assert not cap(rendered).any() and rendered.skipped["bodies_never_held"] == 1


def test_auto_range_keeps_weights_apart_over_the_bake() -> None:
    shift = path(y=0.02 * np.sin(6 * T))
    peaks: dict[bool, list[float]] = {False: [], True: []}
    heavy = (
        Body("heavy", cuboid(0.02, 0.02, 0.02), QUIET | {"weight_on": True, "weight_acceleration": 9.0}),
        poses(shift + [0, 0, 0.0]),
    )
    for auto in (False, True):
        for alpha in (3.0, 9.0):
            rendered = grip(shift, {"auto_range": auto}, weight_on=True, weight_acceleration=alpha, more=[])
            peaks[auto].append(float(rendered.signals["magnitude"].max()))
            assert np.abs(cap(rendered)).max() == pytest.approx(2e-3, rel=1e-6)
    assert peaks[False][1] / peaks[False][0] == pytest.approx(3.0)
    # In one scene: both are held at once, the lighter keeps a third of the heavier.
    light = Body("light", heavy[0].mesh, QUIET | {"weight_on": True, "weight_acceleration": 3.0})
    far = np.array([1.0, 0, 0])
    fingers = [
        poses(shift + [-0.02, 0, 0], THUMB),
        poses(shift + [0.02, 0, 0], INDEX),
        poses(shift + far + [-0.02, 0, 0], THUMB),
        poses(shift + far + [0.02, 0, 0], INDEX),
    ]
    scene = [heavy, (light, poses(shift + far))]
    tops = [np.abs(cap(baked(fingers, scene, {"auto_range": True}, which=f))).max() for f in range(4)]
    assert tops == pytest.approx([2e-3, 2e-3, 2e-3 / 3, 2e-3 / 3], rel=1e-6)
    assert [f.code for f in baked(fingers, scene, {"auto_range": True}).findings] == ["auto-range"]
    loud = [np.abs(cap(baked(fingers, scene, which=f))).max() for f in (0, 2)]
    assert loud == pytest.approx([2e-3, 2e-3], rel=1e-6)  # without it both saturate, and feel alike


def test_content_of_a_child_is_the_way_between_the_centres_of_gravity() -> None:
    marble = Mesh(cuboid(0.002, 0.002, 0.002).vertices + [0, 0, 0.001], cuboid(1, 1, 1).triangles)
    inside = path(y=0.01 * np.sin(3 * T), z=-0.004)
    rendered = grip(
        path(),
        content=("marble",),
        content_on=True,
        content_amplitude=30.0,
        content_kind="child",
        more=[(Body("marble", marble, QUIET), poses(inside))],
    )
    oc = np.stack([0 * C, 0.01 * np.sin(3 * C), 0 * C - 0.003], axis=1)
    assert cap(rendered) == pytest.approx(2e-3 * 30.0 * (oc @ THUMB)[:, :2], abs=1e-9)


def test_content_without_a_child_says_so() -> None:
    rendered = grip(path(), content_on=True, content_amplitude=30.0, content_kind="child")
    assert [f.code for f in rendered.findings] == ["no-content"] and not cap(rendered).any()


@pytest.mark.parametrize("kind", ["pendulum", "slosh", "loose"])
def test_built_in_contents_at_their_rest(kind: str) -> None:
    """A pendulum hangs its length down, a liquid lies level, a loose body lies on the floor of its room."""
    rendered = grip(
        path(),
        content_on=True,
        content_amplitude=10.0,
        content_kind=kind,
        content_length=0.03,
        content_size=0.02,
        content_damping=0.9,
    )
    down = {"pendulum": 0.03, "slosh": 0.0, "loose": 0.02}[kind]
    assert cap(rendered)[-1] == pytest.approx(2e-3 * 10.0 * (np.array([0, 0, -down]) @ THUMB)[:2], abs=1e-12)


def test_pattern_plays_on_its_own_in_the_pad_s_plane() -> None:
    _, t = FRAMES, T
    rendered = baked(
        [poses(path(z=3.0))],
        [(Body("b", TABLE), poses(path()))],
        finger={
            "pattern": "orientation",
            "pattern_angle": math.pi / 2,
            "pattern_frequency": 2.0,
            "pattern_amplitude": 0.75,
        },
        animated={"finger/0/pattern_play": (t >= 0.25).astype(float)},
    )
    s = C - 0.25
    want = np.where((s >= 0) & (s <= 0.5), 1.5e-3 * np.sin(2 * np.pi * 2 * s), 0.0)
    assert cap(rendered) == pytest.approx(want[:, None] * np.array([1.0, 0.0]), abs=1e-12)


def test_pattern_switch_that_is_animated_silences_it_only_while_off() -> None:
    """The switch holds each sample's value until the next; the pattern itself goes on behind it, in phase."""
    wave = 2e-3 * 0.5 * np.sin(2 * np.pi * 2.0 * C)
    play = {
        "pattern": "orientation",
        "pattern_play": True,
        "pattern_repeat": True,
        "pattern_amplitude": 0.5,
        "pattern_frequency": 2.0,
    }
    for use, on in ((T < 0.5).astype(float), C < 0.5), ((T >= 0.5).astype(float), C >= 0.5):
        for header in (True, False):  # the channel decides, whatever the header says
            rendered = baked(
                [poses(path(z=0.5))],
                [(Body("b", TABLE, QUIET), poses(path()))],
                {"use_pattern": header},
                finger=play,
                animated={"device/0/0/use_pattern": use},
            )
            expected = np.where(on, wave, 0.0)
            # where the switch cuts in or out the tactor needs some samples to follow
            settled = np.abs(C - 0.5) > 0.02
            assert cap(rendered)[settled, 1] == pytest.approx(expected[settled], abs=1e-12)
            assert not cap(rendered)[:, 0].any()


# -- several at once, limits, skipping ---------------------------------------------------------------------------------

BOTH = {
    "weight_on": True,
    "weight_gravity": 0.06,
    "content_on": True,
    "content_amplitude": 10.0,
    "content_kind": "pendulum",
    "content_length": 0.03,
}


def test_effects_are_added_then_limited_once() -> None:
    alone = [cap(grip(path(), {f"use_{off}": False}, **BOTH)) for off in ("weight", "content")]
    assert cap(grip(path(), **BOTH)) == pytest.approx(alone[0] + alone[1], abs=1e-15)
    strong = BOTH | {"weight_gravity": 0.2, "content_amplitude": -70.0}  # 1.962 and -2.1: together within the range
    rendered = grip(path(), **strong)
    assert rendered.signals["magnitude"] == pytest.approx(2.1 - 1.962) and not rendered.track.limited
    rendered = grip(path(), **BOTH | {"weight_gravity": 0.2})
    assert np.hypot(*cap(rendered).T).max() == pytest.approx(2e-3)
    assert rendered.track.limited["tactor_x.disc"] == 1001


def test_each_switch_of_the_device_works() -> None:
    off = {f"use_{name}": False for name in ("transient", "texture", "weight", "content", "pattern")}
    assert not cap(grip(path(y=0.01 * np.sin(6 * T)), off, **BOTH)).any()


def test_cap_and_pulleys_agree_in_every_sample_and_nothing_is_too_fast() -> None:
    material = QUIET | {
        "transient_on": True,
        "transient_amplitude": 3.0,
        "transient_frequency": 300.0,
        "transient_decay": 90.0,
    }
    z = 0.045 - 0.02 * np.sin(2 * np.pi * 3 * T)
    rendered = baked([poses(path(z=z))], [(Body("b", TABLE, material), poses(path()))])
    track = rendered.track
    angles = np.stack([track.column("pulley_1"), track.column("pulley_2")], axis=1)
    assert TACTOR.forward(angles) == pytest.approx(cap(rendered), abs=1e-16)
    assert track.limited["tactor_x.slew_of_pair"] > 0
    assert np.hypot(*np.diff(cap(rendered), axis=0).T).max() <= 0.15e-3 * (1 + 1e-8)
    limited = track.within_limits()
    assert np.abs(limited.values - track.values).max() < 1e-12
    assert not [f for f in limited.check() if f.severity == "error"]


def test_untouched_bodies_and_effects_that_are_off_are_not_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    from core.effects import content, texture, transient, weight

    for module in (content, texture, transient, weight):
        monkeypatch.setattr(module, "displacement", None)  # a call would fail
    far = baked([poses(path(z=2.0))], [(Body("b", TABLE, BOTH), poses(path()))])
    assert not cap(far).any() and far.skipped["bodies_never_touched"] == 1 and not far.signals["contact"].any()
    off = baked([poses(path(z=0.04, x=0.1 * T))], [(Body("b", TABLE, QUIET), poses(path()))])
    assert off.signals["contact"].all() and off.skipped["effects_off"] == 5


def test_rate_does_not_depend_on_fps() -> None:
    scene = TactileScene("s", Fraction(30000, 1001), (1, 31), 240.0, (Finger("f"),), (Body("b", TABLE),), (), ())
    times = device_times(scene, SPEC.rate)
    assert len(times) == 1002 and times[-1] == pytest.approx(1.001) and np.diff(times) == pytest.approx(1e-3)


def test_frequency_that_the_device_cannot_show_is_reported() -> None:
    material = QUIET | {"transient_on": True, "transient_amplitude": 0.1, "transient_frequency": 700.0}
    rendered = baked([poses(path(z=0.05 - 0.02 * T))], [(Body("b", TABLE, material), poses(path()))])
    assert [f.code for f in rendered.findings] == ["above-nyquist"]


def test_preset_with_a_channel_of_another_mechanism_is_refused() -> None:
    odd = replace(SPEC, channels=(replace(SPEC.channels[0], name="pin_1"), *SPEC.channels[1:]))
    with pytest.raises(DermisError, match="no such channel"):
        baked([poses(path(z=2.0))], [(Body("b", TABLE), poses(path()))], spec=odd)
