"""Job of a child process: learn a finger's own surrogate and save it where `prepare` finds it."""

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
from ..parameters.error_bands import LINEAR
from ..parameters.skin import SKIN_CONTACT
from ..skin.finger_skin import asked_for
from ..skin.model import skin_from_parameters
from ..steps import drain
from ..surrogate.lessons import KINDS
from ..surrogate.store import adapt, place_of, save
from .thimble_use import disc_device

# Start and end of each stage, in thousandths of the time, on linear skin and on skin that follows a nonlinear law.
SHARES = {"dataset": (0, 600), "descriptors": (600, 620), "training": (620, 1000)}
SHARES_BY_LAW = {"stress": (0, 20), "dataset": (20, 850), "descriptors": (850, 860), "training": (860, 1000)}


def adapt_job(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Learn a surrogate, and save it in a folder or return its files.

    Args:
        arrays: not used.
        parameters: 'device' (preset as read), 'device_key', 'skin' (parameters in SI), 'level', and optionally
            'folder' (where the files are saved), 'tissue', 'contact' ('nodes' if contact is solved at the nodes),
            'skins' and 'limit' (folder and size [bytes] of the skins' cache, which holds tables of fingers whose size
            does not ship), 'use' (calibration to the person, see `disc_device`), 'trajectories', 'iterations'.
        report: called with the progress and the total, in thousandths.

    Returns:
        'errors': errors of ridge regression and network on straight presses that were held out, shape (2,).
        'samples' and 'movements': numbers of those that were learned from.
        'held_out': for each of `KINDS`, the error of the ridge regression and the value below which nine in ten
        movements stay, the same two of the network, and the number of movements, shape (kinds, 5).
        'unsettled': number of samples that were left out, because the skin's nonlinear law did not converge.
        'file NAME': the bytes of each file, only without a folder.

    Raises:
        DermisError: the preset or the skin cannot be used, or the servo limits exclude contact.
    """
    spec = from_preset(str(parameters.get("device_key", "thimble")), parameters["device"])
    # The learned values are proportional to stiffness, so one surrogate suits every personal stiffness factor.
    cache = Cache(Path(str(parameters["skins"])), int(parameters["limit"])) if "skins" in parameters else None
    skin = skin_from_parameters(parameters["skin"], level=str(parameters.get("level", "standard")), cache=cache)
    skin = asked_for(skin, str(parameters.get("tissue", SKIN_CONTACT["tissue"].absent)), "skin")
    if parameters.get("contact") == "nodes":
        skin = skin.on_nodes
    device, friction = disc_device(spec, skin, parameters.get("use", {}))
    wanted = {n: int(parameters[n]) for n in ("trajectories", "iterations") if n in parameters}

    shares = shares_of(skin.tissue)

    def tell(stage: str, done: int, total: int) -> None:
        low, high = shares[stage]
        report(low + (high - low) * done // max(total, 1), 1000)

    steps = adapt(device, skin, friction, report=tell, **wanted)
    made = drain(steps, lambda step: tell(*step))
    with TemporaryDirectory() if "folder" not in parameters else nullcontext(parameters["folder"]) as folder:
        paths = save(place_of(Path(folder), skin, device, friction), made)
        travels = {} if "folder" in parameters else {f"file {p.name}": np.fromfile(p, np.uint8) for p in paths}
    meta = made.meta
    held_out = [_row(*(meta["held_out"][name][kind] for name in ("ridge", "network"))) for kind in KINDS]
    return {
        "errors": np.array([meta["ridge_error"], meta["network_error"]]),
        "samples": np.array(meta["samples"]),
        "movements": np.array(meta["movements"]),
        "held_out": np.array(held_out),
        "unsettled": np.array(meta["unsettled"]),
        **travels,
    }


def shares_of(tissue: str) -> dict[str, tuple[int, int]]:
    """Return start and end of each stage for a tissue, in thousandths of the time."""
    return SHARES if tissue == LINEAR else SHARES_BY_LAW


def _row(ridge: Mapping[str, float], network: Mapping[str, float]) -> tuple[float, ...]:
    """Return the errors of both fits side by side, see `adapt_job`."""
    return ridge["error"], ridge["most"], network["error"], network["most"], ridge["movements"]
