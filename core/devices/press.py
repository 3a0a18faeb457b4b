"""Many poses of a platform pressed into the skin at once, each coming from rest.

A platform is a rigid disc under the pad, in a frame parallel to the finger's whose face looks along +Z, carried by
something: rigid legs, or cables and springs that give way. Giving way enters the contact problem as a compliance of
rank six, w = (C + J P J') f + b, so that platform and skin are in balance together.

Each row is a path of its own: from rest to the first touch without contact, then in `steps` equal parts into the skin,
with friction's memory from part to part as in `contact.path`. The rows of a batch go through the alternating method
side by side: one matrix product for all of them.

Source: [S2] III.A (data collection); method as in `contact.admm`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

ROUNDING = 1.0e-3  # [m] radius by which the disc's rim falls away
TOLERANCE = 2e-4  # of the iteration, relative to the forces of a row: below the last of 12 bits
MAX_ITERATIONS = 240
CHECK_EVERY = 6
RELAXATION = 1.7
STEPS = 3
LINEARISATIONS = 4
BALANCE = 2e-3  # [N] that may be left over on a platform that gives way
BATCH = 256
TOUCH_MARGIN = 0.02  # the path in contact begins this share of the whole before the first touch


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of a platform in the finger's frame: rotation (n, 3, 3), centre [m] (n, 3)."""

    rotation: Array
    centre: Array

    def __len__(self) -> int:
        return len(self.centre)

    def take(self, rows: NDArray[np.intp]) -> Poses:
        """Return some of the poses."""
        return Poses(self.rotation[rows], self.centre[rows])

    def moved(self, twist: Array) -> Poses:
        """Return the poses after a small movement about the finger's origin: shift [m], turn [rad], shape (n, 6)."""
        turn = rotation(twist[:, 3:])
        return Poses(turn @ self.rotation, np.einsum("nij,nj->ni", turn, self.centre) + twist[:, :3])


class Carrier(Protocol):
    """What carries a platform."""

    @property
    def disc_radius(self) -> float:
        """Radius of the face that touches [m]."""
        ...

    @property
    def rest(self) -> Array:
        """Command of the reference configuration, shape (motors,)."""
        ...

    def carry(self, commands: Array, start: Poses) -> Poses:
        """Return where the platform is without load, for commands (n, motors), found from poses nearby."""
        ...

    def give(self, commands: Array, poses: Poses, *, first: bool) -> tuple[Array, Array] | None:
        """Return what carries the platform at poses that need not be in balance; None where it is rigid.

        Args:
            first: poses are a first guess, from which nobody should conclude that a cable hangs slack.

        Returns:
            Force [N] and moment about the finger's origin [N m] on the platform, shape (n, 6), and P, its movement
            (shift, turn) for a load, symmetric, shape (n, 6, 6).
        """
        ...

    def rest_poses(self, count: int) -> Poses:
        """Return the reference configuration, `count` times."""
        ...


@dataclass(frozen=True, eq=False)
class Pressed:
    """Rows after pressing.

    Attributes:
        force: on the skin at the pad nodes [N], shape (n, m, 3), float32.
        displacement: of the pad nodes [m], shape (n, m, 3), float32.
        poses: of the platform, in balance.
        touching: shape (n,).
        residual: |f - P(f - w / rho)| / |f| of the contact, shape (n,).
        imbalance: force on the platform left over [N], shape (n,).
    """

    force: Floats
    displacement: Floats
    poses: Poses
    touching: NDArray[np.bool_]
    residual: Array
    imbalance: Array


class Press:
    """Presses one skin with one platform.

    Args:
        compliance: of the pad nodes [m/N], shape (3 m, 3 m).
        positions: undeformed pad nodes in the finger's frame [m], shape (m, 3).
        carrier: what carries the platform.
        friction: Coulomb's coefficient.
        steps: parts of the path in contact.

    Raises:
        DermisError: shapes that do not fit, negative friction, or no step.
    """

    def __init__(
        self, compliance: Array, positions: Array, carrier: Carrier, friction: float, *, steps: int = STEPS
    ) -> None:
        m = len(positions)
        if compliance.shape != (3 * m, 3 * m):
            raise DermisError("the compliance does not fit the nodes", where="platform", value=compliance.shape)
        if not (np.isfinite(friction) and friction >= 0.0):
            raise DermisError("friction cannot be negative", where="platform", value=friction, limit=">= 0")
        if steps < 1:
            raise DermisError("too few steps", where="platform", value=steps, limit=">= 1")
        self.positions, self.carrier, self.friction, self.steps = positions, carrier, float(friction), int(steps)
        self.count = m
        # by component, so that each component of a batch is one block of columns
        order = np.arange(3 * m).reshape(m, 3).T.ravel()
        ends = np.linalg.eigvalsh(compliance)[[0, -1]]
        if not ends[0] > 0.0:
            raise DermisError("the compliance is not positive definite", where="platform", value=float(ends[0]))
        self._rho = float(np.sqrt(ends[0] * ends[1]))
        c = compliance[order][:, order]
        x, y, z = positions.T
        o, e = np.zeros(m), np.ones(m)
        # how a node of the platform moves: shift + turn x position
        self._jacobian = np.concatenate([
            np.column_stack([e, o, o, o, z, -y]), np.column_stack([o, e, o, -z, o, x]),
            np.column_stack([o, o, e, y, -x, o]),
        ])  # fmt: skip
        inverse = np.linalg.inv(c + self._rho * np.eye(3 * m))
        spread = inverse @ self._jacobian
        self._gram = self._jacobian.T @ spread
        self._compliance = np.ascontiguousarray(c, np.float32)
        self._inverse = np.ascontiguousarray(np.hstack([inverse, spread]), np.float32)
        self._spread = np.ascontiguousarray(spread.T, np.float32)

    def press(self, commands: Array, *, via: Array | None = None) -> Pressed:
        """Press rows from rest, in batches.

        Args:
            commands: shape (n, motors).
            via: commands that each row goes to first and then comes back from, shape (n, motors); None for straight.
        """
        parts = [
            self._batch(commands[i : i + BATCH], None if via is None else via[i : i + BATCH])
            for i in range(0, len(commands), BATCH)
        ]
        if not parts:
            m = self.count
            none = np.zeros((0, m, 3), np.float32)
            return Pressed(none, none, self.carrier.rest_poses(0), np.zeros(0, bool), np.zeros(0), np.zeros(0))
        return Pressed(
            np.concatenate([p.force for p in parts]), np.concatenate([p.displacement for p in parts]),
            Poses(np.concatenate([p.poses.rotation for p in parts]), np.concatenate([p.poses.centre for p in parts])),
            np.concatenate([p.touching for p in parts]), np.concatenate([p.residual for p in parts]),
            np.concatenate([p.imbalance for p in parts]),
        )  # fmt: skip

    def gap(self, poses: Poses) -> Array:
        """Return the gap of every undeformed node [m], shape (n, m)."""
        return self._local(poses)[1]

    # -- a batch -----------------------------------------------------------------------------------------------------

    def _batch(self, commands: Array, via: Array | None) -> Pressed:
        n, m = len(commands), self.count
        rest = np.broadcast_to(self.carrier.rest, commands.shape)
        start = self.carrier.rest_poses(n)
        legs = [commands] if via is None else [via, commands]
        free = self.carrier.carry(legs[0], start)
        before, after = self.gap(start).min(axis=1), self.gap(free).min(axis=1)
        share = np.where(after < 0.0, before / np.maximum(before - after, 1e-12), 1.0) - TOUCH_MARGIN
        share = np.clip(share, 0.0, 1.0)[:, None]
        touch = rest + share * (legs[0] - rest)
        part = (1.0 - share) * start.centre + share * free.centre
        near = self.carrier.carry(touch, Poses(free.rotation, part))
        state = _State(self, near)
        path = [touch + (legs[0] - touch) * (k / self.steps) for k in range(1, self.steps + 1)]
        if via is not None:
            path += [via + (commands - via) * (k / self.steps) for k in range(1, self.steps + 1)]
        with np.errstate(over="ignore", invalid="ignore"):  # a row may have no balance; the others go on
            for k, command in enumerate(path):
                state.step(command, last=k == len(path) - 1)
        force = np.ascontiguousarray(state.force.reshape(n, 3, m).transpose(0, 2, 1))
        moved = np.ascontiguousarray(state.image.reshape(n, 3, m).transpose(0, 2, 1))
        touching = np.asarray(force.any(axis=(1, 2)))
        return Pressed(force, moved, state.poses, touching, state.residual, state.imbalance)

    def _local(self, poses: Poses) -> tuple[Array, Array]:
        """Return nodes in the platform's frame, (n, m, 3), and their gaps, (n, m) [m]."""
        local = (self.positions[None] - poses.centre[:, None]) @ poses.rotation
        over = np.maximum(np.sqrt(local[:, :, 0] ** 2 + local[:, :, 1] ** 2) - self.carrier.disc_radius, 0.0)
        return local, local[:, :, 2] + over * over * (0.5 / ROUNDING)


class _State:
    """A batch between two steps: poses, forces, and the points of the platform that nodes stick to."""

    def __init__(self, press: Press, poses: Poses) -> None:
        self.press, self.free, self.poses = press, poses, poses
        n, m = len(poses), press.count
        self.anchor = press._local(poses)[0][:, :, :2]
        self.deflection = np.zeros((n, 6))
        self.force = np.zeros((n, 3 * m), np.float32)
        self.shift = np.zeros((n, 3 * m), np.float32)  # y of the method
        self.image = np.zeros((n, 3 * m), np.float32)
        self.sticking = np.zeros((n, m), bool)
        self.residual = np.zeros(n)
        self.imbalance = np.zeros(n)

    def step(self, commands: Array, *, last: bool) -> None:
        """Go to the next commands; at the last the platform's balance is linearised anew until it holds."""
        press = self.press
        self.free = press.carrier.carry(commands, self.free)
        self.poses = self.free.moved(self.deflection)
        for k in range(LINEARISATIONS if last else 1):
            given = press.carrier.give(commands, self.poses, first=k == 0)
            local, gap = press._local(self.poses)
            offset = local.copy()
            offset[:, :, :2] -= self.anchor
            offset[:, :, 2] = gap
            offset = (offset @ self.poses.rotation.transpose(0, 2, 1)).transpose(0, 2, 1).reshape(len(gap), -1)
            if given is not None:
                ahead = np.einsum("nij,nj->ni", given[1], given[0])  # where the carrier would go without contact
                offset -= ahead @ press._jacobian.T
            rows = np.flatnonzero((gap.min(axis=1) < 0.0) | self.force.any(axis=1))
            if len(rows):
                self._solve(rows, offset, self.poses.rotation[:, :, 2], None if given is None else given[1])
            if given is None:
                break
            load = self._load()
            movement = np.einsum("nij,nj->ni", given[1], given[0] + load)
            self.poses = self.poses.moved(movement)
            self.deflection += movement
            if last:
                after = press.carrier.give(commands, self.poses, first=False)
                assert after is not None
                self.imbalance = np.linalg.norm((after[0] + load)[:, :3], axis=1)
                if self.imbalance.max(initial=0.0) <= BALANCE:
                    break
        self._settle()

    def _load(self) -> Array:
        """Force and moment of the skin on the platform, shape (n, 6)."""
        return -(self.force.astype(np.float64) @ self.press._jacobian)

    def _settle(self) -> None:
        """Nodes that stick keep their anchor, all others take it along."""
        local = self.press._local(self.poses)[0]
        moved = self.image.reshape(len(local), 3, -1).transpose(0, 2, 1) @ self.poses.rotation
        now = local[:, :, :2] + moved[:, :, :2]
        self.anchor = np.where(self.sticking[:, :, None], self.anchor, now)

    def _solve(self, rows: NDArray[np.intp], offset: Array, normal: Array, gives: Array | None) -> None:
        """Iterate a batch's contact; rows leave as they settle."""
        press, m = self.press, self.press.count
        rho = np.float32(press._rho)
        self.sticking[:] = False
        core = None
        if gives is not None:
            core = gives[rows]
            core = (core @ np.linalg.inv(np.eye(6) + press._gram @ core)).astype(np.float32)  # Woodbury
        b = offset[rows].astype(np.float32)
        n = normal[rows].astype(np.float32)
        z, y = self.force[rows].copy(), self.shift[rows].copy()
        active = np.arange(len(rows))
        residual = np.ones(len(rows))
        for iteration in range(1, MAX_ITERATIONS + 1):
            right = z - y
            right *= rho
            right -= b
            product = right @ press._inverse
            f = product[:, : 3 * m]
            if core is not None:
                f = f - np.matmul(core, product[:, 3 * m :, None])[:, :, 0] @ press._spread
            v: Floats = np.multiply(f, np.float32(RELAXATION))
            v += (1.0 - RELAXATION) * z
            v += y
            new, stick = _projected(v, n, press.friction, m)
            check = iteration % CHECK_EVERY == 0 or iteration == MAX_ITERATIONS
            if check:
                size = np.maximum(np.einsum("ij,ij->i", new, new), 1e-16)
                d, e = f - new, z - new
                left = np.sqrt((np.einsum("ij,ij->i", d, d) + np.einsum("ij,ij->i", e, e)) / size)
            y = v - new
            z = new
            if check:
                done = ~(left > TOLERANCE)  # rows that have no balance leave too
                if iteration == MAX_ITERATIONS:
                    done[:] = True
                if done.all() or done.sum() * 4 >= len(done):
                    at = rows[active[done]]
                    self.force[at], self.shift[at], self.sticking[at] = z[done], y[done], stick[done]
                    residual[active[done]] = left[done]
                    keep = ~done
                    active, z, y, b, n = active[keep], z[keep], y[keep], b[keep], n[keep]
                    core = None if core is None else core[keep]
                    if not len(active):
                        break
        self.residual = np.zeros(len(offset))
        self.residual[rows] = residual
        self.image[rows] = self.force[rows] @ press._compliance


def rotation(vectors: Array) -> Array:
    """Return rotation matrices of rotation vectors [rad], shape (n, 3) to (n, 3, 3)."""
    angle = np.sqrt((vectors**2).sum(axis=1))[:, None, None]
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    k = crossing(vectors)
    first = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    return np.eye(3) + first * k + second * (k @ k)


def crossing(vectors: Array) -> Array:
    """Return the matrices S with S a = v x a, shape (..., 3) to (..., 3, 3)."""
    out = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def _projected(v: Floats, normal: Floats, friction: float, m: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Return Coulomb's projection of a batch (n, 3 m, by component) and which nodes stick, (n, m)."""
    a, b, c = (normal[:, i : i + 1] for i in range(3))
    vx, vy, vz = v[:, :m], v[:, m : 2 * m], v[:, 2 * m :]
    push = a * vx + b * vy + c * vz
    out = np.empty_like(v)
    tx, ty, tz = out[:, :m], out[:, m : 2 * m], out[:, 2 * m :]
    np.subtract(vx, a * push, out=tx)
    np.subtract(vy, b * push, out=ty)
    np.subtract(vz, c * push, out=tz)
    np.maximum(push, 0.0, out=push)
    length = tx * tx
    length += ty * ty
    length += tz * tz
    np.sqrt(length, out=length)
    limit = np.float32(friction) * push
    stick = (length <= limit) & (push > 0.0)
    share = limit / np.maximum(length, np.float32(1e-30))
    np.minimum(share, np.float32(1.0), out=share)
    tx *= share
    ty *= share
    tz *= share
    tx += a * push
    ty += b * push
    tz += c * push
    return out, stick
