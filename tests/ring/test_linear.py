import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax import lax

from ciphernav_jax import ring
from ciphernav_jax.ring.linear import BLOCK, NARROW

MODULUS = 2**64
EXTREMES = (
    0,
    1,
    MODULUS - 1,
    2**63,
    2**63 - 1,
    2**21,
    2**21 - 1,
    2**43,
    2**64 - 2**21,
)
ELEMENTS = st.sampled_from(EXTREMES) | st.integers(0, MODULUS - 1)


def python_dot_general(x, y, dimension_numbers):
    """`lax.dot_general` on Python's integers, by definition: sums of products over index tuples."""
    (x_contract, y_contract), (x_batch, y_batch) = dimension_numbers
    x_free = [i for i in range(x.ndim) if i not in (*x_contract, *x_batch)]
    y_free = [i for i in range(y.ndim) if i not in (*y_contract, *y_batch)]
    sizes = [x.shape[i] for i in (*x_batch, *x_free)] + [y.shape[i] for i in y_free]
    out = np.zeros(sizes, np.uint64)
    for index in np.ndindex(*sizes):
        total = 0
        for inner in np.ndindex(*[x.shape[i] for i in x_contract]):
            at_x, at_y = [0] * x.ndim, [0] * y.ndim
            for axis, position in zip(
                (*x_batch, *x_free, *x_contract), (*index[: x.ndim - len(inner)], *inner), strict=True
            ):
                at_x[axis] = position
            tail = index[len(x_batch) + len(x_free) :]
            y_index = (*index[: len(y_batch)], *tail, *inner)
            for axis, position in zip((*y_batch, *y_free, *y_contract), y_index, strict=True):
                at_y[axis] = position
            total += int(x[tuple(at_x)]) * int(y[tuple(at_y)])
        out[index] = total % MODULUS
    return out


def words(rng, *shape):
    return rng.integers(0, MODULUS, shape, dtype=np.uint64)


matmul = jax.jit(ring.matmul)


@given(entries=st.lists(ELEMENTS, min_size=3 * 5 + 5 * 2, max_size=3 * 5 + 5 * 2))
def test_matmul_equals_python_integers(entries):
    x = np.array(entries[:15], np.uint64).reshape(3, 5)
    y = np.array(entries[15:], np.uint64).reshape(5, 2)
    expected = x.astype(object) @ y.astype(object) % MODULUS
    assert matmul(x, y).tolist() == expected.tolist()


@pytest.mark.parametrize("y", EXTREMES)
@pytest.mark.parametrize("length", [BLOCK - 1, BLOCK, 2 * BLOCK + 1])
def test_no_contraction_length_and_no_worst_case_entry_loses_a_bit(length, y):
    x = np.repeat(np.array(EXTREMES, np.uint64)[:, None], length, axis=1)
    got = matmul(x, np.full((length, 1), y, np.uint64))
    assert got[:, 0].tolist() == [length * a * y % MODULUS for a in EXTREMES]


@pytest.mark.parametrize("columns", [1, NARROW - 1, NARROW])
@pytest.mark.parametrize("length", [1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK - 1, 37, 3 * BLOCK, 127])
def test_any_number_of_blocks_equals_numpy(length, columns):
    rng = np.random.default_rng(length)
    x, y, z = words(rng, 9, length), words(rng, length, columns), words(rng, 9, columns)
    product = x @ y  # numpy's own uint64 product wraps
    np.testing.assert_array_equal(matmul(x, y), product)
    for first, x_axis in ((x, 1), (x.T, 0)):
        for second, y_axis in ((y, 0), (y.T, 1)):
            numbers = (((x_axis,), (y_axis,)), ((), ()))
            np.testing.assert_array_equal(ring.dot_general(first, second, numbers), product)
            np.testing.assert_array_equal(ring.dot_general(first, second, numbers, plus=z), product + z)


@pytest.mark.parametrize(
    ("x_shape", "y_shape", "numbers"),
    [
        ((3, 4), (4, 2), (((1,), (0,)), ((), ()))),
        ((4, 3), (2, 4), (((0,), (1,)), ((), ()))),
        ((2, 3, 4), (2, 4, 5), (((2,), (1,)), ((0,), (0,)))),
        ((3, 2, 4), (4, 5, 2), (((2,), (0,)), ((1,), (2,)))),
        ((2, 3, 4, 2), (4, 2, 3), (((2, 1), (0, 2)), ((0,), (1,)))),
        ((2, 3, 4), (3, 2, 4), (((2,), (2,)), ((0, 1), (1, 0)))),
        ((2, 3), (4,), (((), ()), ((), ()))),
        ((4,), (4,), (((0,), (0,)), ((), ()))),
        ((), (2, 2), (((), ()), ((), ()))),
        ((2, 0), (0, 3), (((1,), (0,)), ((), ()))),
        ((0, 2), (2, 3), (((1,), (0,)), ((), ()))),
    ],
)
def test_dot_general_equals_python_integers_and_has_lax_shape(x_shape, y_shape, numbers):
    rng = np.random.default_rng(7)
    x, y = words(rng, *x_shape), words(rng, *y_shape)
    got = jax.jit(lambda x, y: ring.dot_general(x, y, numbers))(x, y)
    assert got.dtype == jnp.uint64
    assert got.shape == jax.eval_shape(lambda x, y: lax.dot_general(x, y, numbers), x, y).shape
    expected = python_dot_general(x, y, numbers)
    np.testing.assert_array_equal(got, expected)
    plus = words(rng, *expected.shape)
    np.testing.assert_array_equal(ring.dot_general(x, y, numbers, plus=plus), expected + plus)


@pytest.mark.parametrize(("x_axis", "y_axis"), [(0, 0), (0, None), (None, 0)])
@pytest.mark.parametrize("length", [5, 2 * BLOCK + 3])
def test_under_vmap_with_either_side_shared(x_axis, y_axis, length):
    rng = np.random.default_rng(8)
    x = words(rng, *([3] if x_axis == 0 else []), 2, length)
    y = words(rng, *([3] if y_axis == 0 else []), length, 4)
    got = jax.jit(jax.vmap(ring.matmul, in_axes=(x_axis, y_axis)))(x, y)
    np.testing.assert_array_equal(got, np.matmul(x, y))


def test_a_layer_of_the_classifier_equals_numpy():
    rng = np.random.default_rng(9)
    x, y = words(rng, 50, 288), words(rng, 288, 128)
    got = np.asarray(matmul(x, y))
    columns = rng.integers(0, 128, 8)
    np.testing.assert_array_equal(got[:, columns], x @ y[:, columns])
    assert math.prod(got.shape) == len(np.unique(got))
