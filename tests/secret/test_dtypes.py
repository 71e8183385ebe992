"""Indexing, bools and integers on secrets: exactly what JAX gives on the same values."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

FLOATS, INTEGERS = np.array([1.0, -2.5, 3.0]), np.array([1, -2, 3])
BOOLS = np.array([[True, False, True], [False, False, False], [True, True, True]])
NARROW = np.array([1, 2, 3], np.uint8)
INDEX = np.array([2, 0, 9, -1, -9])  # 9 and -9 lie outside


def at(x, fill=None, index=INDEX):
    return x.at[index].get(mode="fill", fill_value=fill)


# name: function of FLOATS, INTEGERS, BOOLS, NARROW as secrets, and of INDEX as public argument
FUNCTIONS = {
    "a fill value": lambda x, i, b, u, k: at(x, 7.5),
    "an integer to fill floats": lambda x, i, b, u, k: at(x, -7),
    "a float to fill integers": lambda x, i, b, u, k: at(i, 7.5),
    "to fill bools": lambda x, i, b, u, k: at(b, False),
    "bools by default": lambda x, i, b, u, k: at(b),
    "narrow integers by default": lambda x, i, b, u, k: at(u),
    "fill a product": lambda x, i, b, u, k: at(x * x, -3e6),
    "fill at run time": lambda x, i, b, u, k: at(x, 7.5, k),
    "fill rows": lambda x, i, b, u, k: at(b * x, 7.5, k),
    "NaN at run time": lambda x, i, b, u, k: at(x, None, k),
    "the largest beside a mask": lambda x, i, b, u, k: jnp.max(at(x, -jnp.inf, k)),
    "the least integer at run time": lambda x, i, b, u, k: jnp.take(i, k),
    "clip": lambda x, i, b, u, k: jnp.take(x, k, mode="clip"),
    "wrap": lambda x, i, b, u, k: jnp.take(x, k, mode="wrap"),
    "plain indexing": lambda x, i, b, u, k: x[k],
    "drop": lambda x, i, b, u, k: x.at[k].set(5.0),
    "gradient of a fill": lambda x, i, b, u, k: jax.grad(lambda x: jnp.sum(at(x, 7.5, k) ** 2))(x),
    "dot of bools": lambda x, i, b, u, k: jnp.where(b @ b.T, 1.0, 2.0),
    "dot with public bools": lambda x, i, b, u, k: ~(b @ BOOLS[0]),
    "inner product of bools": lambda x, i, b, u, k: jnp.einsum("ij,ij->i", b, b).astype(np.float64),
    "count by a dot": lambda x, i, b, u, k: jax.lax.dot(b, b, preferred_element_type=np.int32),
    "bools added": lambda x, i, b, u, k: jnp.where(b + b.T, 1.0, 2.0),
    "bools multiplied": lambda x, i, b, u, k: jnp.where(b * b.T, 1.0, 2.0),
    "largest bool": lambda x, i, b, u, k: jnp.max(b, axis=1),
    "smallest bool": lambda x, i, b, u, k: jnp.where(jnp.min(b, axis=1), 1.0, 2.0),
    "arg max of bools": lambda x, i, b, u, k: jnp.argmax(b, axis=1),
    "order of bools": lambda x, i, b, u, k: (b < b.T, b >= b.T, jnp.maximum(b, b.T)),
}


@cache
def results(parties, truncation):
    protocol = cn.Protocol(truncation=truncation)
    step = cn.secure(lambda *args: {name: f(*args) for name, f in FUNCTIONS.items()}, protocol=protocol)
    secrets = cn.share(
        jax.random.key(0), (FLOATS, INTEGERS, BOOLS, NARROW), parties=parties, protocol=protocol
    )
    return cn.reveal(step(jax.random.key(1), *secrets, INDEX))


@pytest.mark.slow
@pytest.mark.parametrize(("parties", "truncation"), [(3, "probabilistic")])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_indexing_and_bools_are_as_in_jax(name, parties, truncation):
    with jax.numpy_dtype_promotion("standard"):
        got = results(parties, truncation)[name]
        expected = FUNCTIONS[name](*map(jnp.asarray, (FLOATS, INTEGERS, BOOLS, NARROW)), jnp.asarray(INDEX))
    for one, other in zip(jax.tree.leaves(got), jax.tree.leaves(expected), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("x", [FLOATS, INTEGERS])
def test_an_index_out_of_range_that_reads_no_number_is_refused(x):
    with pytest.raises(NotImplementedError, match=r"out of range.*fill_value.*clip"):
        cn.secure(lambda x: jnp.take(x, INDEX))(jax.random.key(1), cn.share(jax.random.key(0), x, parties=2))


@pytest.mark.parametrize(
    "f", [jnp.sum, lambda v: 2 * v, jax.nn.relu, jnp.max, lambda v: v > 0, lambda v: jnp.cumsum(v[::-1])]
)
def test_what_is_computed_with_an_entry_out_of_range_is_no_number(f):
    x, key = cn.share(jax.random.key(0), FLOATS, parties=2), jax.random.key(1)
    step = cn.secure(lambda x, i: (f(jnp.take(x, i)), x))
    with pytest.raises(
        ValueError, match=r"computes with what was read at an index out of range.*test_dtypes"
    ):
        step(key, x, np.array([0, 9, 9, -9]))
    for revealed in map(cn.reveal, jax.jit(step)(key, x, np.array([0, 9, 9, -9]))):
        assert revealed.dtype == bool or np.all(np.isnan(revealed))
    inside = np.array([0, 2, 2, -1])
    np.testing.assert_allclose(cn.reveal(step(key, x, inside)[0]), f(FLOATS[inside]), atol=2.0**-19)


def test_what_a_constant_chooses_beside_an_entry_out_of_range_is_itself():
    x = cn.share(jax.random.key(0), FLOATS, parties=2)
    step = cn.secure(lambda x, i: jnp.where(np.array([False]), jnp.take(x, i), 7.0))
    np.testing.assert_array_equal(cn.reveal(step(jax.random.key(1), x, np.array([0, 9]))), [7.0, 7.0])


@pytest.mark.parametrize("f", [lambda v: 2 * v, lambda v: v, lambda v: jnp.ones_like(v)])
def test_apply_is_refused_with_what_to_write(f):
    x = cn.share(jax.random.key(0), FLOATS, parties=2)
    with pytest.raises(NotImplementedError, match=r"x\.at\[i\]\.set\(f\(x\[i\]\)\)"):
        cn.secure(lambda x: x.at[1].apply(f))(jax.random.key(1), x)
