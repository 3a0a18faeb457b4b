"""A model learned on linear tissue, on a finger that follows the law: what is said, and its errors by the law."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.thimble import mechanism
from core.matching.thimble_use import prepare
from core.presets import Library
from core.skin.model import fingertip_skin
from core.steps import drain
from core.surrogate.dataset import record
from core.surrogate.lessons import KINDS, by_law
from core.surrogate.store import BY_LAW, adapt, contact_of, errors_by_law, save
from core.surrogate.table import relative_rms

FEW = {"trajectories": 40, "hidden": 6, "iterations": 5}


def test_a_model_learned_on_linear_tissue_says_so_on_tissue_that_follows_the_law(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    skin, spec = fingertip_skin(level="draft"), Library().device("thimble_3rrs")
    law, device = skin.with_law(), mechanism(spec)
    made = drain(adapt(device, skin, 0.6, **FEW))
    save(tmp_path / "mine", made)
    use = {"thimble_method": "ridge", "thimble_surrogate": str(tmp_path / "mine.npz")}
    assert not prepare(spec, skin, use).findings
    (finding,) = prepare(spec, law, use, "finger 'i'").findings
    assert (finding.code, finding.severity, finding.where) == ("surrogate-linear", "info", "finger 'i'")
    assert "linear tissue" in finding.what and finding.value is None  # it was made for a finger of linear tissue
    assert "by_law" not in made.meta and errors_by_law(made.meta) == {}

    own = drain(adapt(device, law, 0.6, **FEW))
    same = {k: v for k, v in own.meta.items() if k != "by_law"}
    assert same == made.meta and own.meta["tissue"] == "linear", "it is the same model, judged by the law as well"
    errors = errors_by_law(own.meta)
    table = drain(by_law(device, law, 0.6, own.descriptors, BY_LAW, len(KINDS)))
    linear = drain(record(device, contact_of(device, skin, 0.6), BY_LAW, seed=len(KINDS), pressed=3))
    assert np.array_equal(table.x, linear.x)
    channels = own.descriptors.table(linear).channels
    assert 0.02 < np.linalg.norm(table.channels - channels) / np.linalg.norm(channels) < 0.3
    for name, fit in (("ridge", own.ridge), ("network", own.network)):
        assert own.meta["by_law"][name]["movements"] == BY_LAW and errors[name] == relative_rms(fit, table)
    save(tmp_path / "own", own)
    (finding,) = prepare(spec, law, {**use, "thimble_surrogate": str(tmp_path / "own.npz")}).findings
    assert finding.value == f"by the law {100 * errors['ridge']:.0f} % off"


@pytest.mark.parametrize("value", [3, {"ridge": 1.0}, {"ridge": {"error": "x"}, "network": {}}])
def test_damaged_errors_by_the_law_are_none(value: Any) -> None:
    assert errors_by_law({"by_law": value}) == {}
