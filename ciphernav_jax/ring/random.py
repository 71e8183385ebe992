"""Uniform ring elements.

The generator is XLA's counter-based Threefry-2x32 with 20 rounds (Salmon et al., *Parallel random numbers:
as easy as 1, 2, 3*, SC 2011), on a 64-bit key: fast, reproducible, the same on every backend, and **not** a
vetted cryptographic generator. A simulation needs uniform, independent words; a deployment needs a dealer with a
cipher and a 128-bit key.
"""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax.ring.fixed_point import require_x64

# Words in one call of the generator: 4 MB, so that a draw is still in the cache when it is used.
PIECE = 1 << 19


def draw(key: Array, shapes: Sequence[tuple[int, ...]]) -> list[UInt64[Array, "..."]]:
    """Independent uniform uint64 arrays of the given shapes, from few large calls of the generator.

    One call for many arrays keeps compile and run time down; the arrays are cut from its output in order.

    Args:
        key: a JAX random key. The same key and shapes give the same words.
        shapes: the shapes wanted.
    """
    require_x64()
    if not jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        key = jax.random.wrap_key_data(key)
    words = jax.random.key_data(key).astype(jnp.uint32).reshape(-1)
    state = jnp.concatenate([words, jnp.zeros(4, jnp.uint32)])[:4]

    arrays: list[Array] = []
    for group in _groups([math.prod(shape) for shape in shapes]):
        total = sum(math.prod(shapes[i]) for i in group)
        state, uniform = lax.rng_bit_generator(
            state, (total,), jnp.uint64, algorithm=lax.RandomAlgorithm.RNG_THREE_FRY
        )
        start = 0
        for i in group:
            size = math.prod(shapes[i])
            arrays.append(lax.slice(uniform, (start,), (start + size,)).reshape(shapes[i]))
            start += size
    return arrays


def _groups(sizes: Sequence[int]) -> list[list[int]]:
    """Consecutive indices, grouped so that a group holds about PIECE words."""
    groups: list[list[int]] = []
    filled = PIECE
    for i, size in enumerate(sizes):
        if filled + size > PIECE:
            groups.append([])
            filled = 0
        groups[-1].append(i)
        filled += size
    return groups
