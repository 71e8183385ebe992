"""Secrets handed on to other parties."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

from ..parties.simulated import joint_uniformity

X = {"w": np.array([[1.5, -2.0], [0.25, 3.0]]), "n": np.arange(3), "b": np.array(True)}


@pytest.mark.parametrize(("old", "new"), [(2, 5), (5, 2), (3, 3)])
def test_the_values_stay_and_the_shares_are_new(old, new):
    x = cn.share(jax.random.key(0), X, parties=old)
    y = cn.reshare(jax.random.key(1), x, parties=new)
    for before, after in zip(jax.tree.leaves(X), jax.tree.leaves(cn.reveal(y)), strict=True):
        np.testing.assert_array_equal(after, before)
        assert after.dtype == before.dtype
    assert {leaf.parties for leaf in y.values()} == {new}
    assert not np.intersect1d(x["w"].shares, y["w"].shares).size
    step = cn.secure(lambda x: x["w"] @ x["w"])
    np.testing.assert_allclose(cn.reveal(step(jax.random.key(2), y)), X["w"] @ X["w"], atol=1e-5)


def test_what_is_public_and_leading_axes_stay():
    keys = jax.random.split(jax.random.key(3), 4)
    x = jax.vmap(lambda key, v: cn.share(key, v, parties=2))(keys, np.arange(8.0).reshape(4, 2))
    y = cn.reshare(jax.random.key(4), (x, 7), parties=3)
    assert y[1] == 7
    np.testing.assert_array_equal(cn.reveal(y[0]), np.arange(8.0).reshape(4, 2))


def test_all_but_one_of_each_group_know_nothing():
    """What they hold of a zero, before and after: uniform jointly."""

    def views(key):
        first, second = jax.random.split(key)
        x = cn.share(first, jnp.zeros(()), parties=2)
        return jnp.stack([x.shares[0], *cn.reshare(second, x, parties=3).shares[1:]])

    assert joint_uniformity(jax.vmap(views)(jax.random.split(jax.random.key(5), 4000)).T) > 1e-4


def test_one_key_for_several_is_refused():
    x = jax.vmap(lambda k, v: cn.share(k, v, parties=2))(
        jax.random.split(jax.random.key(6), 4), np.arange(4.0)
    )
    with pytest.raises(ValueError, match="one key for all"):
        jax.vmap(lambda x: cn.reshare(jax.random.key(7), x, parties=3))(x)
    key = jax.random.key(8)
    cn.reshare(key, x, parties=3)
    other = jax.tree.map(lambda a: a[::-1], x)
    with pytest.warns(cn.KeyReuseWarning):
        cn.reshare(key, other, parties=3)
