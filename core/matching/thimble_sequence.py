"""Commands of a thimble over a sequence of touches, and their mismatch."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.disc import DiscContact
from ..devices.spec import DeviceSpec
from ..devices.thimble import channel_values
from ..errors import DermisError
from ..skin.model import SkinModel
from ..skin.observation import stress_errors
from .minimum import GIVES_WAY
from .stress import ThimbleFrame


@dataclass(frozen=True, eq=False)
class ThimbleSequence:
    """Commands of the device over a sequence, and how well they match.

    Attributes:
        x: configurations, shape (n, freedoms): pitch, roll [rad] and distance [m]; for six legs followed by two shifts
            [m] and yaw [rad].
        angles: servo angles from neutral [rad], or lengths of the six legs [m], shape (n, freedoms).
        force: force of the device on each pad node [N], float32, shape (n, m, 3).
        mismatch: |rendered - target| / |target| in the method's own descriptor, shape (n,); 0 without touch.
        kkt: KKT residual of the search, see `Minimum`, shape (n,).
        iterations: number of steps of the search, shape (n,).
        pressing: whether the disc presses on the skin, shape (n,).
        touched: whether the target is a touch, shape (n,).
        held_back: whether a servo's range or speed limited the search, shape (n,).
        steep: whether a better pose was excluded because the platform would give way there, shape (n,).
        rescued: whether the direct search replaced a learned model, shape (n,).
        method: name of the method, one of `thimble_use.METHODS`.
        predicted: stimulus predicted by the search's model, shape (n, k); zeros without touch. None for 'force' and
            'geometry', which do not predict a stimulus.
        amounts: displacement of the pad in linear skin minus its displacement in nonlinear skin [m], see
            `Stimulus.given`, shape (n, 3 m); None for linear skin.
        stress_error: error of the whole stress, relative to the target's, shape (n,); 0 without touch.
        looks, unsettled: evaluations of the nonlinear law and their final error, see `ThimbleFrame`, shape (n,).
    """

    x: Array
    angles: Array
    force: NDArray[np.float32]
    mismatch: Array
    kkt: Array
    iterations: NDArray[np.int64]
    pressing: NDArray[np.bool_]
    touched: NDArray[np.bool_]
    held_back: NDArray[np.bool_]
    steep: NDArray[np.bool_]
    rescued: NDArray[np.bool_]
    method: str
    predicted: Array | None = None
    amounts: Array | None = None
    stress_error: Array = field(default_factory=lambda: np.zeros(0))
    looks: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    unsettled: Array = field(default_factory=lambda: np.zeros(0))

    def commands(self, spec: DeviceSpec) -> Array:
        """Return the values of a preset's channels in SI, shape (n, channels).

        Raises:
            DermisError: the preset has a channel that a thimble does not have.
        """
        if self.x.shape[1] > 3:  # for six legs, the channels are the legs in the order of the preset
            columns = {c.name: column for c, column in zip(spec.channels, self.angles.T, strict=True)}
        else:
            columns = channel_values(self.angles, self.x)
        unknown = [c.name for c in spec.channels if c.name not in columns]
        if unknown:
            raise DermisError(
                "the thimble has no such channel",
                where=f"device preset '{spec.key}'",
                value=", ".join(unknown),
                limit=", ".join(columns),
            )
        return np.stack([columns[c.name] for c in spec.channels], axis=1)


def collect(
    frames: list[ThimbleFrame],
    contact: DiscContact,
    method: str,
    skin: SkinModel | None = None,
    forces: Array | None = None,
) -> ThimbleSequence:
    """Return the sequence made of some frames.

    Args:
        frames: the frames.
        contact: contact of the disc.
        method: see `ThimbleSequence`.
        skin, forces: linear skin, and forces of the virtual touches on its pad nodes [N], shape (n, m, 3), from which
            `stress_error` is computed. None takes it from the frames.
    """
    made = contact.nodal_forces([f.solution for f in frames])
    touched = np.array([f.minimum is not None for f in frames])
    if skin is None or forces is None:
        errors = np.array([f.stress_error for f in frames])
    else:
        errors = np.where(touched, stress_errors(skin, forces, made), 0.0)
    found = [f.minimum for f in frames]
    predicted = None
    if method not in ("force", "geometry"):
        predicted = np.array([np.zeros_like(f.stimulus) if f.minimum is None else f.minimum.stimulus for f in frames])
    return ThimbleSequence(
        np.array([f.x for f in frames]),
        np.array([f.angles for f in frames]),
        made.astype(np.float32),
        np.array([f.mismatch for f in frames]),
        np.array([0.0 if m is None else m.kkt for m in found]),
        np.array([0 if m is None else m.iterations for m in found]),
        np.array([f.touching for f in frames]),
        touched,
        np.array([m is not None and any(a != GIVES_WAY for a in m.active) for m in found]),
        np.array([m is not None and GIVES_WAY in m.active for m in found]),
        np.array([f.rescued for f in frames]),
        method,
        predicted,
        amounts_of(frames, contact),
        errors,
        np.array([f.looks for f in frames]),
        np.array([f.unsettled for f in frames]),
    )


def amounts_of(frames: list[ThimbleFrame], contact: DiscContact) -> Array | None:
    """Return `ThimbleSequence.amounts` of some frames [m], shape (n, 3 m).

    It is None for linear skin.
    """
    if contact.law is None:
        return None
    none = np.zeros(3 * contact.points.node_count)
    return np.array([none if f.solution.amounts is None else f.solution.amounts for f in frames])
