"""Presses without a scene: against bakes in the same place, and the press test against a finger that is the model."""

from __future__ import annotations

from . import Result, benchmark


@benchmark("press_against_bake", limit=0.01)
def press_against_bake() -> Result:
    """Largest difference of force between a press and a bake by the same steps in the same place, of seven surfaces."""
    import numpy as np

    from core.experiment import fingertip, press
    from tests.presses import SURFACES, baked

    skin, worst, where = fingertip(level="draft"), {}, {}
    for name, surface in SURFACES.items():
        for at in ((0.0, 0.0), (0.7e-3, 1.1e-3)):
            for friction in (0.0, 0.3, 0.6):
                for depth in (0.5e-3, 1.5e-3):
                    touch = press(skin, surface, depth, friction=friction, at=at)
                    assert touch.place is not None
                    force = baked(surface, touch.place, depth, friction)[-1].sum(axis=0)
                    off = float(np.linalg.norm(touch.force.sum(axis=0) - force) / np.linalg.norm(force))
                    if off > worst.get(name, -1.0):
                        worst[name], where[name] = off, f"friction {friction:g}, {1e3 * depth:g} mm, at {at}"
    most = max(worst, key=worst.__getitem__)
    return Result("press_against_bake", worst[most], "", None, worst, f"worst: {most}, {where[most]}")


@benchmark("alpha_identity_error", limit=0.002)
def alpha_identity_error() -> Result:
    """How far from 1 the factor of a finger is that is the model itself, pressed as its touches are solved."""
    import numpy as np

    from core.contact.single_touch import STEP
    from core.experiment import fingertip
    from core.matching.press_test import DEPTHS, press_loads, stiffness_factor
    from core.parameters.material import FRICTION
    from core.surface.gap import Surface
    from tests.presses import baked

    off, deepest = {}, max(DEPTHS)
    for level in ("draft", "standard"):
        for contact in ("points", "nodes"):
            plate, place = Surface.block(0.1, 0.1), np.array([0.0, 0.0, deepest])
            felt = baked(plate, place, deepest, FRICTION, contact, level)
            read = [float(felt[round(depth / STEP)][:, 2].sum()) for depth in DEPTHS]
            model = press_loads(fingertip(level=level), contact=contact)
            off[f"{level}, {contact}"] = abs(stiffness_factor(DEPTHS, read, model).alpha - 1.0)
    return Result("alpha_identity_error", max(off.values()), "", None, off)
