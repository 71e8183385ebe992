"""What no result is made of costs nothing, wherever it stands; but for what a while loop carries."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import ciphernav_jax as cn

from .test_costs import shares

pytestmark = pytest.mark.newest_jax

# Each function, and the same without what its result is not made of.
PAIRS = {
    "comparison": (lambda x: (jnp.max(x), x + 1)[1], lambda x: x + 1),
    "operation without a rule": (lambda x: (jnp.exp(x), x * x)[1], lambda x: x * x),
    "result of an inner function": (
        lambda x: jax.jit(lambda y: (jnp.sort(y * y), y * y))(x)[1],
        lambda x: jax.jit(lambda y: y * y)(x),
    ),
    "carry of a scan": (
        lambda x: lax.scan(lambda c, _: ((c[0] * c[0], jax.nn.relu(c[1])), None), (x, x), None, 3)[0][0],
        lambda x: lax.scan(lambda c, _: (c * c, None), x, None, 3)[0],
    ),
    "rows of a scan": (
        lambda x: lax.scan(lambda c, row: (c + row, row * row), jnp.zeros_like(x[0]), x)[0],
        lambda x: lax.scan(lambda c, row: (c + row, None), jnp.zeros_like(x[0]), x)[0],
    ),
    "result of a branch": (
        lambda x: lax.cond(jnp.sum(jnp.ones(2)) > 1, lambda y: (y * y, y > 0), lambda y: (y, y < 0), x)[0],
        lambda x: lax.cond(jnp.sum(jnp.ones(2)) > 1, lambda y: y * y, lambda y: y, x),
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_what_no_result_is_made_of_costs_nothing(name):
    whole, live = PAIRS[name]
    assert cn.cost(cn.secure(whole), *shares((4, 3))) == cn.cost(cn.secure(live), *shares((4, 3)))


def test_a_gradient_does_not_pay_for_the_value():
    """The loss's own comparison and its sum's truncation; the derivative needs the residuals alone."""

    def loss(w, x):
        return jnp.sum(jax.nn.relu(x @ w) ** 2)

    gradient = cn.cost(cn.secure(jax.grad(loss)), *shares((3, 2), (4, 3)))
    both = cn.cost(cn.secure(jax.value_and_grad(loss)), *shares((3, 2), (4, 3)))
    assert len(gradient.openings) < len(both.openings)
    assert gradient.rounds <= both.rounds
    assert gradient.bytes_dealt < both.bytes_dealt


def test_results_are_those_of_the_function():
    x = cn.share(jax.random.key(0), np.array([[1.5, -2.0, 0.25]] * 4), parties=3)
    for whole, live in PAIRS.values():
        got = cn.reveal(cn.secure(whole)(jax.random.key(1), x))
        np.testing.assert_array_equal(got, cn.reveal(cn.secure(live)(jax.random.key(1), x)))


def test_what_reaches_out_is_refused_all_the_same():
    def tells(x):
        jax.debug.print("{}", x)
        return x

    with pytest.raises(NotImplementedError, match="reaches out"):
        cn.cost(cn.secure(tells), *shares((3,)))


def test_arguments_that_nothing_reads_are_taken():
    step = cn.secure(lambda x, unread: x * x)
    assert (
        cn.cost(step, *shares((3,), (1000,))).bytes_sent
        == cn.cost(cn.secure(jnp.square), *shares((3,))).bytes_sent
    )
