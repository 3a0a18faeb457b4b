"""The parts that the contact references are made of, each against something known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from core.parameters.error_bands import LINEAR
from tests.benchmarks.references.cases import FAMILIES, FINGER, SCALES, first_contact
from tests.benchmarks.references.contact import Press, Pressed
from tests.benchmarks.references.hexahedra import Grading, Gradings, HexMesh, chart_below, graded_fingertip, places
from tests.benchmarks.references.making import Meshed
from tests.benchmarks.references.neo_hookean import BALANCED, NeoHookean, pressed
from tests.benchmarks.references.results import PATH, errors, is_judged, load, missing, summary, table
from tests.benchmarks.references.shapes import Ball, Edge, Flat, Pillar, Plate, Ribs, Rod
from tests.benchmarks.references.slab import HEIGHT, cells, skin, slid_apart
from tests.benchmarks.references.sliding import SLIDES, slid
from tests.benchmarks.references.tissue import MATERIAL, PA, Condensed, Tissue, cauchy, stiffness
from tests.benchmarks.references.turned_shapes import Cone, Dot, Peg, Torus

pytestmark = pytest.mark.one_line("3.13", "a tool of developers: the product does not use it")

COARSE = Gradings(Grading(0.4, 0.5), Grading(0.8, 1.0), Grading(0.4, 0.5))


def box(*axes, half=False):
    """Bricks between places along x, y and z; what lies highest is held."""
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape([len(a) for a in axes])
    i = [slice(None, -1), slice(1, None)]
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    elements = np.stack([number[i[a], i[b], i[c]].ravel() for a, b, c in corners], axis=1)
    low = np.flatnonzero(nodes[:, 2] == nodes[:, 2].min())
    return HexMesh(nodes, elements, nodes[:, 2] == nodes[:, 2].max(), low, half)


def test_constant_strain_passes_through_distorted_bricks():
    mesh = box(*3 * [np.linspace(0.0, 1.0, 4)])
    inside = (np.abs(mesh.nodes - 0.5) < 0.49).all(axis=1)
    mesh.nodes[inside] += np.random.default_rng(7).uniform(-0.08, 0.08, (inside.sum(), 3))
    slope = np.array([[0.02, 0.01, 0.03], [0.0, -0.01, 0.02], [0.0, 0.0, 0.015]])
    slope[:, :2] = 0.0  # the held face neither turns nor stretches
    moved = (mesh.nodes - [0.0, 0.0, 1.0]) @ slope.T
    force = (stiffness(mesh) @ moved.ravel()).reshape(-1, 3)
    assert np.abs(force[inside]).max() < 1e-9 * np.abs(force).max()
    outside = np.flatnonzero(~inside & ~mesh.held)
    tissue = Tissue(mesh, outside)
    found, left = tissue.deformed(force[outside])
    np.testing.assert_allclose(found, moved, atol=1e-11)
    assert left < 1e-10
    points = np.array([[0.4, 0.5, 0.6], [0.2, 0.7, 0.1]])
    wanted = np.tile(cauchy(slope[None]), (2, 1))
    np.testing.assert_allclose(tissue.stress(found, points), wanted, rtol=1e-6, atol=1e-3)
    first, shear = MATERIAL.lame
    np.testing.assert_allclose(wanted[0, [2, 3]], [(first + 2.0 * shear) * 0.015, shear * 0.02])


def test_nearly_incompressible_bricks_do_not_lock():
    """A wide block that is pressed flat bulges at its sides; with plain strains it would be several times as stiff."""
    mesh = box(np.linspace(0.0, 4.0, 9), np.linspace(0.0, 4.0, 9), np.linspace(0.0, 4.0, 9))
    fine = box(np.linspace(0.0, 4.0, 17), np.linspace(0.0, 4.0, 17), np.linspace(0.0, 4.0, 17))
    found = []
    for each in (mesh, fine):
        middle = each.pad[(np.abs(each.nodes[each.pad, :2] - 2.0) <= 1.0).all(axis=1)]
        weight = np.where(np.abs(np.abs(each.nodes[middle, :2] - 2.0) - 1.0) < 1e-9, 0.5, 1.0).prod(axis=1)
        force = np.column_stack([0.0 * weight, 0.0 * weight, 0.01 * weight / weight.sum()])
        found.append(float((Tissue(each, middle).deformed(force)[0][middle, 2] * weight).sum() / weight.sum()))
    assert found[0] == pytest.approx(found[1], rel=0.06)


def test_half_a_mesh_gives_way_like_the_whole():
    y, z = np.linspace(-1.0, 1.0, 5), np.linspace(0.0, 1.0, 4)
    x = np.array([0.0, 0.2, 0.5, 1.0])
    half, whole = box(x, y, z, half=True), box(np.concatenate([-x[:0:-1], x]), y, z)
    force = np.random.default_rng(2).standard_normal((len(half.pad), 3))
    force[half.cut[half.pad], 0] = 0.0
    key = {tuple(p): row for row, p in enumerate(whole.nodes[whole.pad])}
    rows, others = (np.array([key[tuple(p * [s, 1, 1])] for p in half.nodes[half.pad]]) for s in (1, -1))
    forces = np.zeros((len(whole.pad), 3))
    np.add.at(forces, rows, force)
    np.add.at(forces, others, force * [-1.0, 1.0, 1.0])
    one, two = Tissue(half, half.pad), Tissue(whole, whole.pad)
    moved, both = one.deformed(force)[0], two.deformed(forces)[0]
    np.testing.assert_allclose(moved[half.pad], both[whole.pad][rows], atol=1e-9 * np.abs(both).max())
    points = np.array([[0.3, 0.1, 0.4], [-0.3, 0.1, 0.4], [0.01, 0.1, 0.4]])
    exact = two.stress(both, points)
    np.testing.assert_allclose(one.stress(moved, points), exact, atol=1e-8 * np.abs(exact).max())


def half_space(count, step, poisson, young=0.1):
    """Points of a grid on a half space, and their compliance by Boussinesq and Cerruti, loads spread over a cell."""
    x, y = (a.ravel() for a in np.meshgrid(*2 * [step * np.arange(-count, count + 1)]))
    shear = young / (2.0 * (1.0 + poisson))
    dx, dy = x[:, None] - x, y[:, None] - y
    apart = np.hypot(dx, dy)
    np.fill_diagonal(apart, 1.0)
    one, xx, xy = 1.0 / apart, dx * dx / apart**3, dx * dy / apart**3
    np.fill_diagonal(one, 4.0 * np.arcsinh(1.0) / step)
    np.fill_diagonal(xx, 2.0 * np.arcsinh(1.0) / step)
    yy = one - xx
    c = np.zeros((len(x), 3, len(x), 3))
    c[:, 0, :, 0], c[:, 1, :, 1] = (1.0 - poisson) * one + poisson * xx, (1.0 - poisson) * one + poisson * yy
    c[:, 0, :, 1] = c[:, 1, :, 0] = poisson * xy
    c[:, 2, :, 2] = (1.0 - poisson) * one
    return np.stack([x, y, 0.0 * x], axis=1), c.reshape(3 * len(x), -1) / (2.0 * np.pi * shear), shear


def test_a_ball_on_a_half_space_presses_like_hertz():
    young, poisson, radius, depth = 0.1, 0.48, 30.0, 0.05
    points, compliance, _ = half_space(14, 0.1, poisson)
    [found] = Press(compliance, points, Ball(radius)).depths(np.zeros(3), [depth], 0.1)
    hertz = 4.0 / 3.0 * young / (1.0 - poisson**2) * np.sqrt(radius) * depth**1.5
    assert found.force[:, 2].sum() == pytest.approx(hertz, rel=0.015)
    assert found.residual < 1e-5 and found.change < 1e-5


def test_a_ball_that_is_drawn_sticks_and_slips_like_cattaneo_and_mindlin():
    poisson, radius, depth, friction = 0.5, 30.0, 0.04, 0.4
    points, compliance, shear = half_space(11, 0.12, poisson)
    press = Press(compliance, points, Ball(radius), friction)
    [state] = press.depths(np.zeros(3), [depth], 0.01)
    load, touch = state.force[:, 2].sum(), np.sqrt(radius * depth)
    most = 3.0 * friction * load / (16.0 * touch) * (2.0 - poisson) / shear  # where all of it slips
    pulls = []
    for share in (0.25, 0.5, 0.75, 0.95):
        before = state
        state = press.settled(np.array([share * most, 0.0, depth]), before, 3e-6, 200)
        pulls.append(state.force[:, 0].sum() / (friction * state.force[:, 2].sum()))
        assert press.residual(state, before) < 1e-4
    wanted = 1.0 - (1.0 - np.array([0.25, 0.5, 0.75, 0.95])) ** 1.5
    np.testing.assert_allclose(pulls, wanted, atol=0.02)


def test_the_residual_of_contact_tells_what_is_wrong():
    points, compliance, _ = half_space(8, 0.1, 0.48)
    press = Press(compliance, points, Ball(20.0), 0.3)
    [state] = press.depths(np.zeros(3), [0.02], 0.01)
    before = Pressed(0.0 * points, 0.0 * points, np.zeros(3))
    assert state.residual < 1e-4
    wrong = {
        "inside": replace(state, displacement=state.displacement - [0.0, 0.0, 0.001]),
        "pulled": replace(state, force=state.force - [0.0, 0.0, 0.1 * state.force[:, 2].max()]),
        "beyond the cone": replace(state, force=state.force + [0.5 * state.force[:, 2].max(), 0.0, 0.0]),
    }
    for name, each in wrong.items():
        assert press.residual(each, before) > 0.9e-3, name


SOLIDS = [
    *(Flat(), Ball(2.0), Edge(60.0), Edge(120.0), Ribs(), Rod(3.0), Peg(1.0, 0.1), Peg(6.0, 0.1, 6.0)),
    *(Torus(1.0, 5.0, 5.0), Cone(60.0, 0.5), Dot(0.72, 0.48)),
    *(Pillar(2.0, 0.1), Pillar(2.0, 0.05), Plate(0.5, 0.1), Plate(2.0, 0.2, turned=True)),
]


@pytest.mark.parametrize("shape", SOLIDS, ids=str)
def test_gaps_are_those_of_the_triangles(shape):
    low = 0.0 if isinstance(shape, Dot) else -0.3  # where a cap meets its plate, the gap inside is of one of both
    points = np.random.default_rng(3).uniform([-2.2, -1.0, low], [2.2, 1.0, 0.3], (300, 3))
    gap, normal = shape.gap(points)
    mesh = shape.surface().query(points * 1e-3, 1.0)
    np.testing.assert_allclose(1e3 * mesh.gap, gap, atol=2e-3)
    step = 1e-6
    slopes = np.stack(
        [(shape.gap(points + step * e)[0] - shape.gap(points - step * e)[0]) / (2 * step) for e in np.eye(3)], 1
    )
    smooth = np.abs(np.linalg.norm(slopes, axis=1) - 1.0) < 1e-6
    assert smooth.mean() > 0.95
    np.testing.assert_allclose(slopes[smooth], normal[smooth], atol=1e-5)


@pytest.mark.parametrize("half", [True, False])
def test_a_graded_mesh_fits_together_on_the_smooth_skin_with_a_line_under_the_shape(half):
    aside = 0.0 if half else 0.8
    mesh = graded_fingertip(FINGER, COARSE, aside, 1.0, half=half)
    faces = np.array([(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])
    sides, count = np.unique(np.sort(mesh.elements[:, faces].reshape(-1, 4)), axis=0, return_counts=True)
    assert set(count) == {1, 2}
    border = np.zeros(len(mesh.nodes), bool)
    border[sides[count == 1]] = True
    assert border[mesh.pad].all()
    skin = mesh.nodes[mesh.pad]
    x, y = skin[:, 0], skin[:, 1]
    low = skin[:, 2] < 4.0
    np.testing.assert_allclose(skin[low], places(FINGER, chart_below(FINGER, x[low], y[low]), 1.0), atol=1e-9)
    line = skin[(np.abs(y) < 1e-3) & low]
    assert np.abs(line[:, 0] - aside).min() < 2e-3
    if half:
        assert mesh.cut.sum() > 50 and (mesh.nodes[:, 0] >= 0.0).all()


def test_as_much_skin_is_held_as_the_nail_covers_whatever_the_mesh():
    areas = []
    for scale in (1.0, 0.7):
        mesh = graded_fingertip(FINGER, COARSE, 0.0, scale, half=True)
        count = mesh.elements[0, 0] - mesh.elements[0, 4]  # of the nodes of a layer, the skin first
        faces = mesh.elements[(mesh.elements[:, 4:] < count).all(axis=1), 4:]
        a, b, c, d = mesh.nodes[faces[mesh.held[faces].all(axis=1)]].transpose(1, 0, 2)
        areas.append((0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1).sum(), mesh.bed.sum() / 3.0))
    (held, border), whole = areas[0], [sum(area) for area in areas]
    assert border > 0.3 * held  # were it held or free as a whole, the area would be that far off
    assert whole[0] == pytest.approx(whole[1], rel=0.03)


def test_half_the_scale_is_eight_times_the_elements():
    coarse, fine = (graded_fingertip(FINGER, COARSE, 0.0, scale, half=True) for scale in (2.0, 1.0))
    assert 6.0 < len(fine.elements) / len(coarse.elements) < 10.0


def test_first_contact_touches_and_no_more():
    at = first_contact(Edge(90.0), 0.81)
    rng = np.random.default_rng(4)
    skin = places(FINGER, 0.3 * rng.random(2000) * np.exp(2j * np.pi * rng.random(2000)), 1.0)
    gap = Edge(90.0).gap(skin - at)[0]
    assert 0.0 <= gap.min() < 0.02


def test_the_other_side_of_the_finger_answers_as_its_mirror_image():
    edge = replace(FAMILIES["edge 0.37"], shapes=(("edge", Edge(90.0)),), gradings=COARSE, depths=(0.3,), reach=-0.5)
    forces = []
    for side in (1.0, -1.0):
        own = replace(edge, sideways=side * edge.sideways)
        [found] = Meshed(own, 2.0).cases(Edge(90.0), own.probes)
        forces.append(found.force)
    np.testing.assert_allclose(forces[0], forces[1] * [-1.0, 1.0, 1.0], atol=2e-5 * forces[0][2])


def test_a_wide_slab_is_squeezed_like_confined_tissue():
    """Even pressure far from the sides: strain is stress over the modulus of tissue that cannot widen."""
    points, compliance = skin(*cells((0.0,), 0.1, 0.5), 7.9)
    x, first, shear = points[:, 0], *(PA * value for value in MATERIAL.lame)
    force = np.zeros((len(x), 3))
    force[:, 2] = 1e-3 * np.gradient(x)
    moved = (compliance @ force.ravel()).reshape(-1, 3)
    middle = np.abs(x).argmin()
    assert moved[middle, 2] == pytest.approx(1e-3 * HEIGHT / (first + 2.0 * shear), rel=0.1)
    assert np.abs(moved[middle, :2]).max() < 0.01 * moved[middle, 2]  # the middle point is half a cell aside


def test_sliding_without_friction_ends_where_pressing_does_once_cells_resolve_the_rounding():
    coarse, fine = (slid_apart(Edge(90.0), (0.2,), even, 0.6, 0.0)[2].max() for even in (0.08, 0.02))
    assert fine < 0.002 and coarse > 0.1


def test_a_slide_is_told_beside_presses_and_drags_by_friction():
    slide = replace(SLIDES["slid edge 90"], shape=Ball(3.0), gradings=COARSE, way=((0.0, 0.0), (0.1, 0.0)), depth=0.3)
    found = slid(slide, (4.0, 2.8, 2.0))
    free, held = found["slid edge 90, friction 0"], found["slid edge 90, friction 0.3"]
    assert free["slid"][0] == free["pressed"][0] and np.shape(free["apart"]) == (3, 1)
    assert np.array(free["apart"]).max() < 0.02
    drag = held["slid"][1][0] - held["pressed"][1][0]
    assert 0.1 < drag / held["pressed"][1][2] < 0.3
    assert [mesh["scale"] for mesh in free["meshes"]] == [4.0, 2.8, 2.0]
    assert all(mesh["contact"] < 1e-4 for case in (free, held) for mesh in case["meshes"])


def test_errors_follow_the_order_of_convergence():
    exact = np.random.default_rng(6).standard_normal((6, 6))
    for order in (1.0, 2.0):
        stresses = [exact * (1.0 + 0.1 * h**order) for h in (1.0, 0.5, 0.3)]
        last = 0.1 * 0.3**order / (1.0 + 0.1 * 0.3**order)
        np.testing.assert_allclose(errors(stresses, (1.0, 0.5, 0.3), 3), last, rtol=1e-6)


def test_what_does_not_converge_is_not_judged_by():
    stress = np.ones((6, 6))
    forces = [np.array([0.0, 0.0, f]) for f in (1.0, 1.1, 1.0)]
    wavering = summary(forces, [stress] * 3, SCALES, 3)
    assert wavering["error"]["force"] == pytest.approx(0.1 / (2.0**0.5 - 1.0), rel=0.01) and not is_judged(wavering)
    assert is_judged(summary([forces[0]] * 3, [stress] * 3, SCALES, 3))
    assert not is_judged(summary([forces[0]] * 3, [stress, stress, 1.1 * stress], SCALES, 3))


def test_the_file_holds_what_its_rule_says_of_every_case():
    known = load()
    assert json.loads(PATH.read_text()) == known
    made = {case["family"] for case in known["cases"].values()}
    titles = [title for name in FAMILIES if name in made for *_, title in FAMILIES[name].cases()]
    assert list(known["cases"]) == titles and len(titles) > 30
    for name, case in known["cases"].items():
        family = FAMILIES[case["family"]]
        assert np.shape(case["stress"]) == (len(family.probes), 6), name
        np.testing.assert_allclose(known["probes"][family.name], family.probes, atol=1e-4)
        forces = [[force] for force in case["forces"]]
        own = abs(forces[-1][0] / forces[-2][0] - 1.0) * missing(forces, SCALES)
        assert case["error"]["force"] == pytest.approx(own, rel=0.1, abs=1e-4), name
        assert [mesh["scale"] for mesh in case["meshes"]] == pytest.approx(SCALES, abs=1e-3)
        balanced = 1e-9 if family.tissue == LINEAR else BALANCED  # one solve, or Newton's method
        for mesh in case["meshes"]:
            assert mesh["contact"] < 1e-4 and mesh["balance"] < balanced, name


def test_the_coarsest_mesh_gives_again_what_the_file_says_of_it():
    case = load()["cases"]["ball 5 mm, 0.5 mm deep"]
    family = replace(FAMILIES["ball 5"], depths=(0.5,))
    [found] = Meshed(family, SCALES[0]).cases(Ball(5.0), family.probes)
    assert found.force[2] == pytest.approx(case["forces"][0], rel=1e-4)
    assert len(found.stress) == len(family.probe_depths) * 42
    assert found.force[2] == pytest.approx(case["force"][2], rel=0.03)


def test_the_tangent_of_the_neo_hookean_law_is_the_slope_of_its_forces():
    mesh = box(*3 * [np.linspace(0.0, 1.0, 3)])
    rng = np.random.default_rng(8)
    law, moved = NeoHookean(mesh), rng.uniform(-0.06, 0.06, mesh.nodes.shape)
    way = rng.standard_normal(mesh.nodes.shape)
    step = 1e-6
    slope = (law.forces(moved + step * way) - law.forces(moved - step * way)) / (2.0 * step)
    exact = (law.tangent(moved) @ way.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(slope, exact, atol=1e-7 * np.abs(exact).max())


def test_a_bar_of_neo_hookean_tissue_stretches_by_its_law():
    """Stress and stretch of a bar with free sides in closed form: no stress across it."""
    mesh = box(np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1.0, 3), np.linspace(0.0, 4.0, 9))
    law = NeoHookean(mesh)
    stretch = 1.3
    sides = brentq(lambda s: law.shear * (s - 1 / s) + law.first * np.log(s * s * stretch) / s, 0.5, 1.2)
    moved = mesh.nodes * (np.array([sides, sides, stretch]) - 1.0)
    force = law.forces(moved)
    inner = (mesh.nodes[:, 2] > 0.0) & (mesh.nodes[:, 2] < 4.0)
    along = law.shear * (stretch - 1 / stretch) + law.first * np.log(sides**2 * stretch) / stretch
    assert np.abs(force[inner]).max() < 1e-12
    assert force[mesh.held, 2].sum() == pytest.approx(along, rel=1e-9)
    stress = law.stress(moved, np.array([[0.5, 0.5, 2.0]]))[0]
    assert stress[2] == pytest.approx(along / sides**2 / PA, rel=1e-6)
    assert np.abs(stress[[0, 1]]).max() < 1e-6 * stress[2]


def test_neo_hookean_tissue_is_pressed_like_linear_tissue_where_little_moves():
    mesh = box(np.linspace(0.0, 1.5, 7), np.linspace(-1.5, 1.5, 7), np.linspace(0.0, 2.0, 6), half=True)
    start = np.zeros(3)
    linear = Condensed(mesh, NeoHookean(mesh).tangent(np.zeros_like(mesh.nodes)), mesh.pad)
    for friction in (0.0, 0.3):
        depths = (0.002, 0.3)
        press = Press(linear.compliance, mesh.nodes[mesh.pad], Ball(4.0), friction, mesh.cut[mesh.pad])
        ours = press.depths(start, depths, 0.1)
        theirs = pressed(mesh, mesh.pad, Ball(4.0), friction, start, depths, 0.1)
        small, large = (b[0].force[:, 2].sum() / a.force[:, 2].sum() for a, b in zip(ours, theirs, strict=True))
        assert small == pytest.approx(1.0, abs=0.01) and large > 1.02
        assert all(state.residual < 1e-4 and left < 1e-7 for state, _, left in theirs)


def test_slides_in_the_file_follow_the_rule():
    slides = load()["slides"]
    assert slides
    for name, case in slides.items():
        slide = SLIDES[name.partition(",")[0]]
        assert case["way"] == [list(place) for place in slide.way], name
        assert np.shape(case["slid"]) == np.shape(case["pressed"]) == (len(slide.way), 3)
        assert case["slid"][0] == case["pressed"][0]
        ratio = np.linalg.norm(np.subtract(case["slid"], case["pressed"]), axis=1) / np.linalg.norm(
            case["pressed"], axis=1
        )
        np.testing.assert_allclose(case["apart"][-1], ratio[1:], rtol=0.06, atol=1e-4)  # of two digits
        assert all(mesh["contact"] < 1e-3 for mesh in case["meshes"]), name


def test_a_case_is_a_line_of_the_table():
    known = load()
    head, *lines = table(known).splitlines()
    assert head.startswith("case") and len(lines) == len(known["cases"])
    for line, (name, case) in zip(lines, known["cases"].items(), strict=True):
        assert line.startswith(name) and f"{case['force'][2]:.4f}" in line
        assert line.endswith("not judged by") != is_judged(case)


def test_units_of_the_stiffness():
    """A bar that is pulled: stress over strain is Young's modulus where the sides are free."""
    mesh = box(np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1.0, 3), np.linspace(0.0, 10.0, 21))
    force = np.zeros((9, 3))
    force[:, 2] = -0.001 * np.outer([0.25, 0.5, 0.25], [0.25, 0.5, 0.25]).ravel()
    moved, _ = Tissue(mesh, mesh.pad).deformed(force)
    middle = np.abs(mesh.nodes[:, 2] - 5.0) < 1.1
    slope = np.polyfit(mesh.nodes[middle, 2], moved[middle, 2], 1)[0]
    assert slope == pytest.approx(0.001 / (PA * MATERIAL.young), rel=0.01)
