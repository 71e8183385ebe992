"""The works that are timed: ordinary JAX functions, and their inputs by seed.

- `product`: x y of two secret matrices.
- `relu`: of secret values.
- `forward`: the paper's action classifier, all secret; `forward-public` with public weights.
- `train`: a step of training it in secret: forward, backward through the squared error, update.
- `train-loop`: several such steps in one loop, compiled as one function, as trainings run.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import secure

# Multiplies the gradient of the summed error: a learning rate of 0.6 for the mean over 500 x 5 values, as a
# power of two. The sum's gradients are far from the resolution of fixed point, the mean's are not.
RATE = 2.0**-12

Weights = list[tuple[Any, Any]]


@dataclass(frozen=True)
class Sizes:
    """How large the works are."""

    widths: tuple[int, ...] = (288, 128, 64, 16, 5)
    """Of the network, from the features to the actions."""
    forward: int = 100
    """Batch of a forward pass."""
    train: int = 500
    """Batch of a training step."""
    steps: int = 10
    """Steps of `train-loop`."""
    relu: int = 100_000
    product: tuple[int, int, int] = (500, 288, 128)
    """Rows, contraction and columns."""

    @staticmethod
    def from_json(sizes: dict[str, Any]) -> "Sizes":
        # Tuples are lists in JSON.
        given: dict[str, Any] = {n: tuple(x) if isinstance(x, list) else x for n, x in sizes.items()}
        return Sizes(**given)


@dataclass(frozen=True)
class Work:
    """A function, its arguments, and what it costs in products.

    Attributes:
        name, title: as in the table.
        function: ordinary JAX.
        args: its arguments, pytrees of float64 arrays whose values are those of float32.
        secret: which of them are secret.
        products: (rows, contraction, columns) of each matrix product in one call of the function.
        steps: how often it is called in one loop, its first result the next first argument.
    """

    name: str
    title: str
    function: Callable[..., Any]
    args: tuple[Any, ...]
    secret: tuple[bool, ...]
    products: tuple[tuple[int, int, int], ...] = ()
    steps: int = 1

    def secured(self, protocol: Protocol) -> Callable[..., Any]:
        """`run(key, *args)`: all steps, evaluated by the parties on secrets."""
        step = secure(self.function, protocol=protocol)
        if self.steps == 1:
            return step

        def run(key: Array, state: Any, *args: Any) -> Any:
            of_steps = keys.derive(key, "step", np.arange(self.steps))
            return jax.lax.scan(lambda state, key: step(key, state, *args), state, of_steps)

        return run

    def expected(self) -> Any:
        """What `run` should give: the same in float64, in the clear."""
        if self.steps == 1:
            return jax.jit(self.function)(*self.args)

        @jax.jit
        def run(state: Any, *args: Any) -> Any:
            return jax.lax.scan(lambda s, _: self.function(s, *args), state, length=self.steps)

        return run(*self.args)


def forward(weights: Weights, x: Array) -> Array:
    """float[n, 5]: linear layers with ReLU between."""
    for kernel, bias in weights[:-1]:
        x = jax.nn.relu(x @ kernel + bias)
    kernel, bias = weights[-1]
    return x @ kernel + bias


def squared_error(weights: Weights, x: Array, labels: Array) -> Array:
    """Summed over the batch and the actions."""
    return jnp.sum(jnp.square(forward(weights, x) - labels))


def train_step(weights: Weights, x: Array, labels: Array) -> tuple[Weights, Array]:
    """The weights after a step of SGD, and the squared error summed over the batch before it."""

    loss, gradient = jax.value_and_grad(squared_error)(weights, x, labels)
    return jax.tree.map(lambda w, g: w - RATE * g, weights, gradient), loss


def product(x: Array, y: Array) -> Array:
    """The matrix product."""
    return x @ y


def works(sizes: Sizes | None = None, seed: int = 0) -> dict[str, Work]:
    """All works by name, from the quickest to the slowest; the inputs come from `seed`."""
    sizes = sizes or Sizes()
    rng = np.random.default_rng(seed)
    rows, contraction, columns = sizes.product
    layers = tuple(itertools.pairwise(sizes.widths))
    weights = random_weights(rng, sizes.widths)
    few, many = (random_inputs(rng, n, sizes.widths[0]) for n in (sizes.forward, sizes.train))
    actions = sizes.widths[-1]
    labels = np.eye(actions)[rng.integers(0, actions, sizes.train)]

    passed = tuple((sizes.forward, *layer) for layer in layers)
    # Each layer's product, its gradient for the kernel, and, but for the first, that for its input.
    n = sizes.train
    trained = tuple(
        [(n, i, o) for i, o in layers] + [(i, n, o) for i, o in layers] + [(n, o, i) for i, o in layers[1:]]
    )
    step = (train_step, (weights, many, labels), (True, True, True), trained)
    all_works = (
        Work(
            "product",
            f"product {rows}x{contraction}x{columns}, both secret",
            product,
            (random_inputs(rng, rows, contraction), random_inputs(rng, contraction, columns)),
            (True, True),
            ((rows, contraction, columns),),
        ),
        Work("relu", f"ReLU of {sizes.relu:,}", jax.nn.relu, (4 * random_inputs(rng, sizes.relu),), (True,)),
        Work(
            "forward-public",
            f"forward, batch {sizes.forward}, public weights",
            forward,
            (weights, few),
            (False, True),
            passed,
        ),
        Work(
            "forward",
            f"forward, batch {sizes.forward}, secret weights",
            forward,
            (weights, few),
            (True, True),
            passed,
        ),
        Work("train", f"training step, batch {n}, secret weights", *step),
        Work("train-loop", f"the same, one of {sizes.steps} in a loop", *step, steps=sizes.steps),
    )
    return {work.name: work for work in all_works}


def error(found: Any, expected: Any) -> float:
    """The largest deviation of any output, as part of that output's largest value where this is above 1."""
    errors = [
        np.max(np.abs(np.asarray(f, np.float64) - e)) / max(1.0, np.max(np.abs(e)))
        for f, e in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)
    ]
    return float(np.max(errors))


def random_inputs(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """float64 from the normal distribution, with the values of float32."""
    return rng.standard_normal(shape, np.float32).astype(np.float64)


def random_weights(rng: np.random.Generator, widths: tuple[int, ...]) -> Weights:
    """A kernel and a bias for each layer, float64 with the values of float32."""
    return [_layer(rng, fan_in, fan_out) for fan_in, fan_out in itertools.pairwise(widths)]


def _layer(rng: np.random.Generator, fan_in: int, fan_out: int) -> tuple[np.ndarray, np.ndarray]:
    # PyTorch's default, which is the paper's: uniform within 1 / sqrt(fan in).
    bound = fan_in**-0.5
    kernel, bias = (rng.uniform(-bound, bound, shape) for shape in ((fan_in, fan_out), (fan_out,)))
    return tuple(array.astype(np.float32).astype(np.float64) for array in (kernel, bias))  # pyright: ignore
