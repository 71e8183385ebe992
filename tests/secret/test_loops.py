"""Loops and branches inside a function on secrets.

Inputs lie on a grid of 2^-8 within +-1, so that encoding is exact and a product with one of them does not
enlarge an error. Each product then adds less than one unit of 2^-frac_bits, and the carry of a loop is
truncated in every iteration: bounds count the truncations.
"""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import ciphernav_jax as cn

pytestmark = pytest.mark.newest_jax

UNIT = 2.0**-20
X = np.round(np.random.default_rng(0).uniform(-1, 1, (4, 3)) * 256) / 256
N = 3  # a public number that only the run knows


def multiply_up(carry, row):
    return carry * row, carry


# name: (function of X as a secret and N as a public array; bound in units)
FUNCTIONS = {
    "scan": (lambda x, n: lax.scan(multiply_up, x[0], x), 4),
    "reverse scan": (lambda x, n: lax.scan(multiply_up, x[0], x, reverse=True), 4),
    "empty scan": (lambda x, n: lax.scan(multiply_up, x[0], x[:0]), 0),
    "scan of public inputs": (lambda x, n: lax.scan(multiply_up, x[0], jnp.asarray(X)), 4),
    "scan with a constant": (lambda x, n: lax.scan(lambda c, r: (r @ x.T, c), x[:, 0], x)[0], 1),
    "gradient of a scan": (
        # A row is multiplied by up to 4 others and a cotangent that sums up to 4 terms of 4 truncations.
        lambda x, n: jax.grad(lambda x: jnp.sum(lax.scan(multiply_up, x[0], x)[1]))(x),
        4 * 4 + 4 * 4,
    ),
    "fori_loop": (lambda x, n: lax.fori_loop(0, 3, lambda i, c: c + jax.nn.relu(x[i]), jnp.zeros(3)), 0),
    "map": (lambda x, n: lax.map(lambda row: row * row, x), 1),
    # The second entry becomes secret in the first iteration, the third in the second.
    "a carry that becomes secret": (
        lambda x, n: lax.scan(lambda c, r: ((c[0] + 1, 0.3 * (c[1] + r), c[1]), None), (0, -X[0], X[1]), x)[
            0
        ],
        4,
    ),
    "a carry that becomes public": (lambda x, n: lax.scan(lambda c, r: (X[0], c * r), x[0], x), 1),
    "counted while": (
        lambda x, n: lax.while_loop(lambda c: c[0] < 5, lambda c: (c[0] + 1, c[1] / 2), (0, x)),
        2,
    ),
    "while that never runs": (
        lambda x, n: lax.while_loop(lambda c: c[0] < 0, lambda c: (c[0], -c[1]), (0, x)),
        0,
    ),
    "while on call": (lambda x, n: lax.fori_loop(0, n, lambda i, c: c * x[i], x[0]), 3),
    "while on call in a scan": (
        lambda x, n: lax.scan(lambda c, r: (lax.fori_loop(0, n, lambda i, d: d * r, c), None), x[0], x)[0],
        12,
    ),
    "scan in a while on call": (
        lambda x, n: lax.fori_loop(0, n, lambda i, c: lax.scan(multiply_up, c, x)[0], x[0]),
        12,
    ),
    "a vmapped loop whose entries end at different times": (
        lambda x, n: jax.vmap(lambda r, m: lax.fori_loop(0, m, lambda i, c: c * r, r))(x, np.arange(4)),
        3,
    ),
    "the same on call": (
        lambda x, n: jax.vmap(
            lambda r, m: lax.while_loop(lambda s: s[0] < m, lambda s: (s[0] + 1, s[1] * r), (0, r))
        )(x, np.arange(4) % n),
        2,
    ),
    "branches": (
        lambda x, n: (lax.cond(n > 2, lambda: x * x, lambda: x), lax.cond(n > 3, lambda: x * x, lambda: x)),
        1,
    ),
    "a branch of public outputs": (lambda x, n: lax.cond(n > 2, lambda: 0.3 * X, lambda: x * x), 0.5),
    "a known branch": (lambda x, n: lax.cond(np.bool_(True), lambda: x * x, lambda: jnp.exp(x)), 1),
    "switch": (lambda x, n: lax.switch(n - 1, [lambda: x, lambda: -x, lambda: x * x * x]), 2),
    "all together": (
        lambda x, n: lax.scan(
            lambda c, r: (
                lax.fori_loop(0, 2, lambda i, d: d * r, c),
                lax.cond(n > 2, lambda: r * r, lambda: r),
            ),
            x[0],
            x,
        ),
        8,
    ),
}
VARIANTS = [(2, "probabilistic"), (3, "probabilistic"), (2, "local")]


@cache
def results(parties, truncation):
    """All functions in one compilation."""
    protocol = cn.Protocol(truncation=truncation)
    step = cn.secure(lambda *args: {name: f(*args) for name, (f, _) in FUNCTIONS.items()}, protocol=protocol)
    return step(jax.random.key(9), cn.share(jax.random.key(1), X, parties=parties, protocol=protocol), N)


@pytest.mark.slow
@pytest.mark.parametrize(("parties", "truncation"), VARIANTS)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_secure_is_the_function_within_its_bound(name, parties, truncation):
    function, bound = FUNCTIONS[name]
    got = jax.tree.leaves(cn.reveal(results(parties, truncation)[name]))
    for value, expected in zip(got, jax.tree.leaves(function(jnp.asarray(X), N)), strict=True):
        assert value.dtype == expected.dtype
        assert value.shape == expected.shape
        # Float64 itself rounds in the last of 53 bits.
        assert np.max(np.abs(value - expected), initial=0) <= bound * UNIT + 1e-12


def test_what_stays_public_in_all_iterations_is_public():
    index, became_secret, _ = results(2, "probabilistic")["a carry that becomes secret"]
    assert not isinstance(index, cn.Secret)
    assert isinstance(became_secret, cn.Secret)
    assert isinstance(results(2, "probabilistic")["a branch of public outputs"], cn.Secret)


def test_every_iteration_rounds_by_itself():
    """The same product in each iteration of a scan and of a loop on call: with one mask for all iterations,
    all would round alike.
    """
    x = cn.share(jax.random.key(0), np.full(64, 0.77), parties=2)

    def products(x, n):
        scanned = lax.map(lambda i: x * x, jnp.arange(4))
        on_call = lax.fori_loop(0, n, lambda i, kept: kept.at[i].set(x * x), jnp.zeros((4, 64)))
        return scanned, on_call

    for rounded in cn.reveal(cn.secure(products)(jax.random.key(1), x, 4)):
        assert len(np.unique(rounded, axis=0)) == 4


def test_a_secret_predicate_is_refused_with_a_way_out():
    x = cn.share(jax.random.key(0), X, parties=2)
    refused = {
        "cond": lambda x: lax.cond(x[0, 0] > 0, lambda: x, lambda: -x),
        "while": lambda x: lax.while_loop(lambda c: c[0, 0] > 0, lambda c: c - 1, x),
    }
    for name, function in refused.items():
        with pytest.raises(NotImplementedError, match=rf"`{name}`.*secret.*test_loops\.py:\d+.*jnp\.where"):
            cn.secure(function)(jax.random.key(1), x)


def test_an_operation_without_a_rule_in_a_body_is_named():
    x = cn.share(jax.random.key(0), X, parties=2)
    with pytest.raises(NotImplementedError, match=r"`exp`.*test_loops\.py:\d+"):
        cn.secure(lambda x: lax.map(lambda row: jnp.exp(row), x))(jax.random.key(1), x)
