"""What a work needs at least: the time of its products and its randomness, at rates measured on the spot.

- Multiply-adds: in float64, since a ring product takes five products of 22-bit limbs (`ring.linear`). The
  dealer makes one ring product for each product of secrets and every party two; with a public factor every
  party makes one and the dealer none.
- Random bytes: the uniform words of the dealer, at the speed of the generator.

Everything else, limbs, openings, circuits, memory traffic, counts as overhead.
"""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax import ring
from ciphernav_jax.experiments.work import Work
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret import cost, secure

LIMB_PRODUCTS = 5


def rates() -> dict[str, float]:
    """This machine's raw rates: float64 multiply-adds and random bytes a second, the best of several runs."""
    size, words = 1024, 1 << 19  # words that stay in the cache
    x = jnp.asarray(np.random.default_rng(0).standard_normal((size, size)))
    key = jax.random.key(0)
    return {
        "multiply_adds": size**3 / _best(jax.jit(jnp.matmul), x, x),
        "random_bytes": 8 * words / _best(jax.jit(lambda key: ring.draw(key, [(words,)])), key),
    }


def needs(work: Work, protocol: Protocol, parties: int, args: tuple[Any, ...]) -> dict[str, int]:
    """float64 multiply-adds and random bytes of one step, all parties and the dealer; nothing is computed."""
    each = 1 + 2 * parties if all(work.secret) else parties
    products = sum(m * k * n for m, k, n in work.products)
    drawn = cost(secure(work.function, protocol=protocol), *args).uniform_words
    return {
        "multiply_adds": LIMB_PRODUCTS * each * products,
        "random_bytes": 8 * drawn,
    }


def seconds(needed: dict[str, int], rate: dict[str, float]) -> float:
    """The time of what is needed, one after the other."""
    return sum(needed[name] / rate[name] for name in needed)


def _best(function: Callable[..., Array | list[Array]], *args: Any, runs: int = 15) -> float:
    jax.block_until_ready(function(*args))
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        jax.block_until_ready(function(*args))
        times.append(time.perf_counter() - start)
    return min(times)
