"""The pin array's rendering against matrices written out, on real skin: limits, lead, fades, methods, finer meshes."""

from __future__ import annotations

import functools
import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from core.contact.skin_contact import SkinContact
from core.contact.skin_sampler import SkinSampler
from core.devices.spec import from_preset
from core.errors import DermisError
from core.matching import pin_report, pins
from core.matching.bounded_lsq import BoundedLeastSquares
from core.matching.deformation import METHODS, PinSolver
from core.pipeline.render import run
from core.presets import Library
from core.scene.sliding import RATE, SETTLE, sliding_plane
from core.scene.tactile_scene import DeviceUse
from core.skin.blas import pools
from core.skin.model import fingertip_skin, skin_from_parameters
from core.skin.stimulus import Stimulus
from core.skin.stress import RECEPTOR_DEPTHS

KKT = 1e-12
SLIDE = 0.75  # [s] of sliding in these tests


@functools.cache
def skin(level="draft"):
    return fingertip_skin(level=level)


@functools.cache
def spec(**changes):
    preset = json.loads(json.dumps(Library().device("pin_array_128").source))
    for name, value in changes.items():
        if name in ("slew", "high"):
            preset["channels"][0][name] = {"value": value, "unit": "N/s" if name == "slew" else "N"}
        else:
            preset["parameters"][name]["value"] = value
    return from_preset("pins", preset)


@functools.cache
def felt(level="draft", friction=0.6, direction=0.0, depth=2e-3, slide=SLIDE):
    scene = sliding_plane(depth, friction, direction, slide=slide)
    sampler = SkinSampler(scene, {0: skin(level)})
    for chunk in scene.chunks:
        sampler.add(chunk)
    return sampler.finish()[0]


def rendered(touch=None, device=None, **parameters):
    scene = sliding_plane(slide=SLIDE)
    use = DeviceUse("pin_array_128", parameters)
    return pins.render(None, scene, 0, use, device or spec(), touch or felt())


def test_a_whole_bake_of_skins_holds_blas_at_one_thread(monkeypatch):
    counts = []
    render = pins.render
    monkeypatch.setattr(
        pins, "render", lambda *a: counts.extend(p["num_threads"] for p in pools().info()) or render(*a)
    )
    scene = sliding_plane(slide=0.05)
    finger = replace(scene.fingers[0], devices=(DeviceUse("pin_array_128"),))
    before = [p["num_threads"] for p in pools().info()]
    with pools().limit(limits=2):
        assert not run(replace(scene, fingers=(finger,))).findings
    assert counts and set(counts) == {1} and before == [p["num_threads"] for p in pools().info()]


def test_every_pin_of_the_preset_meets_an_average_finger_within_its_stroke():
    ready = pins.setup(skin("standard"), spec())
    assert ready.met.hits.all() and not ready.met.findings
    assert np.abs(ready.met.travel).max() <= ready.pins.stroke / 2
    assert (ready.pins.directions[:, 1] > 0).all()  # towards the tip, and never back


@pytest.mark.parametrize("key", ["index_small", "index_large", "thumb_small", "thumb_large", "little_medium"])
def test_other_fingers_lose_few_pins_and_say_so(key):
    ready = pins.setup(skin_from_parameters(Library().skin(key), level="draft"), spec())
    lost = (~ready.met.hits).sum()
    assert lost <= 16
    assert sum(f.count for f in ready.met.findings if f.code in ("pin-misses", "pin-off-pad")) == lost


def test_the_matrices_are_those_of_the_skin():
    model, ready = skin(), pins.setup(skin(), spec())
    rng = np.random.default_rng(1)
    x, force = rng.random(128), rng.normal(size=(model.pad_count, 3))
    u = model.displacement(force)[model.mesh.free]
    shown = model.displacement(pins.rendered_force(ready, x))[model.mesh.free]
    expected = np.linalg.norm(u - shown) / np.sqrt(len(u))
    assert ready.matcher.displacement_error(force.ravel(), x[ready.met.hits])[0] == pytest.approx(expected, rel=1e-5)


def test_pins_press_with_their_own_force_on_the_skin():
    ready = pins.setup(skin(), spec())
    x = np.random.default_rng(2).random(128)
    total = Stimulus(skin(), pins.rendered_force(ready, x)).resultant
    np.testing.assert_allclose(total, x[ready.met.hits] @ ready.pins.directions[ready.met.hits], atol=1e-12)


@pytest.mark.parametrize(("weighting", "inside"), [("surface", lambda m: m.surface), ("all", lambda m: m.free)])
def test_weightings_choose_nodes(weighting, inside):
    mesh = skin().mesh
    chosen = np.flatnonzero(pins.node_weights(skin(), weighting))
    assert np.array_equal(chosen, np.intersect1d(inside(mesh), mesh.free))


def test_receptor_nodes_lie_at_receptor_depth():
    mesh = skin("standard").mesh
    chosen = np.flatnonzero(pins.node_weights(skin("standard"), "receptor"))
    pad = mesh.nodes[np.intersect1d(mesh.surface, mesh.pad)]
    away = np.linalg.norm(mesh.nodes[chosen][:, None] - pad[None], axis=2).min(axis=1)
    assert len(chosen) > 100 and (away >= min(RECEPTOR_DEPTHS) * 0.999).all()
    assert np.setdiff1d(chosen, mesh.free).size == 0


def test_real_problems_match_two_outside_solvers_and_carry_certificates():
    optimize = pytest.importorskip("scipy.optimize")
    ready, touch = pins.setup(skin("standard"), spec()), felt("standard")
    for method in ("DM2", "FM2"):
        gram = ready.matcher.gram(method)
        solver = BoundedLeastSquares(gram, 0.0, 0.4)
        root = np.linalg.cholesky(gram)
        for force in touch.force[:: len(touch.force) // 3]:
            c = ready.matcher.rhs(method, force.ravel().astype(float))
            ours = solver.solve(c)
            assert ours.converged and ours.optimality(0.0, 0.4) <= KKT
            side, scale = np.linalg.solve(root, c), np.abs(gram).max()
            bvls = optimize.lsq_linear(root.T, side, (0, 0.4), method="bvls", tol=1e-15, max_iter=2000).x
            np.testing.assert_allclose(ours.x, bvls, atol=1e-6)
            box = optimize.minimize(
                lambda x, c=c, h=gram, s=scale: (0.5 * x @ h @ x - c @ x) / s,
                np.full(len(c), 0.1),
                jac=lambda x, c=c, h=gram, s=scale: (h @ x - c) / s,
                bounds=[(0, 0.4)] * len(c),
                method="L-BFGS-B",
                options={"maxiter": 200_000, "maxfun": 400_000, "ftol": 0, "gtol": 1e-13, "maxcor": 60},
            ).x

            def cost(x, c=c, h=gram):
                return 0.5 * x @ h @ x - c @ x

            assert cost(ours.x) <= min(cost(bvls), cost(box)) + 1e-12 * abs(cost(ours.x))
            assert cost(box) - cost(ours.x) <= 1e-4 * abs(cost(ours.x))  # it stops short where curvature is small


@pytest.mark.parametrize("peer", ["daqp", "osqp"])
def test_real_problems_match_quadratic_solvers_where_they_are_installed(peer):
    pytest.importorskip(peer)
    from tests.benchmarks import bench_pins

    ready = pins.setup(skin("standard"), spec())
    gram = ready.matcher.gram("DM2")
    solve, solver = getattr(bench_pins, f"_{peer}")(gram), BoundedLeastSquares(gram, 0.0, 0.4)
    for force in felt("standard").force[::40]:
        c = ready.matcher.rhs("DM2", force.ravel().astype(float))
        np.testing.assert_allclose(solver.solve(c).x, solve(c), atol=5e-3)


def test_the_papers_order_holds_on_the_matching_mesh():
    r = {x.method: x for x in pin_report.compare(felt("standard", slide=1.25), spec(), bounded=False)}
    u = {m: r[m].displacement_peak for m in METHODS}  # when all of the contact slips
    assert u["DM0"] <= u["DM2"] <= min(u["DM1"], u["FM1"], u["FM2"])
    assert abs(u["FM1"] / u["FM2"] - 1) < 0.1  # 'relatively small'
    assert u["DM1"] > 2 * u["DM2"]
    assert r["FM0"].force_error <= r["FM2"].force_error <= r["FM1"].force_error
    assert max(x.kkt for x in r.values()) <= KKT


def test_deformation_matching_shows_more_shear_than_force_matching():
    slopes = {m: [] for m in ("FM1", "DM2")}
    for mu in (0.0, 0.6):
        for x in pin_report.compare(felt(friction=mu), spec(), methods=("FM1", "DM2")):
            slopes[x.method].append(x.shear_ratio)
    fm, dm = (slopes[m][1] - slopes[m][0] for m in ("FM1", "DM2"))
    assert dm > 1.5 * fm > 0


def test_tilted_pins_cannot_pull_back():
    back = felt(direction=np.radians(270.0), friction=0.5)
    assert back.force[-1].sum(axis=0)[1] < -0.5  # what is wanted
    for method in ("FM1", "DM2"):
        forces = rendered(back, pin_method=method, pin_fade_out=0.0).track.values[-1]
        assert forces @ pins.setup(skin(), spec()).pins.directions[:, 1] >= 0.0


def test_the_finer_mesh_has_a_target_of_its_own():
    reports = {x.method: x for x in pin_report.compare(felt(), spec(), finer=felt("standard"))}
    # forces of opposite sign that cancel on their own mesh do not on another one
    assert reports["DM0"].finer_share > 1.5 * reports["DM0"].displacement_share
    direct = pins.match(PinSolver(pins.setup(skin(), spec()).matcher, "DM2"), felt())
    fine, ready = felt("standard"), pins.setup(skin("standard"), spec())
    i = len(fine.times) - 1
    u, shown = (
        skin("standard").displacement(f)[skin("standard").mesh.free]
        for f in (fine.force_at(i), pins.rendered_force(ready, direct.forces[i]))
    )
    expected = np.linalg.norm(u - shown) / np.sqrt(len(u))
    assert pin_report.error_on(ready, fine, direct)[i] == pytest.approx(expected, rel=1e-4)


def test_stiffer_skin_needs_forces_that_much_larger_and_bounds_hold_after_it():
    stiff = skin().with_material(alpha=0.75)
    touch = replace(felt(), model=stiff, held=(0.75 * felt().force).astype(np.float32))
    for method in METHODS:
        ready = pins.setup(skin(), spec())
        one = pins.match(PinSolver(ready.matcher, method, force_limit=None), felt())
        other = pins.match(PinSolver(pins.setup(stiff, spec()).matcher, method, force_limit=None), touch)
        # bounded, there are many best answers on a mesh as coarse as this: they do the same to the skin
        felt_of, share = np.eye(one.forces.shape[1]), 2e-5
        if method.endswith("2"):
            felt_of, share = ready.distribution.T, 2e-4
            felt_of = felt_of @ skin().compliance32 if method == "DM2" else felt_of
        wanted = 0.75 * one.forces @ felt_of
        np.testing.assert_allclose(other.forces @ felt_of, wanted, atol=share * np.abs(wanted).max())
    assert rendered(touch).track.values.max() <= 0.4


def test_the_track_leads_by_the_delay_or_not():
    late, early = (rendered(pin_fade_in=0.0, pin_fade_out=0.0, pin_lead=lead).track for lead in (False, True))
    shift = round(0.075 * RATE)
    np.testing.assert_allclose(early.values[:-shift], late.values[shift:], atol=1e-12)
    np.testing.assert_array_equal(early.values[-shift:], np.repeat(late.values[-1:], shift, axis=0))
    assert early.meta["lead_s"] == "0.075" and late.meta["lead_s"] == "0"


def test_fades_are_smooth_steps_of_their_length():
    plain, faded = (rendered(pin_fade_in=f, pin_fade_out=f).track for f in (0.0, 0.2))
    t, end = plain.times, plain.times[-1]

    def smooth(x):
        x = np.clip(x, 0, 1)
        return x**2 * (3 - 2 * x)

    gain = smooth(t / 0.2) * smooth((end - t) / 0.2)
    np.testing.assert_allclose(faded.values, plain.values * gain[:, None], atol=1e-12)


def test_pins_stay_within_force_and_speed():
    track = rendered(device=spec(slew=2.0), pin_fade_in=0.0, pin_fade_out=0.0, pin_lead=False).track
    assert track.values.min() >= 0 and track.values.max() <= 0.4
    assert max(np.abs(b - a).max() for a, b in pairwise(track.values)) <= 2.0 / RATE * (1 + 1e-9)
    assert rendered(pin_bounded=False).track.values.max() > 0.4


@pytest.mark.parametrize("method", ["DM1", "DM2", "FM2"])
def test_a_gap_without_contact_is_forgotten(method):
    """Pins that follow slowly start from rest after every gap, as if nothing had been touched before it."""
    touch, step = felt(), 0.01  # [N] a sample
    after = slice(len(touch.contact) - 60, None)
    split = np.r_[0:60, range(*after.indices(len(touch.contact)))]
    solver = PinSolver(pins.setup(skin(), spec()).matcher, method, slew=step)
    both = pins.match(solver, replace(touch, contact=touch.contact[split], held=touch.force[split]))
    alone = pins.match(solver, replace(touch, contact=touch.contact[after], held=touch.force[after]))
    first, last = touch.contact[59], touch.contact[after][0]
    assert last > first + 1 and not both.forces[first + 1 : last].any()
    assert both.forces[first].max() > 3 * step, "it had risen by then"
    assert both.forces[last].max() <= step * (1 + 1e-9)
    np.testing.assert_allclose(both.forces[last:], alone.forces[last:], atol=1e-9)


def test_a_single_frame_has_the_limit_of_force_but_no_speed():
    ready, times = pins.setup(skin(), spec(slew=2.0)), np.arange(3) / RATE
    assert pins.make_solver(ready, spec(slew=2.0), "DM2", times).slew == pytest.approx(2.0 / RATE)
    single = pins.make_solver(ready, spec(slew=2.0), "DM2", None)
    assert single.slew is None and (single.high == 0.4).all()
    assert pins.make_solver(ready, spec(slew=2.0), "DM2", None, bounded=False).high.min() > 1e3


def test_a_channel_below_the_parameter_bounds_the_optimum_not_only_the_track():
    weak, ready = spec(high=0.15), pins.setup(skin(), spec(high=0.15))
    found = rendered(device=weak, pin_lead=False, pin_fade_in=0.0, pin_fade_out=0.0)
    assert found.track.values.max() == pytest.approx(0.15, rel=1e-9) and float(found.track.meta["worst_kkt"]) <= KKT
    told = next(f for f in found.findings if f.code == "pins-at-limit")
    assert told.limit == "0.15 N a pin"
    clipped = np.clip(rendered(pin_lead=False, pin_fade_in=0.0, pin_fade_out=0.0).track.values[-1], 0.0, 0.15)
    target = felt().force_at(len(felt().times) - 1).reshape(1, -1)
    error = [ready.matcher.displacement_error(target, x[ready.met.hits]) for x in (found.track.values[-1], clipped)]
    assert error[0] < error[1], "the best within the limits is not the best without them, cut off"


def test_what_is_at_its_limit_is_told():
    found = rendered()
    assert any(f.code == "pins-at-limit" for f in found.findings)
    assert found.signals["at_limit"].max() > 0
    assert float(found.track.meta["worst_kkt"]) <= KKT


def test_nothing_touched_gives_zeros_without_any_matrices(monkeypatch):
    monkeypatch.setattr(pins, "setup", lambda *_: pytest.fail("nothing is to be built"))
    free = felt()
    nothing = replace(free, contact=free.contact[:0], held=free.force[:0])
    found = rendered(nothing)
    assert not found.track.values.any() and found.track.values.shape == (len(free.times), 128)
    assert not any(s.any() for s in found.signals.values())
    with pytest.raises(DermisError, match="nothing was touched"):
        pin_report.compare(nothing, spec())
    with pytest.raises(DermisError, match="'rows' is too small"):  # a bad layout does not wait for a touch
        rendered(nothing, spec(rows=0))


def test_the_plane_of_the_scene_follows_the_papers_law():
    scene = sliding_plane(1.5e-3, 0.4, np.radians(90), slide=2.0)
    chunk = scene.chunks[0]
    place = chunk.bodies[0, :, :3, 3]
    t = chunk.times - SETTLE
    moving = t > 0
    expected = -0.02 * np.cos(np.pi / 4 * t[moving]) + 0.02
    np.testing.assert_allclose(place[moving, 1], expected, atol=1e-15)
    np.testing.assert_allclose(place[moving, 2], 1.5e-3, atol=1e-15)
    np.testing.assert_allclose(place[:, 0], 0.0, atol=1e-15)
    assert place[-1, 1] == pytest.approx(0.02) and chunk.times[-1] == pytest.approx(SETTLE + 2.0)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [({"pin_method": "DM3"}, "method"), ({"pin_nodes": "nail"}, "unknown pin nodes"), ({"pin_fade_in": -0.1}, "fade")],
)
def test_bad_settings_are_refused(parameters, words):
    with pytest.raises(DermisError, match=words):
        rendered(**parameters)


def test_a_layout_of_another_number_than_the_channels_is_refused():
    with pytest.raises(DermisError, match="differ in number"):
        rendered(device=spec(rows=7))


def test_pins_beside_the_pad_are_switched_off_and_named():
    moved = spec(forward=-9.0)
    ready = pins.setup(skin(), moved)
    off = [f for f in ready.met.findings if f.code == "pin-off-pad"]
    assert off and off[0].count > 0 and (~ready.met.hits).sum() >= off[0].count
    assert not rendered(device=moved).track.values[:, ~ready.met.hits].any()


def test_a_finer_skin_of_another_scene_is_refused():
    other = felt("standard")
    shorter = SkinContact(**{**other.__dict__, "times": other.times[:-1]})
    with pytest.raises(DermisError, match="another scene"):
        pin_report.compare(felt(), spec(), finer=shorter)
