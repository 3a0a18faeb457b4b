"""Times at which an object counts as held, by the modes of its parameter `held_mode`.

* 'auto': opposed fingers hold it. A finger holds a body while both it and another finger touch the body, with outward
  normals at least 120 degrees apart, such as thumb and index on two sides of a cube. A finger that rests on top does
  not hold it.
* 'keyed': all fingers that touch the body hold it while its animated parameter `held` is on.
* 'never': it is never held.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..parameters.finger import FINGER
from ..parameters.material import BODY
from ..scene.tactile_scene import TactileScene
from .encounter import Encounter, encounter
from .pad_contact import PadContact

# Two normals are opposed if the cosine of their angle is at most this: 120 degrees.
OPPOSED = -0.5


def meet(pad_contact: PadContact, scene: TactileScene, finger: int, body: int, times: Array) -> Encounter | None:
    """Return the encounter of a finger and a body at the finger's touch distance, or None if they never touch."""
    if (finger, body) not in pad_contact.pairs:
        return None
    given = scene.fingers[finger].parameters
    distance = pad_contact.series(f"finger/{finger}", FINGER["touch_distance"], given, times)
    return encounter(pad_contact, finger, body, times, distance)


def holding_times(
    pad_contact: PadContact, scene: TactileScene, finger: int, body: int, times: Array
) -> NDArray[np.bool_] | None:
    """Return whether a finger holds a body at given times, shape (m,); None if it never does.

    Args:
        pad_contact: contact of the pads over the whole range.
        scene: the scene's header.
        finger, body: indices of the pair.
        times: times [s], shape (m,).

    Raises:
        DermisError: the `held_mode` is unknown.
    """
    parameters = scene.bodies[body].parameters
    mode = BODY["held_mode"].of(parameters, f"object '{scene.bodies[body].name}'")
    if mode == "never":
        return None
    own = meet(pad_contact, scene, finger, body, times)
    if own is None:
        return None
    if mode == "keyed":
        switch = pad_contact.series(f"body/{body}", BODY["held"], parameters, times)
        holds = own.touching & (np.asarray(switch) > 0.5)
    else:
        holds = np.zeros(len(times), dtype=bool)
        for other in range(len(scene.fingers)):
            theirs = None if other == finger else meet(pad_contact, scene, other, body, times)
            if theirs is not None:
                holds |= own.touching & theirs.touching & _opposed(pad_contact, finger, other, body, times)
    return holds if np.count_nonzero(holds) else None


def _opposed(pad_contact: PadContact, finger: int, other: int, body: int, times: Array) -> NDArray[np.bool_]:
    """Return whether two fingers' normals are opposed at the sample nearest to each time, shape (m,)."""
    first, second = sorted((finger, other))

    def at_times() -> NDArray[np.bool_]:
        a, b = pad_contact.pairs[first, body].normal, pad_contact.pairs[second, body].normal
        samples = np.einsum("ij,ij->i", a, b) <= OPPOSED
        if samples.all() or not samples.any():
            return np.full(len(times), bool(samples[0]))
        middles = (pad_contact.times[1:] + pad_contact.times[:-1]) / 2.0
        return samples[np.searchsorted(middles, times)]

    known: tuple[Array, NDArray[np.bool_]] | None = pad_contact.kept.get(("opposed", first, second, body, len(times)))
    if known is None or not (known[0] is times or np.array_equal(known[0], times)):
        known = pad_contact.kept["opposed", first, second, body, len(times)] = (times, at_times())
    return known[1]
