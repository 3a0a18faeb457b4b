"""Checks of a surrogate from files.

They are checks of shapes and of finite values, and a trial evaluation.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .forward import ForwardModel
from .surrogate import Surrogate

REMEDY = "Adapt it again, or use the direct method"


def check_parts(made: Surrogate, size: int, freedoms: int, where: str) -> None:
    """Check that the parts of a surrogate fit together.

    Args:
        made: the surrogate.
        size: number of components of the forces on the skin's pad nodes.
        freedoms: number of degrees of freedom of the device.
        where: name of the surrogate, for errors.

    Raises:
        DermisError: a part has a wrong shape or values that are not finite, the scale of the ridge has zeros, the sizes
            of network and descriptors differ, or the modulus is not valid.
    """
    spaces, ridge = made.descriptors, made.ridge
    stress, trial, friction = spaces.stress, spaces.trial, spaces.friction
    k, t, q = (len(np.atleast_1d(space.basis)) for space in (stress, trial, friction))
    # Trial and friction forces act on the pressed points. These need not be the pad nodes, so `size` does not apply.
    p, any_size, places3 = freedoms + t + q, stress.mean.size, trial.mean.size
    wanted: dict[str, tuple[Array, tuple[int, ...]]] = {
        "stress_mean": (stress.mean, (any_size,)),
        "stress_basis": (stress.basis, (k, any_size)),
        "stress_curve": (stress.curve, (stress.curve.size,)),
        "readout": (spaces.observation_matrix, (k, size)),
        "trial_mean": (trial.mean, (places3,)),
        "trial_basis": (trial.basis, (t, places3)),
        "trial_curve": (trial.curve, (trial.curve.size,)),
        "friction_mean": (friction.mean, (places3,)),
        "friction_basis": (friction.basis, (q, places3)),
        "friction_curve": (friction.curve, (friction.curve.size,)),
        "ridge_centre": (ridge.centre, (p,)),
        "ridge_scale": (ridge.scale, (p,)),
        "ridge_constant": (ridge.constant, (k,)),
        "ridge_linear": (ridge.linear, (k, p)),
        "ridge_quadratic": (ridge.quadratic, (k, p, p)),
    }
    for name, (part, shape) in wanted.items():
        if part.shape != shape or 0 in shape:
            raise DermisError(
                f"the surrogate's '{name}' has the wrong shape",
                where=where,
                value=part.shape,
                limit=str(shape),
                remedy=REMEDY,
            )
        if not np.issubdtype(part.dtype, np.floating) or not np.isfinite(part).all():
            raise DermisError(f"the surrogate's '{name}' is not finite", where=where, remedy=REMEDY)
    if (ridge.scale == 0.0).any():
        raise DermisError("the surrogate's 'ridge_scale' has zeros", where=where, remedy=REMEDY)
    if (made.network.inputs, made.network.outputs) != (p, k):
        raise DermisError(
            "the sizes of network and descriptors do not fit",
            where=where,
            value=f"{made.network.inputs} inputs, {made.network.outputs} outputs",
            limit=f"{p} and {k}",
            remedy=REMEDY,
        )
    modulus = made.meta.get("modulus")
    if isinstance(modulus, bool) or not isinstance(modulus, int | float) or not 0.0 < modulus < np.inf:
        raise DermisError(
            "the surrogate states no valid stiffness", where=where, value=modulus, limit="> 0 Pa", remedy=REMEDY
        )


def try_out(model: ForwardModel, poses: Iterable[Array], where: str) -> None:
    """Evaluate a model at some poses, to detect failures early.

    This is done before a sequence begins.

    Args:
        model: the model.
        poses: configurations of the device, each of shape (n,).
        where: name of the model, for errors.

    Raises:
        DermisError: an evaluation fails, or its result has a wrong shape or values that are not finite.
    """
    for x in poses:
        try:
            value, slope = model.evaluate(x)
        except Exception as error:  # onnxruntime raises its own exceptions
            raise DermisError(
                "the surrogate cannot be evaluated",
                where=where,
                value=f"{type(error).__name__}: {error}"[:200],
                remedy=REMEDY,
            ) from error
        if value.shape != (model.size,) or slope.shape != (model.size, len(x)):
            raise DermisError(
                "the surrogate's output has the wrong shape",
                where=where,
                value=f"{value.shape}, {slope.shape}",
                limit=f"({model.size},), ({model.size}, {len(x)})",
                remedy=REMEDY,
            )
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            raise DermisError("the surrogate's output is not finite", where=where, remedy=REMEDY)
