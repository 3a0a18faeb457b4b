"""Reports of a comparison: text, CSV, JSON values and an HTML page."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from ..files import write_bytes
from ..matching.felt_errors import MEASURES
from ..matching.thimble_use import LOOKUP
from ..track.file_names import FileNames, safe
from ..version import version
from .aligned import aligned
from .device_comparison import Comparison, Row
from .measures import Measure, rms
from .picture import shown_unit, svg

COLUMNS = ("device", "method", "measure", "target", "rendered", "off", "clipped", "out of reach")
FLOORS = ("best pose found", "with lateral axes")  # additional columns if floors were computed
WORDS = (
    ("target, rendered", "root of the mean square over the samples that were looked at"),
    ("off", "RMS of the difference over the RMS of the target; of stress that of the six components under the pad"),
    ("clipped", "share of all samples that a limit of the device changed, of its channel that was changed most"),
    (
        "out of reach",
        "share of the touched samples at which the device presses less than 5 % of what is asked, or its range ends",
    ),
)
FLOOR_WORDS = (
    "best pose found, with lateral axes",
    "what the best pose that a search found would leave, and with two more axes along the pad and a turn about its "
    "normal; of the stress of the whole skin, of cells of it, and of virtual electrodes",
)
_FLOORS = ",best_found,with_lateral_axes"
_STYLE = """body{font:14px/1.45 system-ui,sans-serif;color:#20262e;max-width:1000px;margin:2em auto;padding:0 1em}
table{border-collapse:collapse;width:100%}td,th{text-align:left;padding:4px 10px;border-bottom:1px solid #e4e7eb}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}tr.first td{border-top:2px solid #b9c0c8}
svg{max-width:100%;height:auto;margin:1em 0}.faint{color:#6b7480}"""


def columns(found: Comparison) -> tuple[str, ...]:
    """Return the names of the columns of `lines`."""
    return (*COLUMNS, *FLOORS) if _has_floors(found) else COLUMNS


def lines(found: Comparison) -> list[tuple[str, ...]]:
    """Return the rows of the table as text, one row for each measure.

    Device, method and shares stand only in the first row of a device. If a floor was computed for a device, a row for
    each measure of the floor follows the device's own measures.
    """
    out: list[tuple[str, ...]] = []
    more = ("",) * (len(columns(found)) - len(COLUMNS))
    for row in found.rows:
        for i, measure in enumerate(row.judged.measures):
            own = (row.title, row.method) if i == 0 else ("", "")
            shares = (_percent(row.clipped), _percent(row.judged.out_of_reach)) if i == 0 else ("", "")
            out.append((*own, measure.name, *_figures(measure), f"{100 * measure.off:.0f} %", *shares, *more))
        for name, *errors in _floors(row):
            off, best, lateral = ("" if e is None else f"{100 * e:.0f} %" for e in errors)
            out.append(("", _floor_by(row), name, "", "", off, "", "", best, lateral))
    return out


def _has_floors(found: Comparison) -> bool:
    return any(row.floor is not None for row in found.rows)


def _floors(row: Row) -> list[tuple[str, float, float, float | None]]:
    """Return name and errors of each measure of a device's floor.

    The errors are those of the device, of the best pose found, and of the best pose with lateral axes (or None).
    """
    if row.floor is None:
        return []
    lateral = row.floor.lateral or (None,) * len(MEASURES)
    return list(zip(MEASURES, row.floor.rendered, row.floor.best, lateral, strict=True))


def _floor_by(row: Row) -> str:
    """Return the method whose error stands beside a device's floor.

    It is the device's own method if this searches for a pose, and stress matching if it is a look-up table.
    """
    return "stress" if row.method == LOOKUP else row.method


def text(found: Comparison) -> str:
    """Return the comparison as text for a terminal.

    It has the table, the skipped devices and the findings about the touch.
    """
    made = aligned([columns(found), *lines(found)])
    return "\n".join([*made, *(f"skipped: {s.title}: {s.why}" for s in found.skipped), *map(str, found.findings)])


def csv(found: Comparison) -> str:
    """Return the table as CSV in SI units.

    Lines `# key: value` precede it, as in a track.
    """
    head = ["# dermis-comparison 1", *(f"# {k}: {v}" for k, v in _about(found)), *map(_comment, found.skipped)]
    head += [f"# {_line(str(finding))}" for finding in found.findings]
    floors = _has_floors(found)
    head.append("device,kind,method,measure,unit,target_rms,rendered_rms,off,clipped,out_of_reach" + floors * _FLOORS)
    for row in found.rows:
        shares = row.clipped, row.judged.out_of_reach
        for m in row.judged.measures:
            figures = (rms(m.target), rms(m.rendered), m.off, *shares)
            words = (row.device, row.kind, row.method, m.name, m.unit)
            head.append(",".join([*words, *(f"{v:.9g}" for v in figures)]) + floors * ",,")
        for name, off, best, lateral in _floors(row):
            values = (None, None, off, *shares, best, lateral)
            head.append(",".join([row.device, row.kind, _floor_by(row), name, "", *map(_number, values)]))
    return "\n".join(head) + "\n"


def html(found: Comparison) -> str:
    """Return a self-contained HTML page.

    It has the table, a glossary, the skipped devices and the pictures.
    """
    words = (*WORDS, FLOOR_WORDS) if _has_floors(found) else WORDS
    parts = [
        f"<!DOCTYPE html><html lang=en><meta charset=utf-8><title>{escape(found.finger)}: devices compared</title>",
        f"<style>{_STYLE}</style><h1>{escape(found.finger)}: one touch, {len(found.rows)} devices</h1>",
        f"<p class=faint>{escape(', '.join(f'{k} {v}' for k, v in _about(found)))}. Simulated.</p>",
        "<table><tr>" + "".join(f"<th{_side(i)}>{c}</th>" for i, c in enumerate(columns(found))) + "</tr>",
        *(
            f"<tr{' class=first' if line[0] else ''}>"
            + "".join(f"<td{_side(i)}>{escape(c)}</td>" for i, c in enumerate(line))
            + "</tr>"
            for line in lines(found)
        ),
        "</table>",
        "<p class=faint>" + "<br>".join(f"<b>{escape(k)}</b>: {escape(v)}" for k, v in words) + "</p>",
    ]
    if found.findings:
        parts.append("<ul>" + "".join(f"<li>{escape(str(f))}</li>" for f in found.findings) + "</ul>")
    if found.skipped:
        items = "".join(f"<li>{escape(s.title)}: {escape(s.why)}</li>" for s in found.skipped)
        parts.append(f"<h2>Skipped</h2><ul>{items}</ul>")
    for row in found.rows:
        parts.append(f"<h2>{escape(row.title)}</h2>{svg(row, found.duration)}")
        if row.floor is not None:
            parts.append(f"<p>{escape('. '.join(row.floor.words()))}.</p>")
        worse = [f for f in row.findings if f.severity != "info"]
        if worse:
            parts.append("<ul>" + "".join(f"<li>{escape(str(f))}</li>" for f in worse) + "</ul>")
    return "\n".join(parts) + "\n</html>\n"


def as_dict(found: Comparison) -> dict[str, Any]:
    """Return the contents of the panel, as plain JSON values."""
    return {
        "scene": found.scene,
        "finger": found.finger,
        "content_hash": found.content_hash,
        "rows": [_plain(row) for row in found.rows],
        "skipped": [{"title": s.title, "why": s.why} for s in found.skipped],
        "findings": [f"{f.what}. {f.remedy}".rstrip(". ") for f in found.findings],
    }


def write(found: Comparison, folder: Path) -> tuple[Path, Path]:
    """Write CSV and HTML into a folder; return their paths.

    Raises:
        DermisError: the folder cannot be written.
    """
    stem = FileNames().take(f"{safe(found.finger) or 'finger'}.devices")
    table, page = Path(folder) / f"{stem}.csv", Path(folder) / f"{stem}.html"
    write_bytes(table, csv(found).encode())
    write_bytes(page, html(found).encode())
    return table, page


def _about(found: Comparison) -> Iterator[tuple[str, str]]:
    yield "scene", _line(found.scene)
    yield "finger", _line(found.finger)
    yield "generator", f"dermis {version()}"
    yield "content_hash", found.content_hash


def _plain(row: Row) -> dict[str, Any]:
    measures = [{"name": m.name, "off": m.off, "figures": _both(m)} for m in row.judged.measures]
    return {
        "device": row.device,
        "title": row.title,
        "kind": row.kind,
        "measures": measures,
        "clipped": row.clipped,
        "out_of_reach": row.judged.out_of_reach,
        "floors": [
            {"name": name, "by": _floor_by(row), "off": off, "best": best, "lateral": lateral}
            for name, off, best, lateral in _floors(row)
        ],
    }


def _figures(measure: Measure) -> tuple[str, str]:
    """Return the RMS of target and rendered values, each with the shown unit."""
    factor, unit = shown_unit(measure)
    target, rendered = (f"{rms(v) / factor:.3g} {unit}".rstrip() for v in (measure.target, measure.rendered))
    return target, rendered


def _both(measure: Measure) -> str:
    """Return the RMS of target and rendered values in one short text."""
    factor, unit = shown_unit(measure)
    target, rendered = (f"{rms(v) / factor:.2g}" for v in (measure.target, measure.rendered))
    return f"{target} → {rendered} {unit}".rstrip()


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.9g}"


def _comment(skipped: Any) -> str:
    return f"# skipped {_line(skipped.device)}: {_line(skipped.why)}"


def _line(words: str) -> str:
    """Return a text in a single line."""
    return " ".join(words.splitlines())


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if 0.0 < share < 0.0995 else f"{100 * share:.0f} %"


def _side(column: int) -> str:
    return " class=n" if column > 2 else ""
