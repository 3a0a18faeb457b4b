"""Dataset: forces on a skin in random movements of a device.

Surrogates and subspaces are trained with these data.
"""

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
from ..skin.observation import Observer
from .trial import TrialForce

MAX_TILT = np.radians(25.0)  # [rad] largest pitch and roll to either side
MAX_LATERAL = np.array([1.5e-3, 1.5e-3, np.radians(10.0)])  # [m, m, rad] largest shifts and yaw to either side
MAX_DEPTH = 1.6e-3  # [m] largest movement into the skin after first contact
CLEARANCE = 0.6e-3  # [m] largest distance before first contact at which a movement starts
MAX_FORCE = 4.0  # [N] a movement ends after the first sample with a larger force
# Least and largest number of steps from one configuration to the next. Small and large steps are recorded, because the
# surrogate must predict the effect of the friction state for both.
STEPS = (8, 32)


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples of random movements of the device, all with contact.

    Attributes:
        x: configurations, shape (n, 3), or (n, 6) for a device with six degrees of freedom.
        force: forces on the m pad nodes [N], shape (n, 3 m).
        before: forces on the p pressed points at the end of the previous step [N], shape (n, 3 p). These forces are
            part of the friction state with which the step begins.
        trial: trial forces on the p pressed points at the new pose [N], see `TrialForce`, shape (n, 3 p), with x of all
            points first. They are computed from the same friction state.
        trajectory: number of the movement to which each sample belongs, shape (n,).
        friction: Coulomb's coefficient of friction.
        stress: components of stress that an observer saw, shape (n, k); None if the movements were not observed.
        unsettled: number of samples that were left out, because the skin's nonlinear law did not converge.
    """

    x: Array
    force: NDArray[np.float32]
    before: NDArray[np.float32]
    trial: NDArray[np.float32]
    trajectory: Indices
    friction: float
    stress: Array | None = None
    unsettled: int = 0

    def __len__(self) -> int:
        return len(self.x)

    def rows(self, chosen: NDArray[np.bool_]) -> Dataset:
        """Return the samples for which `chosen`, shape (n,), is true."""
        x, force, before, trial, owner = self.x, self.force, self.before, self.trial, self.trajectory
        stress = None if self.stress is None else self.stress[chosen]
        rows = x[chosen], force[chosen], before[chosen], trial[chosen], owner[chosen]
        return Dataset(*rows, self.friction, stress, self.unsettled)


def record(
    device: DiscDevice,
    contact: DiscContact,
    trajectories: int,
    *,
    seed: int = 0,
    steps: tuple[int, int] = STEPS,
    pressed: int = 1,
    observer: Observer | None = None,
) -> Generator[tuple[int, int], None, Dataset]:
    """Move the device between random configurations and record samples.

    Yields (finished, all) movements and returns the dataset. Each movement starts clear of the skin and goes to one or
    more configurations in the skin. It ends early at a configuration that the device cannot reach, or after a sample
    whose force exceeds `MAX_FORCE`. Tilts are uniformly distributed. For each tilt, the distance is uniformly
    distributed in a range that begins or ends at first contact. On skin that follows a nonlinear law, samples at which
    the law does not converge are left out.

    Args:
        device: the mechanism.
        contact: contact of the device's disc with the skin.
        trajectories: number of movements.
        seed: seed of the random numbers.
        steps: least and largest number of steps from one configuration to the next.
        pressed: number of configurations in the skin in each movement. With more than one, a movement presses, rolls
            and releases, as devices do in use, so that friction states after different paths are recorded.
        observer: observer of the components of stress, by the law that the contact's skin follows; None for none.

    Raises:
        DermisError: the servo limits exclude contact, or no sample touches.

    Source: [S0] 4.1
    """
    rng = np.random.default_rng(seed)
    alone = TrialForce.of(contact)
    x, force, before, trial, owner, stress = [], [], [], [], [], list[Array]()
    unsettled = 0
    for number in range(trajectories):
        ends = [_random(device, contact, rng, 0.0, CLEARANCE)]
        ends += [_random(device, contact, rng, -MAX_DEPTH, 0.0) for _ in range(pressed)]
        state = FrictionState.rest(contact.count)
        for at in _between(ends, rng, steps):
            if not device.feasible(at):
                break
            contact.hold(state)
            pose = placed(device, device.pose(at))
            found = contact.solve(pose)
            if found.touching:
                if found.settled:
                    x.append(at)
                    alone.hold(state)
                    trial.append(alone.at(pose)[0].astype(np.float32))
                    before.append(state.force.ravel().astype(np.float32))
                    nodal = contact.nodal(found)
                    force.append(nodal.ravel().astype(np.float32))
                    if observer is not None:
                        stress.append(observer.seen(nodal, found.amounts))
                    owner.append(number)
                else:
                    unsettled += 1
                if np.linalg.norm(found.force.sum(axis=0)) > MAX_FORCE:
                    break
            state = contact.settle(found)
        yield number + 1, trajectories
    if not x:
        raise DermisError("no movement of the device touches the skin", where="dataset", value=trajectories)
    return Dataset(
        np.array(x),
        np.array(force),
        np.array(before),
        np.array(trial),
        np.array(owner),
        contact.friction,
        None if observer is None else np.array(stress),
        unsettled,
    )


def joined(parts: Sequence[Dataset]) -> Dataset:
    """Join datasets.

    The movements are numbered anew, so that no two movements have the same number. The coefficient of friction is that
    of the first dataset. Either all datasets have components of stress, or none has.
    """
    first = np.cumsum([0, *(part.trajectory.max() + 1 for part in parts)])
    owner = np.concatenate([part.trajectory + at for part, at in zip(parts, first[:-1], strict=True)])
    x, force, before, trial = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "force", "before", "trial")
    )
    seen = [part.stress for part in parts if part.stress is not None]
    stress = np.concatenate(seen) if seen else None
    return Dataset(x, force, before, trial, owner, parts[0].friction, stress, sum(part.unsettled for part in parts))


def split(trajectory: Indices, share: float = 0.5, seed: int = 0) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks of the training samples and of the test samples.

    All samples of a movement are in the same set, because they are too similar to be in both.

    Args:
        trajectory: number of the movement of each sample, shape (n,).
        share: share of the movements for training; at least one movement is used for it.
        seed: seed of the choice.

    Source: [S0] 4.2, 'half of the data'; by movement, as this product's corrections say.
    """
    numbers = np.unique(trajectory)
    chosen = np.random.default_rng(seed).permutation(len(numbers))[: max(1, round(share * len(numbers)))]
    train = np.isin(trajectory, numbers[chosen])
    return train, ~train


def _between(ends: list[Array], rng: np.random.Generator, steps: tuple[int, int]) -> Iterator[Array]:
    """Yield configurations on straight lines from each of `ends` to the next.

    Args:
        ends: configurations, each of shape (n,).
        rng: generator of random numbers.
        steps: least and largest number of steps on a line.
    """
    yield ends[0]
    for a, b in pairwise(ends):
        count = int(rng.integers(steps[0], steps[1] + 1))
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            yield a + share * (b - a)


def _random(device: DiscDevice, contact: DiscContact, rng: np.random.Generator, low: float, high: float) -> Array:
    for _ in range(200):
        pitch, roll = rng.uniform(-MAX_TILT, MAX_TILT, 2)
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
