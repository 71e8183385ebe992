"""Bit slicing: 64 values of 64 bits turned into 64 words, one for each bit position.

A word of a sliced array holds the same bit of 64 values, so one bitwise operation on words works on 64
values at once, and a circuit over the bits of N values costs as many word operations as N / 64 words have.
Value number i * B + b of N (padded to 64 B) is bit i of the words in column b.
"""

import math

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import UInt64

WORD = 64


def most_significant_bit(x: UInt64[Array, "..."]) -> UInt64[Array, "..."]:
    """1 where x stands for a negative number, else 0."""
    return x >> 63


def columns(count: int) -> int:
    """How many columns B of 64 values hold `count` values."""
    return -(-count // WORD)


def _transpose(x: UInt64[Array, "64 b"]) -> UInt64[Array, "64 b"]:
    """Transposes the 64 x 64 bit matrix that stands in each column: bit j of word i becomes bit i of word j.

    Six rounds of exchanging blocks (Warren, Hacker's Delight, 7-3). Each round pairs the words i and
    i + 32 and then interleaves the halves, which rotates the bits of the index; after six rounds every
    word is back in its place. All rounds are alike, so they run in one `scan`, whose steps XLA does not
    compute twice. A selection interleaves the halves: a `stack` in its place takes XLA twice as long.
    """
    distance = [32, 16, 8, 4, 2, 1]
    low_half = [sum(1 << i for i in range(WORD) if not i & d) for d in distance]
    first = np.array([True, False])[:, None]  # of the two words of a pair, [pair, 2, column]

    def exchange(x, stage):
        d, low = stage
        a, b = x[:32], x[32:]
        moved = ((a >> d) ^ b) & low
        return jnp.where(first, (a ^ (moved << d))[:, None], (b ^ moved)[:, None]).reshape(x.shape), None

    stages = (np.array(distance, np.uint64), np.array(low_half, np.uint64))
    return lax.scan(exchange, x, stages)[0]


def bit_slice(x: UInt64[Array, "..."]) -> UInt64[Array, "64 b"]:
    """Row j holds bit j of all values of x, 64 to a word; B = ceil(size / 64), padded with zeros."""
    flat = x.reshape(-1)
    b = columns(flat.size)
    return _transpose(jnp.pad(flat, (0, WORD * b - flat.size)).reshape(WORD, b))


def bit_unslice(words: UInt64[Array, "64 b"], shape: tuple[int, ...]) -> UInt64[Array, "*shape"]:
    """The inverse of `bit_slice`, cut to `shape`."""
    return _transpose(words).reshape(-1)[: math.prod(shape)].reshape(shape)


def pack(bits: UInt64[Array, "..."]) -> UInt64[Array, " b"]:
    """One row of a sliced array from values that are 0 or 1."""
    flat = bits.reshape(-1)
    b = columns(flat.size)
    rows = jnp.pad(flat, (0, WORD * b - flat.size)).reshape(WORD, b)
    return jnp.sum(rows << np.arange(WORD, dtype=np.uint64)[:, None], axis=0, dtype=jnp.uint64)


def unpack(words: UInt64[Array, "*rows b"], shape: tuple[int, ...]) -> UInt64[Array, "..."]:
    """The inverse of `pack`, row by row: values 0 or 1 of the given shape."""
    bits = (words[..., None, :] >> np.arange(WORD, dtype=np.uint64)[:, None]) & np.uint64(1)
    rows = words.shape[:-1]
    return bits.reshape(*rows, -1)[..., : math.prod(shape)].reshape(*rows, *shape)
