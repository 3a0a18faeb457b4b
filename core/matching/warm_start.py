"""WarmStartTable: configurations and their stimuli, from which searches start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..cache import Cache
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice, seated
from ..devices.disc_pose import FrictionState
from ..devices.first_contact import first_contact
from ..errors import DermisError
from ..skin.store import kept
from ..surrogate.forward import ForwardModel

# [rad] Pitches and rolls of the configurations.
TABLE_TILTS = np.radians([-24.0, -16.0, -8.0, 0.0, 8.0, 16.0, 24.0])
TILTS_APART = np.radians(4.0)  # [rad] two starts differ by more than this in pitch or roll; half the grid's spacing
# [m] Depths beyond first contact.
TABLE_DEPTHS = (0.05e-3, 0.15e-3, 0.35e-3, 0.7e-3, 1.1e-3, 1.5e-3)


@dataclass(frozen=True, eq=False)
class WarmStartTable:
    """Configurations all over a device's workspace, and the stimulus of each from rest.

    Attributes:
        x: configurations, shape (t, n).
        depth: depth beyond first contact [m], shape (t,).
        direction: unit vector along the stimulus, shape (t, k).
        strength: norm of the stimulus, shape (t,).
    """

    x: Array
    depth: Array
    direction: Array
    strength: Array

    @classmethod
    def of(cls, x: list[Array], depth: list[float], stimuli: list[Array], none: str) -> WarmStartTable:
        """Return the table of some configurations.

        Args:
            x: configurations, shape (n,) each.
            depth: depth of each beyond first contact [m].
            stimuli: stimulus of each, shape (k,), not zero.
            none: message of the error if there are no configurations.

        Raises:
            DermisError: there are no configurations.
        """
        if not x:
            raise DermisError(none, where="thimble")
        strength = np.sqrt((np.array(stimuli) ** 2).sum(axis=1))
        return cls(np.array(x), np.array(depth), np.array(stimuli) / strength[:, None], strength)

    def configuration(self, row: int, strength: float) -> Array:
        """Return the configuration of an entry at another depth.

        The depth is chosen for a given strength, but is at least a quarter of the least of `TABLE_DEPTHS` and at most
        their largest. The strength of a stimulus is assumed to grow with depth^1.5, as for a ball by Hertz.

        Args:
            row: index of the entry.
            strength: norm that the stimulus shall have.
        """
        depth = self.depth[row] * (max(strength, 0.0) / self.strength[row]) ** (2.0 / 3.0)
        x: Array = self.x[row].copy()
        x[2] += self.depth[row] - min(max(depth, TABLE_DEPTHS[0] / 4), TABLE_DEPTHS[-1])
        return x

    def promising(self, target: Array, count: int) -> list[Array]:
        """Return the configurations with the stimuli most like a target.

        Stimuli are compared by their direction alone. The depth of each configuration is then chosen for the strength
        of the target, see `configuration`. Pitch or roll of any two differ by more than `TILTS_APART`. The most similar
        one is first.

        Args:
            target: stimulus to approximate, shape (k,), not zero.
            count: largest number of configurations.
        """
        size = float(np.sqrt(target @ target))
        alike = self.direction @ target / size
        chosen: list[int] = []
        for row in np.argsort(-alike, kind="stable").tolist():
            if len(chosen) >= count:
                break
            tilts = self.x[chosen, :2]
            if not (np.abs(tilts - self.x[row, :2]).max(axis=1) <= TILTS_APART).any():
                chosen.append(row)
        return [self.configuration(row, size * float(alike[row])) for row in chosen]


RECORDED_ROWS = 300  # largest number of rows of a recording that are used; more would slow down every frame


def recorded_table(device: DiscDevice, contact: DiscContact, model: ForwardModel, x: Array) -> WarmStartTable:
    """Return the table of a model that was learned from a recording.

    Args:
        device: the mechanism.
        contact: its disc and the skin, for the depths.
        model: the learned model.
        x: recorded configurations, shape (n, 3).

    Raises:
        DermisError: no recorded pose within the servo limits makes the channels change.
    """
    rows, depths, stimuli = [], [], []
    chosen = x[np.unique(np.linspace(0, len(x) - 1, RECORDED_ROWS).round().astype(int))]
    for at in chosen:
        if device.feasible(at):
            stimulus, slope = model.evaluate(at)
            if stimulus.any() and slope.any():
                rows.append(at)
                depths.append(max(first_contact(device, contact, at[0], at[1]) - at[2], TABLE_DEPTHS[0]))
                stimuli.append(stimulus)
    return WarmStartTable.of(
        rows, depths, stimuli, "no recorded pose within the servo limits makes the channels change"
    )


def warm_start_table(device: DiscDevice, contact: DiscContact, model: ForwardModel) -> WarmStartTable:
    """Return the table of a forward model.

    Raises:
        DermisError: no pose within the servo limits touches the skin.
    """
    rows, depths, stimuli = [], [], []
    model.hold(FrictionState.rest(contact.count))
    for pitch in TABLE_TILTS:
        for roll in TABLE_TILTS:
            z = first_contact(device, contact, pitch, roll)
            for depth in TABLE_DEPTHS:
                x = seated(device, pitch, roll, z - depth)
                if device.feasible(x):
                    stimulus, slope = model.evaluate(x)
                    if stimulus.any() and slope.any():
                        rows.append(x)
                        depths.append(depth)
                        stimuli.append(stimulus)
    return WarmStartTable.of(rows, depths, stimuli, "no pose within the servo limits touches the skin")


def kept_table(
    cache: Cache | None, key: str, device: DiscDevice, contact: DiscContact, model: ForwardModel
) -> WarmStartTable:
    """Return the table of a forward model, from a cache if it is there.

    Args:
        cache: the cache; None always computes the table.
        key: key of the cache entry, made from all inputs.
        device, contact, model: as for `warm_start_table`.

    Raises:
        DermisError: as `warm_start_table`.
    """

    def made() -> dict[str, Array]:
        table = warm_start_table(device, contact, model)
        return {"table": np.column_stack([table.x, table.depth, table.strength, table.direction])}

    n = device.freedoms
    rows = kept(cache, key, {"table": (None, n + 2 + model.size)}, made)["table"]
    x, depth, strength, direction = (np.ascontiguousarray(part) for part in np.split(rows, [n, n + 1, n + 2], axis=1))
    return WarmStartTable(x, depth[:, 0], direction, strength[:, 0])
