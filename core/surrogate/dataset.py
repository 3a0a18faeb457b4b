"""Dataset: what a skin feels along random movements of the device; what surrogates and subspaces are made from."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice, seated
from ..devices.disc_pose import FrictionState, placed
from ..devices.first_contact import first_contact
from ..errors import DermisError
from .trial import TrialForce

MAX_TILT = np.radians(25.0)
MAX_LATERAL = np.array([1.5e-3, 1.5e-3, np.radians(10.0)])  # shifts [m] and yaw to either side, where a device has them
MAX_DEPTH = 1.6e-3  # [m] beyond first contact
CLEARANCE = 0.6e-3  # [m] before it
MAX_FORCE = 4.0  # [N] a movement ends where it is reached
STEPS = (8, 32)  # from one end of a movement to the other: the friction state must be known for small steps and large


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples along random movements of the device, those in contact only.

    Attributes:
        x: configuration, shape (n, 3), or (n, 6) of a device with six freedoms.
        force: on the pad nodes [N], float32, shape (n, 3 m).
        before: forces one step earlier on the p places that are pressed, which is the friction state that the step
            began with [N], shape (n, 3 p).
        trial: forces that each place would have by itself, from that state and the new pose [N], shape (n, 3 p), x of
            all places first.
        trajectory: which movement each sample belongs to, shape (n,).
        friction: Coulomb's coefficient.
    """

    x: Array
    force: NDArray[np.float32]
    before: NDArray[np.float32]
    trial: NDArray[np.float32]
    trajectory: Indices
    friction: float

    def __len__(self) -> int:
        return len(self.x)

    def rows(self, chosen: NDArray[np.bool_]) -> Dataset:
        """Return some of the samples."""
        x, force, before, trial, owner = self.x, self.force, self.before, self.trial, self.trajectory
        return Dataset(x[chosen], force[chosen], before[chosen], trial[chosen], owner[chosen], self.friction)


def record(
    device: DiscDevice,
    contact: DiscContact,
    trajectories: int,
    *,
    seed: int = 0,
    steps: tuple[int, int] = STEPS,
    max_force: float = MAX_FORCE,
    max_depth: float = MAX_DEPTH,
    max_tilt: float = MAX_TILT,
    pressed: int = 1,
) -> Generator[tuple[int, int], None, Dataset]:
    """Move the device between random configurations and record; yields movements done and in all.

    Every movement starts clear of the skin and ends pressed into it, as far as the servos allow; tilts are uniform, and
    distances uniform about first contact at their tilt.

    Args:
        steps: fewest and most from one configuration to the next.
        pressed: configurations pressed into the skin that a movement goes through; with more than one it presses, rolls
            and lets go as devices do in use, and friction remembers more than one way.

    Raises:
        DermisError: servo limits that exclude contact, or nothing recorded.

    Source: [S0] 4.1
    """
    rng = np.random.default_rng(seed)
    alone = TrialForce.of(contact)
    x, force, before, trial, owner = [], [], [], [], []
    for number in range(trajectories):
        ends = [_random(device, contact, rng, max_tilt, 0.0, CLEARANCE)]
        ends += [_random(device, contact, rng, max_tilt, -max_depth, 0.0) for _ in range(pressed)]
        state = FrictionState.rest(contact.count)
        for at in _between(ends, rng, steps):
            if not device.feasible(at):
                break
            contact.hold(state)
            pose = placed(device, device.pose(at))
            found = contact.solve(pose)
            if found.touching:
                x.append(at)
                alone.hold(state)
                trial.append(alone.at(pose)[0].astype(np.float32))
                before.append(state.force.ravel().astype(np.float32))
                force.append(contact.nodal(found).ravel().astype(np.float32))
                owner.append(number)
                if np.linalg.norm(found.force.sum(axis=0)) > max_force:
                    break
            state = contact.settle(found)
        yield number + 1, trajectories
    if not x:
        raise DermisError("no movement of the device touches the skin", where="dataset", value=trajectories)
    return Dataset(np.array(x), np.array(force), np.array(before), np.array(trial), np.array(owner), contact.friction)


def joined(parts: Sequence[Dataset]) -> Dataset:
    """Return datasets as one; movements stay apart."""
    first = np.cumsum([0, *(part.trajectory.max() + 1 for part in parts)])
    owner = np.concatenate([part.trajectory + at for part, at in zip(parts, first[:-1], strict=True)])
    x, force, before, trial = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "force", "before", "trial")
    )
    return Dataset(x, force, before, trial, owner, parts[0].friction)


def split(trajectory: Indices, share: float = 0.5, seed: int = 0) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks of training and test samples; no movement is in both, for its samples are alike.

    Source: [S0] 4.2, 'half of the data'; by movement, as this product's corrections say.
    """
    numbers = np.unique(trajectory)
    chosen = np.random.default_rng(seed).permutation(len(numbers))[: max(1, round(share * len(numbers)))]
    train = np.isin(trajectory, numbers[chosen])
    return train, ~train


def _between(ends: list[Array], rng: np.random.Generator, steps: tuple[int, int]) -> Iterator[Array]:
    """Yield configurations on straight ways from end to end."""
    yield ends[0]
    for a, b in pairwise(ends):
        count = int(rng.integers(steps[0], steps[1] + 1))
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            yield a + share * (b - a)


def _random(
    device: DiscDevice, contact: DiscContact, rng: np.random.Generator, max_tilt: float, low: float, high: float
) -> Array:
    for _ in range(200):
        pitch, roll = rng.uniform(-max_tilt, max_tilt, 2)
        z = first_contact(device, contact, pitch, roll)
        x = seated(device, pitch, roll, z + rng.uniform(low, high))
        if len(x) > 3:
            x[3:] = rng.uniform(-1.0, 1.0, len(x) - 3) * MAX_LATERAL
        if device.feasible(x):
            return x
    raise DermisError(
        "the servo limits exclude contact with the skin",
        where="thimble",
        value="{:.3g} to {:.3g}".format(*(float(end[0]) for end in device.servo_limits)),
        remedy="Use longer links, a wider servo range, or mount the device nearer to the pad",
    )
