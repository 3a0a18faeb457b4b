"""Learned models: exact where the truth is of their kind, derivatives by differences, ONNX by onnxruntime."""

from __future__ import annotations

import json

import numpy as np
import pytest

from core.errors import DermisError
from core.files import write_npz
from core.surrogate import onnx
from core.surrogate.network import Network, sigmoid, softplus, train
from core.surrogate.ridge import PartOfRidge, QuadraticRidge, fit_ridge
from core.surrogate.table import SampleTable, read_table, relative_rms
from tests.tables import write_table


def table_of(function, count=400, inputs=7, seed=0):
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, (count, inputs)) * np.geomspace(1, 1e-3, inputs) + 0.3
    y = np.array([function(row) for row in u])
    return SampleTable(u[:, :3], u[:, 3:], y, np.arange(count) // 10)


def random_network(inputs=7, hidden=11, outputs=4, seed=5):
    rng = np.random.default_rng(seed)
    return Network(
        rng.normal(size=inputs),
        rng.uniform(0.5, 2, inputs),
        rng.normal(size=(hidden, inputs)),
        rng.normal(size=hidden),
        rng.normal(size=(outputs, hidden)),
        rng.normal(size=outputs),
    )


def check_derivative(fit, u, ways=None):
    ways = np.eye(len(u)) if ways is None else ways
    value, slope = fit.along(u, ways)
    np.testing.assert_allclose(value, fit.predict(u[None])[0], rtol=1e-12)
    for j, way in enumerate(ways.T):
        h = 1e-6
        ahead, behind = (fit.predict((u + s * h * way)[None])[0] for s in (1, -1))
        np.testing.assert_allclose(slope[:, j], (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-7)


def test_ridge_recovers_a_quadratic_exactly():
    rng = np.random.default_rng(2)
    c, b, q = rng.normal(size=3), rng.normal(size=(3, 7)), rng.normal(size=(3, 7, 7))
    table = table_of(lambda u: c + b @ u + np.einsum("kij,i,j->k", q, u, u))
    fit = fit_ridge(table, penalty=1e-12)
    assert relative_rms(fit, table) < 1e-6
    unseen = table_of(lambda u: c + b @ u + np.einsum("kij,i,j->k", q, u, u), seed=9)
    assert relative_rms(fit, unseen) < 1e-6
    check_derivative(fit, unseen.inputs[0])


def test_a_polynomial_of_its_first_inputs_is_the_polynomial_where_the_others_are_given():
    rng = np.random.default_rng(3)
    bent = rng.normal(size=(4, 7, 7))
    whole = QuadraticRidge(
        rng.normal(size=7),
        rng.uniform(0.5, 2, 7),
        rng.normal(size=4),
        rng.normal(size=(4, 7)),
        bent + bent.transpose(0, 2, 1),
    )
    part = PartOfRidge(whole, 3)
    for row in rng.normal(size=(5, 7)):
        ways = np.concatenate([rng.normal(size=(4, 2)), np.zeros((3, 2))])
        part.give(row[4:])
        for ours, theirs in zip(part.along(row[:4], ways[:4]), whole.along(row, ways), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)
        check_derivative(whole, row, ways)


def test_softplus_and_its_derivative_hold_at_both_ends():
    mpmath = pytest.importorskip("mpmath")
    z = np.array([-800.0, -40.0, -1.0, 0.0, 1.0, 40.0, 800.0])
    np.testing.assert_allclose(softplus(z), [float(mpmath.log1p(mpmath.exp(v))) for v in z], rtol=1e-14)
    np.testing.assert_allclose(sigmoid(z), [float(1 / (1 + mpmath.exp(-v))) for v in z], rtol=1e-14)


def test_the_networks_derivative_is_that_of_its_values():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        check_derivative(random_network(seed=seed), rng.normal(size=7))
        check_derivative(random_network(seed=seed), rng.normal(size=7), rng.normal(size=(7, 3)))


def test_training_learns_a_smooth_function_that_no_quadratic_can():
    def bent(u):
        return np.array([np.tanh(3 * (u[0] + u[1])), np.exp(-4 * u[2] ** 2) + u[0]])

    rng = np.random.default_rng(0)
    tables = []
    for count in (1500, 300):
        u = rng.uniform(-1, 1, (count, 4))
        tables.append(SampleTable(u[:, :3], u[:, 3:], np.array([bent(row) for row in u]), np.arange(count)))
    table, unseen = tables
    network = train(table, hidden=40, iterations=100)
    assert relative_rms(network, unseen) < 0.01
    assert relative_rms(fit_ridge(table), unseen) > 0.15
    assert network.hidden == 40 and network.inputs == 4 and network.outputs == 2


def test_the_same_table_and_seed_give_the_same_network():
    table = table_of(lambda u: u[:2] ** 2)
    one, two, other = (train(table, hidden=8, iterations=20, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.weights, two.weights)
    assert np.abs(one.weights - other.weights).max() > 1e-3


def test_onnx_gives_what_numpy_gives(tmp_path):
    pytest.importorskip("onnxruntime")
    network = random_network()
    onnx.write(tmp_path / "n.onnx", network, {"skin": "abc"})
    fit = onnx.OnnxFit(tmp_path / "n.onnx", {"skin": "abc"})
    u = np.random.default_rng(1).normal(size=(50, 7)) * 10
    np.testing.assert_allclose(fit.predict(u), network.predict(u), rtol=1e-6, atol=1e-6)
    ways = np.random.default_rng(2).normal(size=(5, 7, 3))
    for row, way in zip(u[:5], ways, strict=True):
        for ours, theirs in zip(network.along(row, way), fit.along(row, way), strict=True):
            np.testing.assert_allclose(theirs, ours, rtol=1e-6, atol=1e-6)
    assert (fit.inputs, fit.outputs) == (7, 4)


def test_the_same_network_gives_the_same_bytes():
    assert onnx.dumps(random_network(), {"b": 1, "a": 2}) == onnx.dumps(random_network(), {"a": 2, "b": 1})


def test_a_file_cut_anywhere_is_refused_in_words(tmp_path):
    pytest.importorskip("onnxruntime")
    data = onnx.dumps(random_network(hidden=3, outputs=2))
    path = tmp_path / "n.onnx"
    for size in [*range(0, len(data), 37), len(data) - 1]:
        path.write_bytes(data[:size])
        with pytest.raises(DermisError):
            onnx.OnnxFit(path)


def rewritten(data, **changes):
    """Return the model with other metadata."""
    at = data.rindex(b'{"')
    meta = {**json.loads(data[at:]), **changes}
    head = data[: data.rindex(b"r", 0, at - 9)]  # the tag of field 14
    pair = onnx._field(1, onnx.META.encode()) + onnx._field(2, json.dumps(meta, sort_keys=True).encode())
    return head + onnx._field(14, pair)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: b"MZ not a model at all", "the ONNX file is incomplete or damaged|did not make"),
        (lambda d: d.replace(b"dermis-surrogate 2", b"someone-elses-one2"), "did not make"),
        (lambda d: d.replace(b"jacobian", b"gradient"), "'jacobian' has the wrong"),
        (lambda d: d.replace(b"features", b"measures"), "'features' has the wrong"),
        (lambda d: d.replace(b"dermis-surrogate 2", b"dermis-surrogate 1"), "an older format.*Adapt it again"),
        (
            lambda d: d.replace(
                onnx._field(8, onnx._field(1, b"") + onnx._varint(2, 17)),
                onnx._field(8, onnx._field(1, b"") + onnx._varint(2, 99)),
            ),
            "operator set",
        ),
        (lambda d: rewritten(d, inputs=9), "has the wrong type or shape"),
        (lambda d: rewritten(d, outputs=-1), "impossible sizes"),
        (lambda d: rewritten(d, skin="another"), "trained for another skin"),
        (lambda d: d.replace(b"MatMul", b"MutMal"), "cannot run"),
    ],
)
def test_foreign_files_are_refused_in_words(tmp_path, change, words):
    pytest.importorskip("onnxruntime")
    data = onnx.dumps(random_network(), {"skin": "mine"})
    changed = change(data)
    assert changed != data
    (tmp_path / "n.onnx").write_bytes(changed)
    with pytest.raises(DermisError, match=words):
        onnx.OnnxFit(tmp_path / "n.onnx", {"skin": "mine"})


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(DermisError, match="cannot be read"):
        onnx.OnnxFit(tmp_path / "none.onnx")


def test_any_table_of_configurations_and_channels_can_be_fitted(tmp_path):
    """Nineteen channels of a recorded sensor, no skin model anywhere."""
    table = table_of(lambda u: np.outer(np.arange(1, 20), u[:3]).sum(axis=1) + u[0] * u[1], inputs=3)
    write_table(tmp_path / "t.npz", table)
    read = read_table(tmp_path / "t.npz")
    np.testing.assert_array_equal(read.channels, table.channels)
    assert relative_rms(fit_ridge(read, 1e-10), read) < 1e-4
    rows = "\n".join(",".join(f"{v:.17g}" for v in [*x, *c]) for x, c in zip(table.x, table.channels, strict=True))
    (tmp_path / "t.csv").write_text("pitch,roll,distance" + ",e" * 19 + "\n" + rows)
    text = read_table(tmp_path / "t.csv")
    np.testing.assert_allclose(text.channels, table.channels, rtol=1e-15)
    assert text.memory.shape == (len(table.x), 0)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"x": np.zeros((4, 3))}, "'channels' is missing"),
        ({"x": np.zeros((4, 2)), "channels": np.zeros((4, 5))}, "needs x"),
        ({"x": np.zeros((4, 3)), "channels": np.full((4, 5), np.inf)}, "not finite.*|row 0"),
    ],
)
def test_bad_tables_are_refused(tmp_path, arrays, words):
    write_npz(tmp_path / "t.npz", arrays)
    with pytest.raises(DermisError, match=words):
        read_table(tmp_path / "t.npz")
    (tmp_path / "t.npz").write_bytes(b"nothing")
    with pytest.raises(DermisError, match="cannot be read"):
        read_table(tmp_path / "t.npz")
