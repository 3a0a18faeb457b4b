"""Network: one hidden layer of softplus neurons, trained here with L-BFGS; nothing beyond numpy and scipy is needed.

Source: [S0] 4.2 (18-260-10, softplus because it can be differentiated)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from .table import SampleTable

Report = Callable[[int, int], None]

HIDDEN = 260  # Source: [S0] 4.2
ITERATIONS = 600
START_PENALTY = 1e-4  # on the first output weights, times the number of samples
DECAY = 1e-4  # weight decay, relative to the mean square of the channels


@dataclass(frozen=True, eq=False)
class Network:
    """y = mean + size * (V softplus(A s + a) + b) with s the standardised inputs.

    Attributes:
        centre, scale: of the inputs, shape (p,).
        weights, bias: A (h, p) and a (h,), of the hidden layer.
        output_weights, offset: V (c, h) and b (c,), in the channels' own units.
    """

    centre: Array
    scale: Array
    weights: Array
    bias: Array
    output_weights: Array
    offset: Array

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.centre)

    @property
    def outputs(self) -> int:
        """Number of channels."""
        return len(self.offset)

    @property
    def hidden(self) -> int:
        """Number of neurons in the hidden layer."""
        return len(self.bias)

    def predict(self, u: Array) -> Array:
        """Return channels for rows of inputs."""
        z = ((np.atleast_2d(u) - self.centre) / self.scale) @ self.weights.T + self.bias
        return softplus(z) @ self.output_weights.T + self.offset

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the channels and their derivative by the first three inputs."""
        z = self.weights @ ((u - self.centre) / self.scale) + self.bias
        value = self.output_weights @ softplus(z) + self.offset
        slope = (self.output_weights * sigmoid(z)) @ (self.weights[:, :3] / self.scale[:3])
        return value, slope

    def fixed(self, memory: Array) -> Callable[[Array], tuple[Array, Array]]:
        """Return `evaluate` as a function of the first three inputs, with the others folded in once."""
        u = np.concatenate([np.zeros(3), memory])
        rest = self.weights @ ((u - self.centre) / self.scale) + self.bias
        first = self.weights[:, :3] / self.scale[:3]

        def evaluate(x: Array) -> tuple[Array, Array]:
            z = first @ x + rest
            both = np.empty((len(z), 4))
            both[:, 0] = softplus(z)
            both[:, 1:] = first * sigmoid(z)[:, None]
            answer = self.output_weights @ both
            return answer[:, 0] + self.offset, answer[:, 1:]

        return evaluate


def softplus(z: Array) -> Array:
    """Return log(1 + exp z) without overflow."""
    return np.log1p(np.exp(-np.abs(z))) + np.maximum(z, 0.0)


def sigmoid(z: Array) -> Array:
    """Return 1 / (1 + exp -z) without overflow, the derivative of softplus."""
    e = np.exp(-np.abs(z))
    return np.where(z >= 0.0, 1.0, e) / (1.0 + e)


def train(
    table: SampleTable,
    *,
    hidden: int = HIDDEN,
    iterations: int = ITERATIONS,
    decay: float = DECAY,
    seed: int = 0,
    report: Report | None = None,
) -> Network:
    """Train a network on a table; the same table and seed give the same network.

    Args:
        hidden: neurons. iterations: of L-BFGS. decay: weight decay.
        report: called with iterations done and in all.

    Raises:
        DermisError: no neurons or no iterations.
    """
    from scipy.optimize import minimize

    if hidden < 1 or iterations < 1:
        raise DermisError("a network needs neurons and iterations", where="training", value=(hidden, iterations))
    u, y = table.inputs, table.channels
    n, p, c = len(u), u.shape[1], y.shape[1]
    centre, scale = u.mean(axis=0), u.std(axis=0)
    scale = np.where(scale > 1e-12 * max(float(scale.max()), 1e-300), scale, 1.0)
    mean = y.mean(axis=0)
    size = float(np.sqrt(((y - mean) ** 2).mean())) or 1.0
    s, wanted = ((u - centre) / scale).astype(np.float32), ((y - mean) / size).astype(np.float32)
    rng = np.random.default_rng(seed)
    first, shift = rng.normal(0.0, 1.0 / np.sqrt(p), (hidden, p)), rng.uniform(-1.0, 1.0, hidden)
    # the output weights start at the best ones for the random hidden layer: a linear solve worth hundreds of iterations
    features = np.concatenate([softplus(s @ first.T + shift), np.ones((n, 1))], axis=1)
    gram = features.T @ features
    gram[np.diag_indices(hidden + 1)] += START_PENALTY * n
    best = np.linalg.solve(gram, features.T @ wanted)
    start = np.concatenate([first.ravel(), shift, best[:-1].T.ravel(), best[-1]])
    cuts = np.cumsum([hidden * p, hidden, c * hidden])

    def unpack(theta: Array) -> tuple[NDArray[np.float32], ...]:
        a, b, v, o = np.split(theta.astype(np.float32), cuts)
        return a.reshape(hidden, p), b, v.reshape(c, hidden), o

    ones = np.ones(n, np.float32)

    def loss(theta: Array) -> tuple[float, Array]:
        a, b, v, o = unpack(theta)
        z = s @ a.T
        z += b
        # both from one exponential, in place: this is where training spends its time
        e = np.exp(-np.abs(z))
        active = np.log1p(e)
        active += np.maximum(z, 0.0)
        gate = np.where(z >= 0.0, np.float32(1.0), e)
        e += np.float32(1.0)
        gate /= e
        miss = active @ v.T
        miss += o
        miss -= wanted
        back = miss @ v
        back *= gate
        share = 2.0 / (n * c)
        gradient = (
            np.concatenate([(back.T @ s).ravel(), back.T @ ones, (miss.T @ active).ravel(), miss.T @ ones]).astype(
                np.float64
            )
            * share
        )
        weight = theta.copy()
        weight[cuts[0] : cuts[1]] = 0.0
        weight[cuts[2] :] = 0.0
        value = float(np.einsum("ij,ij->", miss, miss, dtype=np.float64)) / (n * c) + decay * float(weight @ weight) / c
        return value, gradient + 2.0 * decay * weight / c

    done = 0

    def callback(_: Array) -> None:
        nonlocal done
        done += 1
        if report is not None:
            report(done, iterations)

    options = {"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": 20, "ftol": 1e-9, "gtol": 1e-9}
    found = minimize(loss, start, jac=True, method="L-BFGS-B", callback=callback, options=options)
    a, b, v, o = np.split(found.x, cuts)
    return Network(centre, scale, a.reshape(hidden, p), b, v.reshape(c, hidden) * size, o * size + mean)
