"""Products of matrices modulo 2^64, by floating-point units.

XLA's own uint64 products run at about 1 G multiply-adds/s on two cores, its float64 products at
40. So a ring element is written in three balanced 22-bit limbs, x = x0 + 2^22 x1 + 2^44 x2 with
|xi| <= 2^21, and

    x y = x0 y0 + 2^22 (x0 y1 + x1 y0) + 2^44 (x0 y2 + x1 y1 + x2 y0)   (mod 2^64),

six float64 products instead of nine: the other three are multiples of 2^66. A product of two limbs is at
most 2^42, so three sums of `MAX_CONTRACTION` of them stay below 2^53 and every float is an exact integer.
"""

import math

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

LIMB = 22
MAX_CONTRACTION = 2 ** (53 - 2 * (LIMB - 1)) // 3

DimensionNumbers = tuple[tuple[tuple[int, ...], tuple[int, ...]], tuple[tuple[int, ...], tuple[int, ...]]]


def _limbs(x: UInt64[Array, "..."]) -> tuple[Array, Array, Array]:
    """float64 (x0, x1, x2) with x = x0 + 2^22 x1 + 2^44 x2 mod 2^64, each |xi| <= 2^21."""
    rest = lax.bitcast_convert_type(x, jnp.int64)
    limbs = []
    for unused in (64 - LIMB, 64 - LIMB, LIMB - 2):  # the top limb has the 20 bits that are left
        limb = (rest << unused) >> unused
        limbs.append(limb.astype(jnp.float64))
        rest = (rest - limb) >> LIMB
    return tuple(limbs)  # pyright: ignore[reportReturnType]


def _to_ring(x: Array) -> UInt64[Array, "..."]:
    return lax.bitcast_convert_type(x.astype(jnp.int64), jnp.uint64)


def dot_general(
    x: UInt64[Array, "..."], y: UInt64[Array, "..."], dimension_numbers: DimensionNumbers
) -> UInt64[Array, "..."]:
    """`jax.lax.dot_general` modulo 2^64, exact.

    Args:
        x, y: ring elements.
        dimension_numbers: ((x contracting, y contracting), (x batch, y batch)), as in `lax.dot_general`.

    Returns:
        Ring elements of shape (batch, x free, y free).
    """
    (x_contract, y_contract), (x_batch, y_batch) = dimension_numbers
    x_free = [i for i in range(x.ndim) if i not in (*x_contract, *x_batch)]
    y_free = [i for i in range(y.ndim) if i not in (*y_contract, *y_batch)]
    out_shape = [x.shape[i] for i in (*x_batch, *x_free)] + [y.shape[i] for i in y_free]
    contraction = math.prod(x.shape[i] for i in x_contract)
    if contraction == 0 or 0 in out_shape:
        return jnp.zeros(out_shape, jnp.uint64)

    batch = [x.shape[i] for i in x_batch]
    left = x.transpose(*x_batch, *x_free, *x_contract).reshape(*batch, -1, contraction)
    right = y.transpose(*y_batch, *y_contract, *y_free).reshape(*batch, contraction, -1)
    chunks = range(0, contraction, MAX_CONTRACTION)
    parts = [
        _batched_matmul(left[..., k : k + MAX_CONTRACTION], right[..., k : k + MAX_CONTRACTION, :])
        for k in chunks
    ]
    return sum(parts[1:], start=parts[0]).reshape(out_shape)


def _batched_matmul(x: UInt64[Array, "*b m k"], y: UInt64[Array, "*b k n"]) -> UInt64[Array, "*b m n"]:
    """x @ y mod 2^64 for k <= MAX_CONTRACTION. The limbs of y stand side by side: three products, not six."""
    n, last = y.shape[-1], y.ndim - 1
    x0, x1, x2 = _limbs(x)
    y0, y1, y2 = _limbs(y)
    numbers = (((last,), (last - 1,)), (tuple(range(last - 1)), tuple(range(last - 1))))
    p = lax.dot_general(x0, lax.concatenate([y0, y1, y2], last), numbers)
    q = lax.dot_general(x1, lax.concatenate([y0, y1], last), numbers)
    r = lax.dot_general(x2, y0, numbers)
    low, middle, high = p[..., :n], p[..., n : 2 * n] + q[..., :n], p[..., 2 * n :] + q[..., n:] + r
    return _to_ring(low) + (_to_ring(middle) << LIMB) + (_to_ring(high) << 2 * LIMB)


def matmul(x: UInt64[Array, "m k"], y: UInt64[Array, "k n"]) -> UInt64[Array, "m n"]:
    """The matrix product modulo 2^64, exact."""
    return dot_general(x, y, (((1,), (0,)), ((), ())))
