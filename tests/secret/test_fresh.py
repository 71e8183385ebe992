"""A key hides one thing: reuse under vmap and in loops raises, reuse by a later call warns."""

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import ciphernav_jax as cn
from ciphernav_jax.secret import KeyReuseWarning, fresh, view

pytestmark = pytest.mark.newest_jax

KEY = jax.random.key(1)
KEYS = jax.random.split(KEY, 3)
X = np.arange(6.0).reshape(3, 2)
share = partial(cn.share, parties=2)
step = cn.secure(jnp.square)
two = cn.secure(jnp.multiply)


@pytest.fixture(autouse=True)
def no_keys_of_other_tests():
    fresh.forget()
    with warnings.catch_warnings():
        warnings.simplefilter("error", KeyReuseWarning)
        yield


def stacked(secret):
    return jax.tree.map(lambda shares: jnp.stack([shares] * 3), secret)


# --- vmap


def test_a_vmap_over_values_with_one_key_is_refused():
    with pytest.raises(ValueError, match=r"over share.*same masks.*jax\.vmap\(share\)\(jax\.random\.split"):
        jax.vmap(lambda x: share(KEY, x))(X)
    with pytest.raises(ValueError, match="same masks"):
        jax.vmap(share, in_axes=(None, 0))(KEY, {"x": X})
    with pytest.raises(ValueError, match="same masks"):
        jax.jit(jax.vmap(jax.vmap(share, in_axes=(0, None)), in_axes=(None, 0)))(KEYS, X)
    shared = jax.vmap(share)(KEYS, X)
    np.testing.assert_array_equal(cn.reveal(shared), X)
    assert len(np.unique(shared.shares)) == shared.shares.size
    same = jax.vmap(lambda key: share(key, X))(KEYS)
    assert len(np.unique(same.shares)) == same.shares.size


def test_a_vmap_over_secrets_with_one_key_is_refused():
    """It would open all entries under the same masks."""
    x = share(KEY, X)
    with pytest.raises(ValueError, match=r"same masks.*jax\.random\.split"):
        jax.vmap(step, in_axes=(None, 0))(KEY, stacked(x))
    with pytest.raises(ValueError, match="same masks"):
        jax.vmap(jax.vmap(step, in_axes=(0, None)), in_axes=(None, 0))(KEYS, stacked(x))
    with pytest.raises(ValueError, match="same masks"):
        jax.vmap(lambda y: two(KEY, x, y))(X[:, None])
    assert jax.vmap(step)(KEYS, stacked(x)).shape == (3, *X.shape)


def test_a_vmap_over_what_the_function_closes_over_is_refused():
    """Two multiples of a secret under one mask: their difference is the secret's."""
    x = share(KEY, X)

    def scaled(y, key):
        return cn.secure(lambda x: x * y)(key, x)

    for function in (scaled, jax.jit(scaled)):
        with pytest.raises(ValueError, match="same masks"):
            jax.vmap(function, in_axes=(0, None))(jnp.asarray(X), KEY)
    scaled_apart = jax.vmap(scaled)(jnp.asarray(X), KEYS)
    np.testing.assert_allclose(cn.reveal(scaled_apart), X[:, None] * X, atol=2.0**-19)


# --- loops


def looped(body) -> Iterator[Callable[[], Any]]:
    """The body in each kind of loop, over the rows of X."""
    yield lambda: lax.scan(lambda c, x: (c, body(x)), 0, X)
    yield lambda: lax.map(body, X)
    yield lambda: lax.fori_loop(0, 3, lambda i, c: c + total(body(jnp.asarray(X)[i])), 0.0)
    yield lambda: lax.fori_loop(0, jnp.int32(3), lambda i, c: c + total(body(jnp.asarray(X)[i])), 0.0)
    yield lambda: lax.while_loop(lambda c: c < 9, lambda c: c + total(body(c + X[1])) + 1, 0.0)
    yield jax.jit(lambda: lax.scan(lambda c, x: (c, body(x)), 0, X))


def total(result):
    return jnp.sum(cn.reveal(result))


BODIES = {
    "share": lambda key, x: share(key(x), x),
    "share in a branch": lambda key, x: lax.cond(
        x[0] > 0, lambda: share(key(x), x), lambda: share(key(x), -x)
    ),
    "share, vmapped": lambda key, x: jax.vmap(lambda k, v: share(k, v))(jax.random.split(key(x), 2), x),
    "step": lambda key, x: step(key(x), share(jax.random.fold_in(KEY, x[0].astype(int)), x)),
    "public argument": lambda key, x: two(key(x), SECRET, x),
}
SECRET = share(KEY, X[0])
CONSTANT = {
    "as it is": lambda x: KEY,
    "derived": lambda x: jax.random.split(jax.random.fold_in(KEY, 2))[0],
    "made in the body": lambda x: jax.random.key(3),
    "derived here": lambda x: cn.ring.keys.derive(KEY, "step", 7),
}


@pytest.mark.parametrize("name", BODIES)
def test_a_loop_with_one_key_for_all_iterations_is_refused(name):
    for constant in CONSTANT.values():
        for loop in looped(partial(BODIES[name], constant)):
            with pytest.raises(
                ValueError, match=r"one key for each iteration of a loop.*ring\.keys\.derive\(key, i\)"
            ):
                loop()


def test_a_loop_with_one_key_for_what_the_function_closes_over_is_refused():
    """Multiples of a secret under one mask; also where the call before had a key of each iteration's own."""

    def body(c, each):
        x, key = each
        scaled = cn.secure(lambda s: s * s * x)
        scaled(key, SECRET)
        return c, scaled(KEY, SECRET)

    for tool in (lambda step: step, cn.validate, cn.audit):
        fresh.forget()  # other functions, of the same secret
        with pytest.raises(ValueError, match="one key for each iteration"):
            lax.scan(lambda c, x, tool=tool: (c, tool(cn.secure(lambda s: s * x))(KEY, SECRET)), 0, X)
    fresh.forget()
    with pytest.raises(ValueError, match="one key for each iteration"):
        lax.scan(body, 0, (X, KEYS))


@pytest.mark.parametrize("derivative", [jax.custom_jvp, jax.custom_vjp])
def test_a_function_with_a_derivative_of_its_own_takes_its_key_as_an_argument(derivative):
    """It may be called in a loop, which cannot be seen from within."""
    closed = derivative(lambda x: share(KEY, x))
    given = derivative(lambda key, x: share(key, x))
    for function in (closed, given):
        (function.defjvp if derivative is jax.custom_jvp else function.defvjp)(function, function)
    for trace in (lambda: lax.scan(lambda c, x: (c, closed(x)), 0, X), lambda: jax.jit(closed)(X)):
        with pytest.raises(ValueError, match=r"derivative of its own.*its key as an argument"):
            trace()
    assert closed(X[0]).shape == (2,)
    shares = lax.scan(lambda c, each: (c, given(*each)), 0, (KEYS, X))[1].shares
    assert len(np.unique(shares)) == shares.size


def test_devices_with_one_key_are_refused():
    mesh = jax.make_mesh((1,), ("d",), axis_types=(jax.sharding.AxisType.Auto,))
    spec = jax.sharding.PartitionSpec

    def mapped(function):
        return jax.shard_map(
            function, mesh=mesh, in_specs=(spec("d"),), out_specs=spec(None, "d"), check_vma=False
        )

    for function in (mapped(lambda x: share(KEY, x)), jax.jit(mapped(lambda x: share(KEY, x)))):
        with pytest.raises(ValueError, match="one key for each device"):
            function(X)

    def of_each(x):
        return share(cn.ring.keys.derive(KEY, lax.axis_index("d")), x)

    np.testing.assert_array_equal(cn.reveal(mapped(of_each)(X)), X)


@pytest.mark.parametrize("name", BODIES)
def test_a_loop_with_a_key_for_each_iteration_runs(name):
    def by_value(x):
        return jax.random.fold_in(jax.random.split(KEY)[0], x[0].astype(jnp.uint32))

    scanned, *_, jitted = looped(partial(BODIES[name], by_value))
    shares = scanned()[1].shares
    assert len(np.unique(shares)) == shares.size
    np.testing.assert_array_equal(jitted()[1].shares, shares)


def test_a_loop_in_which_nothing_changes_but_the_key_runs_and_so_does_the_same_call_in_all_iterations():
    x = share(KEY, X)
    _, results = lax.scan(lambda c, key: (c, step(key, x)), 0, KEYS)
    assert len(np.unique(results.shares)) == results.shares.size
    _, results = lax.scan(lambda c, _: (c, step(KEY, x)), 0, KEYS)
    np.testing.assert_array_equal(results.shares[0], results.shares[1])


def test_a_jitted_function_with_a_key_of_its_own_runs():
    jitted = jax.jit(lambda x: step(jax.random.key(3), share(jax.random.key(2), x)))
    np.testing.assert_allclose(cn.reveal(jitted(X)), X**2, atol=2.0**-19)


# --- calls


def warned(call):
    with pytest.warns(KeyReuseWarning) as caught:
        call()
    return caught


def test_a_key_that_shares_other_values_a_second_time_warns_where_it_was_written():
    share(KEY, X)
    (warning,) = warned(lambda: share(KEY, X + 1))
    assert warning.filename == __file__
    assert "difference of the values" in str(warning.message)
    warned(lambda: share(jax.random.key_data(KEY), [X][0] - 1))
    warned(lambda: share(KEY, X, protocol=cn.Protocol(frac_bits=16)))


def test_a_key_that_is_given_to_a_second_step_or_with_other_arguments_warns():
    x, y = share(KEY, (X, X + 1))
    step(KEY, x)
    (warning,) = warned(lambda: step(KEY, y))
    assert warning.filename == __file__
    assert "what is opened" in str(warning.message)
    warned(lambda: two(KEY, x, x))
    two(KEYS[0], x, X)
    warned(lambda: two(KEYS[0], x, X + 1))
    warned(lambda: cn.transcript(step)(KEYS[0], x))


def test_what_leaks_nothing_does_not_warn():
    for _ in range(2):  # the same again
        x = share(KEY, X)
        step(KEY, x)
        cn.transcript(step)(KEY, x)
        view(step)(KEY, x)
        cn.audit(step)(KEY, x)
    share(KEY, {"another": X + 1})
    share(KEYS[0], X + 1)
    jax.jit(lambda x: share(KEY, x))(X + 2)
    for i in (1, 2):
        cn.simulate(jnp.square, parties=2)(KEY, X + i)
    fresh.forget()
    share(KEY, X + 1)


def test_a_change_in_a_long_array_is_seen_and_memory_is_bounded(monkeypatch):
    long = np.zeros((300, 1000))
    share(KEY, long)
    warned(lambda: share(KEY, long + 1))
    monkeypatch.setattr(fresh, "REMEMBERED", 3)
    for i in range(5):
        share(jax.random.fold_in(KEY, i), X)
    assert len(fresh._hidden_by) == 3
    share(jax.random.fold_in(KEY, 0), X + 1)  # forgotten
    warned(lambda: share(jax.random.fold_in(KEY, 4), X + 1))


# --- the parties' axis


def test_a_sum_over_an_axis_that_a_user_calls_party_is_not_over_the_parties():
    x = share(KEY, X)

    def of_each(key, scale):
        return cn.secure(lambda x, s: x * 2 + lax.psum(s, "party"))(key, x, scale)

    results = jax.vmap(of_each, axis_name="party")(KEYS, jnp.arange(1.0, 4.0))
    np.testing.assert_array_equal(cn.reveal(results), [2 * X + 6.0] * 3)


def test_one_entry_of_many_is_something_else_to_hide():
    many = np.zeros(100_000)
    share(KEYS[0], many)
    many[1] = 5
    with pytest.raises(KeyReuseWarning):
        share(KEYS[0], many)


def test_equal_keys_of_a_batch_are_one_key_given_twice():
    same = jnp.broadcast_to(KEY, (3,))
    with pytest.raises(KeyReuseWarning):
        jax.vmap(share)(same, X)
    with pytest.raises(KeyReuseWarning):
        jax.vmap(jax.vmap(share))(jnp.stack([KEYS, KEYS], 1), X)
    jax.vmap(lambda key: share(key, X))(same)


@pytest.mark.parametrize(
    "traced", [jax.jit, lambda f: jax.jit(lambda key, x: lax.cond(x[0, 0] < 9, f, f, key, x))]
)
def test_a_key_given_twice_within_a_trace_is_warned_of(traced):
    for twice in (
        lambda key, x: (share(key, x), share(key, 2 * x)),
        lambda key, x: (share(KEY, x), share(KEY, x[0])),
        lambda key, x: (step(key, SECRET), step(key, share(KEYS[0], x))),
        lambda key, x: (two(key, SECRET, x[0]), two(key, SECRET, x[1])),
    ):
        with pytest.raises(KeyReuseWarning):
            traced(twice)(KEY, jnp.asarray(X))
    for once in (
        lambda key, x: (share(key, x), share(key, x)),
        lambda key, x: (share(key, x), step(key, SECRET)),
        lambda key, x: [share(k, x * i) for i, k in enumerate(jax.random.split(key, 9))],
        lambda key, x: lax.cond(x[0, 0] > 0, lambda: share(key, x), lambda: share(key, -x)),
    ):
        traced(once)(KEY, jnp.asarray(X))
