import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciphernav_jax import ring
from ciphernav_jax.ring import bits

SHAPES = ((), (1,), (63,), (64,), (65,), (5, 26), (3, 7, 11))
EDGES = (0, 1, 2**31, 2**32 - 1, 2**32, 2**62, 2**63 - 1, 2**63, 2**64 - 1)


def words(seed, *shape):
    rng = np.random.default_rng(seed)
    x = rng.integers(0, 2**64, shape, dtype=np.uint64)
    return np.where(rng.random(shape) < 0.3, rng.choice(np.array(EDGES, np.uint64), shape), x)


def python_slice(x):
    """Bit j of value number i * B + b is bit i of word (j, b), in Python's integers."""
    flat = [int(v) for v in np.ravel(x)]
    columns = -(-len(flat) // 64)
    out = [[0] * columns for _ in range(64)]
    for number, value in enumerate(flat):
        i, b = divmod(number, columns)
        for j in range(64):
            out[j][b] |= (value >> j & 1) << i
    return np.array(out, np.uint64).reshape(64, columns)


@pytest.mark.parametrize("shape", SHAPES)
def test_slicing_puts_every_bit_where_it_says_and_unslicing_brings_it_back(shape):
    x = words(1, *shape)
    sliced = jax.jit(ring.bit_slice)(x)
    np.testing.assert_array_equal(sliced, python_slice(x))
    np.testing.assert_array_equal(jax.jit(lambda w: ring.bit_unslice(w, shape))(sliced), x)


transpose = jax.jit(bits._transpose)


@given(x=st.lists(st.sampled_from(EDGES) | st.integers(0, 2**64 - 1), min_size=64, max_size=64))
def test_transposition_exchanges_words_and_bits(x):
    got = transpose(np.array(x, np.uint64)[:, None])[:, 0].tolist()
    assert got == [sum((x[i] >> j & 1) << i for i in range(64)) for j in range(64)]


def test_transposition_moves_each_of_the_4096_bits_alone():
    # Column 64 i + j holds a matrix whose only bit is bit j of word i.
    i, j = np.divmod(np.arange(4096), 64)
    single = np.zeros((64, 4096), np.uint64)
    single[i, np.arange(4096)] = np.uint64(1) << j.astype(np.uint64)
    expected = np.zeros((64, 4096), np.uint64)
    expected[j, np.arange(4096)] = np.uint64(1) << i.astype(np.uint64)
    np.testing.assert_array_equal(transpose(single), expected)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_packed_row_is_a_row_of_the_sliced_array_and_unpacks_to_the_bits(shape):
    x = words(2, *shape)
    sliced = python_slice(x)
    for j in (0, 31, 63):
        row = jax.jit(bits.pack)(x >> np.uint64(j) & np.uint64(1))
        np.testing.assert_array_equal(row, sliced[j])
    got = jax.jit(lambda w: bits.unpack(w, shape))(sliced)
    assert got.shape == (64, *shape)
    np.testing.assert_array_equal(got, np.stack([x >> np.uint64(j) & np.uint64(1) for j in range(64)]))


def test_most_significant_bit_is_that_of_negative_numbers():
    x = np.array([0, 1, 2**63 - 1, 2**63, 2**64 - 1], np.uint64)
    assert jax.jit(ring.most_significant_bit)(x).tolist() == [0, 0, 0, 1, 1]


@given(count=st.integers(0, 10**6))
def test_columns_are_as_few_as_hold_the_values(count):
    b = bits.columns(count)
    assert 64 * b >= count
    assert b == 0 or 64 * (b - 1) < count


def test_an_empty_array_slices_to_no_words():
    empty = jnp.zeros((0, 3), jnp.uint64)
    assert ring.bit_slice(empty).shape == (64, 0)
    assert ring.bit_unslice(ring.bit_slice(empty), (0, 3)).shape == (0, 3)
    assert bits.unpack(bits.pack(empty), (0, 3)).shape == (0, 3)
