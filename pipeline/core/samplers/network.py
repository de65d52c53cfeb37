"""Meta-model testing with a neural network (thesis section 4.4.3 and Table 6.1, row 5)."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from pipeline.core.samplers.meta_model import Hyperparameters, MetaModel, MetaModelSampler
from pipeline.core.space import Floats

ITERATIONS = 60
"""Stopping early is part of the regularisation."""

Layers = list[tuple[Floats, Floats]]
"""Weights (inputs, outputs) and biases (outputs,) of each layer."""


class NetworkSampler(MetaModelSampler):
    """Predicts the KPI by a feed-forward network.

    It has tanh in the hidden layers and a sigmoid at the output, as the KPI is in [0, 1], which
    scikit-learn's regressor does not offer. L-BFGS minimises the mean squared error plus an L2
    penalty on the weights. The search and its parameters are those of `MetaModelSampler`.
    """

    grid: ClassVar[tuple[Hyperparameters, ...]] = tuple(
        {"hidden": hidden, "penalty": penalty}
        for hidden in ((16,), (32,), (32, 16))
        for penalty in (1e-3, 1e-2)
    )

    def fit(
        self, inputs: Floats, kpi: Floats, hyperparameters: Hyperparameters, seed: int
    ) -> MetaModel:
        hidden, penalty = hyperparameters["hidden"], hyperparameters["penalty"]
        layers = train(inputs, kpi, hidden, penalty, np.random.default_rng(seed))
        return lambda others: (forward(layers, others)[-1][:, 0], np.zeros(len(others)))


def train(
    inputs: Floats, kpi: Floats, hidden: tuple[int, ...], penalty: float, rng: np.random.Generator
) -> Layers:
    """Fit a network.

    Args:
        inputs: (n, f).
        kpi: (n,), in [0, 1].
        hidden: units of each hidden layer.
        penalty: of the squared weights, at least 0.
        rng: source of the initial weights.
    """
    # Takes half a second to import, and every study constructs every strategy to check it.
    from scipy.optimize import minimize

    shapes = list(pairwise((inputs.shape[1], *hidden, 1)))
    start = [(rng.normal(size=shape) / np.sqrt(shape[0]), np.zeros(shape[1])) for shape in shapes]

    def objective(flat: Floats) -> tuple[float, Floats]:
        layers = _unpacked(flat, shapes)
        loss, gradients = loss_and_gradients(layers, inputs, kpi, penalty)
        return loss, _packed(gradients)

    minimum: Any = minimize(
        objective, _packed(start), jac=True, method="L-BFGS-B", options={"maxiter": ITERATIONS}
    )
    return _unpacked(minimum.x, shapes)


def forward(layers: Layers, inputs: Floats) -> list[Floats]:
    """The inputs (n, f) and the outputs of each layer; the last are the predictions, (n, 1)."""
    from scipy.special import expit

    outputs = [inputs]
    for weights, biases in layers[:-1]:
        outputs.append(np.tanh(outputs[-1] @ weights + biases))
    weights, biases = layers[-1]
    return [*outputs, expit(outputs[-1] @ weights + biases)]


def loss_and_gradients(
    layers: Layers, inputs: Floats, kpi: Floats, penalty: float
) -> tuple[float, Layers]:
    """Squared errors plus `penalty` times the squared weights, both summed, a test; its gradients.

    Args: as for `train`.
    """
    outputs, count = forward(layers, inputs), len(kpi)
    error = outputs[-1][:, 0] - kpi
    squares = sum(float(np.sum(weights**2)) for weights, _ in layers)
    loss = float(error @ error + penalty * squares) / count
    signal = (2 / count * error * outputs[-1][:, 0] * (1 - outputs[-1][:, 0]))[:, None]
    gradients: Layers = []
    for (weights, _), before in zip(reversed(layers), reversed(outputs[:-1]), strict=True):
        gradients.insert(0, (before.T @ signal + 2 * penalty / count * weights, signal.sum(axis=0)))
        signal = (signal @ weights.T) * (1 - before**2)
    return loss, gradients


def _packed(layers: Layers) -> Floats:
    return np.concatenate([part.ravel() for layer in layers for part in layer])


def _unpacked(flat: Floats, shapes: list[tuple[int, int]]) -> Layers:
    layers, at = [], 0
    for inputs, outputs in shapes:
        end = at + inputs * outputs
        layers.append((flat[at:end].reshape(inputs, outputs), flat[end : end + outputs]))
        at = end + outputs
    return layers
