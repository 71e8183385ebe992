"""simulate(f): floats to floats through the protocol, and derivatives through the protocol."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

pytestmark = pytest.mark.newest_jax

UNIT = 2.0**-20
KEY = jax.random.key(7)
RNG = np.random.default_rng(0)
W = np.round(RNG.uniform(-1, 1, (4, 3)) * 256) / 256
X = np.round(RNG.uniform(-1, 1, (5, 4)) * 256) / 256


def loss(w, x):
    return jnp.sum(jax.nn.relu(x @ w) ** 2)


@cache
def simulated(parties):
    """The loss and its gradients by w and x, through the protocol at KEY."""
    through = partial(cn.simulate(loss, parties=parties), KEY)
    return jax.jit(jax.value_and_grad(through, argnums=(0, 1)))(W, X)


def bounds():
    """Of the loss and its gradients by w and x: h = relu(x w) errs by 1 unit, and each is truncated once."""
    h = np.maximum(X @ W, 0)
    of_h = np.ones_like(h)
    return (
        (2 * h + UNIT).sum() + 1,
        np.abs(X).T @ (2 * of_h) + 1,
        2 * of_h @ np.abs(W).T + 1,
    )


@pytest.mark.parametrize("parties", [2, 3])
def test_values_and_gradients_are_the_function_s_within_bounds(parties):
    value, gradients = simulated(parties)
    exact = (loss(W, X), *jax.grad(loss, argnums=(0, 1))(jnp.asarray(W), jnp.asarray(X)))
    for got, expected, bound in zip((value, *gradients), exact, bounds(), strict=True):
        # The cotangent 1 is a secret too: the products with it are truncated, one unit more.
        assert np.all(np.abs(got - expected) <= (bound + 1) * UNIT)
        assert not np.array_equal(got, expected)  # it went through the protocol


def test_the_gradient_is_the_secure_gradient():
    shared = cn.share(jax.random.key(1), (W, X), parties=3)
    secret = cn.reveal(cn.secure(jax.grad(loss))(jax.random.key(2), *shared))
    assert np.all(np.abs(simulated(3)[1][0] - secret) <= (2 * bounds()[1] + 1) * UNIT)


def test_keys_are_derived_as_documented():
    def pullback(args, cotangents):
        return jax.vjp(loss, *args)[1](*cotangents)

    backward_key = cn.ring.keys.derive(KEY, "pullback")
    by_hand = cn.secure(loss)(KEY, *cn.share(KEY, (W, X), parties=2))
    value, gradients = simulated(2)
    np.testing.assert_array_equal(value, cn.reveal(by_hand))
    backward = cn.simulate(pullback, parties=2)(backward_key, (W, X), [1.0])
    for got, expected in zip(gradients, backward, strict=True):
        np.testing.assert_array_equal(got, expected)


def test_second_derivatives_are_evaluated_by_the_protocol():
    def cube(x):
        return jnp.sum(x**3)

    def gradient_norm(f):
        return jax.grad(lambda x: jnp.sum(jax.grad(f)(x) ** 2))

    got = gradient_norm(partial(cn.simulate(cube, parties=2), KEY))(X)
    # 3 x^2 and 6 x err by units: 36 x^3 by a few dozen.
    np.testing.assert_allclose(got, 36 * X**3, atol=60 * UNIT)
    assert not np.array_equal(got, 36 * X**3)


def test_integers_have_no_derivative_and_pytrees_pass():
    def f(inputs):
        return {"float": inputs["x"] * inputs["n"].astype(jnp.float64), "integer": inputs["n"] + 1}

    simulated = cn.simulate(f, parties=2)
    inputs = {"x": jnp.asarray(X[0]), "n": jnp.arange(4)}
    out = simulated(KEY, inputs)
    np.testing.assert_array_equal(out["integer"], np.arange(4) + 1)
    gradient = jax.grad(lambda inputs: jnp.sum(simulated(KEY, inputs)["float"]), allow_int=True)(inputs)
    np.testing.assert_allclose(gradient["x"], np.arange(4), atol=UNIT)
    assert gradient["n"].dtype == jax.dtypes.float0


@pytest.mark.parametrize("keys", ["one", "many"])
def test_entries_of_a_vmap_have_masks_of_their_own(keys):
    """Entries are equal, so equal masks would round them alike, forward and backward."""
    x = jnp.full((4, 64), 0.77)
    simulated = cn.simulate(lambda x: 0.3 * x * x, parties=2)
    batch = (KEY, None) if keys == "one" else (jax.random.split(KEY, 4), 0)

    def both(key, x):
        return simulated(key, x), jax.grad(lambda x: jnp.sum(simulated(key, x)))(x)

    for out, exact in zip(
        jax.vmap(both, in_axes=(batch[1], 0))(batch[0], x), (0.3 * x**2, 0.6 * x), strict=True
    ):
        np.testing.assert_allclose(out, exact, atol=4 * UNIT)
        assert len(np.unique(out, axis=0)) == 4


def test_out_of_range_and_forward_mode_are_refused():
    simulated = cn.simulate(jnp.square, parties=2)
    with pytest.raises(ValueError, match=r"stay below 4\.1943e\+06"):
        simulated(KEY, np.full(2, 1e9))
    with pytest.raises(TypeError, match="forward-mode"):
        jax.jvp(partial(simulated, KEY), (X,), (X,))


def test_a_gradient_by_what_the_function_closes_over_is_no_silent_zero():
    with pytest.raises(jax.errors.UnexpectedTracerError):
        jax.grad(lambda w: cn.simulate(lambda x: jnp.sum(w * x), parties=2)(KEY, X))(1.0)
