"""Recordings and recorded tables: what is good is read, and every way to be bad is named."""

from __future__ import annotations

import re

import numpy as np
import pytest

from core.design.recorded_table import read_table, rest_finding
from core.design.recordings import read_recording, same_channels
from core.design.task import read_sensed
from core.errors import DermisError
from core.number_rows import Line, numbers_of

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


@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
@pytest.mark.parametrize("where", ["all", "rows", "names", "some rows"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_separators_at_the_ends_of_lines_part_nothing(write, separator, where, newline):
    lines = recording(counts(), separator=separator).splitlines()
    chosen = {"all": range(len(lines)), "rows": range(1, len(lines)), "names": [0], "some rows": [3, 8]}[where]
    ended = [line + separator if i in chosen else line for i, line in enumerate(lines)]
    found = read_recording(write("\ufeff" + newline.join(ended) + newline))
    np.testing.assert_array_equal(found.readings, read_recording(write("\n".join(lines))).readings)
    assert found.channels == tuple(NAMES)


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

    with pytest.raises(DermisError, match=f"the unit of the times is not stated.*'time_{unit}'"):
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


@pytest.mark.parametrize(("name", "unit"), [("m1 [ms]", "ms"), ("m1 [counts]", "counts"), ("m1_us", "us")])
def test_a_motors_unit_that_is_no_length_and_no_angle_is_refused(write, name, unit):
    """It was taken as SI without a word."""
    path = write(text(np.column_stack([*rows()]), (name, "m2", "m3", *NAMES)))
    with pytest.raises(DermisError, match=rf"column '{re.escape(name)}': the unit does not fit .*'{unit}'; .*deg"):
        read_table(path, np.full(3, 2.0))


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
    "no name": (recording().replace("e8", "", 1), "a column has no name .*column 9"),
    "last cell": (recording().rsplit(",", 1)[0] + ",\n", "not a number"),
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
    with pytest.raises(DermisError, match="different numbers of channels.*found 20"):
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
    table = read_table(path, np.full(3, 2.0), at_rest=commands[0])
    assert len(table.commands) == 36 and table.meta["rest_rows"] == 5
    np.testing.assert_array_equal(table.readings[table.rest], readings[0])
    np.testing.assert_allclose(table.commands[table.rest], commands[0], rtol=1e-5)


def test_rest_is_the_row_nearest_to_the_device_at_rest_or_what_a_person_says(write):
    """The row with the least last channel was taken: another order of the channels, another rest."""
    commands, readings = rows(still=1)
    names = ("m1", "m2", "m3", *NAMES)
    readings[7, -1] = 1  # least pressure
    order = np.random.default_rng(4).permutation(20)
    for channels in (np.arange(20), order):
        path = write(text(np.column_stack([commands, readings[:, channels]]), (*names[:3], *np.array(NAMES)[channels])))
        table = read_table(path, np.full(3, 2.0), at_rest=commands[3])
        np.testing.assert_allclose(table.commands[table.rest], commands[3], rtol=1e-5)
        (said,) = rest_finding(table)
        assert said.code == "rest-guessed" and said.value == "line 5"
        told = read_table(path, np.full(3, 2.0), at_rest=commands[3], rest_rows=(11, 12, 13))
        rest = told.commands[told.rest]
        assert min(np.abs(rest - commands[i]).max() for i in (10, 11, 12)) < 1e-5
        assert len(told.commands) == 38 and told.meta["rest_rows"] == 3 and rest_finding(told) == ()
    with pytest.raises(DermisError, match="no such row of rest .*allowed: 1 to 40"):
        read_table(path, np.full(3, 2.0), rest_rows=(41,))


def test_rest_of_a_recording_tells_its_noise_and_moves_it_to_the_tables(write):
    rng = np.random.default_rng(5)
    values = 1000.0 + 300.0 * np.sin(np.arange(400) / 9.0)[:, None] * np.linspace(0.2, 1.0, 20)
    values[:100] = 1000.0
    values += rng.normal(0.0, 2.0, values.shape)
    path = write(recording(values))
    assert read_recording(path, (0.0, 0.99)).noise == pytest.approx(2.0, rel=0.05)
    rest = np.full(20, 1500.0)
    moved = read_recording(path, (0.0, 0.99)).tared(rest)
    np.testing.assert_allclose(moved[:100].mean(axis=0), rest)
    np.testing.assert_allclose(moved - moved[0], values - values[0], atol=0.02)
    np.testing.assert_array_equal(read_recording(path).tared(rest), read_recording(path).readings)
    with pytest.raises(DermisError, match="too few samples at rest .*allowed: >= 2, within 0 to 3.99 s"):
        read_recording(path, (7.0, 8.0))


def test_a_gap_is_refused_with_its_row(write):
    values = counts()
    times = np.arange(50) / 100
    times[20:] += 0.5
    with pytest.raises(DermisError, match=r"line 22, column 1 'time': samples are missing .*0.51 s without one"):
        read_recording(write(text(np.column_stack([times, values]))))


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


def test_a_clock_that_goes_on_in_another_unit_is_refused_with_its_row(write):
    """Seconds, and then milliseconds: most samples were far apart, so none was missing."""
    values = counts(200)
    times = np.arange(200) / 100
    times[70:] = times[69] + (times[70:] - times[69]) * 1000.0
    with pytest.raises(DermisError, match=r"line 3, column 1 'time_s': the time between samples changes.*10 s apart"):
        read_recording(write(text(np.column_stack([times, values]), ("time_s", *NAMES))))
    seldom = np.column_stack([np.arange(200) * 10.0, values])
    assert len(read_recording(write(text(seldom, ("time_s", *NAMES)))).times) == 200, "as seldom all along"


@pytest.mark.parametrize("factor", [1000.0, 1e-3])
@pytest.mark.parametrize("row", [10, 90, 190])
def test_a_unit_that_changes_between_noisy_samples_is_refused_with_its_row(write, factor, row):
    """Electrodes that change by a third from sample to sample, among them one that stands at nought now and then."""
    rng = np.random.default_rng(4)
    felt = np.rint(60.0 * np.exp(rng.normal(0.0, 0.3, (200, 7))) + rng.normal(0.0, 3.0, (200, 7)))
    felt[rng.uniform(size=200) < 0.04, 2] = 0.0
    assert len(read_recording(write(recording(felt, names=("time", *NAMES[:7])))).times) == 200
    felt[row:] *= factor
    with pytest.raises(DermisError, match=rf"line {row + 2}, all channels: the unit of the readings changes"):
        read_recording(write(recording(felt, names=("time", *NAMES[:7]))))


@pytest.mark.parametrize("contact", [0.02, 1.0, 40.0])
def test_a_touch_that_sets_in_at_once_is_no_change_of_unit(write, contact):
    """Of a tared sensor of three axes, from its noise to a thousand times as much within a sample, and back."""
    rng = np.random.default_rng(5)
    felt = rng.normal(0.0, 0.001, (200, 3))
    felt[80:140] += contact * np.array([1.0, 0.8, 1.3]) * (1.0 + 0.2 * np.sin(np.arange(60.0)))[:, None]
    assert len(read_recording(write(recording(felt, names=("time", "x", "y", "z")))).times) == 200


@pytest.mark.parametrize("factor", [1000.0, 1e-3])
@pytest.mark.parametrize("row", [8, 25, 32])
def test_a_table_that_goes_on_in_another_unit_is_refused_with_its_row(write, factor, row):
    commands, readings = rows(still=1)
    other = readings * np.where(np.arange(40) >= row, factor, 1.0)[:, None]
    names = ("m1", "m2", "m3", *NAMES)
    with pytest.raises(DermisError, match=rf"line {row + 2}, all channels: the unit of the readings changes"):
        read_table(write(text(np.column_stack([commands, other]), names)), np.full(3, 2.0))
    rested = readings.astype(float)
    rested[:12] = np.random.default_rng(3).normal(0.0, 1.0, (12, 20))  # a tared sensor, untouched at first
    rested[20, :4] = 0.5  # and a light touch, of some electrodes
    assert len(read_table(write(text(np.column_stack([commands, rested]), names)), np.full(3, 2.0)).commands) > 30


def test_a_number_with_an_underscore_is_none(write):
    content = recording(counts())
    lines = content.splitlines()
    lines[9] = lines[9].replace(lines[9].split(",")[3], "1_0", 1)
    with pytest.raises(DermisError, match="line 10, e3: not a number .*1_0"):
        read_recording(write("\n".join(lines) + "\n"))


@pytest.mark.parametrize("separator", [",", ";", "\t", ""])
def test_numbers_read_all_at_once_are_those_of_every_line(separator):
    """To the last bit, whatever their form; where one line is another matter, all are left to be looked at."""
    rng = np.random.default_rng(8)
    drawn = [10.0 ** rng.uniform(-300, 300) * rng.normal() for _ in range(400)]
    cells = [repr(v) for v in drawn] + ["0", "-0.0", "1e5", "+7", ".5", "5.", "nan", "inf", "-Infinity", " 3 "]
    cells = [cell.strip() if not separator else cell for cell in cells] + ["12", "4"]
    joined = separator or " "
    lines = [Line(i + 1, joined.join(cells[4 * i : 4 * i + 4]), separator) for i in range(len(cells) // 4)]
    found = numbers_of(lines, 4)
    assert found is not None
    np.testing.assert_array_equal(found, np.array([line.numbers() for line in lines]))
    for odd in ("1_0", "0x10", "1d5", "a", '"3"', "1,5" if separator != "," else "1;5", ""):
        other = Line(99, joined.join(["1", "2", odd, "4"][: 4 if odd or separator else 2]), separator)
        assert numbers_of([*lines, other], 4) is None, odd
    assert numbers_of(lines, 5) is None and numbers_of([*lines, Line(99, "1", separator)], 4) is None
