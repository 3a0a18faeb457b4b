"""Models for tissue that follows the neo-Hookean law: learned by the law, better by it than those of linear tissue."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from core.devices.thimble import Thimble, mechanism
from core.errors import DermisError
from core.matching.adapt import shares_of
from core.matching.thimble_use import prepare
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin
from core.skin.observation import Observer
from core.steps import drain
from core.surrogate.dataset import record
from core.surrogate.store import adapt, contact_of, errors_by_law, load, place_of, save, tissue_of
from core.surrogate.surrogate import Surrogate
from core.surrogate.table import SampleTable, relative_rms

FRICTION = 0.6
FEW = {"trajectories": 60, "hidden": 20, "iterations": 20}
OLD = {"ridge": {"error": 0.071}, "network": {"error": 0.08}}  # as earlier versions judged models of linear tissue

pytestmark = pytest.mark.one_line("3.13", "numbers alone; adapting is tested on both lines")


class Made(NamedTuple):
    """Models for linear tissue and for the law, and what the training of the latter told."""

    linear: Surrogate
    law: Surrogate
    told: list[tuple[str, int, int]]


@pytest.fixture(scope="module")
def device() -> Thimble:
    return mechanism(Library().device("thimble_3rrs"))


@pytest.fixture(scope="module")
def law() -> SkinModel:
    return fingertip_skin(level="draft").with_law()


@pytest.fixture(scope="module")
def made(device: Thimble, law: SkinModel) -> Made:
    told: list[tuple[str, int, int]] = []
    linear = drain(adapt(device, law.linear, FRICTION, **FEW))
    steps = adapt(device, law, FRICTION, report=lambda *step: told.append(step), **FEW)
    return Made(linear, drain(steps, told.append), told)


def test_a_model_learned_by_the_law_is_nearer_to_it_on_movements_that_it_has_not_seen(
    device: Thimble, law: SkinModel, made: Made
) -> None:
    pair = made.linear, made.law
    matrices = [each.descriptors.observation_matrix for each in pair]
    contact, observer = contact_of(device, law, FRICTION), Observer(law, np.concatenate(matrices))
    data = drain(record(device, contact, 12, seed=99, pressed=3, observer=observer))
    assert data.stress is not None and data.unsettled == 0
    channels = np.split(data.stress, [len(matrices[0])], axis=1)
    tables: list[SampleTable] = [
        each.descriptors.table(replace(data, stress=own)) for each, own in zip(pair, channels, strict=True)
    ]
    for name in ("ridge", "network"):
        linear, own = (relative_rms(getattr(m, name), t) for m, t in zip(pair, tables, strict=True))
        assert own < linear, name
    of_forces = made.law.descriptors.table(replace(data, stress=None)).channels
    off = np.linalg.norm(tables[1].channels - of_forces) / np.linalg.norm(of_forces)
    assert 0.02 < off < 0.3, "the stress is that by the law, not that of the same forces on linear tissue"


def test_progress_of_training_by_the_law_rises_to_its_end(made: Made) -> None:
    shares, total = shares_of("neo_hookean"), 0
    assert [name for name in shares if any(stage == name for stage, _, _ in made.told)] == list(shares)
    for stage, done, most in made.told:
        low, high = shares[stage]
        assert total <= (total := low + (high - low) * done // most)
    assert total == 1000


def test_each_tissue_finds_its_own_model_and_says_if_there_is_only_that_of_linear_tissue(
    tmp_path: Path, device: Thimble, law: SkinModel, made: Made
) -> None:
    pytest.importorskip("onnxruntime")
    spec, linear = Library().device("thimble_3rrs"), law.linear
    use = {"thimble_method": "ridge", "thimble_surrogate": str(tmp_path)}
    assert (made.linear.meta["tissue"], made.law.meta["tissue"]) == ("linear", "neo_hookean")
    save(place_of(tmp_path, law, device, FRICTION), made.law)
    used = prepare(spec, law, use)
    assert used.method == "ridge" and not used.findings
    assert "no surrogate was adapted" in prepare(spec, linear, use).findings[0].what
    save(place_of(tmp_path, linear, device, FRICTION), made.linear)
    for skin, model in ((law, made.law), (linear, made.linear)):
        used = prepare(spec, skin, use)
        assert used.method == "ridge" and not used.findings
        assert np.array_equal(used.observation_matrix, model.descriptors.observation_matrix)
    for path in tmp_path.glob(f"{place_of(tmp_path, law, device, FRICTION).stem}.*"):
        path.unlink()
    used = prepare(spec, law, use, "finger 'i'")
    (finding,) = used.findings
    assert used.method == "ridge" and (finding.code, finding.severity) == ("surrogate-linear", "info")
    assert finding.where == "finger 'i'" and finding.value is None and "Adapt it again" in finding.remedy


def test_files_of_earlier_versions_are_read_as_models_of_linear_tissue(
    tmp_path: Path, device: Thimble, law: SkinModel, made: Made
) -> None:
    pytest.importorskip("onnxruntime")
    spec = Library().device("thimble_3rrs")
    use = {"thimble_method": "ridge", "thimble_surrogate": str(tmp_path / "old.npz")}
    plain = {k: v for k, v in made.linear.meta.items() if k not in ("tissue", "unsettled")}
    for more, value in (({}, None), ({"tissue": "linear", "by_law": OLD}, "by the law 7 % off")):
        save(tmp_path / "old", replace(made.linear, meta={**plain, **more}))
        assert tissue_of(load(tmp_path / "old", law, device, FRICTION).meta) == "linear"
        assert not prepare(spec, law.linear, use).findings
        (finding,) = prepare(spec, law, use).findings
        assert finding.code == "surrogate-linear" and finding.value == value


def test_a_model_learned_by_the_law_is_refused_for_linear_tissue(
    tmp_path: Path, device: Thimble, law: SkinModel, made: Made
) -> None:
    pytest.importorskip("onnxruntime")
    save(tmp_path / "mine", made.law)
    with pytest.raises(DermisError, match="made for another tissue.*neo_hookean.*linear"):
        load(tmp_path / "mine", law.linear, device, FRICTION)
    graph = (tmp_path / "mine.onnx").read_bytes()
    save(tmp_path / "mine", replace(made.law, meta={**made.law.meta, "tissue": "linear"}))
    (tmp_path / "mine.onnx").write_bytes(graph)
    with pytest.raises(DermisError, match="another tissue"):
        load(tmp_path / "mine", law, device, FRICTION)


@pytest.mark.parametrize("value", [3, {"ridge": 1.0}, {"ridge": {"error": "x"}, "network": {}}])
def test_damaged_errors_by_the_law_are_none(value: Any) -> None:
    assert errors_by_law({"by_law": value}) == {}
    assert errors_by_law({"by_law": OLD}) == {"ridge": 0.071, "network": 0.08}
