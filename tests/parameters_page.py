"""The page `core/PARAMETERS.md`: every row, in words. `python3 build_addon.py docs` writes it anew."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from core.devices.kinds import KINDS
from core.parameters.device import DEVICE
from core.parameters.finger import FINGER
from core.parameters.material import BODY, CURVED
from core.parameters.parameter import LARGEST, Parameter, Table
from core.parameters.screen import HEIGHT, MAP_UNIT, SCREEN, SEQUENCE
from core.parameters.skin import SKIN, SKIN_CONTACT
from core.parameters.stream import STREAM
from core.parameters.wave import WAVE

PAGE = Path(__file__).resolve().parents[1] / "core" / "PARAMETERS.md"
_DEVICES, _SKIN = "object.dermis.finger.devices[i]", "object.dermis.finger.skin"
_MAP = {row.name: row for row in (MAP_UNIT, HEIGHT)}
_OBJECT = "`Body.parameters`; presets in `presets/materials`, all but `held`"
GROUPS: tuple[tuple[str, str, str, Table], ...] = (
    ("Finger", "`Finger.parameters`", "object.dermis.finger", FINGER),
    ("A finger's skin", "`Finger.parameters`, beside `skin`", _SKIN, SKIN_CONTACT),
    ("Skin", "`skin` of `Finger.parameters`, and presets in `presets/skins`", _SKIN, SKIN),
    ("Device on a finger", "`DeviceUse.parameters`", _DEVICES, DEVICE),
    (
        "Object",
        "`Body.parameters`; presets in `presets/materials`, all but `held` and `kink_time`",
        "object.dermis.material",
        {**BODY, CURVED.name: CURVED},
    ),
    ("Screen", "`Screen.parameters`", "object.dermis.screen", {**SCREEN, **SEQUENCE, **_MAP}),
    (
        "WAV files",
        "the settings of `core.track.export.write`; `python -m core export` has `--wav-NAME`",
        "scene.dermis.wav",
        WAVE,
    ),
    ("Stream", "a `StreamRequest`; `python -m core stream` has options for some", "scene.dermis_stream", STREAM),
)
HEAD = """# Parameters

Made from the rows of `core/parameters/` and `core/devices/kinds.py` by `python3 build_addon.py docs`; a test holds it
current. Numbers stand in the unit of Blender's window; scenes and the engine take SI, presets say their unit.
*Default* is the value of a new item in the window, *absent* the engine's value where a scene or preset has none
(empty: the default; -: no value, see the note).
Ranges hold in the window, in presets and in scenes alike; where something differs, the note says so.
"""


def page() -> str:
    """Return the whole page."""
    return "\n".join([HEAD, *(_group(*group) for group in GROUPS), _kinds()])


def _group(title: str, where: str, path: str, rows: Table) -> str:
    lines = [f"## {title}\n", f"In {where}; in Blender `{path}`.\n"]
    lines.append(_row("name", "property", "unit", "default", "absent", "range", "keyed", "meaning", "source"))
    lines.append(_row(*9 * ["---"]))
    lines += [_line(row) for row in rows.values()]
    return "\n".join(lines) + "\n"


def _line(row: Parameter) -> str:
    absent = "" if row.absent == row.default else "-" if row.absent is None else _shown(row, row.absent)
    text = f"{row.text} ({row.note})" if row.note else row.text
    return _row(
        f"`{row.name}`",
        f"`{row.saved}`" if row.label else "",
        row.window_unit if row.numeric else "",
        "-" if row.default is None else _shown(row, row.default),
        absent,
        "" if row.numeric and row.high >= LARGEST and row.low <= -LARGEST else row.allowed,
        "yes" if row.keyed else "",
        text,
        row.source,
    )


def _shown(row: Parameter, value: Any) -> str:
    if row.numeric:
        return f"{value / row.factor:g}"
    return ("on" if value else "off") if isinstance(value, bool) else f"`{value}`" if value else "empty"


def _kinds() -> str:
    lines = ["## Kinds of device\n", "The `parameters` of a preset, in SI (required ones in bold), and which"]
    lines += [
        "of the settings above the kind reads. Each kind holds a finger, unless its row says otherwise.\n",
        _row("kind", "preset", "settings"),
        _row(*3 * ["---"]),
    ]
    for name, kind in KINDS.items():
        told = [_told(row) for row in kind.parameters.values()]
        cell = f"`{name}`" if kind.worn else f"`{name}`, no finger in it"
        lines.append(_row(cell, "; ".join(told), ", ".join(f"`{setting}`" for setting in kind.settings)))
    return "\n".join(lines) + "\n"


def _told(row: Parameter) -> str:
    absent = f" (absent: {row.default})" if row.default is not None else ""
    return f"**`{row.name}`** {row.allowed}" if row.required else f"`{row.name}` {row.allowed}{absent}"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE
    target.write_text(page(), encoding="utf-8", newline="\n")
