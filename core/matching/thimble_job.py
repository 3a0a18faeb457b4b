"""Job of a child process: compute the tables of a thimble on a skin.

Matching needs these tables. They are stored in the skins' cache.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache, cache_key
from ..devices.spec import DeviceSpec, from_preset
from ..parameters.skin import SKIN_CONTACT
from ..skin.finger_skin import asked_for
from ..skin.model import SkinModel, skin_from_parameters
from ..skin.store import write_table
from ..surrogate.press_points import pressed_on
from ..version import version
from .thimble import follower
from .thimble_use import prepare

STAGES = 3


def tables_key(spec: DeviceSpec, skin: SkinModel, use: Mapping[str, Any]) -> str:
    """Return the key of the cache entry that marks complete tables.

    The tables are those for a device on a skin.
    """
    settings = json.dumps(dict(use), sort_keys=True)
    what = (spec.hash, skin.key, skin.tissue, pressed_on(skin), repr(skin.material), settings)
    return cache_key(version(), "dermis-thimble-tables 1", *what)


def make(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Compute the tables for a device on a skin, and store them in the cache.

    They are the contact points, the device's description, and the poses from which searches start.

    Args:
        arrays: not used.
        parameters: 'device' (the preset as read), 'device_key', 'skin' (parameters in SI), 'level', 'tissue',
            'contact', 'use' (as in `prepare`), and 'folder' and 'limit' [bytes] of the skins' cache.
        report: called with the number of finished stages and the number of all stages.

    Returns:
        'pad': number of pad nodes.

    Raises:
        DermisError: the preset, the skin or the settings cannot be used, or the folder cannot be written.
    """
    report(0, STAGES)
    spec = from_preset(str(parameters["device_key"]), parameters["device"])
    cache = Cache(Path(str(parameters["folder"])), int(parameters["limit"]))
    skin = skin_from_parameters(parameters["skin"], level=str(parameters["level"]), cache=cache)
    skin = asked_for(skin, str(parameters.get("tissue", SKIN_CONTACT["tissue"].absent)), "skin")
    if parameters.get("contact") == "nodes":
        skin = skin.on_nodes
    report(1, STAGES)
    use = prepare(spec, skin, parameters["use"])
    report(2, STAGES)
    follower(use)
    mark = tables_key(spec, skin, parameters["use"])
    cache.put(mark, lambda part: write_table(part, np.zeros(1)))
    report(STAGES, STAGES)
    return {"pad": np.array(skin.pad_count)}
