"""A fingertip, a press and a match without a scene: what must hold of any touch, and of the shapes pressed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.contact.solver.path_solver import PathSolver
from core.devices import thimble
from core.errors import DermisError
from core.experiment import Touch, fingertip, match, press
from core.skin.blas import pools
from core.skin.model import SkinModel
from core.surface import shapes
from core.surface.gap import Surface
from core.track import csv

pytestmark = pytest.mark.shared_tests("numbers alone")


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip(level="draft")


# -- shapes


def test_a_sphere_has_a_spheres_volume_and_stands_at_the_origin() -> None:
    ball = Surface.sphere(4e-3, facets=5_000)
    assert ball.closed and not ball.findings()
    assert ball.volume == pytest.approx(4 / 3 * np.pi * 4e-3**3, rel=1e-12)
    assert ball.box[1, 2] == pytest.approx(0.0, abs=1e-15)
    centre = np.array([0.0, 0.0, ball.box[0, 2] / 2])
    radii = np.linalg.norm(ball.vertices - centre, axis=1)
    assert np.ptp(radii) < 1e-12, "every corner lies at one distance"
    gaps = ball.query(centre + 6e-3 * np.random.default_rng(1).normal(size=(200, 3))).gap
    assert gaps.min() > -radii.max()


def test_a_spheres_surface_is_off_by_no_more_than_it_says() -> None:
    radius, facets = 5e-3, 2_000
    ball = Surface.sphere(radius, facets)
    directions = np.random.default_rng(2).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    middle = np.array([0.0, 0.0, 0.5 * (ball.box[0, 2] + ball.box[1, 2])])
    off = ball.query(middle + radius * directions).gap
    assert np.abs(off).max() <= 3 * radius / facets


def test_a_block_and_an_edge_are_what_they_say() -> None:
    block = Surface.block(0.03, 0.02, 0.01)
    assert block.closed and block.volume == pytest.approx(6e-6, rel=1e-12)
    angle, rounding = np.radians(60.0), 0.2e-3
    wedge = Surface.build(*shapes.edge(angle, rounding, length=0.04, height=0.02))
    assert wedge.closed and not wedge.findings() and wedge.box[1, 2] == pytest.approx(0.0, abs=1e-15)
    # far from the rounding its faces make the angle, and both touch the circle of the rounding
    outside = np.array([[0.02, 0.0, -0.005]])
    normal = wedge.query(outside).normal[0]
    assert np.arctan2(normal[2], normal[0]) == pytest.approx(angle / 2, abs=1e-9)
    centre = np.array([0.0, 0.0, -rounding])
    faces = wedge.query(centre + 0.0 * outside).gap
    assert faces[0] == pytest.approx(-rounding, rel=0.01)


@pytest.mark.parametrize(
    "build",
    [
        lambda: shapes.sphere(0.0),
        lambda: shapes.block(height=-1.0),
        lambda: shapes.edge(np.pi),
        lambda: shapes.edge(1.0, np.nan),
        lambda: shapes.sphere("5 mm"),
        lambda: shapes.sphere(5e-3, 10**9),
        lambda: shapes.sphere(5e-3, 0),
    ],
)
def test_impossible_shapes_are_refused(build: object) -> None:
    with pytest.raises(DermisError):
        build()  # type: ignore[operator]


# -- pressing


def test_first_contact_is_where_the_surface_meets_the_pad(skin: SkinModel) -> None:
    """At no depth nothing is felt; a twentieth of a millimetre beyond, it is; wherever the surface stood before."""
    ball = Surface.sphere(5e-3, 5_000)
    lifted = Surface.build(ball.vertices + [0.0, 0.0, 0.03], ball.triangles)
    touch = press(skin, ball, 0.3e-3)
    assert press(skin, ball, 0.0).normal_force == pytest.approx(0.0, abs=1e-4)
    assert touch.normal_force > 0.0
    assert press(skin, lifted, 0.3e-3).force == pytest.approx(touch.force, abs=1e-4 * np.abs(touch.force).max())


def test_pressing_deeper_never_pulls(skin: SkinModel) -> None:
    block = Surface.block()
    forces = [press(skin, block, depth).resultant[2] for depth in (0.2e-3, 0.5e-3, 1e-3, 1.5e-3)]
    assert all(b > a > 0 for a, b in zip(forces, forces[1:], strict=False))


def test_force_is_proportional_to_stiffness(skin: SkinModel) -> None:
    ball = Surface.sphere(5e-3, 5_000)
    soft, hard = (press(fingertip(level="draft", alpha=a), ball, 1e-3) for a in (1.0, 2.0))
    assert hard.force == pytest.approx(2 * soft.force, abs=2e-3 * np.abs(hard.force).max())
    assert soft.residual <= 1e-3 and not soft.findings


def test_friction_holds_back_and_stays_in_its_cone(skin: SkinModel) -> None:
    block = Surface.block(0.2, 0.2)
    friction = 0.4
    slid = press(skin, block, 1e-3, friction=friction, slide=(4e-3, 0.0))
    across = float(np.hypot(*slid.resultant[:2]))
    assert slid.resultant[0] > 0, "the skin is drawn along with the surface"
    assert across <= friction * slid.normal_force * 1.01
    assert across >= 0.9 * friction * abs(slid.resultant[2]), "after four millimetres all of it slides"
    assert abs(press(skin, block, 1e-3, friction=0.0, slide=(4e-3, 0.0)).resultant[0]) < 0.1 * across


def test_a_turned_surface_is_the_surface_turned(skin: SkinModel) -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    plate, turned = Surface.block(0.004, 0.05), Surface.block(0.05, 0.004)
    one, two = press(skin, plate, 1e-3, turn=quarter), press(skin, turned, 1e-3)
    assert one.force == pytest.approx(two.force, abs=1e-4 * np.abs(two.force).max())


def test_what_cannot_be_pressed_is_refused(skin: SkinModel) -> None:
    block = Surface.block()
    for wrong in (
        {"depth": -1e-3},
        {"depth": 0.1},
        {"friction": -1.0},
        {"turn": np.ones((3, 3))},
        {"slide": (1.0,)},
        {"at": (0.5, 0.0)},
        {"at": (0.09, 0.0)},
        {"depth": "1 mm"},
        {"depth": np.array([1e-3])},
        {"friction": True},
        {"friction": np.inf},
        {"slide": (5.0, 0.0)},
        {"slide": "ab"},
        {"turn": -np.eye(3)},
        {"turn": 30.0},
    ):
        with pytest.raises(DermisError) as caught:
            press(skin, block, **wrong)  # type: ignore[arg-type]
        assert caught.value.where in (*wrong, "surface") and caught.value.limit and "\n" not in str(caught.value)
    with pytest.raises(DermisError, match="a millimetre is 1e-3"):
        press(skin, block, 1.5)
    with pytest.raises(DermisError, match="skin: expected SkinModel, got Surface"):
        press(block, skin)  # type: ignore[arg-type]
    with pytest.raises(DermisError, match="no such length"):
        fingertip(level="draft", with_=0.01)
    with pytest.raises(DermisError, match="no such preset"):
        fingertip("toe")


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_a_step_is_a_length_and_a_slide_ends_where_the_surface_has_left(skin: SkinModel) -> None:
    assert press(skin, Surface.block(0.02, 0.02), 0.3e-3, slide=[0, 0.06]).normal_force == 0.0


def test_too_deep_is_a_finding(skin: SkinModel) -> None:
    deep = [f for f in press(skin, Surface.block(), 2.5e-3).findings if f.code == "too-deep"]
    assert deep and deep[0].frame is None, "a press has no frames"


def test_a_surface_that_is_inside_out_is_told(skin: SkinModel) -> None:
    block = Surface.block()
    turned = Surface.build(block.vertices, block.triangles[:, ::-1])
    assert "inside-out" in [f.code for f in press(skin, turned, 0.1e-3).findings]


def test_one_blas_thread_does_it(skin: SkinModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two pools of threads that fight over the cores made a thimble's first match twelve times slower."""
    counts = []

    def asked(solver: PathSolver, *arguments: object, **more: object) -> object:
        counts.extend(pool["num_threads"] for pool in pools().info())
        return step(solver, *arguments, **more)  # type: ignore[arg-type]

    step = PathSolver.step
    monkeypatch.setattr(PathSolver, "step", asked)
    press(skin, Surface.block(), 0.1e-3, contact="nodes")
    assert counts and set(counts) == {1}


# -- matching


def test_pins_by_every_method(skin: SkinModel) -> None:
    """No bounded answer is nearer to the skin wanted than the optimal one, and the optimum proves itself."""
    touch = press(skin, Surface.sphere(5e-3, 5_000), 1e-3)
    best, clamped = match(touch), match(touch, method="DM1")
    assert best.method == "DM2" and best.optimality < 1e-9 and best.error <= clamped.error
    values = np.array(list(best.commands.values()))
    assert len(values) == 128 and values.min() >= 0.0 and values.max() <= 0.4 + 1e-12
    felt = best.rendered.displacement[skin.mesh.free] - touch.displacement[skin.mesh.free]
    assert best.error == pytest.approx(float(np.sqrt((felt**2).sum() / len(felt))), rel=1e-3)


def test_an_exact_match_is_optimal(skin: SkinModel) -> None:
    """Three forces and three servos: what is left over is rounding, and its direction is no doubt."""
    found = match(press(skin, Surface.sphere(5e-3), 1e-3, friction=0.5), "thimble_3rrs", "force")
    assert found.error < 1e-6 and found.optimality < 1e-6


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("device", ["pin_array_128", "thimble_3rrs"])
def test_a_match_becomes_a_track_that_a_file_gives_back(device: str, skin: SkinModel, tmp_path: Path) -> None:
    found = match(press(skin, Surface.sphere(5e-3, 5_000), 1e-3), device)
    csv.write(found.track(0.5), tmp_path / "held.csv")
    track = csv.read(tmp_path / "held.csv")
    assert track.duration == pytest.approx(0.5, abs=1.0 / track.spec.rate) and track.meta["method"] == found.method
    for name, value in found.commands.items():
        assert track.column(name) == pytest.approx(value, abs=1e-9), name
    assert not [f for f in track.within_limits(start_at_rest=True).check() if f.severity == "error"]
    if device == "thimble_3rrs":
        pose = [float(track.column(name)[0]) for name in ("pitch", "roll", "distance")]
        mechanism = thimble.mechanism(found.device)
        servos = np.array([found.commands[f"servo_{i}"] for i in (1, 2, 3)])
        assert mechanism.forward(servos, pose) == pytest.approx(pose, abs=1e-6), "the pose that these servos make"
    with pytest.raises(DermisError):
        found.track(0.0)


def test_one_line_says_what_it_is(skin: SkinModel) -> None:
    touch = press(skin, Surface.block(), 0.5e-3)
    assert isinstance(touch, Touch)
    for thing in (touch, match(touch), Surface.block()):
        assert "\n" not in repr(thing) and len(repr(thing)) < 120
    assert repr(Surface.block()) == "Surface(12 triangles, 50 x 50 x 20 mm, closed)"


def test_what_needs_a_scene_says_so(skin: SkinModel) -> None:
    touch = press(skin, Surface.block(), 0.5e-3)
    with pytest.raises(DermisError, match="Render a scene"):
        match(touch, "haptip")
    with pytest.raises(DermisError, match="unknown matching method"):
        match(touch, method="DM9")
    with pytest.raises(DermisError, match="thimble_3rrs: no surrogate was adapted .* stress, force, geometry"):
        match(touch, "thimble_3rrs", "network")
    for wrong in ((skin, "haptip"), (touch, None)):
        with pytest.raises(DermisError, match="expected (Stimulus, got SkinModel|DeviceSpec, got NoneType)"):
            match(*wrong)  # type: ignore[arg-type]
