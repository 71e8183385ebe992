"""The operations of random programs as a user writes them in JAX."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax


class Plain:
    """The operations as a user writes them in JAX."""

    def add(self, x, y):
        return x + y

    def sub(self, x, y):
        return x - y

    def mul(self, x, y):
        return x * y

    def neg(self, x):
        return -x

    def square(self, x):
        return jnp.square(x)

    def power(self, x, n):
        return x**n

    def dot(self, x, y):
        return jnp.dot(x, y)

    def plus(self, x, c):
        return x + _constant(x, c)

    def scaled(self, x, c):
        return x * _constant(x, c)

    def divided(self, x, c):
        return x / _constant(x, c)

    def forgotten(self, x, c):
        return x * 0.0 + _constant(x, c)

    def over(self, x, y):
        return x / y

    def table(self, x, c):
        return x @ _constant(x, c)

    def multiple(self, x, n):
        return x * jnp.asarray(n, x.dtype)

    def compare(self, x, y, name):
        return getattr(jnp, name)(x, y)

    def against(self, x, c, name):
        return getattr(jnp, name)(x, _constant(x, c))

    def maximum(self, x, y):
        return jnp.maximum(x, y)

    def minimum(self, x, y):
        return jnp.minimum(x, y)

    def relu(self, x):
        return jax.nn.relu(x)

    def clip(self, x, low, high):
        return jnp.clip(x, _constant(x, low), _constant(x, high))

    def abs(self, x):
        return jnp.abs(x)

    def sign(self, x):
        return jnp.sign(x)

    def where(self, b, x, y):
        return jnp.where(b, x, y)

    def one_of(self, b, x, on_true, on_false):
        return x * jnp.where(b, _constant(x, on_true), _constant(x, on_false))

    def over_one_of(self, b, x, on_true, on_false):
        return x / jnp.where(b, _constant(x, on_true), _constant(x, on_false))

    def sum(self, x, axis):
        return jnp.sum(x, axis=axis)

    def mean(self, x, axis):
        return jnp.mean(x, axis=axis)

    def var(self, x, axis):
        return jnp.var(x, axis=axis)

    def cumsum(self, x):
        return jnp.cumsum(x, axis=0)

    def max(self, x, axis):
        return jnp.max(x, axis=axis)

    def min(self, x, axis):
        return jnp.min(x, axis=axis)

    def argmax(self, x, axis):
        return jnp.argmax(x, axis=axis)

    def argmin(self, x, axis):
        return jnp.argmin(x, axis=axis)

    def masked_max(self, x, hidden, mask):
        return jnp.max(x + _constant(x, np.where(hidden, mask, 0.0)), axis=-1)

    def convert(self, x, dtype):
        return x.astype(dtype)

    def logic(self, x, y, name):
        return getattr(jnp, name)(x, y)

    def logical_not(self, x):
        return ~x

    def any(self, x, axis):
        return jnp.any(x, axis=axis)

    def all(self, x, axis):
        return jnp.all(x, axis=axis)

    def reshape(self, x, shape):
        return x.reshape(shape)

    def transpose(self, x):
        return x.T

    def reverse(self, x):
        return jnp.flip(x, 0)

    def part(self, x, start):
        return x[start:]

    def copies(self, x, n):
        return jnp.broadcast_to(x, (n, *x.shape))

    def padded(self, x, c):
        return lax.pad(x, jnp.asarray(c, x.dtype), [(1, 1, 0)] + [(0, 0, 0)] * (x.ndim - 1))

    def joined(self, x, y):
        return jnp.concatenate([x, y])

    def split(self, x):
        return jnp.split(x, 2)[1]

    def take(self, x, index):
        return x[np.array(index)]

    def filled(self, x, c):
        return x.at[np.array([0, 99])].get(mode="fill", fill_value=c)

    def put(self, x, y):
        return x.at[0].set(y)

    def put_sum(self, x, y):
        return x.at[np.array([0, 0])].add(y)

    def slice_at(self, x, i):
        return lax.dynamic_index_in_dim(x, i, keepdims=False)

    def update_at(self, x, y, i):
        return lax.dynamic_update_index_in_dim(x, y, i, 0)

    def scan(self, x, start, body):
        def step(carry, each):
            carry = BODIES[body](self, carry, each)
            return carry, carry

        return lax.scan(step, start, x)[1]

    def repeated(self, x, n, body):
        return lax.fori_loop(0, n, lambda _, carry: BODIES[body](self, carry, x), x)

    def until(self, x, n, body):
        def step(state):
            return state[0] + jnp.ones((), n.dtype), BODIES[body](self, state[1], x)

        return lax.while_loop(lambda state: state[0] < n, step, (jnp.zeros_like(n), x))[1]

    def branch(self, x, flag, body, other):
        return lax.cond(flag, lambda x: BODIES[body](self, x, x), lambda x: BODIES[other](self, x, x), x)

    def slope(self, x, c):
        """The derivative of sum(max(x, c)^2): 2 max(x, c) where x > c, half of it where they are equal."""
        return jax.grad(lambda v: jnp.sum(jnp.maximum(v, _constant(x, c)) ** 2))(x)

    def product_slope(self, x, y, c):
        """The derivative by x of sum(max(x y, c)): y where x y > c, half of it where they are equal."""
        return jax.grad(lambda v: jnp.sum(jnp.maximum(v * y, _constant(x, c))))(x)

    def product_beside_its_maximum(self, x, y, z, name):
        product = x * y
        return getattr(jnp, name)(jnp.maximum(product, z), product)

    def largest_product(self, x, y):
        product = x * y
        return jnp.where(product == jnp.max(product), product, jnp.zeros((), x.dtype))


def _constant(x, c):
    return np.asarray(c, x.dtype)


# What loops and branches do: (operations, carry, each) -> carry.
BODIES: list[Callable[[Any, Any, Any], Any]] = [
    lambda ops, carry, x: ops.add(carry, x),
    lambda ops, carry, x: ops.add(ops.scaled(carry, 0.5), x),
    lambda ops, carry, x: ops.maximum(carry, ops.mul(x, x)),
    lambda ops, carry, x: ops.add(ops.mul(ops.scaled(carry, 0.3), x), carry),
    lambda ops, carry, x: ops.where(ops.compare(carry, x, "greater"), ops.scaled(carry, 0.9), x),
]
