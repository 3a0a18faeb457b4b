"""Afferents: response of a fingertip to a touch, and its noise.

Two kinds of afferents resolve where something touches: slowly adapting (SA I) and fast adapting (FA I) ones. Here time
is divided into frames of a quarter second. In each frame an SA I afferent reads the mean strain at its place, and an
FA I afferent reads how much the strain changes. All afferents have the same noise. It is calibrated by human force
discrimination: between a flat press of 1 N and one of 7 % more, all afferents together have d' = 1. The constants were
fixed before the model was first used to compare touches, and have not been changed since.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Indices
from ..errors import DermisError
from ..experiment import press
from ..skin.model import SkinModel
from ..skin.stimulus import Stimulus
from ..skin.stress import RECEPTOR_DEPTHS, stored
from ..surface.gap import Surface

# Afferents on a fingertip [1/m^2]. Source: Johansson and Vallbo 1979, J. Physiol. 286: 241 a cm^2, of which 70 are SA I
# and 141 FA I (RA); the other 30 (SA II, PC) have wide fields, and are left out
SA1_DENSITY, FA1_DENSITY = 70e4, 141e4
# [m] Depths at which SA I and FA I (RA) afferents read, see `skin.stress`
SA1_DEPTH, FA1_DEPTH = RECEPTOR_DEPTHS[:2]
# [s] Time over which the impulses of an afferent are counted. It is chosen, not measured: touches here last some
# seconds, and no better value is known.
FRAME = 0.25
# JND: just noticeable difference of a force, 7 % of it. REFERENCE_FORCE [N]: force at which the noise is calibrated.
# Source: Pang, Tan and Durlach 1991 (of an actively squeezed force)
JND, REFERENCE_FORCE = 0.07, 1.0
HELD = 1.0  # [s] duration of the two calibration presses; the skin is pressed in during the first frame
# Both kinds have the same noise, and it does not grow with the response: in each trial SA1 and RA afferents repeat the
# number of their impulses to within 1, however large it is. Source: Vega-Bermudez and Johnson 1999, J. Neurophysiol. 81
#
# FAST_OVER_SLOW: impulses of an FA I afferent in a frame in which the strain changes by some amount, relative to those
# of an SA I afferent in a frame with this amount as mean strain; assumed
FAST_OVER_SLOW = 1.0
CLOSE = 1e-3  # tolerance of the force of a calibration press, as a share of the reference force


@dataclass(frozen=True, eq=False)
class Afferents:
    """The afferents of a skin.

    Attributes:
        skin: model of the skin.
        slow, fast: indices of the probes that SA I and FA I afferents read, shapes (s,) and (f,).
        slow_count, fast_count: number of afferents at each of these probes, shapes (s,) and (f,).
        noise: standard deviation of the strain that one afferent reads in one frame [Pa].
    """

    skin: SkinModel
    slow: Indices
    fast: Indices
    slow_count: Array
    fast_count: Array
    noise: float

    @classmethod
    def of(cls, skin: SkinModel) -> Afferents:
        """Return the afferents of a skin, with calibrated noise.

        Raises:
            DermisError: no flat press with the force of a calibration press was found.
        """
        probes = skin.probes
        slow, fast = (np.flatnonzero(probes.depth == depth) for depth in (SA1_DEPTH, FA1_DEPTH))
        counts = (SA1_DENSITY * skin.areas[probes.pad[slow]], FA1_DENSITY * skin.areas[probes.pad[fast]])
        quiet = cls(skin, slow, fast, *counts, 1.0)
        less, more = (quiet.strain([held]) for held in _held(skin, (1.0, 1.0 + JND)))
        frames = int(round(HELD / FRAME))
        way = np.concatenate([[0.0, 0.5], np.ones(2 * frames - 1)])  # ends and middles of its frames
        apart = np.linalg.norm(quiet.read(way[:, None] * more) - quiet.read(way[:, None] * less))
        return cls(skin, slow, fast, *counts, float(apart))

    def strain(self, states: Sequence[Stimulus]) -> Array:
        """Return the strain at every probe for some states, as a stress [Pa].

        The values are sqrt(2 E U), shape (n, probes), with Young's modulus E and the strain energy density U. SA1
        afferents follow this energy. Source: Dandekar, Raju and Srinivasan 2003, J. Biomech. Eng. 125.
        """
        material = self.skin.material
        energy = np.array([stored(state.probe_stress, material) for state in states])
        return np.asarray(np.sqrt(2.0 * material.modulus * np.maximum(energy, 0.0)))

    def read(self, strain: Array) -> Array:
        """Return the response of all afferents [Pa], shape (frames, slow + fast).

        The response at a probe is multiplied by the square root of the number of its afferents. The d' of an ideal
        observer is therefore the Euclidean distance between two responses, divided by `noise`.

        Args:
            strain: strain at the probes [Pa] at the ends and middles of the frames, shape (2 frames + 1, probes).

        Raises:
            DermisError: an even number of moments.
        """
        if len(strain) % 2 == 0:
            raise DermisError("frames need their ends and middles", where="afferents", value=len(strain), limit="odd")
        slow, fast = strain[:, self.slow], strain[:, self.fast]
        mean = (slow[:-2:2] + 4.0 * slow[1::2] + slow[2::2]) / 6.0
        change = np.abs(np.diff(fast, axis=0)).reshape(-1, 2, fast.shape[1]).sum(axis=1)
        fast_share = FAST_OVER_SLOW * np.sqrt(self.fast_count)
        both: Array = np.hstack([np.sqrt(self.slow_count) * mean, fast_share * change])
        return both


def moments(duration: float) -> Array:
    """Return the ends and middles of the frames that cover a touch [s].

    The shape is (2 frames + 1,).

    Args:
        duration: duration of the touch [s].
    """
    frames = max(int(np.ceil(duration / FRAME - 1e-9)), 1)
    return 0.5 * FRAME * np.arange(2 * frames + 1, dtype=np.float64)


def _held(skin: SkinModel, shares: Sequence[float]) -> list[Stimulus]:
    """Return the stimuli of flat presses on a skin.

    The forces are shares of the reference force.
    """
    plate = Surface.block(0.1, 0.1)
    depths, forces, found = [0.0], [0.0], []
    depth = 1e-3
    for share in shares:
        wanted = share * REFERENCE_FORCE
        for _ in range(12):
            made = press(skin, plate, depth, friction=0.0)
            depths.append(depth)
            forces.append(made.normal_force)
            if abs(made.normal_force - wanted) <= CLOSE * REFERENCE_FORCE:
                break
            # The force is nearly a power of the depth, so the secant method is applied to the logarithms.
            power = 1.5
            if len(depths) > 2 and depths[-2] != depths[-1] and forces[-2] != forces[-1]:
                power = float(np.clip(np.log(forces[-1] / forces[-2]) / np.log(depths[-1] / depths[-2]), 0.5, 4.0))
            depth *= (wanted / made.normal_force) ** (1.0 / power)
        else:
            raise DermisError(
                "no flat press of the reference force was found",
                where="afferents",
                value=f"{forces[-1]:.3g} N at {1e3 * depths[-1]:.2f} mm",
                limit=f"{wanted:g} N",
            )
        found.append(made)
    return list(found)
