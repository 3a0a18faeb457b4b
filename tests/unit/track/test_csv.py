"""CSV version 1: exact text, round trips, and refusals that name the line."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.track import csv
from core.track.command_track import CommandTrack
from core.track.known_keys import EXPORT_META, FIRST_META, METHOD_META

FIXED = settings(derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])

SPEC = DeviceSpec(
    "haptip",
    "HapTip",
    "shear_tactor",
    1000.0,
    (Channel("tactor_x", "m", -0.002, 0.002, 0.15, 0.0, "x"), Channel("contact", "1")),
    {"link": 0.005, "mode": "a, b", "names": ["p", "q"], "flag": True},
    {"bandwidth": 115200.0, "bits_per_sample": 8.0},
    stated_hash="0123456789abcdef",
)
TRACK = CommandTrack(
    SPEC,
    np.arange(3) / 1000,
    np.array([[0.0, 1.0], [1.25e-6, -0.0], [-0.002, 1 / 3]]),
    {
        "finger": "Index",
        "scene": "Tap",
        "fps": "30000/1001",
        "frame_range": "1 250",
        "generator": "dermis 1.0.0",
        "content_hash": "abc",
        "x.zebra": "last",
    },
    {"tactor_x.slew": 2, "tactor_x.range": 0},
)
TEXT = """\
# dermis-track 1
# generator: dermis 1.0.0
# finger: Index
# scene: Tap
# frame_range: 1 250
# fps: 30000/1001
# content_hash: abc
# x.zebra: last
# device: haptip
# device_name: HapTip
# kind: shear_tactor
# spec_hash: 0123456789abcdef
# rate: 1000.0
# units: SI
# samples: 3
# channel.tactor_x: {"low": -0.002, "high": 0.002, "slew": 0.15, "rest": 0.0, "actuator": "x"}
# channel.contact: {"low": null, "high": null, "slew": null, "rest": 0.0, "actuator": ""}
# parameter.flag: true
# parameter.link: 0.005
# parameter.mode: "a, b"
# parameter.names: ["p", "q"]
# wire.bandwidth: 115200.0
# wire.bits_per_sample: 8.0
# limited.tactor_x.range: 0
# limited.tactor_x.slew: 2
t_s,tactor_x[m],contact[1]
0,0,1
0.001,1.25e-06,0
0.002,-0.002,0.333333333
"""


def test_the_text_is_exactly_this() -> None:
    assert csv.dumps(TRACK) == TEXT


def test_reading_gives_the_track_back() -> None:
    found = csv.loads(TEXT)
    assert found.spec == SPEC and found.spec.hash == SPEC.hash
    assert found.meta == TRACK.meta and found.limited == TRACK.limited
    assert found.times.tolist() == [0.0, 0.001, 0.002]
    assert found.values.tolist() == [[0.0, 1.0], [1.25e-6, 0.0], [-0.002, 0.333333333]]


def test_order_of_the_caller_does_not_show() -> None:
    turned = replace(TRACK, meta=dict(reversed(TRACK.meta.items())), limited=dict(reversed(TRACK.limited.items())))
    assert csv.dumps(turned) == TEXT


def test_files_have_the_same_bytes_in_another_process(tmp_path: Path) -> None:
    csv.write(TRACK, tmp_path / "here.csv")
    assert (tmp_path / "here.csv").read_bytes() == TEXT.encode()
    code = (
        "import sys; from pathlib import Path; from core.track import csv; "
        "csv.write(csv.read(Path(sys.argv[1])), Path(sys.argv[2]))"
    )
    env = {**os.environ, "PYTHONPATH": str(Path(csv.__file__).parents[2]), "PYTHONHASHSEED": "99"}
    subprocess.run([sys.executable, "-c", code, tmp_path / "here.csv", tmp_path / "there.csv"], check=True, env=env)
    assert (tmp_path / "there.csv").read_bytes() == TEXT.encode()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["here.csv", "there.csv"]


TEXTS = st.text(st.characters(codec=None, exclude_categories=()), max_size=20)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@settings(FIXED, max_examples=150)
@given(
    meta=st.dictionaries(st.from_regex(r"x\.[A-Za-z0-9_.-]{1,8}|finger|scene|law", fullmatch=True), TEXTS, max_size=4),
    rows=st.lists(st.tuples(NUMBERS, NUMBERS), max_size=8),
    limits=st.tuples(st.floats(-1e9, 0), st.floats(0, 1e9), st.floats(1e-9, 1e9)),
    name=TEXTS,
    actuator=TEXTS,
)
def test_round_trip(
    meta: dict[str, str], rows: list[tuple[float, float]], limits: tuple[float, float, float], name: str, actuator: str
) -> None:
    text = actuator.encode("utf-8", "replace").decode()
    spec = replace(SPEC, name=name, channels=(Channel("a", "m", *limits, 0.0, text), Channel("b", "V")))
    given_track = CommandTrack(spec, np.arange(len(rows)) / 1000, np.array(rows).reshape(-1, 2), meta)
    found = csv.loads(csv.dumps(given_track).encode().decode())
    assert found.spec == spec and found.meta == meta and found.limited == {}
    np.testing.assert_array_equal(found.times, given_track.times)
    np.testing.assert_allclose(found.values, given_track.values, rtol=5e-9, atol=5e-324)
    assert csv.dumps(found) == csv.dumps(given_track)


@pytest.mark.parametrize("rate", [240.0, 1000.0, 30000 / 1001, 44100.0])
def test_times_on_a_grid_come_back_to_the_bit(rate: float) -> None:
    times = np.arange(3001) / rate
    spec = replace(SPEC, rate=rate)
    found = csv.loads(csv.dumps(CommandTrack(spec, times, np.zeros((3001, 2)))))
    np.testing.assert_array_equal(found.times, times)


def test_times_of_no_grid_come_back_as_written() -> None:
    found = csv.loads(csv.dumps(replace(TRACK, times=np.array([0.0, 0.5, 0.7000000001]))))
    assert found.times.tolist() == [0.0, 0.5, 0.7]


def test_a_limited_track_passes_its_check_from_the_file_too() -> None:
    rng = np.random.default_rng(5)
    raw = CommandTrack(SPEC, np.arange(4000) / 1000, rng.normal(size=(4000, 2)) * 0.003)
    found = csv.loads(csv.dumps(raw.within_limits()))
    assert {f.code for f in found.check()} == {"limited-range", "limited-slew"}


def test_crlf_is_read() -> None:
    assert csv.dumps(csv.loads(TEXT.replace("\n", "\r\n"))) == TEXT


def test_other_programs_keys_are_kept_and_optional_ones_may_be_missing() -> None:
    lines = [
        x for x in TEXT.splitlines() if not x.startswith(("# samples", "# device_name", "# parameter", "# limited"))
    ]
    found = csv.loads("\n".join([*lines[:1], "# x.tool: other: 7", *lines[1:]]) + "\n")
    assert found.meta["x.tool"] == "other: 7" and found.spec.name == "haptip" and found.limited == {}


def test_edited_elsewhere_with_rows_removed_loads_when_the_count_goes_too() -> None:
    short = TEXT.replace("0.001,1.25e-06,0\n", "").replace("# samples: 3\n", "")
    assert csv.loads(short).times.tolist() == [0.0, 0.002]


LINES = TEXT.splitlines()


def test_the_missing_line_of_a_channel_is_spelled_out_and_works() -> None:
    lines = [line for line in LINES if not line.startswith("# channel.contact")]
    with pytest.raises(DermisError, match=r"'# channel.contact' is missing") as caught:
        csv.loads("\n".join(lines) + "\n")
    line = '# channel.contact: {"rest": 0}'
    assert caught.value.remedy == f"Write '{line}' for a channel without limits"
    assert csv.loads("\n".join([lines[0], line, *lines[1:]]) + "\n").channels == SPEC.channels


def test_a_rate_that_contradicts_the_rows_is_found_by_the_check() -> None:
    found = csv.loads(TEXT.replace("# rate: 1000.0", "# rate: 50.0"))
    assert [(f.severity, f.value) for f in found.check() if f.code == "rate"] == [("error", "50 Hz")]


def test_all_that_the_methods_say_of_themselves_can_be_read_back() -> None:
    """The keys of every `meta` in the sources, found in their text: none may be missing on the format's list."""
    root = Path(csv.__file__).parents[1]
    found = set()
    for path in (
        *(root / "pipeline").glob("*.py"),
        root / "command_line" / "thimble.py",
        root / "track" / "export.py",
        *(root / "matching").glob("*.py"),
    ):
        if path.name in ("table.py", "screen_map.py", "description.py"):  # meta of other files
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            made: list[ast.expr | None] = []
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "meta":
                made = [node.value]
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
                target = node.targets[0]
                if isinstance(target.value, ast.Name) and target.value.id == "meta":
                    found.add(ast.literal_eval(target.slice))
            elif isinstance(node, ast.FunctionDef) and node.name == "_meta":
                made = [n.value for n in ast.walk(node) if isinstance(n, ast.Return)]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "CommandTrack":
                made = [*node.args[3:4], *(k.value for k in node.keywords if k.arg == "meta")]
            elif isinstance(node, ast.keyword) and node.arg == "meta":
                made = [node.value]
            for value in made:
                if isinstance(value, ast.Dict):
                    found |= {ast.literal_eval(k) for k in value.keys if k is not None}
    assert {"finger", "fps", "forced", "range", "law", "worst_kkt", "sensor", "stimuli", "relief"} <= found
    assert found <= {*FIRST_META, *METHOD_META, *EXPORT_META}


@pytest.mark.parametrize(
    ("old", "new", "where", "what"),
    [
        ("# dermis-track 1", "# dermis-track 2", "line 1", r"newer .* \(found 'version 2'; allowed: version 1\)"),
        ("# dermis-track 1", "# dermis-track 0", "line 1", "a version that does not exist"),
        ("# dermis-track 1", "time,x", "line 1", r"not .* track \(found 'time,x'; allowed: # dermis-track 1\)"),
        ("# dermis-track 1", "\ufeff# dermis-track 1", "line 1", "byte order mark"),
        ("# finger: Index", "# finger Index", "line 3", "not a header line"),
        ("# finger: Index", "# finger: a\\q", "line 3", r"an unknown escape \(found '\\\\q'"),
        ("# scene: Tap", "# finger: Tap", "line 4", r"a key appears twice \(found 'finger'\)"),
        ("# units: SI", "# units: mm", "line 14", r"unknown system of units \(found 'mm'; allowed: SI\)"),
        ("# units: SI\n", "", "track", "'# units' is missing"),
        ("# device: haptip\n", "", "track", "'# device' is missing"),
        ("# rate: 1000.0", "# rate: 0", "line 13", r"rate must be above zero \(found 0.0; allowed: > 0 Hz\)"),
        ("# rate: 1000.0", "# rate: NaN", "line 13", r"not a finite number \(found 'NaN'\)"),
        ("# rate: 1000.0", "# rate: fast", "line 13", r"not a JSON value \(found 'fast'\)"),
        ("# samples: 3", "# samples: 4", "track", r"number of rows is not the one stated \(found 3; allowed: 4\)"),
        ('"slew": 0.15', '"slew": 0', "line 16", r"slew must be above zero \(found 0.0; allowed: > 0\)"),
        ('"low": -0.002', '"low": 0.01', "line 16", r"low is above high \(found 0.01; allowed: <= 0.002\)"),
        ('"low": -0.002', '"low": "x"', "line 16, low", "not a finite number"),
        ('"low": -0.002', '"lowest": 0', "line 16", "not the limits of a channel"),
        ("# limited.tactor_x.slew: 2", "# limited.tactor_x.slew: -2", "line 25", r"not a count \(found '-2'"),
        ("# wire.bandwidth: 115200.0", '# wire.bandwidth: "x"', "wire.bandwidth", "not a finite number"),
        ("# x.zebra: last", "# foo: bar", "line 8", r"unknown key \(found 'foo'; .*Begin .* with 'x.'"),
        ("# x.zebra: last", "# x.: bar", "line 8", "unknown key"),
        ("# kind: shear_tactor", "# kind: banana", "line 11", r"unknown kind of device \(found 'banana'; .*thimble"),
        ("# fps: 30000/1001", "# fps: abc", "line 6", r"not a frame rate \(found 'abc'"),
        ("# fps: 30000/1001", "# fps: 24/0", "line 6", "not a frame rate"),
        ("# fps: 30000/1001", "# fps: 0/1", "line 6", "not a frame rate"),
        ("# fps: 30000/1001", "# fps: -24", "line 6", "not a frame rate"),
        ("# frame_range: 1 250", "# frame_range: x", "line 5", r"not a range of frames \(found 'x'"),
        ("# frame_range: 1 250", "# frame_range: 250 1", "line 5", "not a range of frames"),
        ("# frame_range: 1 250", "# frame_range: 1 nan", "line 5", "not a range of frames"),
        ("# frame_range: 1 250", "# frame_range: 1 2 3", "line 5", "not a range of frames"),
        ("# wire.bandwidth: 115200.0", "# wire.foo: 3", "line 22", r"unknown field of the wire \(found 'wire.foo'"),
        ("# limited.tactor_x.slew: 2", "# limited.tactor_x.bogus: 2", "line 25", "unknown kind of limiting"),
        ("# limited.tactor_x.slew: 2", "# limited.tactor_x: 2", "line 25", "unknown kind of limiting"),
        ("# limited.tactor_x.slew: 2", "# limited.bogus.range: 4", "line 25", r"without a column .*'bogus.range'"),
        ("# x.zebra: last", "# channel: 1", "line 8", r"a name is missing after the group \(found 'channel'\)"),
        ("# x.zebra: last", "# channel.gone: {}", "line 8", r"a channel without a column \(found 'channel.gone'\)"),
        ("t_s,tactor_x[m]", "time,tactor_x[m]", "line 26", r"not the time \(found 'time'; allowed: t_s\)"),
        ("tactor_x[m],", "tactor_x,", "line 26, column 2", r"not a column name \(found 'tactor_x'"),
        ("tactor_x[m],", "tactor_x[mm],", "line 26, column 2", "not a column name"),
        ("contact[1]", "contact[1],", "line 26, column 4", "not a column name"),
        ("contact[1]", "other[1]", "line 26, column 3", r"'# channel.other' is missing in the header"),
        ("contact[1]", "tactor_x[m]", "line 26, column 3", r"a column appears twice \(found 'tactor_x'\)"),
        ("0.001,1.25e-06,0\n", "0.001,1.25e-06,0,\n", "line 28", r"length \(found '4 values'; allowed: 3 values\)"),
        ("0.001,1.25e-06,0\n", "0.001,1.25e-06\n", "line 28", r"another length \(found '2 values'"),
        ("0.001,1.25e-06,0\n", "0.001,1.25e-06,\n", "line 28, column 3", r"not a finite number \(found ''\)"),
        ("0.001,1.25e-06,0\n", "0.001;1.25e-06;0\n", "line 28", "another length"),
        ("1.25e-06", "nan", "line 28, column 2", r"not a finite number \(found 'nan'\)"),
        ("1.25e-06", "inf", "line 28, column 2", r"found 'inf'"),
        ("1.25e-06", "1e999", "line 28, column 2", r"found '1e999'"),
        ("1.25e-06", "1_0", "line 28, column 2", r"found '1_0'"),
        ("1.25e-06", " 1", "line 28, column 2", r"found ' 1'"),
        ("1.25e-06", "0x10", "line 28, column 2", r"found '0x10'"),
        ("1.25e-06", "1.2.3", "line 28, column 2", r"found '1.2.3'"),
        ("0.001,1.25e-06,0\n", "0.001,1.25e-06,0\n\n", "line 29", "an empty line"),
        ("0.001,1.25e-06,0\n", "0,1.25e-06,0\n", "line 28", r"times do not rise \(found '0 s'; allowed: > 0 s\)"),
        ("0.001,1.25e-06,0\n", "0.001,1.25e-06,0\r0\n", "line 28", "another length|not a finite"),
        ("0.333333333\n", "0.33", "line 29", "ends in the middle of a line"),
        ("0.002,-0.002,0.333333333\n", "# more: 1\n", "line 29", "another length"),
    ],
)
def test_refusals_name_the_line(old: str, new: str, where: str, what: str) -> None:
    assert old in TEXT
    with pytest.raises(DermisError, match=what) as caught:
        csv.loads(TEXT.replace(old, new, 1))
    assert where in caught.value.where


@pytest.mark.parametrize("text", ["", "\n", "# dermis-track 1", "# dermis-track 1\n", TEXT[: TEXT.index("t_s")]])
def test_cut_files_are_refused(text: str) -> None:
    with pytest.raises(DermisError):
        csv.loads(text)


@settings(FIXED, max_examples=300)
@given(st.integers(0, len(TEXT)), st.integers(0, 12), st.text('0123456789.,-+e#:{}[]"\\\n\r nta\x00', max_size=6))
def test_a_damaged_file_is_read_or_refused_but_never_breaks(at: int, gone: int, put: str) -> None:
    try:
        found = csv.loads(TEXT[:at] + put + TEXT[at + gone :])
    except DermisError:
        return
    assert np.isfinite(found.values).all() and (np.diff(found.times) > 0).all()
    assert csv.loads(csv.dumps(found)).spec == found.spec


def test_wrong_encoding_names_the_line(tmp_path: Path) -> None:
    path = tmp_path / "latin.csv"
    path.write_bytes(TEXT.replace("Index", "Zeigefinger é").encode("latin-1"))
    with pytest.raises(DermisError, match=r"line 3: not UTF-8 text \(found 'byte 0xe9'; allowed: UTF-8\)"):
        csv.read(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.array([[0, 0], [np.nan, 0], [0, 0]])}, r"1, tactor_x: .* finite number \(found nan\)"),
        ({"times": np.array([0, np.inf, 1])}, r"sample 1: a time is not a finite number \(found inf\)"),
        ({"times": np.array([1e6, 1e6 + 1e-5, 1e6 + 1])}, "times do not rise in the nine digits"),
        ({"meta": {"two\nlines": "x"}}, r"a key that the header cannot hold \(found 'two\\nlines'"),
        ({"meta": {"rate": "5"}}, r"a key that the header cannot hold \(found 'rate'"),
        ({"meta": {"foo": "bar"}}, r"unknown key \(found 'foo'"),
        ({"meta": {"fps": "fast"}}, r"not a frame rate \(found 'fast'"),
        ({"limited": {"gone.range": 1}}, "a limited channel without a column"),
        ({"spec": replace(SPEC, kind="banana")}, "unknown kind of device"),
        ({"meta": {"n": 5}}, r"n: a header value must be a text \(found 5\)"),
        ({"spec": replace(SPEC, channels=(Channel("a,b", "m"), Channel("c", "m")))}, r"found 'a,b\[m\]'"),
        ({"spec": replace(SPEC, channels=(Channel("a", "m"), Channel("a", "m")))}, "two channels have one name"),
        ({"spec": replace(SPEC, parameters={"x": float("nan")})}, "a device setting that the header cannot hold"),
    ],
)
def test_writer_refuses(change: dict[str, object], message: str) -> None:
    with pytest.raises(DermisError, match=message):
        csv.dumps(replace(TRACK, **change))  # type: ignore[arg-type]


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DermisError, match="the file cannot be written") as caught:
        csv.write(TRACK, tmp_path / "file" / "out.csv")
    assert str(tmp_path / "file" / "out.csv") in caught.value.where and caught.value.remedy
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(DermisError, match="the file cannot be written"):
        csv.write(TRACK, tmp_path / "folder.csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.csv"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits on file size are POSIX")
def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    """The system refuses bytes beyond a limit, as a full disk does; the track before stays whole."""
    path = tmp_path / "track.csv"
    csv.write(TRACK, path)
    code = (
        "import resource, signal, sys; from pathlib import Path; from core.track import csv; import core.errors\n"
        "track = csv.read(Path(sys.argv[1]))\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n"
        "try: csv.write(track, Path(sys.argv[1]))\n"
        "except core.errors.DermisError as error: print(error)\n"
    )
    env = {**os.environ, "PYTHONPATH": str(Path(csv.__file__).parents[2]), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-c", code, path], env=env, capture_output=True, text=True, check=True)
    assert "the file cannot be written (found 'File too large')" in done.stdout
    assert path.read_text() == TEXT and [p.name for p in tmp_path.iterdir()] == ["track.csv"]
