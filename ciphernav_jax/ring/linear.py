"""Products of matrices modulo 2^64, by floating-point units.

XLA's own uint64 products run at about 1 G multiply-adds/s on two cores, its float64 products at
40. So a ring element is written in three balanced 22-bit limbs, x = x0 + 2^22 x1 + 2^44 x2 with
|x0|, |x1| <= 2^21 and |x2| <= 2^19, and

    x y = x0 y0 + 2^22 (x0 y1 + x1 y0) + 2^44 (x0 y2 + x1 y1 + x2 y0)   (mod 2^64).

The three products of nine that are missing are multiples of 2^66. The middle sum comes from products that are
there and one more (Karatsuba and Ofman 1962): x0 y1 + x1 y0 = (x0 + x1)(y0 + y1) - x0 y0 - x1 y1. That is
five float64 products. The largest term is (x0 + x1)(y0 + y1), at most 2^44, so a sum of `MAX_CONTRACTION` of
them is at most 2^53, and every float an exact integer.
"""

import math

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

LIMB = 22
MAX_CONTRACTION = 2 ** (53 - 2 * LIMB)

DimensionNumbers = tuple[tuple[tuple[int, ...], tuple[int, ...]], tuple[tuple[int, ...], tuple[int, ...]]]


def _limbs(x: UInt64[Array, "..."]) -> tuple[Array, Array, Array]:
    """float64 (x0, x1, x2) with x = x0 + 2^22 x1 + 2^44 x2 mod 2^64, |x0|, |x1| <= 2^21, |x2| <= 2^19."""
    rest = lax.bitcast_convert_type(x, jnp.int64)
    low = (rest << (64 - LIMB)) >> (64 - LIMB)
    rest = (rest - low) >> LIMB
    middle = (rest << (64 - LIMB)) >> (64 - LIMB)
    high = (rest - middle) >> LIMB
    return low.astype(jnp.float64), middle.astype(jnp.float64), high.astype(jnp.float64)


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
    """x @ y mod 2^64 for k <= MAX_CONTRACTION. The two products of x0 are one, of y0 and y2 side by side."""
    n, last = y.shape[-1], y.ndim - 1
    x0, x1, x2 = _limbs(x)
    y0, y1, y2 = _limbs(y)
    numbers = (((last,), (last - 1,)), (tuple(range(last - 1)), tuple(range(last - 1))))
    p = lax.dot_general(x0, lax.concatenate([y0, y2], last), numbers)
    q = lax.dot_general(x1, y1, numbers)
    r = lax.dot_general(x2, y0, numbers)
    s = lax.dot_general(x0 + x1, y0 + y1, numbers)
    low, middle, high = p[..., :n], s - p[..., :n] - q, p[..., n:] + q + r
    return _to_ring(low) + (_to_ring(middle) << LIMB) + (_to_ring(high) << 2 * LIMB)


def matmul(x: UInt64[Array, "m k"], y: UInt64[Array, "k n"]) -> UInt64[Array, "m n"]:
    """The matrix product modulo 2^64, exact."""
    return dot_general(x, y, (((1,), (0,)), ((), ())))
