"""A surrogate of a platform on six legs: written, read, run by onnxruntime, and differentiated in all six freedoms."""

from __future__ import annotations

import numpy as np
import pytest

from core.devices import hexapod
from core.devices.disc_device import scale_of, seated
from core.devices.disc_pose import FrictionState
from core.devices.first_contact import first_contact
from core.devices.six_legs import SixLegs
from core.errors import DermisError
from core.matching.thimble import match_touch
from core.matching.thimble_use import prepare
from core.presets import Library
from core.skin.model import fingertip_skin
from core.steps import drain
from core.surrogate.forward import DirectModel
from core.surrogate.store import adapt, contact_of, load, save
from tests import touches

pytestmark = pytest.mark.one_line("3.13", "numbers alone; the folder's models are tested on both lines")


@pytest.fixture(scope="module")
def spec():
    return Library().device("hexapod")


@pytest.fixture(scope="module")
def device(spec):
    return SixLegs.of(hexapod.mechanism(spec), spec)


@pytest.fixture(scope="module")
def skin():
    return fingertip_skin(level="draft")


@pytest.fixture(scope="module")
def files(device, skin, tmp_path_factory):
    path = tmp_path_factory.mktemp("six") / "legs.npz"
    save(path, drain(adapt(device, skin, 0.4, trajectories=120, iterations=20)))
    return path


@pytest.mark.parametrize("kind", ["network", "ridge"])
def test_both_models_answer_and_differentiate_in_six_freedoms(files, device, skin, kind):
    contact = contact_of(device, skin, 0.4)
    made = load(files, skin, device, 0.4)
    assert made.meta["freedoms"] == 6
    model = made.model(device, skin, contact, kind)
    direct = DirectModel(device, contact, made.descriptors.observation_matrix)
    x = seated(device, 0.05, -0.05, first_contact(device, contact, 0.05, -0.05) - 0.9e-3)
    direct.hold(FrictionState.rest(contact.count))
    state = contact.settle(direct.solution(x))
    x = x + np.array([0.01, 0.0, -0.05e-3, 0.1e-3, 0.05e-3, 0.01])
    for each in (model, direct):
        each.hold(state)
    value, slope = model.evaluate(x)
    wanted, _ = direct.evaluate(x)
    assert slope.shape == (model.size, 6)
    assert np.linalg.norm(value - wanted) < 0.35 * np.linalg.norm(wanted)  # of so few movements
    for j, step in enumerate(1e-6 * scale_of(device)):
        way = step * np.eye(6)[j]
        differ = (model.evaluate(x + way)[0] - model.evaluate(x - way)[0]) / (2 * step)
        assert np.linalg.norm(slope[:, j] - differ) < 1e-3 * np.linalg.norm(slope)


def test_learned_methods_follow_a_touch(files, spec, skin):
    forces = touches.slide(24).forces(skin, points=True)
    use = prepare(spec, skin, {"platform_method": "ridge", "thimble_surrogate": str(files)})
    assert use.method == "ridge" and not use.findings
    found = match_touch(use, forces)
    assert found.pressing.sum() > 10 and found.x.shape == (24, 6)
    assert np.median(found.mismatch[found.touched]) < 0.6


def test_a_thimble_refuses_what_six_legs_learned(files, skin):
    spec = Library().device("thimble_3rrs")
    use = prepare(spec, skin, {"thimble_method": "ridge", "thimble_surrogate": str(files)})
    assert use.method == "stress" and use.findings[0].code == "surrogate"
    with pytest.raises(DermisError, match="made for another device"):
        load(files, skin, use.device, 0.4)
