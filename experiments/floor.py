"""What a work needs at least: the time of its products and its randomness, at rates measured on the spot.

- Multiply-adds modulo 2^64: the dealer makes one product of matrices for each product of secrets and every
  party two; with a public factor every party makes one and the dealer none. Their rate is that of words that
  stay in registers.
- Random bytes: the uniform words of the dealer, at the speed of the generator.

Everything else, openings, circuits, memory traffic, counts as overhead.
"""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from ciphernav_jax import ring
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import cost, secure
from experiments.work import Work

CHAIN = 64
"""Multiply-adds for each word read and written, when their rate is measured."""


def rates() -> dict[str, float]:
    """This machine's raw rates: uint64 multiply-adds and random bytes a second, the best of several runs."""
    many, words = 1 << 20, 1 << 19  # the latter stay in the cache
    x = jnp.arange(many, dtype=jnp.uint64)
    key = keys.root(0)
    return {
        "multiply_adds": CHAIN * many / _best(jax.jit(_chained), x),
        "random_bytes": 8 * words / _best(jax.jit(lambda key: ring.draw(key, [(words,)])), key),
    }


def _chained(x: Array) -> Array:
    chains = [x + i for i in range(8)]
    for _ in range(CHAIN // len(chains)):
        chains = [c * c + x for c in chains]
    return sum(chains[1:], start=chains[0])


def needs(work: Work, protocol: Protocol, parties: int, args: tuple[Any, ...]) -> dict[str, int]:
    """Multiply-adds and random bytes of one step, all parties and the dealer; nothing is computed."""
    each = 1 + 2 * parties if all(work.secret) else parties
    products = sum(m * k * n for m, k, n in work.products)
    drawn = cost(secure(work.function, protocol=protocol), *args).uniform_words
    return {
        "multiply_adds": each * products,
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
