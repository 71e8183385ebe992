"""Public numbers of any size beside secrets: masks do what one means, and no factor is silently wrong."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

X = np.array([[1.0, -2.0, 3.0], [4e6, -4e6, 0.5]])
INTEGERS = np.array([5, -7, 2**62 - 1])
INF = np.float64(np.inf)
MASKS = np.array([[0.0, -np.inf, -1e9], [np.finfo(np.float32).min, 0.0, -np.inf]])
LEAST = np.array(np.iinfo(np.int64).min)

# name: function of X and INTEGERS as secrets, and of INF, MASKS and LEAST as public arguments
FUNCTIONS = {
    "largest of masked": lambda x, i, inf, m, least: jnp.max(x + m, axis=1),
    "largest of masked products": lambda x, i, inf, m, least: jnp.max(x * 0.5 * x[::-1] + m, axis=1),
    "arg max of masked": lambda x, i, inf, m, least: jnp.argmax(x @ x.T[:, :1] + m, axis=1),
    "masked by a constant": lambda x, i, inf, m, least: jnp.argmax(x + MASKS, axis=1),
    "masked by selection": lambda x, i, inf, m, least: jnp.max(jnp.where(m < 0, -inf, x), axis=1),
    "masked by secret selection": lambda x, i, inf, m, least: jnp.max(jnp.where(x > 2, -jnp.inf, x), 0),
    "smallest but for infinity": lambda x, i, inf, m, least: jnp.min(jnp.where(m < 0, inf, x), axis=1),
    "masked twice": lambda x, i, inf, m, least: jnp.argmax(x + m + m, axis=1),
    "sign of a masked": lambda x, i, inf, m, least: x + m > 0,
    "ReLU of a masked": lambda x, i, inf, m, least: jax.nn.relu(x + m),
    "ReLU of a masked product": lambda x, i, inf, m, least: jax.nn.relu((x / 4e6) * x + m),
    "running maximum": lambda x, i, inf, m, least: jax.lax.fori_loop(
        0, 2, lambda n, best: jnp.maximum(best, x[n]), jnp.full(3, -jnp.inf)
    ),
    "maximum": lambda x, i, inf, m, least: jnp.maximum(x, -inf),
    "maximum of a product": lambda x, i, inf, m, least: jnp.maximum((x / 4e6) * x, -inf),
    "minimum": lambda x, i, inf, m, least: jnp.minimum(x, inf),
    "clip": lambda x, i, inf, m, least: jnp.clip(x, -1.0, inf),
    "constants in maximum, minimum, clip": lambda x, i, inf, m, least: (
        jnp.maximum(x, -jnp.inf),
        jnp.minimum(x, np.finfo(np.float64).max),
        jnp.clip(x, -jnp.inf, 2.0),
        jnp.maximum(i, LEAST),
    ),
    "comparisons": lambda x, i, inf, m, least: (
        x > -inf,
        x <= inf,
        x == inf,
        x != inf,
        inf <= x,
        x >= 1e13 * inf,
    ),
    "comparisons with constants": lambda x, i, inf, m, least: (
        x > -jnp.inf,
        x <= 1e300,
        jnp.inf <= x,
        x == -jnp.inf,
        x <= jnp.nan,
        jnp.nan >= x,
        x != jnp.nan,
        i > LEAST,
        i == LEAST,
    ),
    "comparisons of integers": lambda x, i, inf, m, least: (i > least, i <= -1 - least, i == least),
    "is it a number": lambda x, i, inf, m, least: (
        jnp.isnan(x),
        jnp.isinf(x),
        jnp.isfinite(x),
        jnp.nan_to_num(x),
    ),
    "divided by infinity": lambda x, i, inf, m, least: x / inf,
}


@cache
def results():
    protocol = cn.Protocol(comparison="ideal")  # compiles fast
    step = cn.secure(lambda *args: {name: f(*args) for name, f in FUNCTIONS.items()}, protocol=protocol)
    return cn.reveal(
        step(jax.random.key(1), *cn.share(jax.random.key(0), (X, INTEGERS), parties=3), INF, MASKS, LEAST)
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_numbers_of_any_size_beside_secrets(name):
    expected = FUNCTIONS[name](*map(jnp.asarray, (X, INTEGERS, INF, MASKS, LEAST)))
    for got, exact in zip(jax.tree.leaves(results()[name]), jax.tree.leaves(expected), strict=True):
        assert got.dtype == exact.dtype
        got, exact = np.asarray(got, np.float64), np.asarray(exact, np.float64)
        finite = np.isfinite(exact)
        np.testing.assert_allclose(got[finite], exact[finite], rtol=1e-6, atol=1e-5)
        # What stays masked is as small as can be.
        np.testing.assert_array_equal(np.sign(got[~finite]) * np.inf, exact[~finite])


X1 = np.array([1.0, 2.0])
NOT_USABLE = {
    "NaN times": (lambda x, n: x * n, np.nan),
    "infinity times": (lambda x, n: n * x, np.inf),
    "too large": (lambda x, n: x * n, 1e13),
    "divided by 0": (lambda x, n: x / n, 0.0),
    "one of two divided by 0": (lambda x, n: 1.0 / jnp.where(x > 0, n, 1.0), 0.0),
    "a product of arrays": (lambda x, n: x @ jnp.stack([n, 0 * n]), np.inf),
    "NaN plus": (lambda x, n: x + n, np.nan),
    "compared with NaN": (lambda x, n: x > n, np.nan),
    "maximum with NaN": (lambda x, n: jnp.maximum(x, n), np.nan),
    "in a scan": (lambda x, n: jax.lax.scan(lambda c, i: (c * (n / i), c), x, jnp.arange(3.0))[0], 1.0),
    "in a while loop": (
        lambda x, n: jax.lax.while_loop(lambda s: s[0] < n, lambda s: (s[0] + 1, s[1] / s[0]), (0.0, x)),
        2.0,
    ),
    "in a branch": (lambda x, n: jax.lax.cond(n > 0, lambda x: x * n, lambda x: x, x), np.inf),
}
CHEAP = cn.Protocol(comparison="ideal")


@pytest.mark.parametrize("name", NOT_USABLE)
def test_a_public_number_that_makes_no_sense_raises_and_names_its_line(name):
    f, n = NOT_USABLE[name]
    x, step = cn.share(jax.random.key(0), X1, parties=2), cn.secure(f, protocol=CHEAP)
    with pytest.raises(ValueError, match=r"a public number that .*test_publics\.py:\d+"):
        step(jax.random.key(1), x, np.float64(n))


@pytest.mark.parametrize("tool", [cn.audit, cn.validate])
def test_tools_that_run_the_step_raise_what_it_raises(tool):
    x = cn.share(jax.random.key(0), X1, parties=2)
    with pytest.raises(ValueError, match=r"divides a secret is 0.*test_publics\.py:\d+"):
        tool(cn.secure(lambda x, n: x / n, protocol=CHEAP))(jax.random.key(1), x, np.float64(0))


def test_where_nobody_can_look_the_results_are_poisoned():
    x = cn.share(jax.random.key(0), X1, parties=2)
    step = cn.secure(lambda x, n: (x / n, 2 * x, (x > n).astype(np.int64)), protocol=CHEAP)
    run = jax.jit(lambda n: step(jax.random.key(1), x, n))
    quotient, double, bit = cn.reveal(run(np.float64(2.0)))
    np.testing.assert_allclose(quotient, X1 / 2, atol=1e-5)
    quotient, double, bit = cn.reveal(run(np.float64(0.0)))
    assert np.isnan(quotient).all()
    assert np.isnan(double).all()
    np.testing.assert_array_equal(bit, np.iinfo(np.int64).min)


@pytest.mark.parametrize(
    "f",
    [
        lambda x: x * np.inf,
        lambda x: x / 0.0,
        lambda x: x @ np.array([np.nan, 1.0]),
        lambda x: x + np.array([np.nan, 1.0]),
        lambda x: jnp.where(x > 0, x, jnp.nan),
        lambda x: x > np.array([np.nan, 1.0]),
        lambda x: 1.0 / jnp.where(x > 0, 0.0, 1.0),
    ],
)
def test_constants_that_make_no_sense_raise_while_tracing(f):
    x = cn.share(jax.random.key(0), X1, parties=2)
    with pytest.raises(ValueError, match=r"(constant|divided by 0).*test_publics\.py:\d+"):
        cn.secure(f, protocol=CHEAP)(jax.random.key(1), x)
