"""What a simulation knows of its truncations: how many there are, and how many fail."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn


def loss(w, x):
    return jnp.sum(jax.nn.relu(x @ w) * x[:, :1])


@pytest.mark.parametrize("parties", [2, 5])
def test_the_result_is_that_of_the_step_and_all_truncations_are_counted(parties):
    rng = np.random.default_rng(parties)
    args = cn.share(jax.random.key(0), (rng.normal(size=(3, 4)), rng.normal(size=(6, 3))), parties=parties)
    step = cn.secure(loss)
    key = jax.random.key(1)
    result, (carried_out, failed) = cn.audit(step)(key, *args)
    np.testing.assert_array_equal(result.shares, step(key, *args).shares)
    assert int(carried_out) == 6 * 4 + 1  # the ReLU's, and the sum's
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


@pytest.mark.parametrize(("factor", "fails"), [(2.0**9.9, False), (2.0**10.5, True)])
def test_a_relu_fails_beyond_the_range_and_not_within(factor, fails):
    factors = cn.share(jax.random.key(0), (np.full(64, 2.0**12), np.full(64, factor)), parties=2)
    assert (factor * 2**12 > cn.Protocol().bound) == fails
    step = cn.audit(cn.secure(lambda x, y: jax.nn.relu(x * y)))
    _, (carried_out, failed) = step(jax.random.key(1), *factors)
    assert int(carried_out) == 64
    assert (int(failed) > 0) == fails


def test_it_counts_in_a_loop_around_the_step():
    x = cn.share(jax.random.key(0), np.arange(4.0), parties=2)
    step = cn.audit(cn.secure(lambda x: x * x * 0.5))

    def body(counts, key):
        _, more = step(key, x)  # one truncation an entry: x * x * 0.5 waits until the end
        return jax.tree.map(jnp.add, counts, more), None

    counts, _ = jax.lax.scan(body, (jnp.int64(0), jnp.int64(0)), jax.random.split(jax.random.key(1), 5))
    assert [int(count) for count in counts] == [20, 0]


def test_a_loop_in_the_function_is_refused():
    x = cn.share(jax.random.key(0), np.ones(3), parties=2)
    looped = cn.secure(lambda x: jax.lax.fori_loop(0, 3, lambda _, x: x * x, x))
    with pytest.raises(NotImplementedError, match="audit the body"):
        cn.audit(looped)(jax.random.key(1), x)


def test_only_a_secure_function_is_audited():
    with pytest.raises(TypeError, match="secure"):
        cn.audit(loss)
