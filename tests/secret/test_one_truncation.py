"""A product is truncated once: whatever is moved out of it, selected, clipped or shifted has the same units.

Each function says of a product p what is so in real numbers: all its entries are true. The products have
fractional bits that a truncation rounds, and no two entries are near one another.
"""

import zlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.extend.core import jaxpr_as_fun

import ciphernav_jax as cn

from .random_programs.checking import step_by_step

pytestmark = pytest.mark.slow


def larger_than_0(p):
    """Of two products together, which may not have the bits of a truncation."""
    return jnp.where(p.max(1) > 0, jax.nn.relu(p).max(1) == p.max(1), True)


SELF = {
    "clipped within its range": lambda p: jnp.clip(p, -50.0, 50.0) == p,
    "clipped is not above": lambda p: ~(jnp.clip(p, -50.0, 50.0) > p),
    "clipped by public numbers": lambda p: (
        jnp.clip(p, jnp.full(8, -1.0), jnp.full(8, 1.0)) <= jnp.maximum(p, -1.0)
    ),
    "clipped by one end": lambda p: jnp.where(p < 2, jnp.clip(p, -99.0, 2.0) == p, True),
    "relu6": lambda p: jnp.where(p > 0, jnp.where(p < 6, jax.nn.relu6(p) == p, True), True),
    "relu, a part": lambda p: jnp.where(p[:1] > 0, jax.nn.relu(p)[:1] == p[:1], True),
    "relu of a part": lambda p: jnp.where(p[:, 1] > 0, jax.nn.relu(p[:, 1]) == p[:, 1], True),
    "relu, and nothing added": lambda p: jnp.where(p > 0, jax.nn.relu(p) + jnp.zeros(8) == p, True),
    "relu of another shape": lambda p: p <= jax.nn.relu(p.T.reshape(-1)).reshape(8, -1).T,
    "relu of the negative": lambda p: jax.nn.relu(p) - jax.nn.relu(-p) == p,
    "relu of what is shifted": lambda p: jnp.maximum(p, 0.1) - 0.1 == jax.nn.relu(p - 0.1),
    "relu after its maximum": lambda p: (jnp.max(p) + 0 * p, jnp.where(p > 0, jax.nn.relu(p) == p, True))[1],
    "maximum after relu": lambda p: jnp.max(jax.nn.relu(p), axis=1) == jnp.max(p, axis=1),
    "maximum of a part": lambda p: jnp.max(p[:, :4], axis=1) <= jnp.max(p, axis=1),
    "maximum of both parts": lambda p: jnp.maximum(p[:, :3].max(1), p[:, 3:].max(1)) == p.max(1),
    "minimum and maximum": lambda p: jnp.min(-p, axis=1) == -jnp.max(p, axis=1),
    "gathered": lambda p: p[jnp.array([3, 1])].max(1) == p.max(1)[jnp.array([3, 1])],
    "padded": lambda p: jnp.pad(p, 1, constant_values=-90.0).max() == p.max(),
    "two beside each other": lambda p: jnp.concatenate([p, p - 9], axis=1).max(1) == p.max(1),
    "selected": lambda p: (
        jnp.where(p[:, :1] > 0, p, p[::-1])[:, 2:].max(1)
        == jnp.where(p[:, 0] > 0, p[:, 2:].max(1), p[::-1][:, 2:].max(1))
    ),
    "absolute value": lambda p: jnp.abs(p) == jnp.maximum(p, -p),
    "in a loop": lambda p: lax.fori_loop(
        0, 2, lambda i, same: same & (jnp.clip(p, -50.0, 50.0) == p), p < 90
    ),
    "with a secret added": lambda p: larger_than_0(p + p[0, 0]),
}


@pytest.fixture(scope="module")
def factors():
    rng = np.random.default_rng(3)
    return rng.normal(size=(16, 5)), rng.normal(size=(5, 8))


@pytest.mark.parametrize(
    ("parties", "protocol"),
    [(3, cn.Protocol()), (2, cn.Protocol(truncation="nearest", comparison="ideal"))],
    ids=str,
)
def test_what_is_made_of_a_product_has_its_units(factors, parties, protocol):
    found = {}
    with step_by_step():
        shared = cn.share(jax.random.key(0), factors, parties=parties, protocol=protocol)
        for name, function in SELF.items():
            traced = jaxpr_as_fun(jax.make_jaxpr(lambda x, w, function=function: function(x @ w))(*factors))
            assert np.all(traced(*factors)), f"{name} is not so in real numbers"
            key = jax.random.key(zlib.crc32(name.encode()))
            (found[name],) = cn.reveal(cn.secure(traced, protocol=protocol)(key, *shared))
    assert {name: int(np.sum(~x)) for name, x in found.items() if not np.all(x)} == {}
