"""Plot of stimuli in the first three components of a device's stimuli.

A cloud of dots shows the device's stimuli all over its workspace, and a line those of a touch. Three components do not
describe a stimulus accurately, but they show which stimuli the device can reach.

Source: [S0] 3.3 ('3-PCA stimulus viz') and figures 3, 4, 7
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..skin.model import SkinModel
from ..skin.observation import Observer
from ..steps import drain
from ..surrogate.dataset import MAX_DEPTH, MAX_TILT, record
from ..surrogate.store import contact_of
from .description import describe
from .thimble_sequence import ThimbleSequence
from .thimble_use import ThimbleUse

MOVEMENTS, SEED = 240, 1
MAX_DOTS = 2500  # dots of the cloud


@dataclass(frozen=True, eq=False)
class StimulusPlot:
    """Stimuli by their first three components.

    Attributes:
        cloud: stimuli of the device on linear skin, from rest and along random movements, shape (n, 3).
        configuration: configuration of each dot: pitch, roll and depth, each divided by its largest value, -1 to 1,
            shape (n, 3).
        target: stimuli of the touch, shape (k, 3).
        rendered: stimuli of the device for the touch, shape (k, 3).
        predicted: stimuli that the search predicted, shape (k, 3); None for methods that do not predict them.
        left: relative RMS of the cloud about its mean that is not in the three components.
    """

    cloud: Array
    configuration: Array
    target: Array
    rendered: Array
    predicted: Array | None
    left: float


def stimulus_plot(use: ThimbleUse, forces: Array, found: ThimbleSequence, amounts: Array | None = None) -> StimulusPlot:
    """Return the plot of a touch and a thimble's rendering of it.

    Args:
        forces: forces of the virtual touch on the pad nodes [N], shape (k, m, 3).
        found: the thimble's commands.
        amounts: `Stimulus.given` of the touch [m], see `Follower.follow`, shape (k, 3 m).

    Raises:
        DermisError: the servo limits exclude contact.
    """
    spaces = None if use.observation_matrix is not None else describe(use.device, use.skin, use.friction)
    observation_matrix = use.observation_matrix if spaces is None else spaces.observation_matrix
    assert observation_matrix is not None
    data = drain(record(use.device, contact_of(use.device, use.skin.linear, use.friction), MOVEMENTS, seed=SEED))
    stimuli = data.force.astype(np.float64) @ observation_matrix.T
    about = stimuli - stimuli.mean(axis=0)
    chosen = slice(None, None, max(1, -(-len(stimuli) // MAX_DOTS)))
    depth = data.x[:, 2].max() - data.x[:, 2]
    shares = (data.x[:, 0] / MAX_TILT, data.x[:, 1] / MAX_TILT, depth / MAX_DEPTH - 1)
    configuration = np.stack(shares, axis=1)
    three = observation_matrix[:3]
    touched = found.touched | found.pressing
    return StimulusPlot(
        stimuli[chosen, :3],
        np.clip(configuration[chosen], -1.0, 1.0),
        _through(use.skin, forces[touched], None if amounts is None else amounts[touched], three),
        _through(use.skin, found.force[touched], None if found.amounts is None else found.amounts[touched], three),
        None if found.predicted is None else found.predicted[touched, :3],
        float(np.sqrt((about[:, 3:] ** 2).sum() / (about**2).sum())),
    )


def _through(skin: SkinModel, force: NDArray[np.floating], amounts: Array | None, observation_matrix: Array) -> Array:
    observer = Observer(skin, observation_matrix)
    given = [None] * len(force) if amounts is None else list(amounts)
    seen = [observer.seen(row, own) for row, own in zip(force, given, strict=True)]
    return np.array(seen).reshape(len(force), len(observation_matrix))
