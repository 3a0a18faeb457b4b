"""Forces of a device on the pad nodes, from its track.

The functions serve all kinds of devices that press on skin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.skin_contact import SkinContact
from ..devices.coupling import coupling_of
from ..errors import Finding
from ..interpolate import interpolate
from ..matching import pins
from ..matching.replay import Replay, configurations, unsettled
from ..matching.table import press_of
from ..matching.thimble_use import by_stress, disc_device
from ..parameters.device import DEVICE
from ..track.command_track import CommandTrack


class RenderedTouches(NamedTuple):
    """Effect of a device on the skin at some samples of a touch.

    Attributes:
        forces: forces on the pad nodes [N], shape (k, m, 3).
        given: `Stimulus.given` of each sample.
        findings: samples in which the nonlinear law did not converge.
    """

    forces: Array
    given: list[Array | None]
    findings: tuple[Finding, ...] = ()


def rendered_forces(
    track: CommandTrack, skin: SkinContact, samples: NDArray[np.intp], parameters: Mapping[str, Any]
) -> Array:
    """Return the forces on the pad nodes while a track is played.

    The forces [N] have the shape (k, m, 3); see `rendered_touches`.
    """
    return rendered_touches(track, skin, samples, parameters).forces


def rendered_touches(
    track: CommandTrack, skin: SkinContact, samples: NDArray[np.intp], parameters: Mapping[str, Any]
) -> RenderedTouches:
    """Return the effect on the skin while a track is played.

    A device that is matched by stress is replayed from its first sample, because friction depends on the history. Any
    other platform is pressed from rest at each sample.

    Args:
        samples: indices of the touch's samples, rising, shape (k,).
        parameters: settings of the device in the scene.

    Raises:
        DermisError: the device cannot play the track.
    """
    times = skin.times[samples]
    if track.spec.kind == "pin_array":
        ready = pins.setup(skin.model, track.spec, DEVICE["pin_nodes"].of(parameters))
        lead = float(track.meta.get("lead_s", 0.0))  # [s] time by which the track is ahead of the pins' forces
        pressed = interpolate(track.times, track.values, np.clip(times - lead, track.times[0], track.times[-1]))
        made = np.stack([pins.rendered_force(ready, row) for row in pressed])
        law = ready.matcher.law
        off = np.flatnonzero([law is not None and not law.settles(force.ravel()) for force in made])
        return RenderedTouches(made, [None] * len(made), _told(off, samples, track))
    if by_stress(track.spec, parameters):
        device, friction = disc_device(track.spec, skin.pressed, parameters)
        replay = Replay(device, skin.pressed, friction, configurations(track, device))
        at = np.abs(track.times[None] - times[:, None]).argmin(axis=1)
        found = [replay.solution(i) for i in at.tolist()]
        forces, given = np.stack([replay.contact.nodal(each) for each in found]), [each.amounts for each in found]
        return RenderedTouches(forces, given, replay.findings(track.spec.name))
    commands = interpolate(track.times, track.values, np.clip(times, track.times[0], track.times[-1]))
    coupling = coupling_of(track.spec)
    if coupling is not None:
        commands = coupling.original(commands)
    poses = press_of(skin.model, track.spec).press(commands)
    given = [None] * len(commands) if poses.amounts is None else list(poses.amounts.astype(np.float64))
    told = _told(np.flatnonzero(poses.left > 0.0), samples, track)
    return RenderedTouches(poses.force.astype(np.float64), given, told)


def _told(off: NDArray[np.intp], samples: NDArray[np.intp], track: CommandTrack) -> tuple[Finding, ...]:
    """Return the finding for some of the samples, at which the law did not converge; none for no samples.

    Args:
        off: indices of these samples in `samples`, rising.
        samples: see `rendered_touches`.
        track: the track that is played.
    """
    return unsettled(len(off), track.spec.name, int(samples[off[0]]) if len(off) else 0)
