"""Adaptation: a finger's own surrogate, made in a child process and put where `prepare` finds it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache
from ..devices.spec import from_preset
from ..parameters.skin import SKIN_CONTACT
from ..skin.finger_skin import asked_for
from ..skin.model import skin_from_parameters
from ..steps import drain
from ..surrogate.lessons import KINDS
from ..surrogate.store import adapt, place_of, save
from .thimble_use import disc_device

SHARES = {"dataset": (0, 600), "descriptors": (600, 620), "training": (620, 1000)}  # of the time, in thousandths


def adapt_job(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Make a surrogate and put it into a folder, or return its files; a job for another process or machine.

    Args:
        parameters: 'device' (preset as read), 'device_key', 'skin' (parameters in SI), 'level', and optionally
            'folder' (where the files go), 'tissue', 'contact' ('nodes' where the finger's touches are solved there),
            'skins' and 'limit' (folder and size [bytes] of the cache of skins, where tables of lengths that do not
            ship lie), 'use' (calibration to the person, see `disc_device`), 'trajectories', 'iterations'.

    Returns:
        'errors': of ridge and network on straight presses held out, shape (2,); 'samples' and 'movements' that were
        learned from; 'held_out': for each of `KINDS` error and the value that nine in ten movements stay below, of
        ridge and of network, and the number of movements, shape (2, 5). Without a folder also 'file NAME', its bytes,
        for each file.

    Raises:
        DermisError: a preset or skin that cannot be used, or servo limits that exclude contact.
    """
    spec = from_preset(str(parameters.get("device_key", "thimble")), parameters["device"])
    # the learned values are proportional to stiffness: one surrogate serves a finger whatever its personal factor
    cache = Cache(Path(str(parameters["skins"])), int(parameters["limit"])) if "skins" in parameters else None
    skin = skin_from_parameters(parameters["skin"], level=str(parameters.get("level", "standard")), cache=cache)
    skin = asked_for(skin, str(parameters.get("tissue", SKIN_CONTACT["tissue"].absent)), "skin")
    if parameters.get("contact") == "nodes":
        skin = skin.on_nodes
    device, friction = disc_device(spec, skin, parameters.get("use", {}))
    wanted = {n: int(parameters[n]) for n in ("trajectories", "iterations") if n in parameters}

    def tell(stage: str, done: int, total: int) -> None:
        low, high = SHARES[stage]
        report(low + (high - low) * done // max(total, 1), 1000)

    steps = adapt(device, skin, friction, report=tell, **wanted)
    made = drain(steps, lambda step: tell(*step))
    with TemporaryDirectory() if "folder" not in parameters else nullcontext(parameters["folder"]) as folder:
        paths = save(place_of(Path(folder), skin, device, friction), made)
        travels = {} if "folder" in parameters else {f"file {p.name}": np.fromfile(p, np.uint8) for p in paths}
    meta = made.meta
    held_out = []
    for kind in KINDS:
        ridge, network = (meta["held_out"][name][kind] for name in ("ridge", "network"))
        row = ridge["error"], ridge["most"], network["error"], network["most"], ridge["movements"]
        held_out.append(row)
    return {
        "errors": np.array([meta["ridge_error"], meta["network_error"]]),
        "samples": np.array(meta["samples"]),
        "movements": np.array(meta["movements"]),
        "held_out": np.array(held_out),
        **travels,
    }
