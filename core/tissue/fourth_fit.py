"""The fourth power of an energy, bettered where the law itself was asked.

A series is exact at rest. What is left of it farther on is least where its fourth power, in the ways that touches go,
is what the law asks for there, with the powers damped as they will be.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array, Floats
from ..stiffening.energy import Energy
from ..stiffening.features import Features
from .energy_fit import folded
from .held_states import HeldStates
from .pair_modes import PairModes, pair_forms, pair_rows

RIDGE = 10.0  # over how much is known of each product of ways: what little is known of changes little
AT_ONCE = 16  # states whose equations are in memory together


def fit_fourth(energy: Energy, modes: PairModes, states: HeldStates) -> Energy:
    """Return an energy whose fourth power has products of two ways added, as many of each as states ask for."""
    forms, odd = _forms(modes)
    first, second = np.triu_indices(len(forms))
    alike = odd[first] == odd[second]
    first, second = first[alike], second[alike]
    told = _ways(forms, states.amounts)
    forms = forms / np.sqrt((told * told).mean(axis=0))[:, None, None]
    count = len(first)
    whole, right = np.zeros((count, count)), np.zeros(count)
    for start in range(0, len(states.amounts), AT_ONCE):
        rows, wanted = [], []
        for q, force in zip(
            states.amounts[start : start + AT_ONCE], states.force[start : start + AT_ONCE], strict=True
        ):
            size = float(np.linalg.norm(q + force))
            rows.append(_slopes(energy, forms, first, second, q) / size)
            wanted.append((force - energy.force(q)) / size)
        part = np.concatenate(rows, axis=1).astype(np.float32)
        whole += part @ part.T
        right += part @ np.concatenate(wanted).astype(np.float32)
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    told = np.linalg.solve(whole / size[:, None] / size + RIDGE * np.eye(count), right / size) / size
    matrix = np.zeros((len(forms), len(forms)))
    matrix[first, second] += 0.5 * told
    matrix[second, first] += 0.5 * told
    return _with(energy, forms, odd, matrix)


def _forms(modes: PairModes) -> tuple[Array, Array]:
    """Return the ways and |q / scale|^2 as forms, shape (f, k, k), and which of them are odd."""
    odd = np.zeros(len(modes.forms) + 1, bool)
    odd[len(modes.forms) - modes.unlike : len(modes.forms)] = True
    return np.concatenate([modes.forms, np.diag(modes.scale**-2.0)[None]]), odd


def _ways(forms: Array, amounts: Array) -> Array:
    """Return how much there is of each way, shape (s, f)."""
    return np.array([(forms @ q) @ q for q in amounts])


def _slopes(energy: Energy, forms: Array, first: Array, second: Array, q: Array) -> Array:
    """Return the slope of each damped product of two ways, shape (p, k)."""
    along = forms @ q
    much = along @ q
    slopes = 2.0 * (much[first, None] * along[second] + much[second, None] * along[first])
    if energy.damping is None:
        return np.asarray(slopes)
    weight, slope = energy.damping.weight(q, 0.5)
    return np.asarray(weight * slopes + np.outer(much[first] * much[second], slope))


def _with(energy: Energy, forms: Array, odd: Array, matrix: Array) -> Energy:
    """Return an energy with sum_jk A_jk y_j y_k added, as features of its own number."""
    count = len(forms[0])
    even = energy.features.shape[2]
    own = _whole(energy.features)
    unlike = np.arange(len(own)) >= energy.features.shape[0]
    made: list[Floats] = []
    signs, last = [], 0
    for kind in (False, True):
        ways = pair_rows(forms[odd == kind])
        kept = pair_rows(own[unlike == kind])
        if len(kept) + len(ways) == 0:
            continue
        middle = np.zeros((len(kept) + len(ways),) * 2)
        middle[np.arange(len(kept)), np.arange(len(kept))] = energy.signs[unlike == kind]
        middle[len(kept) :, len(kept) :] = matrix[np.ix_(odd == kind, odd == kind)]
        rows, told = folded(np.concatenate([kept, ways]), middle)
        made.append(pair_forms(rows, count))
        signs.append(told)
        last = len(told) if kind else 0
    features = Features.of(np.concatenate(made), even, last)
    return replace(energy, features=features, signs=np.concatenate(signs))


def _whole(features: Features) -> Array:
    """Return the forms of features, shape (r + s, k, k)."""
    r, s, e, o = features.shape
    out = np.zeros((r + s, e + o, e + o))
    out[:r, :e, :e], out[:r, e:, e:] = features.first, features.second
    across = features.across.transpose(1, 0, 2)
    out[r:, :e, e:], out[r:, e:, :e] = across, across.transpose(0, 2, 1)
    return out
