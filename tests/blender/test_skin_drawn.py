"""What is drawn of a skin: the refined surface, the values on it, and the words of the legend."""

from __future__ import annotations

import numpy as np
import pytest

from blender_addon.preview.skin_state import SkinState
from blender_addon.viewport import skin_colours, skin_field
from blender_addon.viewport.display_surface import Nodal
from core.parameters.error_bands import error_band
from core.parameters.skin import FORCE_ERRORS
from core.skin.model import fingertip_skin
from core.skin.shape import FingertipShape
from core.skin.stimulus import Stimulus
from tests.problems import flat_press

pytestmark = pytest.mark.shared_tests("values of the engine's skin")

DEPTH = 1e-3


@pytest.fixture(scope="module")
def pressed() -> SkinState:
    """Return a draft skin pressed flat by a millimetre."""
    model = fingertip_skin(level="draft")
    force = flat_press(model.compliance, model.positions[:, 2], DEPTH)
    return SkinState("Finger", model, force, float(force[:, 2].sum()), depth=DEPTH, source="live")


def test_the_refined_surface_lies_on_the_fingertip(pressed: SkinState) -> None:
    surface = skin_field.kit(pressed.model.mesh).surface
    shape = FingertipShape()
    pad = surface.rest[(surface.rest[:, 2] < 4e-3) & (np.abs(surface.rest[:, 1]) < 6e-3)]
    axial = pad[:, 1] / shape.tip
    section = np.sqrt(1.0 - np.maximum(axial, 0.0) ** 2)
    q2 = np.minimum(axial, 0.0) ** 2
    half, depth = (
        size * section * (1.0 - 0.5 * q2 / (1.0 + q2 / (2.0 * drop)))
        for size, drop in ((0.5 * shape.width, 0.05), (shape.height_palm, 0.12))
    )
    off = (np.hypot(pad[:, 0] / half, (shape.height_palm - pad[:, 2]) / depth) - 1.0) * shape.height_palm
    assert np.abs(off).max() < 0.25e-3 and np.median(np.abs(off)) < 0.06e-3
    assert len(surface.triangles) == 16 * len(surface.coarse)
    outward = surface.at_rest[surface.rest[:, 2].argmin()]
    assert outward[2] < -0.99


def test_refining_keeps_the_nodes_and_constants(pressed: SkinState) -> None:
    own = skin_field.kit(pressed.model.mesh)
    surface, count = own.surface, len(own.surface.points)
    assert np.array_equal(surface.rest[:count], surface.points)
    assert surface.refine @ np.full(count, 3.0) == pytest.approx(np.full(len(surface.rest), 3.0), rel=1e-12)
    # a rigid turn of the nodes is a rigid turn of what is drawn, up to the curvature between them
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    turned = Nodal(surface.points @ (turn.T - np.eye(3)), np.zeros(count))
    fine = surface.deformed(pressed.model, pressed.force, pressed.normal_force, turned, 1.0, 0.0)
    assert fine.positions == pytest.approx(surface.rest @ turn.T, abs=1e-12)
    assert fine.normals == pytest.approx(surface.at_rest @ turn.T, abs=1e-9)


def test_pressure_adds_up_to_the_force(pressed: SkinState) -> None:
    drawn = skin_field.draw_of(pressed, "pressure")
    model = pressed.model
    own = skin_field.kit(model.mesh)
    nodal = drawn.values[: len(own.surface.points)][own.pad_rows]
    push = -(pressed.force * model.normals).sum(axis=1)
    assert nodal @ model.areas == pytest.approx(push.sum(), rel=1e-9)
    assert drawn.high == pytest.approx((push / model.areas).max(), rel=1e-12)
    assert (drawn.values >= min(0.0, drawn.low)).all() and (drawn.values <= drawn.high).all()


def test_the_drawn_pad_is_flat_where_it_is_pressed_flat(pressed: SkinState) -> None:
    drawn = skin_field.draw_of(pressed, "displacement")
    own = skin_field.kit(pressed.model.mesh)
    touching = own.pad_rows[pressed.force[:, 2] > 0.0]
    assert drawn.positions[touching, 2] == pytest.approx(np.full(len(touching), DEPTH), abs=1e-8)
    lowest = pressed.model.positions[:, 2].min()
    assert drawn.high >= (DEPTH - lowest) * (1.0 - 1e-6)  # the lowest node moves by the whole depth
    twice = skin_field.draw_of(pressed, "displacement", 2.0)
    rest = own.surface.rest
    assert twice.positions - rest == pytest.approx(2.0 * (drawn.positions - rest), abs=1e-12)


@pytest.mark.parametrize("component", skin_field.COMPONENTS)
def test_components_are_the_engines(pressed: SkinState, component: str) -> None:
    stimulus = Stimulus(pressed.model, pressed.force)
    own = skin_field.kit(pressed.model.mesh)
    smooth = stimulus.surface_values(stimulus.stress)[own.surface.nodes, skin_field.COMPONENTS.index(component)]
    drawn = skin_field.draw_of(pressed, component)
    # the draft's table is in single precision
    assert drawn.values[: len(smooth)] == pytest.approx(smooth, abs=2e-6 * np.abs(smooth).max())


def test_von_mises_is_that_of_the_averaged_stress_in_every_accuracy(pressed: SkinState) -> None:
    for level in ("draft", "standard"):
        model = fingertip_skin(level=level)
        force = flat_press(model.compliance, model.positions[:, 2], DEPTH)
        stimulus = Stimulus(model, force)
        xx, yy, zz, yz, xz, xy = stimulus.surface_values(stimulus.stress)[skin_field.kit(model.mesh).surface.nodes].T
        exact = np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (yz**2 + xz**2 + xy**2))
        drawn = skin_field.draw_of(SkinState("Finger", model, force, 1.0), "von_mises")
        assert drawn.values[: len(exact)] == pytest.approx(exact, abs=1e-5 * exact.max()), level


def test_a_stiffer_skin_under_the_same_forces_moves_less_and_is_stressed_alike(pressed: SkinState) -> None:
    hard = pressed.model.with_material(young=2e5)
    stiff = SkinState("Finger", hard, pressed.force, 1.0)
    for quantity, factor in (("displacement", 0.5), ("zz", 1.0)):
        soft, other = (skin_field.draw_of(s, quantity).values for s in (pressed, stiff))
        assert other == pytest.approx(factor * soft, abs=1e-6 * np.abs(soft).max())


def test_a_skin_without_contact_is_drawn_at_rest() -> None:
    model = fingertip_skin(level="draft")
    still = SkinState("Finger", model, np.zeros((model.pad_count, 3)))
    drawn = skin_field.draw_of(still, "von_mises")
    assert np.array_equal(drawn.positions, drawn.surface.rest) and not drawn.values.any()


def test_the_models_error_is_stated_as_measured() -> None:
    force = np.full((1, 3), 0.1)

    def said(depth: float, *, points: object = None, work: str = "solved") -> str:
        return skin_field.error_text([SkinState("Finger", None, force, 1.0, depth=depth, work=work, points=points)])

    shallow, deep = (f"{100 * error_band('linear', depth).stress.median:.0f} %" for depth in (1e-3, 2e-3))
    for text in (said(0.0), skin_field.error_text([])):
        assert f"{shallow} off at 1 mm" in text and f"{deep} at 2 mm" in text and "simulated" in text
    assert f"about {shallow} off" in said(1e-3) and "1.00 mm" in said(1e-3)
    assert "deeper than it is trusted" in said(2.1e-3) and "deeper" not in said(2.0e-3)
    on_nodes, on_points = (f"contact on {where}: {FORCE_ERRORS[where]} off" for where in ("nodes", "points"))
    assert on_nodes in said(1e-3) and on_points in said(1e-3, points=object())
    assert on_points in said(1e-3, work="rendered")  # by pins: no contact of skin was solved


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.9, 1.0), (1.0, 1.0), (1.01, 1.5), (37.0, 40.0), (6.1e-4, 8e-4), (0.0, 1.0), (float("nan"), 1.0), (9.9e7, 1e8)],
)
def test_ranges_end_at_round_numbers(value: float, expected: float) -> None:
    assert skin_field.nice(value) == pytest.approx(expected, rel=1e-12)


def test_colour_maps_run_from_dark_to_bright_and_signs_are_balanced() -> None:
    for name in ("inferno", "viridis", "grey"):
        light = skin_colours.table(name) @ [0.2126, 0.7152, 0.0722]
        assert (np.diff(light) > -1e-6).all() and light[-1] - light[0] > 0.5, name
    signed = skin_colours.table("signed") @ [0.2126, 0.7152, 0.0722]
    assert signed.argmax() in (127, 128) and abs(signed[0] - signed[-1]) < 0.2
