"""Shares: P arrays, each uniform alone and in any company short of all, that together give the value.

- additive: x = x_0 + ... + x_{P-1} mod 2^64, for arithmetic;
- by exclusive or: x = x_0 ^ ... ^ x_{P-1}, for bits.
"""

import functools
import operator
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.ring.random import Generator


def require_parties(parties: int) -> None:
    """Raises ValueError for fewer than two parties, TypeError for what is no number of them."""
    if not isinstance(parties, int | np.integer):
        raise TypeError(f"parties is how many there are, an int, and not a {type(parties).__name__}")
    if parties < 2:
        raise ValueError(f"secret sharing needs at least two parties, got parties={parties}")


def split_sum(
    x: UInt64[Array, "..."], uniform: Sequence[UInt64[Array, "..."]], place: int = 0
) -> list[UInt64[Array, "..."]]:
    """Additive shares of x from P - 1 uniform arrays: these, and at `place` x - sum(uniform)."""
    return [*uniform[:place], functools.reduce(operator.sub, uniform, x), *uniform[place:]]


def split_xor(
    x: UInt64[Array, "..."], uniform: Sequence[UInt64[Array, "..."]], place: int = 0
) -> list[UInt64[Array, "..."]]:
    """Shares of x by exclusive or from P - 1 uniform arrays: these, and at `place` what is left."""
    return [*uniform[:place], functools.reduce(operator.xor, uniform, x), *uniform[place:]]


def join_sum(shares: UInt64[Array, "p ..."]) -> UInt64[Array, "..."]:
    """The value of additive shares."""
    return jnp.sum(shares, axis=0, dtype=jnp.uint64)


def join_xor(shares: UInt64[Array, "p ..."]) -> UInt64[Array, "..."]:
    """The value of shares by exclusive or."""
    return lax.reduce_xor(shares, axes=(0,))


def wraps(shares: UInt64[Array, "p ..."]) -> UInt64[Array, "..."]:
    """How often the sum of additive shares wraps around, all read as signed numbers: the w, modulo 2^64, of
    x_0 + ... + x_{P-1} = x + 2^64 w.
    """
    total, count = shares[0], jnp.zeros(shares.shape[1:], jnp.uint64)
    for share in shares[1:]:
        previous, total = total, total + share
        # Two numbers of one sign overflow when their sum has the other.
        over = ~(previous ^ share) & (previous ^ total)
        sign = (previous >> 63 << 1) - 1  # -1 after positive numbers; the carry is +1
        count -= jnp.where(over >> 63 == 1, sign, 0)
    return count


# Compiled: op by op, each intermediate array would be as large as all shares together.
@functools.partial(jax.jit, static_argnames=("parties", "generator"))
def share_ring(
    key: Array, x: UInt64[Array, "..."], parties: int, generator: Generator = "threefry"
) -> UInt64[Array, "p ..."]:
    """Fresh additive shares of ring elements for `parties` >= 2 parties, from `key` alone."""
    require_parties(parties)
    return jnp.stack(split_sum(x, ring.draw(key, [x.shape] * (parties - 1), generator)))
