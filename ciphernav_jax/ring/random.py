"""Uniform ring elements.

The generator is XLA's counter-based Threefry-2x32 with 20 rounds (Salmon et al., *Parallel random numbers:
as easy as 1, 2, 3*, SC 2011), on a 64-bit key: fast, reproducible, the same on every backend, and **not** a
vetted cryptographic generator. A simulation needs uniform, independent words; a deployment needs a dealer
with a cipher and a 128-bit key.
"""

import itertools
import math
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax.ring.fixed_point import require_x64

# Words in one call of the generator: 1 MB, which stays in the cache.
PIECE = 1 << 17


def draw(
    key: Array, shapes: Sequence[tuple[int, ...]], generator: str = "threefry"
) -> list[UInt64[Array, "..."]]:
    """Independent uniform uint64 arrays of the given shapes, cut in order from one stream of words.

    The stream is made in a `scan`. XLA compiles the generator once for it however many arrays there are, and
    keeps its output: it would otherwise fuse the generator into, and run it again for, each use of the words.

    Args:
        key: a JAX random key. The same key and shapes give the same words.
        shapes: the shapes wanted.
    """
    require_x64()
    sizes = [math.prod(shape) for shape in shapes]
    if not jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        key = jax.random.wrap_key_data(key)
    # One key at a time under vmap: XLA's generator would serve a batch of keys from the first of them.
    stream = jax.custom_batching.sequential_vmap(partial(_stream, count=sum(sizes)))
    words = stream(jax.random.key_data(key))
    starts = [0, *itertools.accumulate(sizes)]
    return [
        lax.slice(words, (start,), (start + size,)).reshape(shape)
        for start, size, shape in zip(starts, sizes, shapes, strict=False)
    ]


def _stream(key_data: Array, count: int) -> UInt64[Array, " count"]:
    words = key_data.astype(jnp.uint32).reshape(-1)
    # The counter starts at 2^63. `jax.random` derives keys and bits from the same block function with small
    # counters: from 0, the first word drawn from a key would be the key that split or fold_in makes of it.
    state = jnp.concatenate([words, jnp.array([0, 1 << 31], jnp.uint32)])[:4]

    # At least two steps: XLA unrolls a loop of one, and then fuses it as above.
    piece = min(PIECE, -(-count // 2))
    steps = -(-count // piece) if piece else 0

    def step(state, _):
        return lax.rng_bit_generator(state, (piece,), jnp.uint64, algorithm=lax.RandomAlgorithm.RNG_THREE_FRY)

    _, uniform = lax.scan(step, state, length=steps)
    return uniform.reshape(-1)[:count]
