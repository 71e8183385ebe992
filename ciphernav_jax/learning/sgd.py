"""Stochastic gradient descent with momentum on the squared loss: ordinary JAX, which `secure` turns into a
protocol as it stands.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np


@dataclass(frozen=True)
class Model:
    """What is trained.

    Attributes:
        predict: `predict(weights, columns)`, a function of a pytree of weights and of a tuple of arrays, one
            for each column, with a row for each sample: the outputs, float[n, outputs].
        outputs: how many there are; an answer is as many numbers, the class's 1 among zeros, say.

    What `predict` reads besides is read when it is compiled: once for each model, recipe and protocol.
    """

    predict: Callable[[Any, tuple], jax.Array]
    outputs: int


@dataclass(frozen=True)
class Sgd:
    """How to train.

    Raises:
        ValueError: for what is out of range.
    """

    steps: int = 1060
    """Steps, a batch each."""
    batch: int = 500
    """Samples per step."""
    learning_rate: float = 0.6
    """For the mean squared error; taken to the power of two nearest in the update."""
    momentum: float = 0.9
    """Part of the velocity that is kept at each step."""
    schedule: Literal["linear", "constant"] = "linear"
    """Whether the learning rate falls to 0 in a straight line, or stays."""
    chunk: int = 53
    """Steps between checkpoints; they run as one compiled loop."""

    def __post_init__(self):
        for name, least in (("steps", 0), ("batch", 1), ("chunk", 1)):
            value = getattr(self, name)
            if not isinstance(value, int | np.integer) or value < least:
                raise ValueError(f"{name} is an integer from {least} on, not {value!r}")
        if not 0 < self.learning_rate < np.inf:
            raise ValueError(f"learning_rate is above 0 and finite, not {self.learning_rate!r}")
        if not 0 <= self.momentum < 1:
            raise ValueError(f"momentum lies in [0, 1), not at {self.momentum!r}")
        if self.schedule not in ("linear", "constant"):
            raise ValueError(f'schedule is "linear" or "constant", not {self.schedule!r}')

    def scale(self, outputs: int) -> float:
        """What the gradient of the summed loss is multiplied by: a power of two.

        The loss is kept as a sum, whose gradients are far from the resolution of fixed point, and the mean's
        1 / (batch * outputs) goes into the rate; a power of two makes it a mere shift.
        """
        return 2.0 ** round(np.log2(self.learning_rate / (self.batch * outputs)))


def sgd_step(
    model: Model,
    state: tuple,
    columns: tuple,
    answers: jax.Array,
    decay: jax.Array,
    recipe: Sgd,
) -> tuple:
    """One step.

    Args:
        model: what is trained.
        state: weights and velocity, two pytrees of the same shape, and the loss summed so far.
        columns: of the batch's samples.
        answers: float[n, outputs].
        decay: float scalar, public, by which the rate has fallen.
        recipe: the scale and the momentum.

    Returns:
        The next state; the loss is the squared error summed over samples and outputs.
    """
    weights, velocity, total = state
    scale = recipe.scale(model.outputs)

    def error(weights):
        return jnp.sum(jnp.square(model.predict(weights, columns) - answers))

    loss, gradient = jax.value_and_grad(error)(weights)

    def slowed(v, g):
        return recipe.momentum * v - jnp.asarray(decay, g.dtype) * (scale * g)

    velocity = jax.tree.map(slowed, velocity, gradient)
    return jax.tree.map(jnp.add, weights, velocity), velocity, total + loss


def count_right(model: Model, weights: Any, columns: tuple, answers: jax.Array) -> jax.Array:
    """float32: for how many samples the largest output stands where the largest number of the answer does."""
    right = jnp.argmax(model.predict(weights, columns), axis=-1) == jnp.argmax(answers, axis=-1)
    return jnp.sum(right.astype(jnp.float32))
