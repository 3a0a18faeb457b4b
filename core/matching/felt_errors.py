"""Errors of a rendered touch by three measures: whole stress, mean stress of cells, electrodes.

The measures are different quantities. The stress of every element is the strictest. The mean stress of 154 cells has
the resolution that the paper uses, and smooths finer details. Nineteen virtual electrodes measure the thickness of the
pulp. They summarise the touch smoothly, as the paper's sensor did.

Source: [S0] 4.1 (154 tetrahedra), 6 (19 electrodes), 7.1 (errors)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError
from ..skin.model import SkinModel
from ..skin.observation import Observer, stress_vector, touch_of
from ..skin.sensor import electrode_sensor

WHOLE, CELLS, ELECTRODES = MEASURES = ("whole stress", "154 cells", "electrodes")
COUNT = 154  # number of cells. Source: [S0] 4.1
_SHEAR = np.sqrt([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # each shear component occurs twice in the Frobenius norm


class FeltErrors:
    """Errors of rendered touches on one skin.

    Args:
        skin: model of the skin. All measures are computed by the law of its tissue.
    """

    def __init__(self, skin: SkinModel) -> None:
        self.skin = skin
        self._electrodes = Observer(skin, electrode_sensor(skin).observation)
        self._cell, self._share, self._root = _cells(skin)

    def of(self, target: Array, rendered: Array, amounts: Array | None = None, made: Array | None = None) -> Array:
        """Return the relative RMS error over a sequence, in the order of `MEASURES`, shape (3,).

        Args:
            target, rendered: forces on the pad nodes [N], shape (n, m, 3).
            amounts, made: `Stimulus.given` of target and rendering, shape (n, 3 m); None computes them from the forces.

        Raises:
            DermisError: the sequences differ in length, or the target touches nothing.
        """
        if len(target) != len(rendered) or not np.any(target):
            raise DermisError(
                "errors are of a touch and as many samples of what was rendered",
                where="errors",
                value=f"{len(target)} and {len(rendered)} samples, {'a' if np.any(target) else 'no'} touch",
            )
        left, whole = np.zeros(len(MEASURES)), np.zeros(len(MEASURES))
        for i, (wanted, given) in enumerate(zip(target, rendered, strict=True)):
            if not wanted.any() and not given.any():
                continue
            asked = self._values(wanted, None if amounts is None else amounts[i])
            shown = self._values(given, None if made is None else made[i])
            left += [float(np.square(b - a).sum()) for a, b in zip(asked, shown, strict=True)]
            whole += [float(np.square(a).sum()) for a in asked]
        return np.sqrt(left / whole)

    def _values(self, force: NDArray[np.floating], amounts: Array | None) -> tuple[Array, Array, Array]:
        felt = touch_of(self.skin, force.astype(np.float64), amounts)
        stress = felt.stress * _SHEAR
        cells = np.stack([np.bincount(self._cell, self._share * column, COUNT) for column in stress.T], axis=1)
        return stress_vector(felt), self._root[:, None] * cells, self._electrodes.see(felt)


def _cells(skin: SkinModel) -> tuple[Indices, Array, Array]:
    """Divide the elements of a skin's mesh into cells.

    A cell contains the elements nearest to its centre. The first centre is the element nearest to the origin, under the
    middle of the pad. Each further centre is the element farthest from all centres before it.

    Returns:
        Cell of each element, the element's share of the cell's volume, shape (elements,) each, and the square root of
        each cell's volume, shape (cells,).
    """
    mesh = skin.mesh
    corners = mesh.nodes[mesh.tetrahedra[:, :4]]
    middles = corners.mean(axis=1)
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    chosen = [int(np.square(middles).sum(axis=1).argmin())]
    nearest = np.full(len(middles), np.inf)
    cell = np.zeros(len(middles), np.intp)
    for k in range(COUNT):
        away = np.square(middles - middles[chosen[-1]]).sum(axis=1)
        cell[away < nearest] = k
        nearest = np.minimum(nearest, away)
        chosen.append(int(nearest.argmax()))
    size = np.bincount(cell, volume, COUNT)
    return cell, volume / size[cell], np.sqrt(size)
