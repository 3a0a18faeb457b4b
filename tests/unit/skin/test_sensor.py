"""The virtual electrodes, against symmetry, proportionality and their own definition worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from core.errors import DermisError
from core.files import write_npz
from core.skin.sensor import LAYOUT, electrode_sensor, noise_floor_of, noise_of, read_stimuli


def read(sensor, force):
    """Return the readings of contact forces, (..., m, 3) to (..., c)."""
    return force.reshape(*force.shape[:-2], -1) @ sensor.matrix.T


def test_nineteen_symmetric_electrodes_over_the_pad(skin):
    sensor = electrode_sensor(skin)
    assert sensor.matrix.shape == (19, 3 * skin.pad_count) == (len(LAYOUT), 3 * skin.pad_count)
    np.testing.assert_allclose(sensor.weights.sum(axis=1), 1.0)
    mirrored = sensor.places * [-1, 1, 1]
    for place in mirrored:
        assert np.linalg.norm(sensor.places - place, axis=1).min() < 1e-9
    assert (sensor.thickness > 0.5e-3).all() and (sensor.thickness < 8e-3).all()


def test_a_mirrored_press_reads_mirrored(skin):
    sensor, positions = electrode_sensor(skin), skin.positions
    other = ((positions[:, None] - positions[None] * [-1, 1, 1]) ** 2).sum(axis=2).argmin(axis=0)
    twin = ((sensor.places[:, None] - sensor.places[None] * [-1, 1, 1]) ** 2).sum(axis=2).argmin(axis=0)
    force = np.zeros((skin.pad_count, 3))
    force[np.argmin(np.linalg.norm(positions - [3e-3, 2e-3, 1e-3], axis=1))] = [0.1, 0.05, 0.4]
    reflected = np.zeros_like(force)
    reflected[other] = force * [-1, 1, 1]
    np.testing.assert_allclose(read(sensor, reflected), read(sensor, force)[twin], rtol=1e-6, atol=1e-9)


def test_a_reading_is_the_share_by_which_tissue_gets_thinner(skin):
    sensor, rng = electrode_sensor(skin), np.random.default_rng(0)
    force = rng.normal(size=(skin.pad_count, 3)) * 0.01
    moved = skin.pad_displacement(force)
    for i in (0, 7, 18):
        inward = sum(w * -(u @ n) for w, u, n in zip(sensor.weights[i], moved, skin.normals, strict=True))
        assert read(sensor, force)[i] == pytest.approx(inward / sensor.thickness[i], rel=1e-9)
    both = np.stack([force, 2 * force])
    np.testing.assert_allclose(read(sensor, both), [read(sensor, force), 2 * read(sensor, force)])


def test_pressing_reads_positive_and_most_where_it_presses(skin):
    sensor = electrode_sensor(skin)
    for i in (3, 7, 13):
        force = np.zeros((skin.pad_count, 3))
        node = np.argmin(np.linalg.norm(skin.positions - sensor.places[i], axis=1))
        force[node] = -0.3 * skin.normals[node]
        depth = read(sensor, force) * sensor.thickness
        assert depth[i] > 0 and depth.argmax() == i


def test_recorded_stimuli_are_read_from_both_files(tmp_path):
    times, stimuli = np.array([0.0, 0.01, 0.02]), np.arange(57, dtype=float).reshape(3, 19)
    write_npz(tmp_path / "a.npz", {"times": times, "stimuli": stimuli})
    names = ",".join(["time", *(f"e{i}" for i in range(19))])
    rows = "\n".join(",".join(map(str, [t, *s])) for t, s in zip(times, stimuli.tolist(), strict=True))
    (tmp_path / "a.csv").write_text(f"{names}\n{rows}\n")
    for name in ("a.npz", "a.csv"):
        found = read_stimuli(tmp_path / name, 19)
        np.testing.assert_array_equal(found[0], times)
        np.testing.assert_array_equal(found[1], stimuli)


@pytest.mark.parametrize(
    ("times", "stimuli", "words"),
    [
        ([0, 1], np.zeros((2, 18)), r"the expected shape.*\(n, 19\)"),
        ([0, 0], np.zeros((2, 19)), "do not rise"),
        ([0, 1], np.full((2, 19), np.nan), "not finite"),
        ([], np.zeros((0, 19)), "the expected shape"),
    ],
)
def test_bad_recordings_are_refused(tmp_path, times, stimuli, words):
    write_npz(tmp_path / "a.npz", {"times": np.array(times, float), "stimuli": stimuli})
    with pytest.raises(DermisError, match=words):
        read_stimuli(tmp_path / "a.npz", 19)


def test_files_that_are_none_are_refused(tmp_path):
    (tmp_path / "b.npz").write_bytes(b"PK\x03\x04 nothing")
    for path in (tmp_path / "b.npz", tmp_path / "missing.npz", tmp_path / "missing.csv"):
        with pytest.raises(DermisError, match="cannot be read"):
            read_stimuli(path, 19)


def test_electrodes_need_places_and_a_size(skin):
    with pytest.raises(DermisError, match="electrodes need"):
        electrode_sensor(skin, spread=0.0)
    with pytest.raises(DermisError, match="electrodes need"):
        electrode_sensor(skin, np.zeros((3, 3)))


def test_noise_is_measured_beside_a_touch():
    """A known noise, on a press that is a hundred times as strong."""
    rng, times = np.random.default_rng(0), np.arange(400) / 100.0
    press = np.outer(np.maximum(np.sin(2.0 * times), 0.0), rng.uniform(0.2, 1.0, 19))
    for sigma in (0.01, 5.0):
        noisy = 100 * sigma * press + rng.normal(0.0, sigma, press.shape)
        assert noise_of(noisy) == pytest.approx(sigma, rel=0.05)
    assert noise_of(press) < 1e-3 and noise_of(noisy[:10]) == 0.0


@pytest.mark.parametrize("channels", [1, 3, 19])
def test_untouched_readings_stay_below_the_noise_floor(channels):
    """The quantile of the chi distribution at four deviations, within the error of its approximation."""
    stats = pytest.importorskip("scipy.stats")
    assert noise_floor_of(2.0, channels) == pytest.approx(2.0 * stats.chi.ppf(stats.norm.cdf(4.0), channels), rel=0.05)
    assert noise_floor_of(0.0, channels) == 0.0


@pytest.mark.parametrize(
    "text",
    [
        "t_ms,a,b\n0,1.5,2\n250,2,3\n",
        "time [ms];a;b\n0;1,5;2\n250;2;3\n",
        "a,timestamp,b\n1.5,10,2\n2,10.25,3\n",
        "0\t1,5\t2\n0,25\t2\t3\n",
    ],
)
def test_names_and_separators_are_those_of_all_recordings(tmp_path, text):
    (tmp_path / "a.csv").write_text(text)
    times, stimuli = read_stimuli(tmp_path / "a.csv", 2)
    np.testing.assert_allclose(times - times[0], [0.0, 0.25])
    np.testing.assert_array_equal(stimuli, [[1.5, 2.0], [2.0, 3.0]])


def test_times_must_be_named_where_there_are_names(tmp_path):
    (tmp_path / "a.csv").write_text("a,b,c\n0,1,2\n1,2,3\n")
    with pytest.raises(DermisError, match="no column has the name of a time"):
        read_stimuli(tmp_path / "a.csv", 2)


def test_a_first_sample_of_missing_values_is_no_line_of_names(tmp_path):
    (tmp_path / "a.csv").write_text("nan" + ",nan" * 19 + "\n0.1" + ",1" * 19 + "\n")
    with pytest.raises(DermisError, match="line 1, column 1: a time is missing"):
        read_stimuli(tmp_path / "a.csv", 19)


@pytest.mark.parametrize("names", ["time,a,b\n", "t,a,b\n", ""])
def test_times_that_can_hardly_be_seconds_need_their_unit(tmp_path, names):
    rows = "".join(f"{10 * i},1,2\n" for i in range(200))
    (tmp_path / "a.csv").write_text(names + rows)
    with pytest.raises(DermisError, match="the unit of the times is not stated.*'time_ms'.*'time_s'"):
        read_stimuli(tmp_path / "a.csv", 2)
    (tmp_path / "a.csv").write_text("time_ms,a,b\n" + rows)
    assert read_stimuli(tmp_path / "a.csv", 2)[0][-1] == pytest.approx(1.99)
    (tmp_path / "a.csv").write_text("time_s,a,b\n" + rows)
    assert read_stimuli(tmp_path / "a.csv", 2)[0][-1] == 1990.0
