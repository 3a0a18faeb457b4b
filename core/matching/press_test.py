"""Personal stiffness factor alpha, from a press test.

A finger is pressed to known depths, and the loads are read. Alpha is the ratio of these loads to the model's loads.
Source: [S1] IV.D. Its text defines alpha in two ways: as the factor of the simulated force, E / E0, as here, and in the
sentence on the fit as the factor of the measured load, E0 / E.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..contact.single_touch import SingleTouch
from ..contact.solver.bodies import ContactBody
from ..errors import DermisError
from ..parameters.material import FRICTION  # also that of the plate, which hardly affects the load
from ..parameters.skin import CONTACT
from ..skin.model import SkinModel
from ..surface.gap import Surface

DEPTHS = (0.5e-3, 1.0e-3, 1.5e-3, 2.0e-3)  # [m] depths of the press test. Source: [S1] IV.D
PLATE = 0.1  # [m] side of the plate, larger than any finger
PAPER_RANGE = (0.61, 0.90)  # range that [S1] fig. 6 reports for ten people, read as E / E0


@dataclass(frozen=True)
class Calibration:
    """Stiffness factor, and its accuracy.

    Attributes:
        alpha: least-squares factor, measured load = alpha * model load.
        standard_error: standard error of alpha, from the scatter of the readings; NaN for fewer than three readings.
        residual: RMS of measured minus fitted load [N].
    """

    alpha: float
    standard_error: float
    residual: float


def press_loads(skin: SkinModel, depths: ArrayLike = DEPTHS, contact: str = CONTACT) -> Array:
    """Return the loads of a flat plate pressed into a skin to each depth [N].

    Args:
        skin: the skin, with its own E and alpha.
        depths: depths beyond first contact, rising and above zero [m], shape (n,).
        contact: 'nodes' for contact at the nodes of the skin's mesh, 'points' for contact on points of the smooth skin.
            It should be that of the finger's touches.

    Raises:
        DermisError: the depths are not rising or not above zero.

    Source: [S1] IV.D
    """
    d = np.asarray(depths, dtype=np.float64)
    if d.ndim != 1 or not (np.diff(d, prepend=0.0) > 0).all():
        raise DermisError("depths must rise from above zero", where="press test", value=np.ravel(d).tolist())
    plate = Surface.block(PLATE, PLATE)
    touch = SingleTouch(skin, ContactBody(plate, friction=FRICTION), "press test", contact)
    return np.array([float(touch.move((0.0, 0.0, up)).solution.force[:, 2].sum()) for up in np.diff(d, prepend=0.0)])


def stiffness_factor(depths: ArrayLike, measured: ArrayLike, modelled: ArrayLike) -> Calibration:
    """Fit alpha in measured = alpha * modelled by least squares.

    Args:
        depths: indentations, rising and above zero [m], shape (n,).
        measured: loads that were read [N], shape (n,).
        modelled: loads of the model with E0 at the same depths [N], shape (n,).

    Raises:
        DermisError: there are fewer than two readings, the lengths differ, a value is not finite, the depths are not
            rising or not above zero, a measured load is negative or does not rise with the depth, or the model has no
            load.
    """
    where = "press test"
    d, f, g = (np.asarray(a, dtype=np.float64) for a in (depths, measured, modelled))
    if not d.shape == f.shape == g.shape or d.ndim != 1:
        raise DermisError("depths and loads differ in number", where=where, value=f"{d.shape}, {f.shape}, {g.shape}")
    if len(d) < 2:
        raise DermisError(
            "two readings or more are needed",
            where=where,
            value=len(d),
            limit="2 or more",
            remedy="Press at 0.5, 1.0, 1.5 and 2.0 mm",
        )
    for name, values in (("depths", d), ("loads", f), ("modelled loads", g)):
        if not np.isfinite(values).all():
            raise DermisError(f"{name} must be numbers", where=where, value=values.tolist())
    if (np.diff(d) <= 0).any() or d[0] <= 0:
        raise DermisError("depths must rise from above zero", where=where, value=[f"{1e3 * x:g} mm" for x in d])
    if (f < 0).any():
        raise DermisError(
            "a load is negative",
            where=where,
            value=float(f.min()),
            limit=">= 0 N",
            remedy="Tare the scale and press again",
        )
    if (np.diff(f) <= 0).any():
        i = int(np.argmax(np.diff(f) <= 0))
        raise DermisError(
            "the load does not rise with depth",
            where=f"{where}, {1e3 * d[i]:g} to {1e3 * d[i + 1]:g} mm",
            value=f"{f[i]:g} to {f[i + 1]:g} N",
            remedy="Read the scale again at these depths",
        )
    if not g @ g > 0:
        raise DermisError("the model carries no load at these depths", where=where)
    alpha = float(f @ g / (g @ g))
    rest = f - alpha * g
    freedom = len(d) - 1
    error = float(np.sqrt(rest @ rest / freedom / (g @ g))) if len(d) > 2 else float("nan")
    return Calibration(alpha, error, float(np.sqrt(np.mean(rest**2))))
