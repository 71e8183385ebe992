"""A training to compare variants by: the paper's classifier learns what a random teacher network answers.

SGD with momentum on the squared error, the step of `navigation.classifier`, on one batch. Errors of each step
add up in the weights, so that a small bias shows where a single result looks right.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.work import (
    RATE,
    Sizes,
    Weights,
    forward,
    random_inputs,
    random_weights,
    squared_error,
)

MOMENTUM = 0.9

State = tuple[Weights, Weights, Any]


@dataclass(frozen=True)
class Training:
    """Initial weights; a batch of features and one-hot labels; features for a forward pass. All float64."""

    weights: Weights
    features: np.ndarray
    labels: np.ndarray
    inputs: np.ndarray

    @property
    def state(self) -> State:
        """Weights, their velocity, and the squared error summed over the batch before the last update."""
        return self.weights, jax.tree.map(np.zeros_like, self.weights), np.float64(0)


def training(sizes: Sizes, seed: int) -> Training:
    """The training of a network of `sizes.widths`, with batches `sizes.train` and `sizes.forward`."""
    rng = np.random.default_rng(seed)
    weights, teacher = random_weights(rng, sizes.widths), random_weights(rng, sizes.widths)
    features, inputs = (random_inputs(rng, n, sizes.widths[0]) for n in (sizes.train, sizes.forward))
    # Without their means, a random network's answers are nearly the same for all inputs.
    answers = np.asarray(forward(teacher, jnp.asarray(features)))
    answers = (answers - answers.mean(axis=0)) / answers.std(axis=0)
    labels = np.eye(sizes.widths[-1])[np.argmax(answers, axis=1)]
    return Training(weights, features, labels, inputs)


def sgd_step(state: State, features: Array, labels: Array) -> State:
    """The state after a step. Ordinary JAX, for floats and, through `secure`, for secrets."""
    weights, velocity, _ = state
    loss, gradient = jax.value_and_grad(squared_error)(weights, features, labels)
    velocity = jax.tree.map(lambda v, g: MOMENTUM * v - RATE * g, velocity, gradient)
    return jax.tree.map(jnp.add, weights, velocity), velocity, loss


def gradient_of_first_step(state: State, results: int) -> Weights:
    """The gradient of the mean over so many results, as it went into the update of the first step."""
    return jax.tree.map(lambda v: np.asarray(v) / (-RATE * results), state[1])


def largest_sign_input(weights: Weights, x: Array) -> float:
    """The largest magnitude of a value that ReLU compares with 0."""
    largest = 0.0
    for kernel, bias in weights[:-1]:
        x = x @ kernel + bias
        largest = max(largest, float(jnp.max(jnp.abs(x))))
        x = jax.nn.relu(x)
    return largest
