"""Uniform ring elements from a counter-based generator, threefry or chacha20.

Both encrypt successive numbers under the key: the words are reproducible, the same on every backend.

- **threefry**: Threefry-2x32 with 20 rounds under a 64-bit key, to which a longer one is hashed; the cipher
  of JAX's own keys. It passes BigCrush, but is **not** a vetted cryptographic generator.
- **chacha20**: the stream cipher of RFC 8439, five to seven times slower. Its 256-bit key is the key's data
  followed by zeros: no stronger than that data, 64 bits in JAX's default keys and 128 in `rbg` keys.

A simulation needs uniform, independent words, and either gives them. A deployment needs a dealer with a
cipher and a secret key of at least 128 bits, made by the operating system and not by a seed.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax.ring import chacha, keys, threefry
from ciphernav_jax.ring.fixed_point import require_x64

Generator = Literal["threefry", "chacha20"]
Halves = tuple[Array, Array]

MAX_WORDS = 1 << 32
# Streams are made in multiples of this many numbers.
ROUND = 64


def draw(
    key: Array, shapes: Sequence[tuple[int, ...]], generator: Generator = "threefry"
) -> list[UInt64[Array, "..."]]:
    """Independent uniform uint64 arrays of the given shapes, cut in order from one stream of words.

    Under `vmap` each key has the stream that it has alone.

    Args:
        key: a JAX random key, of 64 or 128 bits. The same key, shapes and generator give the same words.
        shapes: the shapes wanted, of at most 2^32 words together; a stream does not repeat within them.
        generator: "threefry" or "chacha20"; see the module's docstring.

    Raises:
        ValueError: more words than that, several keys, a key of another length, or an unknown generator.
        RuntimeError: 64-bit types are switched off.
    """
    require_x64()
    if generator not in _STREAMS:
        raise ValueError(f"unknown generator {generator!r}; choose one of {', '.join(get_args(Generator))}")
    key = keys.typed(key)
    if key.shape:
        raise ValueError(f"draw takes one key, got {key.shape}; use jax.vmap for several")
    data = keys.words(key)

    sizes = [math.prod(shape) for shape in shapes]
    if sum(sizes) > MAX_WORDS:
        raise ValueError(f"cannot draw {sum(sizes)} words from one key: at most 2^32. Split the key.")
    rows = _STREAMS[generator](data, sum(sizes))
    starts = itertools.accumulate(sizes, initial=0)
    return [
        _cut(rows, start, start + size).reshape(shape)
        for start, size, shape in zip(starts, sizes, shapes, strict=False)
    ]


def _cut(rows: list[UInt64[Array, " n"]], start: int, stop: int) -> UInt64[Array, " {stop}-{start}"]:
    """The words from start to stop of rows laid end to end. Few arrays span two rows; the rest are slices."""
    n = rows[0].size
    parts = [
        lax.slice(row, (max(start - i * n, 0),), (min(stop - i * n, n),))
        for i, row in enumerate(rows)
        if start < (i + 1) * n and stop > i * n
    ]
    return jnp.concatenate(parts or [jnp.zeros(0, jnp.uint64)])


def _threefry(data: Array, count: int) -> list[UInt64[Array, " count"]]:
    """One row of words."""
    # The keys that are derived from a key, and what `jax.random` makes of it, encrypt other numbers.
    key = keys.cipher_key(data)
    return _kept(lambda i: [threefry.block(key, (jnp.uint32(keys.STREAM), i))], count)


def _chacha20(data: Array, count: int) -> list[UInt64[Array, " n"]]:
    """Eight rows: the first words of all blocks, then the second words, and so on. To interleave is slow."""
    zero = jnp.uint32(0)
    key = [*data, *[zero] * (8 - data.size)]

    def pairs(i: Array) -> list[Halves]:
        words = chacha.block(key, (i, zero, zero, zero))
        return list(zip(words[0::2], words[1::2], strict=True))

    return _kept(pairs, -(-count // 8))


_STREAMS: dict[str, Callable[[Array, int], list[Array]]] = {
    "threefry": _threefry,
    "chacha20": _chacha20,
}


def _kept(pairs: Callable[[Array], list[Halves]], count: int) -> list[UInt64[Array, " count"]]:
    """`pairs` of the numbers 0 ... count - 1, joined to uint64 words, low half first; computed once.

    XLA's CPU backend fuses a generator into, and so runs it again for, each use of its words, unless these
    are the result of a branch. So they are the result of the branch that is always taken, which
    `optimization_barrier` hides from the compiler. (A loop would keep the words too, but starts from zeros
    that must be written first.)

    The two halves of a word leave the branch as a complex number, of which nothing but the bits matters.
    A fusion has one result, so two halves would take two runs of the generator; and joined to a uint64
    inside, they would make XLA compute with half as many uint32 lanes as a vector register has.
    """

    # XLA vectorises a loop over an odd number of words badly: five times slower.
    padded = -(-count // ROUND) * ROUND

    def drawn():
        numbers = lax.iota(jnp.uint32, padded)
        return [lax.complex(_as_float(a), _as_float(b)) for a, b in pairs(numbers)]

    def empty():
        return [jnp.zeros(result.shape, result.dtype) for result in jax.eval_shape(drawn)]

    kept = lax.cond(lax.optimization_barrier(True), drawn, empty)
    kept = [lax.slice(z, (0,), (count,)) for z in kept]
    return [_as_word(lax.real(z)) | _as_word(lax.imag(z)) << np.uint64(32) for z in kept]


def _as_float(half: Array) -> Array:
    return lax.bitcast_convert_type(half, jnp.float32)


def _as_word(half: Array) -> Array:
    return lax.bitcast_convert_type(half, jnp.uint32).astype(jnp.uint64)
