"""What a simulation knows of its truncations: how many there are, and how many fail."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

from ..slow import slow


def loss(w, x):
    return jnp.sum(jax.nn.relu(x @ w) * x[:, :1])


@pytest.mark.parametrize("parties", [2, *slow(5)])
def test_the_result_is_that_of_the_step_and_all_truncations_are_counted(parties):
    rng = np.random.default_rng(parties)
    args = cn.share(jax.random.key(0), (rng.normal(size=(3, 4)), rng.normal(size=(6, 3))), parties=parties)
    step = cn.secure(loss)
    key = jax.random.key(1)
    result, (carried_out, failed) = cn.audit(step)(key, *args)
    np.testing.assert_array_equal(result.shares, step(key, *args).shares)
    assert int(carried_out) == 2 * 6 * 4  # the ReLU's, and those of the products before they are summed
    assert int(failed) == 0


@pytest.mark.parametrize(("truncation", "parties"), [("wrap-count", 3), ("local", 2)])
def test_failures_are_those_that_the_results_show(truncation, parties):
    protocol = cn.Protocol(truncation=truncation)
    x = np.full(1 << 16, 30_000.0)
    factors = cn.share(jax.random.key(2), (x, np.ones_like(x)), parties=parties, protocol=protocol)
    step = cn.secure(jnp.multiply, protocol=protocol)
    result, (carried_out, failed) = cn.audit(step)(jax.random.key(3), *factors)
    wrong = np.abs(cn.reveal(result) - x) > 1
    assert int(carried_out) == x.size
    assert int(failed) == wrong.sum() > 0


@pytest.mark.parametrize(
    ("function", "factor", "fails"),
    [
        (jnp.multiply, 2.0**9.9, False),
        (jnp.multiply, 2.0**10.5, True),
        # A ReLU also takes the sum of two products.
        (lambda x, y: jax.nn.relu(x * y), 2.0**10.9, False),
    ],
)
def test_a_truncation_fails_beyond_the_range_and_not_within(function, factor, fails):
    factors = cn.share(jax.random.key(0), (np.full(64, 2.0**12), np.full(64, factor)), parties=2)
    result, (carried_out, failed) = cn.audit(cn.secure(function))(jax.random.key(1), *factors)
    assert int(carried_out) == 64
    assert (int(failed) > 0) == fails
    assert (np.max(np.abs(cn.reveal(result) - factor * 2**12)) > 1e-2) == fails


def test_it_counts_in_a_loop_around_the_step():
    x = cn.share(jax.random.key(0), np.arange(4.0), parties=2)
    step = cn.audit(cn.secure(lambda x: x * x * 0.5))

    def body(counts, key):
        _, more = step(key, x)  # one truncation an entry: x * x * 0.5 waits until the end
        return jax.tree.map(jnp.add, counts, more), None

    counts, _ = jax.lax.scan(body, (jnp.int64(0), jnp.int64(0)), jax.random.split(jax.random.key(1), 5))
    assert [int(count) for count in counts] == [20, 0]


def scanned(x, _):
    return jax.lax.scan(lambda c, y: (c * y, y * y), jnp.ones(()), x)  # 2 truncations in each of 4 iterations


def counted_while(x, _):
    return jax.lax.while_loop(lambda s: s[0] < 3, lambda s: (s[0] + 1, s[1] * s[1]), (0, x))


def while_on_call(x, n):
    return jax.lax.while_loop(lambda s: s[0] < n, lambda s: (s[0] + 1, s[1] * s[1]), (0, x))


def branched(x, n):
    return jax.lax.switch(n - 3, [lambda x: x * 2.0, lambda x: x * x * x, lambda x: x * 0.3], x)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "argument", "expected"),
    [
        (scanned, 0, 2 * 4),
        (counted_while, 0, 3 * 4),
        (while_on_call, 5, 5 * 4),
        (branched, 3, 0),
        (branched, 4, 2 * 4),
        (branched, 5, 4),
    ],
)
def test_loops_and_branches_count_what_is_carried_out(function, argument, expected):
    x = cn.share(jax.random.key(0), np.linspace(0.5, 1.0, 4), parties=2)
    step, key = cn.secure(function), jax.random.key(1)
    result, (carried_out, failed) = cn.audit(step)(key, x, np.int32(argument))
    assert (int(carried_out), int(failed)) == (expected, 0)
    for ours, steps in zip(
        jax.tree.leaves(result), jax.tree.leaves(step(key, x, np.int32(argument))), strict=True
    ):
        np.testing.assert_array_equal(ours, steps)


@pytest.mark.parametrize(("truncation", "parties"), [("wrap-count", 3), ("local", 2)])
def test_failures_in_a_loop_are_those_that_the_results_show(truncation, parties):
    protocol = cn.Protocol(truncation=truncation)
    x = np.full((4, 1 << 14), 30_000.0)
    factors = cn.share(jax.random.key(2), (x, np.ones_like(x)), parties=parties, protocol=protocol)
    step = cn.secure(lambda x, y: jax.lax.map(lambda xy: xy[0] * xy[1], (x, y)), protocol=protocol)
    result, (carried_out, failed) = cn.audit(step)(jax.random.key(3), *factors)
    wrong = np.abs(cn.reveal(result) - x) > 1
    assert int(carried_out) == x.size
    assert int(failed) == wrong.sum() > 0


def test_only_a_secure_function_is_audited():
    with pytest.raises(TypeError, match="secure"):
        cn.audit(loss)
