"""The largest and the smallest of few and of many entries, and where they stand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.jax_private import Jaxpr

FUNCTIONS = (jnp.max, jnp.min, jnp.argmax, jnp.argmin)


# Few different numbers, so that many entries are equal.
RNG = np.random.default_rng(0)
SIZES = [1, 2, 7, 26, 300]
ARRAYS = [RNG.integers(-n // 3, n // 3 + 1, (n, 2)) / 4 for n in SIZES]


# The ideal comparison compiles fast.
@pytest.mark.parametrize(("comparison", "parties", "count"), [("ideal", 2, 5), ("masked", 3, 1)])
def test_of_any_number_of_entries(comparison, parties, count):
    functions = FUNCTIONS if comparison == "ideal" else FUNCTIONS[2:3]

    def extremes(*arrays):
        return [f(x, axis=0) for x in arrays for f in functions]

    arrays, protocol = ARRAYS[-count:], cn.Protocol(comparison=comparison)
    secrets = cn.share(jax.random.key(0), arrays, parties=parties, protocol=protocol)
    got = cn.reveal(cn.secure(extremes, protocol=protocol)(jax.random.key(1), *secrets))
    for one, other in zip(got, extremes(*map(jnp.asarray, arrays)), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


EMPTY = [np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros((3, 0)), np.zeros((3, 0), np.int16)]


@pytest.mark.parametrize("values", EMPTY, ids=str)
def test_of_nothing_it_is_what_jax_has(values):
    def extremes(x):
        found = [f(x, axis=1, initial=2) for f in (jnp.max, jnp.min)]
        return found + ([f(x, axis=1) for f in FUNCTIONS] if x.shape[1] else [])

    x = cn.share(jax.random.key(0), values, parties=2)
    got = cn.reveal(cn.secure(extremes)(jax.random.key(1), x))
    for one, other in zip(got, extremes(jnp.asarray(values)), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def test_every_axis_at_once():
    x = cn.share(jax.random.key(0), ARRAYS[-1].reshape(10, 20, 3), parties=2)
    step = cn.secure(
        lambda x: (jnp.max(x), jnp.max(x, axis=(0, 2))), protocol=cn.Protocol(comparison="ideal")
    )
    whole, part = cn.reveal(step(jax.random.key(1), x))
    assert whole == ARRAYS[-1].max()
    np.testing.assert_array_equal(part, ARRAYS[-1].reshape(10, 20, 3).max(axis=(0, 2)))


def cost(n, argmax):
    x = cn.share(jax.random.key(0), np.zeros(n), parties=2)
    return cn.cost(cn.secure(jnp.argmax, protocol=cn.Protocol(argmax=argmax)), x)


def test_auto_takes_all_pairs_of_few_and_a_tournament_of_many():
    assert cost(25, "auto") == cost(25, "pairwise") != cost(25, "tree")
    assert cost(26, "auto") == cost(26, "tree") != cost(26, "pairwise")


def equations(jaxpr):
    parts = [x for eqn in jaxpr.eqns for x in jax.tree.leaves(list(eqn.params.values()))]
    inner = [getattr(x, "jaxpr", x) for x in parts if isinstance(getattr(x, "jaxpr", x), Jaxpr)]
    return len(jaxpr.eqns) + sum(map(equations, inner))


def test_the_program_does_not_grow_with_the_number_of_entries():
    def size(n):
        x = cn.share(jax.random.key(0), np.zeros(n), parties=2)
        step = cn.secure(jnp.max)
        traced = jax.make_jaxpr(lambda key, x: step.call(step.given(x)).run(key)[0])(jax.random.key(1), x)
        return equations(traced.jaxpr)

    assert abs(size(2**14) - size(2**10)) < 20 < size(2**10)
