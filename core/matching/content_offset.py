"""Position of an object's content over time: animated child objects, or a simulated body."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..contact.pad_contact import PadContact
from ..effects import content
from ..errors import DermisError, Finding
from ..parameters.material import BODY
from ..scene.tactile_scene import TactileScene


def content_offset(
    pad_contact: PadContact, scene: TactileScene, b: int, times: Array, acceleration: Array
) -> tuple[Array, tuple[Finding, ...]]:
    """Return the offset oc of a body's content, in world axes [m], shape (n, 3), and findings.

    The offset leads from the body's centre of gravity to that of its content.

    Args:
        pad_contact: contact of the pads over the whole range.
        scene: the scene's header.
        b: index of the body.
        times: time of each sample [s], shape (n,).
        acceleration: acceleration of the body's centre of gravity [m/s^2], shape (n, 3).

    Raises:
        DermisError: the kind of content is unknown, or its motion cannot be computed with the given values.

    Source: [S3] eq. 5, oc
    """
    body = scene.bodies[b]
    kind = BODY["content_kind"].of(body.parameters, f"object '{body.name}'")
    if kind == "child":
        return _of_children(pad_contact, scene, b, times)
    names = ("content_length", "content_damping", "content_size")
    length, damping, size = (_constant(pad_contact, scene, b, name, times) for name in names)
    gravity = np.asarray(scene.gravity)
    try:
        with pad_contact.carry(("content", b), times) as carry:
            if kind == "pendulum":
                return content.pendulum(times, acceleration, gravity, length, damping, carry), ()
            if kind == "slosh":
                offset, limited = content.slosh(times, acceleration, gravity, length, damping, size, carry)
                return offset, _walls(body.name, limited)
            there = pad_contact.body_at(b, times)
            turning = there.rotation, there.angular_velocity
            return content.loose(times, *turning, acceleration, gravity, damping, size, carry), ()
    except DermisError as error:
        raise error.changed(where=f"object '{body.name}'") from error


def _of_children(
    pad_contact: PadContact, scene: TactileScene, b: int, times: Array
) -> tuple[Array, tuple[Finding, ...]]:
    """Return the offset to the common centre of gravity of the body's touchable children, and findings."""
    body = scene.bodies[b]
    names = [other.name for other in scene.bodies]
    children = [names.index(name) for name in body.content if name in names]
    if not children:
        missing = [name for name in body.content if name not in names]
        nothing = Finding(
            "warning",
            "no-content",
            "the object has no touchable child, so no content is felt",
            f"object '{body.name}'",
            value=", ".join(missing) or None,
            remedy="Parent a touchable object to it, or choose another content",
        )
        return np.zeros((len(times), 3)), (nothing,)
    row, bodies = BODY["mass"], scene.bodies
    given = (pad_contact.series(f"body/{c}", row, bodies[c].parameters, times) for c in children)
    masses = np.array([np.broadcast_to(mass, times.shape) for mass in given])
    masses[:, masses.sum(axis=0) <= 0.0] = 1.0
    paths = [pad_contact.centre(c, bodies[c].mesh).at(times) for c in children]
    shares = (masses / masses.sum(axis=0))[:, :, None]
    middle = sum((share * path for share, path in zip(shares, paths, strict=True)), np.zeros((1, 3)))
    return middle - pad_contact.centre(b, body.mesh).at(times), ()


def _walls(name: str, limited: int) -> tuple[Finding, ...]:
    if not limited:
        return ()
    return (
        Finding(
            "info",
            "content-limited",
            "the content reached the walls of its room and was held there",
            f"object '{name}'",
            count=limited,
            remedy="Make the room larger, or the length of the liquid shorter",
        ),
    )


def _constant(pad_contact: PadContact, scene: TactileScene, b: int, name: str, times: Array) -> float:
    """Return a parameter's first value, for a quantity that must not change during time integration."""
    return float(np.ravel(pad_contact.series(f"body/{b}", BODY[name], scene.bodies[b].parameters, times))[0])
