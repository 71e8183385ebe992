"""Products of matrices modulo 2^64, by the processor's integer vectors.

XLA turns a uint64 product into one multiply-add after another, about 1 G/s on two cores. So a product is
written here as a loop over blocks of the contraction: each block adds `BLOCK` or a few more outer products

    acc[i, j] += x[i, k] y[k, j] + x[i, k + 1] y[k + 1, j] + ...

which XLA compiles into one pass over acc, with the elements of y and acc in vectors and those of x
broadcast. Two things make it fast, and both are easily lost:

- *The block's width.* XLA fuses a slice into the pass that reads it, unless it is read more than 15 times
  (the limit of its `FusionNodeIndexingEvaluation`). Fused, the pass is not vectorised and four times slower.
- *The order of y*: its free axes last, so that a vector is read from consecutive words.

With 512-bit vectors (`startup.vectors`) that is 30 to 50 G multiply-adds/s; five float64 products
of 22-bit limbs, what one does without integer multiplication in vectors, give 10 on the same machine.
"""

import math

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

BLOCK = 16
"""Least number of outer products in a pass; see above."""

NARROW = 8
"""Fewer columns than this do not fill vectors: the factors change places."""

DimensionNumbers = tuple[tuple[tuple[int, ...], tuple[int, ...]], tuple[tuple[int, ...], tuple[int, ...]]]


def dot_general(
    x: UInt64[Array, "..."],
    y: UInt64[Array, "..."],
    dimension_numbers: DimensionNumbers,
    plus: UInt64[Array, "..."] | None = None,
) -> UInt64[Array, "..."]:
    """`jax.lax.dot_general` modulo 2^64, exact, plus something.

    Args:
        x, y: ring elements.
        dimension_numbers: ((x contracting, y contracting), (x batch, y batch)), as in `lax.dot_general`.
        plus: what to add to the product, of its shape; a sum of products is cheaper so.

    Returns:
        Ring elements of shape (batch, x free, y free).
    """
    (x_contract, y_contract), (x_batch, y_batch) = dimension_numbers
    x_free = [i for i in range(x.ndim) if i not in (*x_contract, *x_batch)]
    y_free = [i for i in range(y.ndim) if i not in (*y_contract, *y_batch)]
    batch = [x.shape[i] for i in x_batch]
    rows, columns = [x.shape[i] for i in x_free], [y.shape[i] for i in y_free]
    m, k, n = math.prod(rows), math.prod(x.shape[i] for i in x_contract), math.prod(columns)
    if k == 0:
        return jnp.zeros((*batch, *rows, *columns), jnp.uint64) if plus is None else plus
    if n < min(m, NARROW):
        flipped = dot_general(y, x, ((y_contract, x_contract), (y_batch, x_batch)))
        product = flipped.reshape(*batch, n, m).swapaxes(-1, -2).reshape(*batch, *rows, *columns)
        return product if plus is None else product + plus
    total = jnp.zeros((*batch, m, n), jnp.uint64) if plus is None else plus.reshape(*batch, m, n)

    y = y.transpose(*y_batch, *y_contract, *y_free).reshape(*batch, k, n)
    if x_free and x_contract and min(x_free) > max(x_contract):  # as it lies, rather than transposed
        x = x.transpose(*x_batch, *x_contract, *x_free).reshape(*batch, k, m)
        product = _add_product(total, x, y, x_axis=-2)
    else:
        x = x.transpose(*x_batch, *x_free, *x_contract).reshape(*batch, m, k)
        product = _add_product(total, x, y, x_axis=-1)
    return product.reshape(*batch, *rows, *columns)


def _add_product(
    total: UInt64[Array, "*b m n"], x: Array, y: UInt64[Array, "*b k n"], x_axis: int
) -> UInt64[Array, "*b m n"]:
    """total + sum over k of x[k] y[k, :], where x is (*b, m, k) and x_axis -1, or (*b, k, m) and -2."""
    width, padding = _blocks(y.shape[-2])
    x, y = _padded(x, x_axis, padding), _padded(y, -2, padding)

    def add_block(i: int | Array, total: Array) -> Array:
        xs = jnp.moveaxis(lax.dynamic_slice_in_dim(x, i * width, width, x_axis), x_axis, -1)
        ys = lax.dynamic_slice_in_dim(y, i * width, width, -2)
        for j in range(width):
            total = total + xs[..., :, j, None] * ys[..., j, None, :]
        return total

    return lax.fori_loop(0, y.shape[-2] // width, add_block, total)


def _blocks(k: int) -> tuple[int, int]:
    """(width of a block, zeros to add to k): the least width that divides k, if any is below 2 BLOCK."""
    exact = (width for width in range(BLOCK, 2 * BLOCK) if k % width == 0)
    width = next(exact, BLOCK)
    return width, -k % width


def _padded(x: Array, axis: int, padding: int) -> Array:
    if not padding:
        return x
    shape = list(x.shape)
    shape[axis] = padding
    return jnp.concatenate([x, jnp.zeros(shape, jnp.uint64)], axis)


def matmul(x: UInt64[Array, "m k"], y: UInt64[Array, "k n"]) -> UInt64[Array, "m n"]:
    """The matrix product modulo 2^64, exact."""
    return dot_general(x, y, (((1,), (0,)), ((), ())))
