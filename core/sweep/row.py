"""One row of a sweep: its parameters and its hash.

The hash identifies the row when a sweep is resumed.
"""

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
        key: hash of all inputs of the row's figures.
        columns: varied parameters, as shown in the table.
        given: parameters of the row's job.
        scene: file of the scene; None if the study makes its own scenes.
    """

    key: str
    columns: Mapping[str, Value]
    given: Mapping[str, Any]
    scene: Path | None = None


def row_key(study: str, content: str, given: Mapping[str, Any]) -> str:
    """Return the key of a row.

    It is a hash of the study, the content of the scene, the parameters of the job and the engine. Results of different
    versions of Dermis or of different presets are therefore not mixed.
    """
    made_by = [engine()[name] for name in SAME]
    return cache_key("dermis-sweep-row 1", study, content, json.dumps(dict(given), sort_keys=True), *made_by)[:32]
