"""Network with one hidden layer of softplus neurons.

It is trained by L-BFGS with NumPy and SciPy alone.

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
ITERATIONS = 150  # largest number of iterations of L-BFGS
# Factor of the squared output weights in the loss, whose error term is a mean over the samples. A much smaller penalty
# is lost in single precision.
PENALTY = 1e-4
DECAY = 1e-6  # factor of the squared weights of the hidden layer, relative to the mean square of the channels


@dataclass(frozen=True, eq=False)
class Network:
    """Network y = V softplus(A s + a) + b with standardised inputs s.

    Attributes:
        centre, scale: mean and scale of the inputs, shape (p,).
        weights, bias: A, shape (h, p), and a, shape (h,), of the hidden layer.
        output_weights, offset: V, shape (c, h), and b, shape (c,), in the channels' own units.
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
        """Return the channels, shape (n, c), for rows of inputs, shape (n, p)."""
        z = ((np.atleast_2d(u) - self.centre) / self.scale) @ self.weights.T + self.bias
        return softplus(z) @ self.output_weights.T + self.offset

    def along(self, u: Array, ways: Array) -> tuple[Array, Array]:
        """Return the channels and their derivatives along given directions.

        The shapes are (c,) and (c, d).

        Args:
            u: inputs, shape (p,).
            ways: directions of the inputs, shape (p, d).
        """
        z = self.weights @ ((u - self.centre) / self.scale) + self.bias
        both = np.empty((len(z), 1 + ways.shape[1]))
        both[:, 0] = softplus(z)
        both[:, 1:] = (self.weights @ (ways / self.scale[:, None])) * sigmoid(z)[:, None]
        answer = self.output_weights @ both
        return answer[:, 0] + self.offset, answer[:, 1:]


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
    seed: int = 0,
    report: Report | None = None,
) -> Network:
    """Train a network on a table.

    The same table and seed give the same network. L-BFGS optimises only the weights and biases of the hidden layer. In
    each step the output weights are the optimal ones for this hidden layer. This saves many steps compared with an
    optimisation of all weights.

    Args:
        table: inputs and channels.
        hidden: number of neurons in the hidden layer.
        iterations: largest number of iterations of L-BFGS.
        seed: seed of the initial weights.
        report: function that is called with (done, total) iterations.

    Raises:
        DermisError: there are no neurons or no iterations.

    Source: Golub and Pereyra 1973 (variable projection)
    """
    from scipy.optimize import minimize

    if hidden < 1 or iterations < 1:
        raise DermisError("a network needs neurons and iterations", where="training", value=(hidden, iterations))
    u, y = table.inputs, table.channels
    n, p, c = len(u), u.shape[1], y.shape[1]
    centre, scale = table.standard
    mean = y.mean(axis=0)
    size = float(np.sqrt(((y - mean) ** 2).mean())) or 1.0
    s, wanted = ((u - centre) / scale).astype(np.float32), ((y - mean) / size).astype(np.float32)
    start = _start(s, hidden, np.random.default_rng(seed))
    active, rates = np.ones((n, hidden + 1), np.float32), np.empty((n, hidden), np.float32)

    def best(theta: Array) -> Array:
        """Return the optimal output weights, with the offset last.

        The outputs of the neurons and their derivatives are left in `active` and `rates`.
        """
        a, b = np.split(theta.astype(np.float32), [hidden * p])
        z = s @ a.reshape(hidden, p).T
        z += b
        # Softplus and its derivative are computed from one exponential and in place, because this takes most of the
        # training time.
        e = np.exp(-np.abs(z))
        np.log1p(e, out=active[:, :-1])
        active[:, :-1] += np.maximum(z, 0.0)
        np.copyto(rates, e)
        rates[z >= 0.0] = 1.0
        e += np.float32(1.0)
        np.divide(rates, e, out=rates)
        gram = (active.T @ active).astype(np.float64)
        gram[np.diag_indices(hidden)] += PENALTY * n
        gram[-1, -1] += 1e-12 * n
        return np.linalg.solve(gram, (active.T @ wanted).astype(np.float64))

    def loss(theta: Array) -> tuple[float, Array]:
        v = best(theta)
        weights, v32 = theta[: hidden * p], v.astype(np.float32)
        miss = active @ v32
        miss -= wanted
        back = miss @ v32[:-1].T
        back *= rates
        # The output weights are optimal, so the gradient has no contribution from their change.
        gradient = np.concatenate([(back.T @ s).ravel(), back.sum(axis=0)]).astype(np.float64) * (2.0 / (n * c))
        gradient[: hidden * p] += (2.0 * DECAY / c) * weights
        value = float(np.einsum("ij,ij->", miss, miss, dtype=np.float64)) / n
        return (value + PENALTY * float((v[:-1] ** 2).sum()) + DECAY * float(weights @ weights)) / c, gradient

    done = 0

    def callback(_: Array) -> None:
        nonlocal done
        done += 1
        if report is not None:
            report(done, iterations)

    options = {"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": 20, "ftol": 1e-9, "gtol": 1e-9}
    found = minimize(loss, start, jac=True, method="L-BFGS-B", callback=callback, options=options).x
    v = best(found)
    a, b = np.split(found, [hidden * p])
    return Network(centre, scale, a.reshape(hidden, p), b, v[:-1].T * size, v[-1] * size + mean)


def _start(s: NDArray[np.float32], hidden: int, rng: np.random.Generator) -> Array:
    """Return initial weights and biases of a hidden layer.

    Neurons come in opposite pairs. Because softplus(z) - softplus(-z) = z, the initial network can represent linear
    functions of the inputs.
    """
    half, size = hidden - hidden // 2, float(np.sqrt((s * s).sum(axis=1).mean())) or 1.0
    weights, bias = rng.normal(0.0, 1.0 / size, (half, s.shape[1])), rng.uniform(-1.0, 1.0, half)
    pairs = [weights, -weights[: hidden // 2]], [bias, -bias[: hidden // 2]]
    return np.concatenate([np.concatenate(part).ravel() for part in pairs])
