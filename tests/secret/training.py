"""The training step that the deployment's processes and those of counted messages run."""

import jax
import jax.numpy as jnp


def training_step(weights, x, y):
    """One step of SGD on a two-layer network with ReLU."""

    def loss(weights):
        return jnp.sum((jax.nn.relu(x @ weights["first"]) @ weights["second"] - y) ** 2)

    value, gradient = jax.value_and_grad(loss)(weights)
    return value, jax.tree.map(lambda w, g: w - 2.0**-8 * g, weights, gradient)
