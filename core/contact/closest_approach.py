"""A finding about fingers that touch nothing in a whole range, with the closest approach.

Distances are looked up only if nothing was touched. Within the search radius a pad's gap is known; beyond it, the
distance from the pad's centre to the body's bounding box is a lower bound.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import Finding
from ..parameters.finger import FINGER
from ..scene.tactile_scene import TactileScene
from .pad_contact import PadContact
from .surfaces import bounds_in_world, box_distances, box_of, boxes_in_world

if TYPE_CHECKING:
    from .skin_contact import SkinContact


class Approach(NamedTuple):
    """The place at which a pad and a body come closest.

    Attributes:
        distance: between the pad's centre and the body [m]; a lower bound if it is not `exact`.
        finger, body: indices of the pair.
        sample: index of the sample.
        exact: whether the distance was measured to the surface, not to the bounding box.
    """

    distance: float
    finger: int
    body: int
    sample: int
    exact: bool


def nothing_touched(
    scene: TactileScene, pad_contact: PadContact, felt: Mapping[int, SkinContact], pads: Collection[int]
) -> tuple[Finding, ...]:
    """Return a finding if fingers should feel something, and none of them touches anything.

    Args:
        scene: the scene's header.
        pad_contact: contact of the pads over the whole range.
        felt: contact of the skins, by the index of the finger. Such a finger touches if its skin carries force.
        pads: indices of the fingers with devices that follow the pad's centre. Such a finger touches if its pad is
            within its touch distance.
    """
    fingers = sorted({*felt, *pads})
    if any(len(contact.contact) for contact in felt.values()):
        return ()
    for (f, _), pair in pad_contact.pairs.items():
        if f in pads or f in felt:
            given = scene.fingers[f].parameters
            distance = pad_contact.series(f"finger/{f}", FINGER["touch_distance"], given, pad_contact.times)
            if (pair.gap <= (distance if f in pads else 0.0)).any():
                return ()
    closest = min(_approaches(scene, pad_contact, fingers), default=None)
    if closest is None:  # there is no body or no such finger
        return ()
    names = ", ".join(f"'{scene.fingers[f].name}'" for f in fingers)
    one, far = scene.fingers[closest.finger].name, closest.distance
    length = f"{1e3 * far:.3g} mm" if far < 0.1 else f"{far:.3g} m"
    time = float(pad_contact.times[closest.sample])
    value = f"{'' if closest.exact else 'at least '}{length} between finger '{one}' and object"
    return (
        Finding(
            "info",
            "nothing-touched",
            "nothing is touched in the whole range, so all that follows touch is at rest",
            f"finger{'s' if len(fingers) > 1 else ''} {names}",
            f"{value} '{scene.bodies[closest.body].name}' at the nearest, at {time:.3g} s",
            remedy="Check the units of paths and objects, which are metres, and the range of frames",
            frame=float(pad_contact.frames[closest.sample]),
        ),
    )


def _approaches(scene: TactileScene, pad_contact: PadContact, fingers: list[int]) -> Iterator[Approach]:
    """Yield approaches, among them the closest one."""
    if not fingers:
        return
    for (f, b), pair in pad_contact.pairs.items():
        if f in fingers:
            gap = np.abs(pair.gap)
            yield Approach(float(gap.min()), f, b, int(gap.argmin()), True)
    for (f, b), (distance, sample) in pad_contact.apart.items():
        if f in fingers and (f, b) not in pad_contact.pairs:
            yield Approach(distance, f, b, sample, False)
    deforming = {b for _, b in pad_contact.apart}
    rigid = [b for b, body in enumerate(scene.bodies) if body.mesh is not None and b not in deforming]
    if not rigid:
        return
    boxes = np.array([box_of(scene.bodies[b].mesh) for b in rigid])  # type: ignore[arg-type]
    low, high = bounds_in_world(pad_contact.bodies[rigid], boxes)
    for f in fingers:
        pad = pad_contact.fingers[f, :, :3, 3]
        over = np.maximum(low - pad.max(axis=0), pad.min(axis=0) - high).clip(min=0.0)
        least, best = np.sqrt((over * over).sum(axis=1)), np.inf
        for k in np.argsort(least, kind="stable").tolist():
            if least[k] >= best:
                break  # every other body stays farther away
            if (f, rigid[k]) not in pad_contact.pairs:
                apart = box_distances(pad, *boxes_in_world(pad_contact.bodies[rigid[k]], boxes[k]))
                best = min(best, float(apart.min()))
                yield Approach(float(apart.min()), f, rigid[k], int(apart.argmin()), False)
