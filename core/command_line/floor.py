"""`python -m core floor`: the errors of the best poses of a device.

They are the errors of the best poses that a search finds for a touch, also with additional axes along the pad.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

import numpy as np

from ..contact.skin_sampler import skin_contacts
from ..errors import DermisError
from ..files import write_bytes
from ..matching.felt_errors import MEASURES
from ..matching.floor import floor_of, looked_at
from ..matching.thimble import amounts_at, forces_at
from ..matching.thimble_use import by_stress, method_name, prepare
from ..parameters.skin import DEFAULT_SKIN
from ..presets import Library
from ..scene import scene_file
from ..skin.finger_skin import finger_skin
from .messages import drain_shown, tell


def floor(options: argparse.Namespace) -> int:
    """Print the errors of a device, and of its best poses, for one finger.

    Write them to --out if it is given, and return the exit status.
    """
    scene, library = scene_file.load(options.scene), Library(options.presets)
    if not 0 <= options.finger < len(scene.fingers):
        raise DermisError(
            "no such finger", where=str(options.scene), value=options.finger, limit=f"0 to {len(scene.fingers) - 1}"
        )
    finger = scene.fingers[options.finger]
    worn = next((u for u in finger.devices if u.preset == options.device), None)
    spec, parameters = library.device(options.device), {} if worn is None else dict(worn.parameters)
    if spec.kind == "hexapod" and not by_stress(spec, parameters):
        parameters[method_name(spec)] = "stress"
    if spec.kind not in ("thimble", "hexapod"):
        raise DermisError(
            "a floor exists only for devices with a disc whose pose is searched",
            where=f"device preset '{options.device}'",
            value=spec.kind,
            limit="thimble, hexapod",
        )
    felt = skin_contacts(scene, {options.finger: finger_skin(finger.parameters, library.skin(DEFAULT_SKIN))})
    skin = felt[options.finger]
    use = prepare(spec, skin.pressed, parameters)
    times = skin.times[looked_at(len(skin.times))]
    found = drain_shown(floor_of(use, forces_at(skin, times), amounts_at(skin, times)), quiet=options.quiet)
    print(f"{finger.name}, {spec.name}, method {use.method}; simulated, {found.samples} touched samples")
    rows: list[tuple[str, Any]] = [("rendered", found.rendered), ("best pose found", found.best)]
    if found.lateral is not None:
        rows.append(("with lateral axes", found.lateral))
    print(f"{'':18}" + "".join(f"{name:>15}" for name in MEASURES))
    for name, errors in rows:
        print(f"{name:18}" + "".join(f"{100 * e:13.1f} %" for e in np.asarray(errors).tolist()))
    if options.out is not None:
        told = {"scene": scene.name, "finger": finger.name, "device": spec.key, "method": use.method}
        write_bytes(options.out, (json.dumps({**told, **found.as_dict()}, indent=2) + "\n").encode())
        print(options.out)
    return tell((*use.findings, *found.findings(f"finger '{finger.name}', {spec.key}")), sys.stderr)
