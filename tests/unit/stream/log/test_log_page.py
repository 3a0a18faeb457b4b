"""The page of the log against the code: columns, header, layouts, addresses."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from core.stream.log import binary, settings, udp_tee
from core.stream.log.csv_form import CsvForm
from core.stream.log.row import BLOCKS, FIRST_SCHEMA, HEAD, SCHEMA, Fate, Phase, file_rows
from core.stream.protocols.bus.servo_bus import ServoBus
from tests.unit.stream.log.test_files import HEADER

PAGE = (Path(__file__).resolve().parents[4] / "presets" / "stream_log.md").read_text("utf-8")


def test_every_column_is_on_the_page() -> None:
    names = CsvForm(2, 2).head(HEADER).decode().splitlines()[-1].split(",")
    for name in names[:8]:
        assert f"| `{name}` |" in PAGE, name
    for block in BLOCKS:
        assert f"| `{block}.CHANNEL[unit]` |" in PAGE
    for name, unit in ServoBus.SENSES:
        assert f"`{name}.CHANNEL[{unit}]`" in PAGE
    for word in (*Phase, *Fate):
        assert f"`{word.name.lower()}` ({word.value})" in PAGE
    assert f"`{SCHEMA}`" in PAGE and f"`{FIRST_SCHEMA}`" in PAGE


def test_the_bytes_are_those_of_the_page() -> None:
    assert binary.MAGIC.hex(" ").upper() in PAGE and udp_tee.MAGIC.hex(" ").upper() in PAGE
    base, each = map(int, re.findall(r"A row is (\d+) \+ (\d+) x channels bytes", PAGE)[0])
    assert (base, base + 7 * each) == (file_rows(0).itemsize, file_rows(7).itemsize)
    (more,) = map(int, re.findall(r"of `sensed` in the header adds (\d+) x channels bytes", PAGE))
    assert file_rows(7, 3).itemsize == base + 7 * each + 3 * 7 * more
    (order,) = re.findall(r"bytes: ([\w, ]+?), two bytes", PAGE)
    assert [name for name, _ in HEAD if name] == order.split(", ")


def test_the_header_is_that_of_the_page() -> None:
    stated = PAGE.split("**Header**")[1].split("##")[0]
    assert {name for name in HEADER.plain() if f"`{name}`" not in stated} == set()


def test_defaults_and_addresses_are_those_of_the_page() -> None:
    tee = settings.Tee.of("udp://HOST:9")
    assert f"format={tee.form}&rate={tee.rate:g}" in PAGE
    assert all(f"`{suffix}`" in PAGE for suffix in settings.FORMS.values())


def test_the_examples_are_python() -> None:
    found = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    assert len(found) == 2 and all(ast.parse(text) for text in found)
    for name in ("started_unix", "number", "time", "names"):
        assert f'"{name}"' in found[1]
