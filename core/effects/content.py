"""Moving contents of a held object: a child object, a pendulum, a liquid, a loose body.

The built-in contents are integrated at the device's own rate from rest at the first time, each by a rule that keeps
its invariants: the pendulum its length and, undamped, its energy; the liquid is an exact linear recursion; the
loose body flies in exact parabolas from wall to wall.

Source: [S3] eq. 5; the built-in bodies are decisions of Dermis
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..memory import Carry

# Bounces within one step; a body that would bounce more often lies still until the next.
MAX_BOUNCES = 8


def displacement(offset: Array, amplitude: float | Array) -> Array:
    """Return d = alpha_gamma oc, as a fraction of the device's range, shape (n, 3).

    Args:
        offset: oc, from the object's centre of gravity to the content's [m], in world axes, shape (n, 3).
        amplitude: alpha_gamma [1/m], one number or shape (n,).

    Source: [S3] eq. 5
    """
    return np.reshape(np.asarray(amplitude), (-1, 1)) * offset


def pendulum(
    times: Array, acceleration: Array, gravity: Array, length: float, damping: float, carry: Carry | None = None
) -> Array:
    """Return the offset of a point mass that hangs on a rod from a moving pivot [m], in world axes, shape (n, 3).

    Kicks by gravity and the pivot's acceleration alternate with exact arcs on the sphere (Strang splitting): the
    length is kept exactly, the energy of an undamped swing to second order without drift. Starts hanging at rest.

    Args:
        times: equally spaced [s], shape (n,).
        acceleration: acceleration of the pivot [m/s^2], shape (n, 3).
        gravity: [m/s^2], shape (3,); must not be 0.
        length: [m]. damping: ratio to the critical damping of a small swing.
        carry: how it goes on from a window of times before, and into the next; None: from rest.

    Raises:
        DermisError: no gravity, a length that is not above 0, or a damping below 0.
    """
    g = float(np.sqrt(np.dot(gravity, gravity)))
    _check(length, damping, g)
    step = _step(times)
    places: list[float] = []  # three a sample: a list takes a fifth of the time that rows of an array do
    ux, uy, uz = (float(v) / g for v in gravity)
    wx = wy = wz = 0.0
    keep = math.exp(-2.0 * damping * math.sqrt(g / length) * step)
    impulses = (np.asarray(gravity) - acceleration) * (step / length)
    carry = carry or Carry()
    if carry.start is None:
        impulses[0] *= 0.5  # velocities live between the samples
    else:
        ux, uy, uz, wx, wy, wz = carry.start
    sin, cos, sqrt, index = math.sin, math.cos, math.sqrt, carry.index
    for k, (ax, ay, az) in enumerate(impulses.tolist()):
        places += (ux, uy, uz)
        if k == index:
            carry.found = ux, uy, uz, wx, wy, wz
        wx, wy, wz = wx * keep + ax, wy * keep + ay, wz * keep + az
        along = wx * ux + wy * uy + wz * uz  # what would stretch the rod, rounding of the arc before included
        wx, wy, wz = wx - along * ux, wy - along * uy, wz - along * uz
        speed = sqrt(wx * wx + wy * wy + wz * wz)
        if speed > 0.0:
            angle = speed * step
            c, s = cos(angle), sin(angle)
            toward, back = s / speed, s * speed
            ux, uy, uz, wx, wy, wz = (
                ux * c + wx * toward,
                uy * c + wy * toward,
                uz * c + wz * toward,
                wx * c - ux * back,
                wy * c - uy * back,
                wz * c - uz * back,
            )
            # Rounding that leaves the sphere would grow from arc to arc: back to unit length.
            unit = 1.5 - 0.5 * (ux * ux + uy * uy + uz * uz)
            ux, uy, uz = ux * unit, uy * unit, uz * unit
    return length * np.array(places).reshape(-1, 3)


def slosh(
    times: Array,
    acceleration: Array,
    gravity: Array,
    length: float,
    damping: float,
    size: float,
    carry: Carry | None = None,
) -> tuple[Array, int]:
    """Return the offset of a liquid's centre of gravity [m], in world axes, shape (n, 3), and how often it was limited.

    The usual mechanical model of the first sloshing mode: a damped mass on a spring of the frequency of a pendulum of
    the given length, that moves in the plane perpendicular to gravity. The recursion is exact for an acceleration that
    is linear between times. The walls limit the offset to `size`.

    Args:
        times: equally spaced [s], shape (n,).
        acceleration: acceleration of the container [m/s^2], shape (n, 3).
        gravity: gravity [m/s^2], shape (3,); not zero.
        length: length of the pendulum with the same frequency [m].
        damping: damping ratio.
        size: half the size of the room [m].
        carry: how it goes on from a window of times before, and into the next; None: from rest.

    Raises:
        DermisError: no gravity, a length or size that is not above 0, or a damping below 0.
    """
    g = float(np.sqrt(np.dot(gravity, gravity)))
    _check(length, damping, g)
    _room(size)
    down = np.asarray(gravity) / g
    level = acceleration - (acceleration @ down)[:, None] * down
    offset = oscillator(_step(times), -level, math.sqrt(g / length), damping, carry)
    distance = np.sqrt(np.einsum("ij,ij->i", offset, offset))
    over = distance > size
    if over.any():
        offset[over] *= (size / distance[over])[:, None]
    return offset, int(over.sum())


def oscillator(step: float, force: Array, omega: float, damping: float, carry: Carry | None = None) -> Array:
    """Return x of x'' + 2 zeta omega x' + omega^2 x = force from rest, exact for a force linear between steps.

    The recursion is summed by doubling: after j passes every sample knows the last 2^j, in whole-array operations.

    Args:
        step: [s]. force: per mass, shape (n, k). omega: [rad/s]. damping: zeta.
        carry: how it goes on from a window of times before, and into the next; None: from rest.
    """
    # Place, speed, force and, as the fourth unknown, the change of force over one step; time in steps.
    system = np.zeros((4, 4))
    system[0, 1] = step
    system[1, :3] = -omega * omega * step, -2.0 * damping * omega * step, step
    system[2, 3] = 1.0
    grown = exponential(system)
    x, v = np.zeros_like(force), np.zeros_like(force)
    change = np.diff(force, axis=0)
    x[1:] = grown[0, 2] * force[:-1] + grown[0, 3] * change
    v[1:] = grown[1, 2] * force[:-1] + grown[1, 3] * change
    if carry is not None and carry.start is not None:
        x[0], v[0] = carry.start
    power, shift = grown[:2, :2], 1
    while shift < len(force) and np.abs(power).max() > 1e-18:
        early_x, early_v = x[:-shift].copy(), v[:-shift].copy()
        x[shift:] += power[0, 0] * early_x + power[0, 1] * early_v
        v[shift:] += power[1, 0] * early_x + power[1, 1] * early_v
        power, shift = power @ power, shift * 2
    if carry is not None:
        carry.found = x[carry.index].copy(), v[carry.index].copy()
    return x


def exponential(matrix: Array) -> Array:
    """Return the exponential of a small matrix by scaling, a Taylor series and squaring."""
    norm = float(np.abs(matrix).sum(axis=1).max())
    halvings = max(0, math.ceil(math.log2(norm)) + 3) if norm > 0.0 else 0
    small = matrix / 2.0**halvings
    term = result = np.eye(len(matrix))
    for k in range(1, 16):
        term = term @ small / k
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


def loose(
    times: Array,
    rotation: Array,
    angular_velocity: Array,
    acceleration: Array,
    gravity: Array,
    damping: float,
    size: float,
    carry: Carry | None = None,
) -> Array:
    """Return the offset of a body that flies and bounces in a cubic room [m], in world axes, shape (n, 3).

    The room is centred on the object's centre of gravity and turns with it. In its frame the body feels gravity, the
    room's acceleration and the forces of rotation, held over a step at their mean, so it flies in parabolas; a wall
    turns its speed back by 1 - damping at the exact instant. Walls are smooth. It starts at the centre, at rest with
    the room.

    Args:
        times: equally spaced [s], shape (n,).
        rotation: rotation of the room, shape (n, 3, 3).
        angular_velocity: angular velocity in world axes [rad/s], shape (n, 3).
        acceleration: acceleration of the room's centre [m/s^2], shape (n, 3).
        gravity: gravity [m/s^2], shape (3,).
        damping: 1 - restitution, 0 to 1. size: half size of the room [m].
        carry: how it goes on from a window of times before, and into the next; None: from rest.

    Raises:
        DermisError: a damping outside 0 to 1, or a size that is not above 0.
    """
    if not 0.0 <= damping <= 1.0:
        raise DermisError("a loose body's damping must lie between 0 and 1", value=damping, limit="0 to 1")
    _room(size)
    step = _step(times)
    restitution = 1.0 - damping
    specific_force = np.einsum("nji,nj->ni", rotation, gravity - acceleration)
    turn = np.einsum("nji,nj->ni", rotation, angular_velocity)
    mean = (specific_force[1:] + specific_force[:-1]) / 2.0
    turns, half = bool(turn.any()), 0.5 * step
    spins = ((turn[1:] + turn[:-1]) / 2.0).tolist() if turns else []
    changes = (np.diff(turn, axis=0) / step).tolist() if turns else []
    carry = carry or Carry()
    place, speed = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]) if carry.start is None else map(list, carry.start)
    places = [*place]
    for k, push in enumerate(mean.tolist()):
        if k == carry.index:
            carry.found = tuple(place), tuple(speed)
        if turns:
            w, dw = spins[k], changes[k]
            x, y, z = _turning(push, w, dw, place, speed)
            halfway = [speed[0] + half * x, speed[1] + half * y, speed[2] + half * z]
            between = [place[0] + half * speed[0], place[1] + half * speed[1], place[2] + half * speed[2]]
            push = _turning(push, w, dw, between, halfway)  # midpoint rule: second order
        for i in range(3):
            x, v, a = place[i], speed[i], push[i]
            end = x + step * (v + 0.5 * step * a)
            # Within the room at the end, and no turning point beyond a wall in between: free flight.
            if -size < end < size and (v * (v + a * step) >= 0.0 or -size < x - 0.5 * v * v / a < size):
                place[i], speed[i] = end, v + a * step
            else:
                place[i], speed[i] = bounce(x, v, a, step, size, restitution)
        places += place
    return np.einsum("nij,nj->ni", rotation, np.array(places).reshape(-1, 3))


def bounce(x: float, v: float, a: float, step: float, size: float, restitution: float) -> tuple[float, float]:
    """Move a body along one axis between two walls at +-size under a constant push; return place and speed.

    It rests against a wall that it is pushed to when it cannot leave it for as long as a step.
    """
    for _ in range(MAX_BOUNCES):
        wall = math.copysign(size, x)
        if abs(x) >= size and v * wall <= 0.0 and a * wall > 0.0 and 2.0 * abs(v) < abs(a) * step and restitution < 1.0:
            return wall, 0.0
        hit, wall = _next_wall(x, v, a, size)
        if hit >= step:
            return x + step * (v + 0.5 * step * a), v + a * step
        arrival = v + a * hit
        x, v, step = wall, -restitution * arrival, step - hit
    return x, 0.0 if restitution < 1.0 else v


def _next_wall(x: float, v: float, a: float, size: float) -> tuple[float, float]:
    """When a body next runs into a wall from inside, and which; inf if never."""
    first, where = math.inf, 0.0
    for wall in (size, -size):
        gap = wall - x
        outward = math.copysign(1.0, wall)
        if gap * outward <= 0.0 and (v * outward > 0.0 or (v == 0.0 and a * outward > 0.0)):
            return 0.0, wall  # at this wall already and on its way out
        discriminant = v * v + 2.0 * a * gap
        if discriminant < 0.0:
            continue
        # Both roots of a t^2 / 2 + v t = gap without cancellation.
        q = -(v + math.copysign(math.sqrt(discriminant), v))
        roots = ([q / a] if a != 0.0 else []) + ([-2.0 * gap / q] if q != 0.0 else [])
        for t in roots:
            if 0.0 < t < first and (v + a * t) * outward > 0.0:
                first, where = t, wall
    return first, where


def _turning(push: list[float], w: list[float], dw: list[float], r: list[float], v: list[float]) -> list[float]:
    """Add the centrifugal, Coriolis and Euler forces of a turning frame, per mass."""
    (wx, wy, wz), (dx, dy, dz), (x, y, z), (vx, vy, vz) = w, dw, r, v
    wr, ww = wx * x + wy * y + wz * z, wx * wx + wy * wy + wz * wz
    return [
        push[0] + ww * x - wr * wx - 2.0 * (wy * vz - wz * vy) - (dy * z - dz * y),
        push[1] + ww * y - wr * wy - 2.0 * (wz * vx - wx * vz) - (dz * x - dx * z),
        push[2] + ww * z - wr * wz - 2.0 * (wx * vy - wy * vx) - (dx * y - dy * x),
    ]


def _step(times: Array) -> float:
    return float((times[-1] - times[0]) / (len(times) - 1)) if len(times) > 1 else 0.0


def _check(length: float, damping: float, gravity: float) -> None:
    if not length > 0.0:
        raise DermisError("the length of a pendulum must be above 0", value=length, limit="> 0 m")
    if not damping >= 0.0:
        raise DermisError("the damping of a content must not be negative", value=damping, limit=">= 0")
    if not gravity > 0.0:
        raise DermisError(
            "a pendulum or a liquid needs gravity",
            value=gravity,
            limit="> 0 m/s^2",
            remedy="Switch gravity on in the Scene properties, or use a loose body",
        )


def _room(size: float) -> None:
    if not size > 0.0:
        raise DermisError("the room of a content must be above 0", value=size, limit="> 0 m")
