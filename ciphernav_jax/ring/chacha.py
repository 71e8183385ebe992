"""The block function of ChaCha20 (RFC 8439, section 2.3; Bernstein, *ChaCha, a variant of Salsa20*, 2008)."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

DOUBLE_ROUNDS = 10
CONSTANTS = np.frombuffer(b"expand 32-byte k", "<u4").astype(np.uint32)
COLUMNS = tuple((i, 4 + i, 8 + i, 12 + i) for i in range(4))
DIAGONALS = tuple((i, 4 + (i + 1) % 4, 8 + (i + 2) % 4, 12 + (i + 3) % 4) for i in range(4))


def _quarter_round(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array, Array, Array]:
    for down, up in ((16, 12), (8, 7)):
        a = a + b
        d = _rotate(d ^ a, down)
        c = c + d
        b = _rotate(b ^ c, up)
    return a, b, c, d


def _rotate(x: Array, distance: int) -> Array:
    return x << np.uint32(distance) | x >> np.uint32(32 - distance)


def block(key: Sequence[Array], counter: Sequence[Array]) -> list[Array]:
    """Sixteen uniform words for each counter: uint32 arrays of the shape of key and counter, broadcast.

    Args:
        key: eight words, uint32 of any shape.
        counter: four words, uint32 of any shape, words 12 to 15 of the state. The RFC counts blocks in the
            first and takes the other three for a nonce.
    """
    shape = jnp.broadcast_shapes(*(jnp.shape(word) for word in (*key, *counter)))
    start = [jnp.broadcast_to(word, shape) for word in (*CONSTANTS, *key, *counter)]
    state = list(start)
    for _ in range(DOUBLE_ROUNDS):
        for indices in (*COLUMNS, *DIAGONALS):
            for i, word in zip(indices, _quarter_round(*(state[i] for i in indices)), strict=True):
                state[i] = word
    return [word + first for word, first in zip(state, start, strict=True)]
