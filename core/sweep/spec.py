"""Specification of a sweep.

It is a TOML file with a study, scenes, and the values of varied parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from ..errors import DermisError
from ..files import read_text
from ..foreign import MAX_TOML, damage_told, is_newer, toml_of

SCHEMA = "dermis-sweep 1"
STUDIES = ("devices", "motors")
MOST = 100_000  # largest number of rows; each is a file in one folder
KEYS = {"schema", "study", "scenes", "finger", "level", "rows", "vary"}

Value = str | int | float | bool


@dataclass(frozen=True)
class Spec:
    """A sweep.

    Attributes:
        study: 'devices' (scenes through devices) or 'motors' (the six interactions of [S2] through platforms).
        vary: the values of each varied parameter, in the file's order; a parameter with one value is fixed.
        scenes: files of sampled scenes.
        finger: name or number of the finger.
        level: level of the skin's mesh, for 'motors'.
        rows: number of rows of a platform's table, for 'motors'; None for that of its preset.
        where: the file, for errors.
    """

    study: str
    vary: Mapping[str, tuple[Value, ...]]
    scenes: tuple[Path, ...] = ()
    finger: str | int = 0
    level: str = "draft"
    rows: int | None = None
    where: str = field(default="sweep")

    def variants(self) -> Iterator[dict[str, Value]]:
        """Yield every combination of the varied parameters.

        The last parameter varies fastest.
        """
        for values in product(*self.vary.values()):
            yield dict(zip(self.vary, values, strict=True))

    def values(self, key: str) -> tuple[Value, ...]:
        """Return the values of a parameter.

        The tuple is empty if the parameter does not vary.
        """
        return self.vary.get(key, ())


def read(path: Path) -> Spec:
    """Read the specification of a sweep.

    Patterns of scenes are relative to the folder of the file.

    Raises:
        DermisError: the file is not TOML, a study or key is unknown, a value is not valid, a scene does not exist, or
            there are more than `MOST` rows.
    """
    where = str(path)
    given = toml_of(read_text(path, most=MAX_TOML), where)
    schema = given.get("schema")
    if schema != SCHEMA:
        newer = is_newer(schema, SCHEMA)
        what = "made for a newer version of Dermis" if newer else "unknown schema"
        raise DermisError(
            what, where=where, value=_shown(schema), limit=SCHEMA, remedy="Update Dermis" if newer else ""
        )
    unknown = sorted(given.keys() - KEYS)
    if unknown:
        raise DermisError("unknown key", where=where, value=unknown[0][:80], limit=", ".join(sorted(KEYS)))
    study = given.get("study")
    if study not in STUDIES:
        raise DermisError("no such study", where=where, value=_shown(study), limit=", ".join(STUDIES))
    finger, rows, level = given.get("finger", 0), given.get("rows"), given.get("level", "draft")
    if not isinstance(finger, str | int) or isinstance(finger, bool):
        raise DermisError("a finger is a name or a number", where=f"{where}, finger", value=_shown(finger))
    if rows is not None and (not isinstance(rows, int) or isinstance(rows, bool) or rows < 1):
        raise DermisError("not a number of rows", where=f"{where}, rows", value=_shown(rows), limit=">= 1")
    if level not in ("draft", "standard"):
        raise DermisError("no such level", where=f"{where}, level", value=_shown(level), limit="draft, standard")
    made = Spec(study, _vary(given.get("vary"), where), _scenes(given, path), finger, level, rows, where)
    count = max(len(made.scenes), 1)
    for values in made.vary.values():
        count *= len(values)
    if count > MOST:
        raise DermisError("too many rows", where=where, value=count, limit=f"{MOST}")
    return made


def _vary(given: Any, where: str) -> dict[str, tuple[Value, ...]]:
    if not isinstance(given, dict) or not given:
        raise DermisError("nothing varies", where=where, limit="a table [vary] with a list of values per key")
    made = {}
    for key, values in given.items():
        listed = values if isinstance(values, list) else [values]
        for value in listed:
            if not isinstance(value, Value):
                remedy = 'Write keys with dots in quotes: "device.disc_radius" = [10, 12]'
                raise DermisError("not a value", where=f"{where}, vary, {key}", value=_shown(value), remedy=remedy)
            if isinstance(value, float) and value - value != 0.0:
                raise DermisError("not a finite number", where=f"{where}, vary, {key}", value=value)
        if not listed or len({(type(v), v) for v in listed}) != len(listed):
            raise DermisError("no value, or one twice", where=f"{where}, vary, {key}", value=len(listed))
        made[str(key)] = tuple(listed)
    return made


def _scenes(given: Mapping[str, Any], path: Path) -> tuple[Path, ...]:
    patterns, where = given.get("scenes", []), f"{path}, scenes"
    if not isinstance(patterns, list) or not all(isinstance(p, str) and p for p in patterns):
        raise DermisError("scenes are a list of files", where=where, value=_shown(patterns))
    if bool(patterns) != (given["study"] == "devices"):
        raise DermisError("scenes are of the study 'devices', which needs some", where=where, value=len(patterns))
    found: list[Path] = []
    for pattern in patterns:
        with damage_told("not a pattern of files", where):
            drive, rest = Path(pattern).anchor, Path(pattern)
            folder = Path(drive) if drive else path.parent
            hits = sorted(folder.glob(str(rest.relative_to(drive) if drive else rest)))
        if not hits:
            raise DermisError("no such scene", where=where, value=pattern, remedy="Paths are beside the file")
        found += hits
    return tuple(dict.fromkeys(found))


def _shown(value: Any) -> Any:
    return value if isinstance(value, str | int | float | bool | None) else type(value).__name__
