import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.party import open_sum
from ciphernav_jax.parties.run import plan, run
from ciphernav_jax.protocols import relu

from .simulated import words


def program(dealer, private, public):
    result = relu.relu(dealer, private["x"] + public, 3)
    return {"y": result.output}, open_sum(result.positive.share())


def inputs(parties):
    return {"x": sharing.share_ring(jax.random.key(1), jnp.asarray(words(1, 6) >> 4), parties)}


@functools.partial(jax.jit, static_argnums=1)
def call(seed, parties):
    return run(program, jax.random.key(seed), parties, inputs(parties), jnp.uint64(0))


def test_private_results_are_shares_and_public_ones_are_values():
    private, public = call(2, 3)
    assert private["y"].shape == (3, 6)
    np.testing.assert_array_equal(public, np.ones(6))


def test_the_same_key_gives_the_same_shares_and_another_key_others():
    first, again, other = (np.asarray(call(seed, 3)[0]["y"]) for seed in (2, 2, 3))
    np.testing.assert_array_equal(first, again)
    assert not np.any(first == other)


def test_the_plan_does_not_depend_on_values_or_on_the_number_of_parties():
    plans = [plan(program, p, inputs(p), jnp.uint64(0)) for p in (2, 3, 5)]
    assert plans[0] == plans[1] == plans[2]
    assert len(plans[0].requests) == 9  # a mask, five levels, the bit, two products


def test_a_mesh_of_another_size_raises():
    mesh = jax.make_mesh((1,), ("party",), devices=jax.devices()[:1])
    with pytest.raises(ValueError, match=r"1 devices.*3 parties"):
        run(program, jax.random.key(2), 3, inputs(3), jnp.uint64(0), mesh)


def test_one_party_raises():
    with pytest.raises(ValueError, match="at least two parties"):
        run(program, jax.random.key(2), 1, {"x": jnp.zeros((1, 6), jnp.uint64)}, jnp.uint64(0))
