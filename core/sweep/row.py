"""One row of a sweep: its name, its parameters, and the hash by which it is known when it is resumed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..cache import cache_key
from ..work.engine import SAME, engine
from .spec import Value


@dataclass(frozen=True)
class Row:
    """One variant of one scene.

    Attributes:
        key: hash of all that its figures depend on. columns: its varied parameters, as the table shows them.
        given: parameters of its job. scene: its file, or None where the study makes its own.
    """

    key: str
    columns: Mapping[str, Value]
    given: Mapping[str, Any]
    scene: Path | None = None


def row_key(study: str, content: str, given: Mapping[str, Any]) -> str:
    """Return the key of a row: of its study, its scene's content, its job's parameters and the engine.

    Another version of Dermis, or other presets, give other keys: their results are not mixed.
    """
    made_by = [engine()[name] for name in SAME]
    return cache_key("dermis-sweep-row 1", study, content, json.dumps(dict(given), sort_keys=True), *made_by)[:32]
