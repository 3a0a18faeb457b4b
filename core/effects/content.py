"""Moving contents of a held object: pendulum, liquid, loose body.

A child object may be a content too. The built-in contents start at rest at the first time and are integrated at the
device's rate. The pendulum keeps its length exactly. Without damping it also keeps its energy, to second order and
without drift. The liquid is an exact linear recursion. The loose body flies in exact parabolas from wall to wall.

Source: [S3] eq. 5; the built-in bodies are decisions of Dermis
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..memory import Carry

# Largest number of bounces in one step. A body that would bounce more often stays at the wall until the next step.
MAX_BOUNCES = 8


def displacement(offset: Array, amplitude: float | Array) -> Array:
    """Return the displacement d = alpha_gamma oc, shape (n, 3).

    It is a fraction of the device's range.

    Args:
        offset: oc, vector from the object's centre of gravity to that of the content [m], in world axes, shape (n, 3).
        amplitude: alpha_gamma [1/m], one number or shape (n,).

    Source: [S3] eq. 5
    """
    return np.reshape(np.asarray(amplitude), (-1, 1)) * offset


def pendulum(
    times: Array, acceleration: Array, gravity: Array, length: float, damping: float, carry: Carry | None = None
) -> Array:
    """Return the offset of a pendulum's mass from its moving pivot [m].

    The offset is in world axes, shape (n, 3). A point mass hangs on a rod, at rest at the first time. Kicks by gravity
    and by the pivot's acceleration alternate with exact arcs on the sphere (Strang splitting). The length is kept
    exactly, and the energy of an undamped swing is kept to second order, without drift.

    Args:
        times: equally spaced times [s], shape (n,).
        acceleration: acceleration of the pivot [m/s^2], shape (n, 3).
        gravity: gravity [m/s^2], shape (3,); not zero.
        length: length of the rod [m].
        damping: ratio to the critical damping of a small swing.
        carry: state from the window of times before, and for the next window; None to start at rest.

    Raises:
        DermisError: gravity is zero, the length is not above 0, or the damping is below 0.
    """
    g = float(np.sqrt(np.dot(gravity, gravity)))
    _check(length, damping, g)
    step = _step(times)
    places: list[float] = []  # three per sample; a list takes a fifth of the time of rows of an array
    ux, uy, uz = (float(v) / g for v in gravity)
    wx = wy = wz = 0.0
    keep = math.exp(-2.0 * damping * math.sqrt(g / length) * step)
    impulses = (np.asarray(gravity) - acceleration) * (step / length)
    carry = carry or Carry()
    if carry.start is None:
        impulses[0] *= 0.5  # velocities are between the samples, so the first kick is half as long
    else:
        ux, uy, uz, wx, wy, wz = carry.start
    sin, cos, sqrt, index = math.sin, math.cos, math.sqrt, carry.index
    for k, (ax, ay, az) in enumerate(impulses.tolist()):
        places += (ux, uy, uz)
        if k == index:
            carry.found = ux, uy, uz, wx, wy, wz
        wx, wy, wz = wx * keep + ax, wy * keep + ay, wz * keep + az
        along = wx * ux + wy * uy + wz * uz  # would stretch the rod; includes rounding of the last arc
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
            # Rounding moves the mass off the sphere, which would grow from arc to arc. Restore the unit length.
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
    """Return the offset of a liquid's centre of gravity [m].

    The offset is in world axes, shape (n, 3). The number of samples at which it was limited is returned too.

    The model is the usual mechanical one of the first sloshing mode: a damped mass on a spring that moves in the plane
    perpendicular to gravity. Its frequency is that of a pendulum of the given length. The recursion is exact for an
    acceleration that is linear between times. The walls limit the offset to `size`.

    Args:
        times: equally spaced times [s], shape (n,).
        acceleration: acceleration of the container [m/s^2], shape (n, 3).
        gravity: gravity [m/s^2], shape (3,); not zero.
        length: length of the pendulum with the same frequency [m].
        damping: damping ratio.
        size: half the size of the room [m].
        carry: state from the window of times before, and for the next window; None to start at rest.

    Raises:
        DermisError: gravity is zero, the length or the size is not above 0, or the damping is below 0.
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
    """Return the positions of a damped oscillator [m], shape (n, k).

    They solve x'' + 2 zeta omega x' + omega^2 x = force, exactly if the force is linear between samples. The recursion
    is summed by doubling, with operations on whole arrays: after j passes, each sample includes the effect of the last
    2^j samples.

    Args:
        step: time between samples [s].
        force: force per mass [m/s^2], shape (n, k).
        omega: angular frequency without damping [rad/s].
        damping: zeta, ratio to the critical damping.
        carry: state from the window of times before, and for the next window; None to start at rest.
    """
    # The unknowns are position, speed, force, and the change of the force over one step. Time is counted in steps.
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
    """Return the exponential of a small matrix.

    It is computed by scaling, a Taylor series and squaring.
    """
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
    """Return the offset of a body that flies and bounces in a cubic room [m].

    The offset is in world axes, shape (n, 3). The room is centred on the object's centre of gravity and turns with the
    object. In the frame of the room, gravity, the acceleration of the room and the forces of rotation act on the body.
    They are constant over a step, at their mean, so the body flies in parabolas. At the exact instant of an impact the
    speed towards the wall is reversed and multiplied by 1 - damping. Walls have no friction. At first the body is at
    the centre, at rest in the room.

    Args:
        times: equally spaced times [s], shape (n,).
        rotation: rotation of the room, shape (n, 3, 3).
        angular_velocity: angular velocity in world axes [rad/s], shape (n, 3).
        acceleration: acceleration of the room's centre [m/s^2], shape (n, 3).
        gravity: gravity [m/s^2], shape (3,).
        damping: 1 - restitution, 0 to 1.
        size: half the size of the room [m].
        carry: state from the window of times before, and for the next window; None to start at rest.

    Raises:
        DermisError: the damping is not between 0 and 1, or the size is not above 0.
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
            # Free flight: the end of the step is inside the room, and so is a turning point on the way.
            if -size < end < size and (v * (v + a * step) >= 0.0 or -size < x - 0.5 * v * v / a < size):
                place[i], speed[i] = end, v + a * step
            else:
                place[i], speed[i] = bounce(x, v, a, step, size, restitution)
        places += place
    return np.einsum("nij,nj->ni", rotation, np.array(places).reshape(-1, 3))


def bounce(x: float, v: float, a: float, step: float, size: float, restitution: float) -> tuple[float, float]:
    """Return position and speed of a body after a step between two walls.

    The body moves along one axis with constant acceleration. If the acceleration presses it against a wall and it would
    bounce back to the wall before the end of the step, it rests at the wall, unless the restitution is 1.

    Args:
        x: position at the start [m].
        v: speed at the start [m/s].
        a: acceleration [m/s^2].
        step: duration of the step [s].
        size: the walls are at +-size [m].
        restitution: speed after an impact divided by the speed before it.
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
    """Return the time to the next impact on a wall [s], and the wall [m].

    The time is inf if there is no impact.
    """
    first, where = math.inf, 0.0
    for wall in (size, -size):
        gap = wall - x
        outward = math.copysign(1.0, wall)
        if gap * outward <= 0.0 and (v * outward > 0.0 or (v == 0.0 and a * outward > 0.0)):
            return 0.0, wall  # already at this wall, and moving or pushed outwards
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
    """Return the acceleration of a body in a turning frame [m/s^2].

    Args:
        push: acceleration without the forces of rotation [m/s^2].
        w: angular velocity of the frame [rad/s].
        dw: angular acceleration of the frame [rad/s^2].
        r: position of the body in the frame [m].
        v: velocity of the body in the frame [m/s].
    """
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
        raise DermisError("the size of a content's space must be above 0", value=size, limit="> 0 m")
