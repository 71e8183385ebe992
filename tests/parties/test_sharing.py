import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing

from ..slow import slow
from .simulated import BY_PARTIES, EDGES, elements, joint_uniformity, words

share = jax.jit(sharing.share_ring, static_argnums=2)


@functools.partial(jax.jit, static_argnums=(0, 3, 4))
def split(splitter, key, x, parties, place=0):
    return jnp.stack(splitter(x, ring.draw(key, [x.shape] * (parties - 1)), place))


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(16)])
def test_additive_shares_add_up_to_the_value(parties):
    x = elements([*EDGES, 2**63, 2**64 - 1])
    shares = np.asarray(share(jax.random.key(1), x, parties))
    assert shares.shape == (parties, *x.shape)
    assert [sum(map(int, column)) % 2**64 for column in shares.T] == x.tolist()
    np.testing.assert_array_equal(sharing.join_sum(shares), x)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(16)])
def test_binary_shares_join_by_exclusive_or(parties):
    x = words(2, 3, 4)
    shares = np.asarray(split(sharing.split_xor, jax.random.key(2), x, parties))
    np.testing.assert_array_equal(functools.reduce(np.bitwise_xor, shares), x)
    np.testing.assert_array_equal(sharing.join_xor(shares), x)


@pytest.mark.parametrize("splitter", [sharing.split_sum, sharing.split_xor])
def test_whoever_is_sent_its_share_the_others_draw_the_same(splitter):
    x = elements([*EDGES])
    first, *drawn = split(splitter, jax.random.key(5), x, 3)
    for place in (1, 2):
        shares = list(split(splitter, jax.random.key(5), x, 3, place))
        np.testing.assert_array_equal(shares.pop(place), first)
        np.testing.assert_array_equal(shares, drawn)


def company_sees(shares):
    """How uniform the shares of every company of P - 1 parties are."""
    return min(joint_uniformity(rows) for rows in itertools.combinations(np.asarray(shares), len(shares) - 1))


@pytest.mark.parametrize("secret", [0, 2**63 + 5])
@pytest.mark.parametrize("splitter", [sharing.split_sum, sharing.split_xor])
@pytest.mark.parametrize("parties", BY_PARTIES)
def test_all_shares_but_one_are_uniform_whatever_the_secret(parties, splitter, secret):
    shares = split(splitter, jax.random.key(3), jnp.full(8192, secret, jnp.uint64), parties)
    assert company_sees(shares) > 1e-6


def test_a_share_that_repeats_or_shows_the_secret_is_noticed():
    x = jnp.full(8192, 5, jnp.uint64)
    shares = np.array(split(sharing.split_sum, jax.random.key(4), x, 3))
    plain = np.stack([np.asarray(x), shares[1], -shares[1]])
    repeated = np.stack([np.asarray(x) - 2 * shares[1], shares[1], shares[1]])
    for leaking in (plain, repeated):
        np.testing.assert_array_equal(sharing.join_sum(leaking), x)
        assert company_sees(leaking) < 1e-100


@pytest.mark.parametrize("parties", [-1, 0, 1])
def test_fewer_than_two_parties_raise(parties):
    with pytest.raises(ValueError, match="at least two parties"):
        sharing.share_ring(jax.random.key(0), jnp.zeros(1, jnp.uint64), parties)


def test_shares_depend_on_the_key_alone():
    x = words(5, 7)
    first, again, other = (share(jax.random.key(seed), x, 3) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.any(np.asarray(first) == np.asarray(other))
