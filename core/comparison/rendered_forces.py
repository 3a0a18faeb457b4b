"""Forces of a device on the pad nodes, from its track.

The functions serve all kinds of devices that press on skin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.skin_contact import SkinContact
from ..devices.coupling import coupling_of
from ..interpolate import interpolate
from ..matching import pins
from ..matching.replay import Replay, configurations
from ..matching.table import press_of
from ..matching.thimble_use import by_stress, disc_device
from ..parameters.device import DEVICE
from ..track.command_track import CommandTrack


def rendered_forces(
    track: CommandTrack, skin: SkinContact, samples: NDArray[np.intp], parameters: Mapping[str, Any]
) -> Array:
    """Return the forces on the pad nodes while a track is played.

    The forces [N] have the shape (k, m, 3); see `rendered_touches`.
    """
    return rendered_touches(track, skin, samples, parameters)[0]


def rendered_touches(
    track: CommandTrack, skin: SkinContact, samples: NDArray[np.intp], parameters: Mapping[str, Any]
) -> tuple[Array, list[Array | None]]:
    """Return the effect on the skin while a track is played.

    A device that is matched by stress is replayed from its first sample, because friction depends on the history. Any
    other platform is pressed from rest at each sample.

    Args:
        samples: indices of the touch's samples, rising, shape (k,).
        parameters: settings of the device in the scene.

    Returns:
        Forces on the pad nodes [N], shape (k, m, 3), and `Stimulus.given` of each sample.

    Raises:
        DermisError: the device cannot play the track.
    """
    times = skin.times[samples]
    if track.spec.kind == "pin_array":
        ready = pins.setup(skin.model, track.spec, DEVICE["pin_nodes"].of(parameters))
        lead = float(track.meta.get("lead_s", 0.0))  # [s] time by which the track is ahead of the pins' forces
        pressed = interpolate(track.times, track.values, np.clip(times - lead, track.times[0], track.times[-1]))
        return np.stack([pins.rendered_force(ready, row) for row in pressed]), [None] * len(pressed)
    if by_stress(track.spec, parameters):
        device, friction = disc_device(track.spec, skin.pressed, parameters)
        replay = Replay(device, skin.pressed, friction, configurations(track, device))
        at = np.abs(track.times[None] - times[:, None]).argmin(axis=1)
        found = [replay.solution(i) for i in at.tolist()]
        return np.stack([replay.contact.nodal(each) for each in found]), [each.amounts for each in found]
    commands = interpolate(track.times, track.values, np.clip(times, track.times[0], track.times[-1]))
    coupling = coupling_of(track.spec)
    if coupling is not None:
        commands = coupling.original(commands)
    made = press_of(skin.model, track.spec).press(commands)
    given: list[Array | None] = [None] * len(commands)
    if made.amounts is not None:
        given = list(made.amounts.astype(np.float64))
    return made.force.astype(np.float64), given
