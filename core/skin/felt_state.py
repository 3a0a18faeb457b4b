"""FeltState: what a linear map of everything that skin feels is a map of.

Of linear skin these are the forces on the pad nodes. Of skin that stiffens its tissue's part comes behind them: how
much there is of each field of stress beyond linear tissue's, and the force that stiffening takes in each pattern of
displacement. Stress and displacement are linear in the three, so that whatever observes skin (stress components,
electrodes) stays a matrix.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..cache import cache_key
from ..stiffening.stiffening import Stiffening
from .stimulus import Stimulus
from .stress import StressOperator

if TYPE_CHECKING:
    from .model import SkinModel


def felt_key(skin: SkinModel) -> str:
    """Return what a skin's state depends on besides E and alpha: of linear skin its own key."""
    return skin.key if skin.stiffening is None else cache_key(skin.key, "stiffens", skin.stiffening.key)


def state_size(skin: SkinModel) -> int:
    """Return the number of a state's components: 3 m of linear skin."""
    return 3 * skin.pad_count + (0 if skin.stiffening is None else tissue_size(skin.stiffening))


def tissue_size(stiffening: Stiffening) -> int:
    """Return the number of components of the tissue's part of a state, r + k."""
    return int(stiffening.stress.fields.shape[2]) + stiffening.count


def tissue_state(stiffening: Stiffening, modulus: float, q: Array) -> Array:
    """Return the tissue's part of a state for amounts of each pattern: E a(q) [Pa] and n(q), shape (r + k,)."""
    return np.concatenate([modulus * stiffening.stress.amounts(q), stiffening.energy.force(q)])


def state_of(skin: SkinModel, force: Array, amounts: Array | None = None) -> Array:
    """Return the state of a skin under forces on its pad nodes [N], shape (m, 3) or (3 m,).

    Args:
        amounts: of each pattern, as the contact found them, shape (k,); found from the forces where None.

    Returns:
        shape (3 m,), and of skin that stiffens (3 m + r + k,).
    """
    flat = np.asarray(force, np.float64).ravel()
    if skin.stiffening is None:
        return flat
    q = Stimulus(skin, flat.reshape(-1, 3), None, amounts).amounts
    assert q is not None
    return np.concatenate([flat, tissue_state(skin.stiffening, skin.material.modulus, q)])


def observed(skin: SkinModel, matrix: Array, force: Array, amounts: Array | None = None) -> Array:
    """Return what a matrix of forces or of states tells of a touch, shape (c,); forces and amounts as in `state_of`."""
    flat = np.asarray(force, np.float64).ravel()
    if matrix.shape[1] == flat.size or skin.stiffening is None:
        return np.asarray(matrix @ flat)
    q = Stimulus(skin, flat.reshape(-1, 3), None, amounts).amounts
    assert q is not None
    count = skin.stiffening.count
    out = matrix[:, : flat.size] @ flat
    out += matrix[:, flat.size : -count] @ (skin.material.modulus * skin.stiffening.stress.amounts(q))
    if matrix[:, -count:].any():  # stress knows nothing of the patterns' forces, which take longest to find
        out += matrix[:, -count:] @ skin.stiffening.energy.force(q)
    return np.asarray(out)


def matched_amounts(felt: Stimulus) -> Array | None:
    """Return how much there is of each pattern of a series where skin lies by the law, shape (k,), for devices.

    What the law has of tissue beneath is not asked: the patterns are of the pad's displacement, which it has found.
    None of linear skin, and where there is no series.
    """
    skin = felt.skin
    if not skin.follows_law or skin.stiffening is None or felt.amounts is None:
        return felt.amounts if skin.stiffening is not None else None
    force = np.asarray(felt.force, np.float64).ravel() / skin.material.modulus
    return skin.stiff.held(force, np.asarray(felt.amounts, np.float64))


def stress_components(skin: SkinModel) -> Array:
    """Return H with |H s| the volume-weighted L2 norm of the stress in a state s [Pa m^1.5], shape (c, state).

    Of linear skin that is `SkinModel.stress_components`.
    """
    root = skin.stress_components()
    if skin.stiffening is None:
        return root
    from scipy.linalg import eigh

    mesh = skin.mesh
    operator = StressOperator(mesh, skin.material.unit, skin.element)
    fields = skin.stiff.elements.astype(np.float64) * operator.weights.reshape(-1, 1)
    free = (3 * mesh.free[:, None] + np.arange(3)).ravel()
    pulled = (operator.weighted_matrix[:, free].T @ fields).astype(np.float32)
    cross = np.asarray(skin.unit_response @ pulled, np.float64)
    gram = np.block([[root.T @ root, cross], [cross.T, fields.T @ fields]])
    scale = np.sqrt(np.diag(gram))  # newtons and amounts of fields are of unlike size
    values, vectors = eigh(gram / (scale[:, None] * scale))
    kept = values > 0.0
    made = np.sqrt(values[kept])[:, None] * vectors[:, kept].T * scale
    return np.hstack([made, np.zeros((len(made), skin.stiffening.count))])
