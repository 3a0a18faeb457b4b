"""Recordings and recorded tables: what is good is read, and every way to be bad is named."""

from __future__ import annotations

import numpy as np
import pytest

from core.design.recordings import read_recording, read_table, same_channels
from core.design.task import read_sensed
from core.errors import DermisError

NAMES = [f"e{i + 1}" for i in range(19)] + ["pressure"]


def counts(rows=50, seed=0):
    return np.random.default_rng(seed).integers(800, 3000, (rows, 20))


def text(values, names=("time", *NAMES), separator=","):
    lines = [separator.join(names)]
    lines += [separator.join(f"{v:g}" for v in row) for row in values]
    return "\n".join(lines) + "\n"


def recording(values=None, **options):
    values = counts() if values is None else values
    return text(np.column_stack([np.arange(len(values)) / 100, values]), **options)


@pytest.fixture
def write(tmp_path):
    def put(content, name="touch.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return put


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_recording_is_read(write, separator):
    values = counts()
    found = read_recording(write("# made by hand\n" + recording(values, separator=separator)))
    np.testing.assert_array_equal(found.readings, values)
    np.testing.assert_allclose(found.times, np.arange(50) / 100)
    assert found.name == "touch"


def test_units_of_times_and_decimal_commas_are_read(write):
    """Milliseconds were taken for seconds, and a decimal comma for no number."""
    values = counts() + 0.25
    found = read_recording(write(text(np.column_stack([np.arange(50) * 10, values]), ("time [ms]", *NAMES))))
    np.testing.assert_allclose(found.times, np.arange(50) / 100)
    commas = recording(values, separator=";").replace(".", ",")
    found = read_recording(write(commas))
    np.testing.assert_array_equal(found.readings, values)
    np.testing.assert_allclose(found.times, np.arange(50) / 100)


@pytest.mark.parametrize("name", ["time", "t", "timestamp"])
@pytest.mark.parametrize(("step", "start", "unit"), [(10, 0, "ms"), (10_000, 0, "us"), (10, 1_790_000_000_000, "ms")])
def test_times_that_can_hardly_be_seconds_need_their_unit(write, name, step, start, unit):
    """200 rows, 10 ms apart, lasted 1990 s."""
    values = counts(200)

    def written(first):
        lines = [f"{start + step * i}," + ",".join(map(str, row)) for i, row in enumerate(values.tolist())]
        return write("\n".join([",".join([first, *NAMES]), *lines]) + "\n")

    with pytest.raises(DermisError, match=f"nobody says in which unit the times are.*'time_{unit}'"):
        read_recording(written(name))
    found = read_recording(written(f"{name}_{unit}"))
    assert np.ptp(found.times) == pytest.approx(199 * step * {"ms": 1e-3, "us": 1e-6}[unit])


def test_slow_recordings_are_seconds_where_their_name_says_so(write):
    values = counts(200)
    slowly = np.column_stack([2.0 * np.arange(200), values])
    np.testing.assert_allclose(read_recording(write(text(slowly, ("time_s", *NAMES)))).times, slowly[:, 0])
    short = np.column_stack([2.0 * np.arange(9), values[:9]])
    np.testing.assert_allclose(read_recording(write(text(short))).times, short[:, 0])


def test_units_of_motors_are_read(write):
    values = counts(40)
    moved = np.random.default_rng(3).uniform(0.0, 2.0, (40, 3))
    given = np.column_stack([np.degrees(moved[:, :2]), moved[:, 2] * 1e3, values])
    table = read_table(write(exact(given, "m1 [deg]", "m2_deg", "m3_mm", *NAMES)), np.full(3, 2.0))
    np.testing.assert_allclose(table.commands, moved, rtol=1e-12)


def changed(row, column, value):
    lines = recording().splitlines()
    cells = lines[row].split(",")
    cells[column] = value
    lines[row] = ",".join(cells)
    return "\n".join(lines)


def constant():
    values = counts()
    values[:, 4] = 1234
    return recording(values)


def saturated():
    values = counts()
    values[:10, 7] = 4095
    return recording(values)


def transposed():
    values = np.column_stack([np.arange(50) / 100, counts()]).T
    lines = [",".join([name, *(f"{v:g}" for v in row)]) for name, row in zip(("time", *NAMES), values, strict=True)]
    return "\n".join(lines)


BAD = {
    "missing": (text(np.arange(9.0)[:, None], ("time",)), "channels are missing .*1 columns"),
    "constant": (constant(), "e5: the channel is constant .*1234"),
    "saturated": (saturated(), "e8: the channel is saturated .*20 % of the time"),
    "lengths": ("\n".join(recording().splitlines()[:5] + ["0.9,1,2,3"]), "line 6: the line has another length .*4 val"),
    "transposed": (transposed(), "the file is transposed"),
    "trailing": ("\n".join(line + "," for line in recording().splitlines()), "lines end with a separator"),
    "trailing later": (
        "\n".join([*recording().splitlines()[:7], recording().splitlines()[7] + ","]),
        "line 8: the line ends with a separator",
    ),
    "nan": (changed(3, 2, "nan"), "line 4, e2: a value is not finite"),
    "text": (changed(3, 2, "oops"), "line 4, e2: not a number .*oops"),
    "empty cell": (changed(3, 2, ""), "line 4, e2: not a number"),
    "times": (changed(4, 0, "0.01"), "line 5, column 1 'time': times do not rise"),
    "names": ("\n".join(recording().splitlines()[1:]), "the line of names is missing"),
    "no time": (recording().replace("time", "e0", 1), "first column must be the time"),
    "twice": (recording().replace("e2", "e1", 1), "two columns have one name .*e1"),
    "short": ("\n".join(recording().splitlines()[:2]), "too few samples"),
    "empty": ("", "no data"),
}


def exact(values, *names):
    return "\n".join([",".join(names), *(",".join(map(repr, row)) for row in values.tolist())])


@pytest.mark.parametrize("channels", [1, 3, 19, 40])
def test_any_number_of_channels_of_any_range_is_read_as_it_is(write, channels):
    """Others' sensors: 19 electrodes alone, volts, newtons below nought; nothing is rounded or cut off."""
    values = np.random.default_rng(2).normal(0.0, 3.0, (30, channels)) + 0.125
    names = [f"c{i}" for i in range(channels)]
    content = "\n".join(
        [",".join(["time", *names])] + [",".join(map(repr, [i / 10, *row])) for i, row in enumerate(values.tolist())]
    )
    found = read_recording(write(content))
    np.testing.assert_array_equal(found.readings, values)
    assert found.channels == tuple(names)
    rng = np.random.default_rng(3)
    moved = np.column_stack([rng.uniform(0, 2, (30, 2)), values])
    table = read_table(write(exact(moved, "m1", "m2", *names), "table.csv"), np.full(2, 2.0))
    kept = np.isin(values[:, 0], table.readings[:, 0])
    np.testing.assert_array_equal(np.sort(table.readings[:, 0]), np.sort(values[kept, 0]))
    assert kept.all() and table.readings.dtype == np.float64
    with pytest.raises(DermisError, match="another number of channels.*found 20"):
        same_channels(read_recording(write(recording())), table)


def test_whole_counts_tell_their_scale(write):
    """A channel at the end of 10 bits is saturated; one that rests at nought is at no end there."""
    values = np.minimum(counts(), 1023)
    values[:, 5] = [0] * 25 + list(range(25))
    values[:, :5] = values[:, 6:] = 500 + np.arange(50)[:, None]
    assert read_recording(write(recording(values))).readings[0, 5] == 0
    values[20:24, 0] = 1023
    with pytest.raises(DermisError, match="e1: the channel is saturated .*8 % of the time"):
        read_recording(write(recording(values)))
    table = read_table(write(text(np.column_stack([*rows()]), ("m1", "m2", "m3", *NAMES))), np.full(3, 2.0))
    assert table.readings.dtype == np.uint16


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_recording_is_refused_by_name(write, kind):
    content, message = BAD[kind]
    with pytest.raises(DermisError, match=message):
        read_recording(write(content))


def test_what_is_no_text_is_refused(write, tmp_path):
    with pytest.raises(DermisError, match="not UTF-8"):
        read_recording(write(b"time,\xff\xfe"))
    with pytest.raises(DermisError, match="cannot be read"):
        read_recording(tmp_path / "none.csv")


def test_two_recordings_of_one_name_are_refused(write, tmp_path):
    one = write(recording())
    (tmp_path / "b").mkdir()
    other = tmp_path / "b" / "touch.csv"
    other.write_text(recording())
    with pytest.raises(DermisError, match="one name"):
        read_sensed([one, other])


def rows(count=40, motors=3, still=5):
    rng = np.random.default_rng(1)
    commands, readings = rng.uniform(0, 2, (count, motors)), counts(count, 2)
    readings[:still] = readings[0]
    return commands, readings


def test_a_recorded_table_collapses_the_rows_that_read_alike_to_one_rest_row(write):
    commands, readings = rows()
    path = write(text(np.column_stack([commands, readings]), ("m1", "m2", "m3", *NAMES)))
    table = read_table(path, np.full(3, 2.0))
    assert len(table.commands) == 36 and table.meta["rest_rows"] == 5
    np.testing.assert_array_equal(table.readings[table.rest], readings[0])
    np.testing.assert_allclose(table.commands[table.rest], commands[0], rtol=1e-5)


def test_bad_tables_are_refused(write):
    commands, readings = rows()
    names = ("m1", "m2", "m3", *NAMES)
    with pytest.raises(DermisError, match=r"too few rows .*found 7; allowed: >= 8"):
        read_table(write(text(np.column_stack([commands, readings])[:7], names)), np.ones(3))
    with pytest.raises(DermisError, match="channels are missing"):
        read_table(write(text(commands, names[:3])), np.ones(3))
    with pytest.raises(DermisError, match="beyond the motor's range"):  # a motor that is none
        read_table(
            write(text(np.column_stack([commands, readings]), names)), np.ones(4), np.array([[0.0] * 4, [2.0] * 4])
        )
    frozen = commands.copy()
    frozen[:, 1] = 1.0
    with pytest.raises(DermisError, match="a motor never moves .*m2"):
        read_table(write(text(np.column_stack([frozen, readings]), names)), np.ones(3))
