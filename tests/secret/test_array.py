"""Secrets: sharing, opening, indexing, and what a Secret refuses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn


@pytest.mark.parametrize("parties", [2, 3, 5, 16])
def test_reveal_undoes_share(parties):
    values = {
        "floats": np.array([[0.0, 1.5, -2.25], [4e6, -4e6, 2.0**-20]]),
        "bits": np.array([True, False]),
        "integers": np.array([-3, 7]),
    }
    shared = cn.share(jax.random.key(0), values, parties=parties)
    for name, value in values.items():
        assert shared[name].shares.shape == (parties, *value.shape)
        assert shared[name].shares.dtype == np.uint64
        assert shared[name].shape == value.shape
        opened = cn.reveal(shared[name])
        assert opened.dtype == value.dtype
        np.testing.assert_array_equal(opened, value)


def test_float32_comes_back_as_float32():
    assert cn.reveal(cn.share(jax.random.key(0), np.ones(2, np.float32), parties=2)).dtype == np.float32


def test_entries_and_leaves_get_shares_of_their_own():
    """Equal values, and equal leaves, must not get equal shares."""
    a, b = cn.share(jax.random.key(0), (np.zeros(1000), np.zeros(1000)), parties=3)
    everything = np.concatenate([np.asarray(a.shares).ravel(), np.asarray(b.shares).ravel()])
    assert len(np.unique(everything)) == everything.size


def test_indexing_is_along_the_value_s_axes():
    values = np.arange(24.0).reshape(4, 6)
    x = cn.share(jax.random.key(0), values, parties=3)
    rows = np.array([3, 0, 0])
    np.testing.assert_array_equal(cn.reveal(x[1]), values[1])
    np.testing.assert_array_equal(cn.reveal(x[1:3, ::2]), values[1:3, ::2])
    np.testing.assert_array_equal(cn.reveal(x[rows]), values[rows])
    assert [row.shape for row in x] == [(6,)] * 4


def test_a_secret_is_a_pytree_of_one_leaf():
    x = cn.share(jax.random.key(0), np.ones(3), parties=2)
    (leaf,) = jax.tree.leaves(x)
    np.testing.assert_array_equal(leaf, x.shares)
    assert jax.jit(lambda x: x)(x).frac_bits == x.frac_bits


def test_a_secret_shows_no_value():
    x = cn.share(jax.random.key(0), np.full(3, 12345.0), parties=2)
    assert repr(x) == "Secret(float64[3], parties=2, frac_bits=20)"
    for leak in (lambda: np.asarray(x), lambda: jnp.sin(x), lambda: float(x)):  # pyright: ignore
        with pytest.raises(TypeError):
            leak()


def test_bad_values_are_refused():
    key = jax.random.key(0)
    with pytest.raises(ValueError, match="at least two parties"):
        cn.share(key, 1.0, parties=1)
    with pytest.raises(ValueError, match=r"stay below 4\.1943e\+06"):
        cn.share(key, 2.0**22, parties=2)
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match=r"finite|stay below"):
            cn.share(key, bad, parties=2)
    with pytest.raises(TypeError, match="complex128"):
        cn.share(key, 1j, parties=2)
