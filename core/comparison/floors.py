"""The floor of each device that is searched for a pose, beside the comparison's error."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import Any

from ..contact.skin_contact import SkinContact
from ..devices.spec import DeviceSpec
from ..matching.floor import Floor, floor_of, looked_at
from ..matching.thimble import amounts_at, forces_at
from ..matching.thimble_use import by_stress, method_name, prepare
from ..pipeline.bake import Progress
from ..steps import in_words

SEARCHED = ("thimble", "hexapod")


def floor_in(
    spec: DeviceSpec, skin: SkinContact | None, parameters: Mapping[str, Any]
) -> Generator[Progress, None, Floor | None]:
    """Find the floor of a device for a touch; yield progress, return None where it is not searched for a pose.

    Six legs that are looked up are searched for once: their floor is the same.

    Raises:
        DermisError: a device that cannot touch this finger.
    """
    if skin is None or spec.kind not in SEARCHED or not len(skin.contact):
        return None
    given = dict(parameters)
    if not by_stress(spec, given):
        given[method_name(spec)] = "stress"
    times = skin.times[looked_at(len(skin.times))]
    forces = forces_at(skin, times)
    if not forces.any():
        return None
    steps = floor_of(prepare(spec, skin.pressed, given), forces, amounts_at(skin, times))
    return (yield from in_words(steps, lambda step: Progress(f"{spec.key}, {step.stage}", step.done, step.total)))
