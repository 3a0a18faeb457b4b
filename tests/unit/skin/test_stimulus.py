"""The stimulus: resultants against closed forms, and nothing computed before it is read."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.model import SkinModel, fingertip_skin
from core.skin.stimulus import Stimulus
from tests.problems import flat_press


def test_nothing_is_computed_before_it_is_read() -> None:
    skin = fingertip_skin(level="draft")
    stimulus = Stimulus(skin, np.zeros((skin.pad_count, 3)))
    assert not stimulus.touching
    summary = stimulus.summary()
    assert summary["normal_force"] == 0 and np.isnan(summary["centre_of_pressure"]).all()
    assert not {"displacement", "stress"} & set(vars(stimulus))
    assert not {"operator", "unit_response", "probes"} & set(vars(skin))
    assert stimulus.stress.shape == (len(skin.mesh.tetrahedra), 6) and not stimulus.stress.any()
    assert stimulus.stress is stimulus.stress


def test_one_force(skin: SkinModel) -> None:
    node = int(np.argmin(np.linalg.norm(skin.positions - [2e-3, 1e-3, 0], axis=1)))
    force = np.zeros((skin.pad_count, 3))
    force[node] = [0.01, -0.02, 0.5]
    stimulus = Stimulus(skin, force)
    assert stimulus.touching
    assert stimulus.resultant == pytest.approx([0.01, -0.02, 0.5])
    assert stimulus.centre_of_pressure == pytest.approx(skin.positions[node])
    assert stimulus.moment == pytest.approx(np.cross(skin.positions[node], force[node]))
    push = -force[node] @ skin.normals[node]
    assert stimulus.pressure[node] == pytest.approx(push / skin.areas[node])
    assert np.count_nonzero(stimulus.pressure) == 1
    assert stimulus.summary()["normal_force"] == pytest.approx(push)


def test_flat_press(skin: SkinModel) -> None:
    depth = 1.5e-3
    force = flat_press(skin.compliance, skin.positions[:, 2], depth)
    stimulus = Stimulus(skin, force)
    touched = force[:, 2] > 0
    height = skin.positions[:, 2] + stimulus.pad_displacement[:, 2]
    assert height[touched] == pytest.approx(np.full(touched.sum(), depth), abs=1e-14)
    assert stimulus.displacement[skin.mesh.pad] == pytest.approx(stimulus.pad_displacement, abs=0)
    # the load is symmetric, so is the answer: no sideways force, centre of pressure on the middle plane
    assert stimulus.resultant[:2] == pytest.approx([0, 0], abs=1e-15)
    assert stimulus.centre_of_pressure[0] == pytest.approx(0, abs=1e-9)
    assert stimulus.energy_density @ skin.mesh.volumes == pytest.approx(stimulus.energy, rel=1e-6)
    # tissue under the plate is compressed, and the probes know
    shallow = (skin.probes.depth == 1.6e-3) & (np.linalg.norm(skin.probes.points[:, :2], axis=1) < 2e-3)
    assert stimulus.probe_stress.shape == (len(skin.probes.points), 6)
    assert (stimulus.probe_stress[shallow, 2] < -1e4).all()
    nodal = stimulus.surface_values(stimulus.energy_density)
    assert nodal.shape == (len(skin.mesh.nodes),) and nodal.min() >= 0


def test_superposition(skin: SkinModel) -> None:
    first, second = np.random.default_rng(10).normal(size=(2, skin.pad_count, 3)) * 1e-3
    both = Stimulus(skin, first + 2 * second).stress
    parts = Stimulus(skin, first).stress + 2 * Stimulus(skin, second).stress
    assert both == pytest.approx(parts, abs=1e-5 * np.abs(both).max())
