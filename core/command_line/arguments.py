"""Arguments of verbs: their type, readers of values, and shared arguments.

The arguments that only one verb takes are defined with that verb.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ..errors import DermisError
from ..parameters.parameter import SWITCH, Parameter
from ..parameters.skin import DEFAULT_SKIN, SKIN_CONTACT
from ..parameters.stream import STREAM
from ..track.formats import FORMATS


class Argument(NamedTuple):
    """Names and keywords for `ArgumentParser.add_argument`."""

    names: tuple[str, ...]
    settings: dict[str, Any]


def argument(*names: str, **settings: Any) -> Argument:
    """Return an argument from the parameters of `add_argument`."""
    return Argument(names, settings)


def switch(name: str, text: str) -> Argument:
    """Return an option without a value, which is True if it is given.

    Args:
        name: name of the option, with its dashes.
        text: help text.
    """
    return argument(name, action="store_true", help=text)


def add_verb(verbs: Any, name: str, *arguments: Argument, run: Any, **more: Any) -> None:
    """Add a verb to a command line.

    Args:
        verbs: the object that `ArgumentParser.add_subparsers` returned.
        name: name of the verb.
        arguments: arguments of the verb.
        run: dotted name, below `core`, of the function that runs the verb. The parsed options hold it as `run`.
        more: keywords of `add_parser`, such as help; also `writes`, the names of options that are paths to write, each
            with True for a folder and False for a file. The parsed options hold `writes`, too.
    """
    writes = more.pop("writes", {})
    parser = verbs.add_parser(name, **more)
    for names, settings in arguments:
        parser.add_argument(*names, **settings)
    parser.set_defaults(run=run, writes=writes)


def number(text: str) -> float:
    """Read a number.

    Raises:
        argparse.ArgumentTypeError: the text is no number.
    """
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error


def angle(text: str) -> float:
    """Read an angle between two faces [degrees], 0 to 180.

    Raises:
        argparse.ArgumentTypeError: the text is no such angle.
    """
    value = number(text)
    if not 0.0 <= value <= 180.0:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: 0 to 180 degrees")
    return value


def share(text: str) -> float:
    """Read a share, 0 to 1.

    Raises:
        argparse.ArgumentTypeError: the text is no such number.
    """
    value = number(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: 0 to 1")
    return value


def seconds(text: str) -> float:
    """Read a duration [s], 0 to 1e6.

    Raises:
        argparse.ArgumentTypeError: the text is no such number.
    """
    value = number(text)
    if not 0.0 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: 0 to 1e6 s")
    return value


def setting(name: str) -> Argument:
    """Return the option for a numeric parameter of `STREAM`.

    A person gives the value in the unit that Blender's panels show. The parsed value is in SI.

    Args:
        name: name of the parameter.
    """
    row = STREAM[name]
    return _number_of(row, row.name, row.default)


def settings_of(form: str, texts: Mapping[str, str] = MappingProxyType({})) -> tuple[Argument, ...]:
    """Return the options for the settings of a format, `--FORMAT-NAME`.

    The value of an option that is not given is None.

    Args:
        form: name of the format.
        texts: help texts, by name of the setting, for settings whose meaning to the verb differs from their meaning in
            a file.
    """
    made = []
    for row in FORMATS[form].settings.values():
        if row.name in texts:
            made.append(_number_of(row, f"{form}_{row.name}", None, texts[row.name]))
        elif row.unit == SWITCH:
            text = f"{form}: {row.text[0].lower()}{row.text[1:]}"
            made.append(argument(f"--{form}-{row.name}", action="store_true", default=None, help=text))
        else:
            made.append(_number_of(row, f"{form}_{row.name}", None))
    return tuple(made)


def _number_of(row: Parameter, name: str, default: float | None, text: str = "") -> Argument:
    def read(text: str) -> float:
        value = number(text) * row.factor
        try:
            row.check(value, "")
        except DermisError as error:
            raise argparse.ArgumentTypeError(f"{text} is not allowed: {error.limit}") from error
        return value

    unit = "" if row.window_unit == "1" else row.window_unit
    usual = f"{row.default / row.factor:g} {unit}".rstrip()
    what = text or f"{row.text[0].lower()}{row.text[1:]} ({usual})"
    option = f"--{name.replace('_', '-')}"
    return argument(option, type=read, default=default, metavar=unit.upper() or "RATIO", help=what)


def span(text: str) -> tuple[float, float]:
    """Read the start and the end of a time span, 'FROM:TO' [s].

    Raises:
        argparse.ArgumentTypeError: the text has another form, FROM is below 0, or TO is not above FROM.
    """
    first, colon, last = text.partition(":")
    ends = number(first), number(last if colon else first)
    if not colon or not 0.0 <= ends[0] < ends[1] < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no stretch of time: FROM:TO, in seconds")
    return ends


def row_numbers(text: str) -> tuple[int, ...]:
    """Read row numbers, which count from 1, such as '1,5,20-30'.

    Raises:
        argparse.ArgumentTypeError: the text has another form.
    """
    rows: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.strip().isdigit() or (dash and not last.strip().isdigit()):
            raise argparse.ArgumentTypeError(f"{part!r} is no number of a row: 1,5,20-30")
        rows += range(int(first), int(last if dash else first) + 1)
    return tuple(rows)


PRESETS = argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")
SCENE = argument("scene", type=Path, metavar="FILE", help="a scene sampled to a file (.npz)")
SCENES = argument("scene", type=Path, nargs="+", metavar="FILE", help="scenes sampled to files (.npz)")
WORKERS = (
    argument("--workers", type=int, default=0, metavar="N", help="number of processes; 0 for one per core"),
    argument("--scheduler", metavar="URL", help="use the workers of a dask scheduler: tcp://HOST:PORT, tls://..."),
    argument("--tls-ca", type=Path, metavar="FILE", help="certificate of the authority, for tls://"),
    argument("--tls-cert", type=Path, metavar="FILE", help="your certificate, for tls://"),
    argument("--tls-key", type=Path, metavar="FILE", help="its key, for tls://"),
)
TRACK = argument("track", type=Path, metavar="TRACK", help="a command track: CSV, JSON or binary")
MAPS = switch("--maps", "also write the maps of touch screens, for real fingers")
QUIET = switch("--quiet", "no progress")
LEVEL = argument("--level", default="draft", choices=("draft", "standard"), help="accuracy of the skin")
TISSUE = argument(
    "--tissue",
    default=SKIN_CONTACT["tissue"].default,
    choices=SKIN_CONTACT["tissue"].keys,
    help="tissue of the skin (linear)",
)

REST = (
    argument(
        "--rest",
        type=span,
        metavar="FROM:TO",
        help="span of each recording in seconds in which nothing is touched; it gives the noise; the readings are "
        "shifted so that their mean in this span equals the table's readings at rest",
    ),
    argument(
        "--rest-rows",
        type=row_numbers,
        default=(),
        metavar="ROWS",
        help="rows of a recorded table in which nothing is touched, such as 1,5,20-30; the one nearest to the device "
        "at rest if left out",
    ),
)
THIMBLE = (argument("--device", default="thimble_3rrs", metavar="PRESET", help="the device preset"), PRESETS)
SKIN = (argument("--skin", default=DEFAULT_SKIN, metavar="PRESET", help="the skin preset"), LEVEL, TISSUE)

SPEAKS = (
    argument(
        "--protocol",
        default=STREAM["protocol"].default,
        choices=sorted(STREAM["protocol"].keys),
        help="protocol of the device (native)",
    ),
    PRESETS,
)


def device(left_out: str, default: str = "") -> tuple[Argument, ...]:
    """Return the options --device, --protocol and --presets.

    Args:
        left_out: words for the device that is used if --device is left out, for the help.
        default: value of --device if it is left out.
    """
    return argument("--device", default=default, metavar="KEY", help=f"device preset; {left_out} if left out"), *SPEAKS


LINK = (
    argument("--url", required=True, help="port or URL of the device, 'virtual:' for the simulated one"),
    argument("--calibration", type=Path, metavar="FILE", help="calibration of this device"),
    setting("rate"),
)
LOG = (
    argument(
        "--log",
        type=Path,
        metavar="FILE",
        help="write a log of the stream, one row per sample: NAME.csv, NAME.dlog (binary), or a folder",
    ),
    setting("log_size"),
    setting("log_total"),
    argument(
        "--tee",
        action="append",
        default=[],
        metavar="ADDRESS",
        help="also send these rows to udp://HOST:PORT or lsl:NAME; may be repeated",
    ),
)
