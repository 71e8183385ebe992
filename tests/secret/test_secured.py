"""secure(f) equals f, within bounds that follow from the truncations f needs.

Inputs lie on a grid of 2^-8, so that encoding them is exact, and so are sums, comparisons, selections and the
products before truncation. Each truncation errs by less than one unit u = 2^-frac_bits; a bound counts the
truncations on the way to an output, times what multiplies them afterwards.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

pytestmark = pytest.mark.newest_jax

UNIT = 2.0**-20
LARGEST = 4.0


def grid(rng, *shape):
    return np.round(rng.uniform(-LARGEST, LARGEST, shape) * 256) / 256


drawn = partial(grid, np.random.default_rng(0))
X, Y, ROW, W, V = drawn(6, 5), drawn(6, 5), drawn(5), drawn(5, 7), drawn(7, 3)
X[0] = [0.0, 1 / 256, -1 / 256, LARGEST, -LARGEST]  # the edges of a comparison with 0
Y[1] = X[1]  # and of a comparison with each other
INDEX = np.array([4, 0, 0, 2])
COLUMN_SUM = np.abs(V).sum(axis=0).max()  # how far a unit in each hidden value moves an output


@jax.custom_vjp
def squared(x):
    return x * x


squared.defvjp(lambda x: (x * x, x), lambda x, g: (2 * x * g,))


def mlp(x, w, v):
    return jax.nn.relu(x @ w) @ v


def loss(x, w, v):
    return jnp.sum(mlp(x, w, v) ** 2)


# name: (function of X, Y, ROW, W, V as secrets; bound in units)
FUNCTIONS = {
    "identity": (lambda x, y, r, w, v: x, 0),
    "add": (lambda x, y, r, w, v: x + y, 0),
    "add a public array": (lambda x, y, r, w, v: Y + x, 0),
    "subtract": (lambda x, y, r, w, v: x - y, 0),
    "subtract from a constant": (lambda x, y, r, w, v: 1.5 - x, 0),
    "negate": (lambda x, y, r, w, v: -x, 0),
    "broadcast": (lambda x, y, r, w, v: x + r, 0),
    "multiply": (lambda x, y, r, w, v: x * y, 1),
    "multiply with broadcasting": (lambda x, y, r, w, v: x * r, 1),
    "multiply by a public array": (lambda x, y, r, w, v: x * Y, 1),
    "multiply by a power of two": (lambda x, y, r, w, v: x * 0.0625, 0),
    "multiply by an integer": (lambda x, y, r, w, v: 3 * x, 0),
    "multiply by zero": (lambda x, y, r, w, v: x * 0.0, 0),
    # The constant is exact to 2^-20 of itself: 0.3 * 4 * 1 more units.
    "multiply by a constant": (lambda x, y, r, w, v: x * 0.3, 1 + 0.3 * LARGEST),
    "multiply by a tiny constant": (lambda x, y, r, w, v: x * 3e-7, 1 + 1e-5),
    "divide": (lambda x, y, r, w, v: x / 7.0, 1 + LARGEST / 7),
    "divide by a power of two": (lambda x, y, r, w, v: x / 256.0, 1),
    "square": (lambda x, y, r, w, v: x**2, 1),
    "cube": (lambda x, y, r, w, v: x**3, 1 + LARGEST),
    "fifth power": (lambda x, y, r, w, v: x**5, 1 + LARGEST * (1 + 2 * LARGEST**2)),
    "sum": (lambda x, y, r, w, v: jnp.sum(x, axis=1), 0),
    "mean": (lambda x, y, r, w, v: jnp.mean(x), 1 + LARGEST),
    "sum of products": (lambda x, y, r, w, v: jnp.sum(x * y), 1),
    "product": (lambda x, y, r, w, v: x @ w, 1),
    "product with public weights": (lambda x, y, r, w, v: x @ W, 1),
    "product with public data": (lambda x, y, r, w, v: X @ w, 1),
    "product of three": (lambda x, y, r, w, v: (x @ w) @ v, 1 + COLUMN_SUM),
    "vmap": (lambda x, y, r, w, v: jax.vmap(lambda a, b: (a * b) @ w)(x, y), 1 + np.abs(W).sum(0).max()),
    "einsum": (lambda x, y, r, w, v: jnp.einsum("bi,bj->ij", x, y), 1),
    "batched product": (lambda x, y, r, w, v: jnp.einsum("bi,bi->b", x, y), 1),
    "relu": (lambda x, y, r, w, v: jax.nn.relu(x), 0),
    "relu of a product": (lambda x, y, r, w, v: jax.nn.relu(x @ w + 0.5), 1),
    "mlp": (lambda x, y, r, w, v: mlp(x, w, v), 1 + COLUMN_SUM),
    "greater": (lambda x, y, r, w, v: x > y, 0),
    "greater than zero": (lambda x, y, r, w, v: x > 0, 0),
    "less": (lambda x, y, r, w, v: x < y, 0),
    "at most": (lambda x, y, r, w, v: x <= y, 0),
    "at least zero": (lambda x, y, r, w, v: x >= 0, 0),
    "equal": (lambda x, y, r, w, v: x == y, 0),
    "not equal": (lambda x, y, r, w, v: x != 1 / 256, 0),
    "both": (lambda x, y, r, w, v: (x > 0) & (y > 0), 0),
    "either, not both": (lambda x, y, r, w, v: ((x > 0) | (y > 0)) & ~((x > 0) & (y > 0)), 0),
    "count": (lambda x, y, r, w, v: jnp.sum((x > y).astype(jnp.float64)), 0),
    "where": (lambda x, y, r, w, v: jnp.where(x > 0, y, 2 * x), 0),
    "where public": (lambda x, y, r, w, v: jnp.where(X > 0, x * y, -1.5), 1),
    "where or zero": (lambda x, y, r, w, v: jnp.where(x > y, x * y, 0.0), 1),
    "maximum": (lambda x, y, r, w, v: jnp.maximum(x, y), 0),
    "minimum": (lambda x, y, r, w, v: jnp.minimum(x, 1.0), 0),
    "absolute": (lambda x, y, r, w, v: jnp.abs(x), 0),
    "clip": (lambda x, y, r, w, v: jnp.clip(x, -1.0, 1.0), 0),
    "leaky relu": (lambda x, y, r, w, v: jax.nn.leaky_relu(x, 0.125), 0),
    "clamp": (lambda x, y, r, w, v: jax.lax.clamp(-1.0, x, 1.0), 0),
    "relu6": (lambda x, y, r, w, v: jax.nn.relu6(x), 0),
    # A sixth is exact to 2^-20 of itself, and it multiplies at most 6.
    "hard sigmoid": (lambda x, y, r, w, v: jax.nn.hard_sigmoid(x), 2),
    "sign": (lambda x, y, r, w, v: jnp.sign(x), 0),
    "step function": (lambda x, y, r, w, v: jnp.heaviside(x, 0.5), 0),
    "where of constants": (lambda x, y, r, w, v: jnp.where(x > 0, 0.3, -1000.7), 0.5),
    "where of integers": (lambda x, y, r, w, v: jnp.where(x > 0, 1, 2), 0),
    "reciprocal of one of two": (lambda x, y, r, w, v: 1.0 / jnp.where(x > 0, 2.0, 4.0), 0),
    "bool of a count": (lambda x, y, r, w, v: jnp.sum((x > 0).astype(jnp.int64), 1).astype(jnp.bool_), 0),
    "exclusive or": (lambda x, y, r, w, v: (x > 0) ^ (y > 0), 0),
    "all": (lambda x, y, r, w, v: jnp.all(x > 0, axis=1), 0),
    "any": (lambda x, y, r, w, v: jnp.any(x > 0, axis=0), 0),
    "largest": (lambda x, y, r, w, v: jnp.max(x, axis=1), 0),
    "smallest product": (lambda x, y, r, w, v: jnp.min((x * y)[:3], axis=0), 1),
    "arg min": (lambda x, y, r, w, v: jnp.argmin(x, axis=0), 0),
    "arg max": (lambda x, y, r, w, v: jnp.argmax(x, axis=1), 0),
    "reshape": (lambda x, y, r, w, v: x.reshape(3, 10).T, 0),
    "slices": (lambda x, y, r, w, v: x[1:4, ::2], 0),
    "concatenate": (lambda x, y, r, w, v: jnp.concatenate([x, x * y, Y], axis=1), 1),
    "split": (lambda x, y, r, w, v: jnp.split(x, 2)[1], 0),
    "pad": (lambda x, y, r, w, v: jnp.pad(x * y, 1, constant_values=-0.5), 1),
    "gather": (lambda x, y, r, w, v: x[INDEX], 0),
    "flip": (lambda x, y, r, w, v: jnp.flip(x, 0), 0),
    "cumulative sum": (lambda x, y, r, w, v: jnp.cumsum(x * y, axis=1), 1),
    # The mean errs by 1 + LARGEST, a deviation is at most 2 LARGEST, the variance LARGEST^2.
    "variance": (
        lambda x, y, r, w, v: jnp.var(x, axis=1),
        4 * LARGEST * (1 + LARGEST) + LARGEST**2 + 2,
    ),
    "divide by a public array": (lambda x, y, r, w, v: x / (1 + np.abs(Y)), 1 + LARGEST),
    "set entries": (lambda x, y, r, w, v: x.at[INDEX[:2]].set(y[:2] * x[:2]), 1),
    "set entries of a public array": (lambda x, y, r, w, v: jnp.asarray(X).at[INDEX[:2]].set(y[:2]), 0),
    "add to entries": (lambda x, y, r, w, v: x.at[INDEX].add(y[:4] * x[:4]), 1),
    # Public entries of a secret are truncated like the others.
    "scaled pad": (lambda x, y, r, w, v: jnp.pad(x, 1, constant_values=-0.5) * 0.3, 1 + 0.3 * LARGEST),
    "custom derivative": (lambda x, y, r, w, v: squared(x), 1),
    "checkpoint": (lambda x, y, r, w, v: jax.checkpoint(jnp.square)(x), 1),
    "inner jit": (lambda x, y, r, w, v: jax.jit(jnp.square)(x), 1),
    "gradient of abs": (lambda x, y, r, w, v: jax.grad(lambda x: jnp.sum(jnp.abs(x)))(x), 0),
    "gradient of maximum": (lambda x, y, r, w, v: jax.grad(lambda x: jnp.sum(jnp.maximum(x, y)))(x), 0),
    "gradient of clip": (lambda x, y, r, w, v: jax.grad(lambda x: jnp.sum(jnp.clip(x, -1.0, 4.0)))(x), 0),
    "gradient of leaky relu": (
        lambda x, y, r, w, v: jax.grad(lambda x: jnp.sum(jax.nn.leaky_relu(x, 0.125)))(x),
        0,
    ),
    "gradient of gather": (lambda x, y, r, w, v: jax.grad(lambda x: jnp.sum(x[INDEX] ** 2))(x), 1),
    "gradient of concatenate": (
        lambda x, y, r, w, v: jax.grad(lambda x: jnp.sum(jnp.concatenate([x, y, x]) ** 2))(x),
        2,
    ),
    # 2/n of a deviation errs by less than 2 (1 + LARGEST), and so does the mean of those, taken off again.
    "gradient of variance": (
        lambda x, y, r, w, v: jax.grad(lambda x: jnp.sum(jnp.var(x, axis=1)))(x),
        4 * (1 + LARGEST),
    ),
    "gradient": (lambda x, y, r, w, v: jax.grad(lambda w: jnp.sum((x @ w) ** 2))(w), None),
    "gradient of an mlp": (lambda x, y, r, w, v: jax.grad(loss, argnums=(1, 2))(x, w, v), None),
}
# Built from comparisons, which are slow to compile.
IN_ONE_VARIANT = {
    *(
        "clamp",
        "relu6",
        "hard sigmoid",
        "sign",
        "step function",
        "bool of a count",
        "exclusive or",
        "all",
        "any",
    ),
    *("largest", "smallest product", "arg min", "gradient of abs", "gradient of maximum", "gradient of clip"),
}
# Others, and more parties: test_variants.py. With local truncation, what truncates and has no signs.
VARIANTS = [(3, "probabilistic"), (2, "local")]
CASES = [
    (name, *variant)
    for name, (_, bound) in FUNCTIONS.items()
    for variant in VARIANTS
    if variant == VARIANTS[0] or (bound != 0 and name not in IN_ONE_VARIANT)
]


@cache
def results(parties, truncation):
    """All functions in one compilation."""
    protocol = cn.Protocol(truncation=truncation)
    functions = {name: FUNCTIONS[name][0] for name, *variant in CASES if variant == [parties, truncation]}
    step = cn.secure(lambda *args: {name: f(*args) for name, f in functions.items()}, protocol=protocol)
    secrets = cn.share(jax.random.key(parties), (X, Y, ROW, W, V), parties=parties, protocol=protocol)
    return step(jax.random.key(99), *secrets)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parties", "truncation"), [case for case in CASES if FUNCTIONS[case[0]][1] is not None]
)
def test_secure_is_the_function_within_its_bound(name, parties, truncation):
    function, bound = FUNCTIONS[name]
    secret = results(parties, truncation)[name]
    expected = function(*map(jnp.asarray, (X, Y, ROW, W, V)))
    assert isinstance(secret, cn.Secret)
    assert secret.parties == parties
    assert secret.dtype == expected.dtype
    error = np.abs(np.asarray(cn.reveal(secret), np.float64) - np.asarray(expected, np.float64))
    assert error.shape == expected.shape
    # Float64 itself rounds in the last of 53 bits.
    assert np.max(error) <= bound * UNIT + 1e-12


@pytest.mark.parametrize(("parties", "truncation"), VARIANTS)
def test_gradients_are_evaluated_on_secrets(parties, truncation):
    """g = 2 (x w) x^T: a unit in each of x w moves g by 2 |x|^T 1 units; and g is truncated once."""
    got = cn.reveal(results(parties, truncation)["gradient"])
    bound = 2 * np.abs(X).sum(axis=0)[:, None] + 1
    assert np.all(np.abs(got - X.T @ (2 * X @ W)) <= bound * UNIT)


@pytest.mark.parametrize(("parties", "truncation"), VARIANTS)
def test_the_backward_pass_of_a_relu_uses_its_bit(parties, truncation):
    hidden = X @ W
    active = hidden > 0
    h = hidden * active
    out = h @ V
    error_out = np.abs(V).sum(axis=0) + 1  # units, of out, from one unit in each of h
    upstream = active * (2 * out @ V.T)
    error_up = 2 * error_out @ np.abs(V).T + 1
    got_w, got_v = cn.reveal(results(parties, truncation)["gradient of an mlp"])
    bound_w = np.abs(X).sum(axis=0)[:, None] * error_up + 1
    bound_v = (
        h.sum(axis=0)[:, None] * 2 * error_out + (2 * np.abs(out) + 2 * error_out * UNIT).sum(axis=0) + 1
    )
    assert np.all(np.abs(got_w - X.T @ upstream) <= bound_w * UNIT)
    assert np.all(np.abs(got_v - h.T @ (2 * out)) <= bound_v * UNIT)


def test_a_public_index_may_be_known_at_run_time_alone():
    def functions(x, i, divisor):
        return (
            jax.lax.dynamic_slice(x, (i, 1), (2, 3)),
            jax.lax.dynamic_update_slice(x, x[:1] * x[1:2], (i, 0)),
            x.at[i].add(x[0]),
            jax.lax.select_n(i, x, 2 * x, 3 * x),
            x / divisor,
        )

    i, divisor = 2, np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    secret = cn.secure(functions)(jax.random.key(1), cn.share(jax.random.key(0), X, parties=3), i, divisor)
    expected = functions(jnp.asarray(X), i, divisor)
    # The reciprocals err by half a unit.
    for got, exact, bound in zip(cn.reveal(secret), expected, (0, 1, 0, 0, 1 + LARGEST / 2), strict=True):
        assert np.max(np.abs(got - exact)) <= bound * UNIT + 1e-12


def test_the_first_of_equal_entries_is_the_arg_max():
    x = cn.share(jax.random.key(0), np.array([[1.0, 3.0, 3.0], [2.0, 2.0, 2.0], [0.0, -1.0, 0.0]]), parties=3)
    index = cn.secure(lambda x: jnp.argmax(x, axis=-1))(jax.random.key(1), x)
    np.testing.assert_array_equal(cn.reveal(index), [1, 0, 0])


# --- training ---------------------------------------------------------------------------------------


def training(parameters, velocity, x, y, momentum):
    def loss(parameters):
        (w0, b0), (w1, b1) = parameters
        return jnp.sum((jax.nn.relu(x @ w0 + b0) @ w1 + b1 - y) ** 2)

    value, gradient = jax.value_and_grad(loss)(parameters)
    velocity = jax.tree.map(lambda v, g: momentum * v - 2.0**-10 * g, velocity, gradient)
    return jax.tree.map(jnp.add, parameters, velocity), velocity, value


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [0.0, 0.9])
def test_secret_training_tracks_float32_training(momentum):
    """200 steps in one scan. What unbiased rounding may do in them is measured on plain float64 training
    whose velocity gets noise of two units at every step, as from two truncations: the secret run may stray as
    far as the farthest of eight such runs.
    """
    steps, rng = 200, np.random.default_rng(2)

    def normal(*shape, scale=1.0):
        return rng.normal(0, scale, shape).astype(np.float32)

    x = normal(steps, 20, 6)
    y = np.maximum(x @ normal(6, 3, scale=0.4), 0)
    parameters = [(normal(6, 8, scale=0.4), normal(8)), (normal(8, 3, scale=0.4), normal(3))]
    velocity = jax.tree.map(np.zeros_like, parameters)
    step = cn.secure(lambda p, v, x, y: training(p, v, x, y, momentum))
    shared = cn.share(jax.random.key(0), (parameters, velocity, x, y), parties=3)

    @jax.jit
    def secretly(parameters, velocity, x, y):
        def body(carry, i):
            key = jax.random.fold_in(jax.random.key(5), i)
            parameters, velocity, value = step(key, *carry, x[i], y[i])
            return (parameters, velocity), value.shares

        return jax.lax.scan(body, (parameters, velocity), jnp.arange(steps))

    @partial(jax.jit, static_argnames="dtype")
    def plainly(noise, parameters, velocity, x, y, dtype):
        def body(carry, step):
            noise, x, y = step
            parameters, velocity, value = training(carry[0], carry[1], x, y, momentum)
            parameters, velocity = (jax.tree.map(jnp.add, part, noise) for part in (parameters, velocity))
            return (parameters, velocity), value

        inputs = jax.tree.map(lambda a: a.astype(dtype), (noise, parameters, velocity, x, y))
        noise, parameters, velocity, x, y = inputs
        return jax.lax.scan(body, (parameters, velocity), (noise, x, y))

    def noise(amplitude):
        return jax.tree.map(lambda p: rng.uniform(-amplitude, amplitude, (steps, *p.shape)), parameters)

    def distance(a, b):
        return max(np.max(np.abs(p - q)) for p, q in zip(*map(jax.tree.leaves, (a, b)), strict=True))

    args = (parameters, velocity, x, y)
    (secret, _), _ = secretly(*shared)
    (plain, _), values = plainly(noise(0), *args, dtype=jnp.float32)
    assert values[-1] < values[0] / 10  # it learns
    (exact, _), _ = plainly(noise(0), *args, dtype=jnp.float64)
    rounded = [plainly(noise(2 * UNIT), *args, dtype=jnp.float64)[0][0] for _ in range(8)]
    allowed = max(distance(run, exact) for run in rounded)
    assert allowed < 1e-3  # and a bound this small says something
    assert distance(cn.reveal(secret), plain) < allowed


# --- composition ------------------------------------------------------------------------------------


def test_what_depends_on_no_secret_stays_public():
    x = cn.share(jax.random.key(0), ROW, parties=2)
    secret, public = cn.secure(lambda x, y: (x + y, 2 * y))(jax.random.key(1), x, ROW)
    assert isinstance(secret, cn.Secret)
    np.testing.assert_array_equal(public, 2 * ROW)


def test_works_under_jit_and_vmap():
    x = cn.share(jax.random.key(0), X, parties=2)
    step = cn.secure(lambda x: x * x)
    keys = jax.random.split(jax.random.key(1), 3)
    jitted = jax.jit(step)(keys[0], x)
    batched = jax.vmap(step, in_axes=(0, None))(keys, x)
    np.testing.assert_array_equal(jitted.shares, step(keys[0], x).shares)
    np.testing.assert_array_equal(batched.shares[0], jitted.shares)
    assert not np.array_equal(batched.shares[0], batched.shares[1])


def test_stacked_secrets_keep_their_parties():
    """Outputs of vmap and scan stack in front of the party axis: three of each, so a mix-up would show."""
    x = cn.share(jax.random.key(0), X, parties=3)
    step = cn.secure(lambda x: 2 * x)
    keys = jax.random.split(jax.random.key(1), 3)
    mapped = jax.vmap(step, in_axes=(0, None))(keys, x)
    _, scanned = jax.lax.scan(lambda _, key: (None, step(key, x)), None, keys)
    for stacked in (mapped, scanned):
        assert stacked.parties == 3
        assert stacked.shape == (3, *X.shape)
        np.testing.assert_array_equal(cn.reveal(stacked), np.stack([2 * X] * 3))
        np.testing.assert_array_equal(cn.reveal(stacked[1]), 2 * X)
        np.testing.assert_array_equal(cn.reveal(step(keys[0], stacked)), np.stack([4 * X] * 3))


def test_a_loop_over_the_party_axis_is_refused():
    x = cn.share(jax.random.key(0), X, parties=3)
    step = cn.secure(lambda x: 2 * x)
    with pytest.raises(ValueError, match="axis sizes"):
        jax.lax.map(lambda each: step(*each), (jax.random.split(jax.random.key(1), 3), x))


def test_the_key_alone_decides_the_shares():
    x = cn.share(jax.random.key(0), X, parties=2)
    step = cn.secure(lambda x: x * x)
    np.testing.assert_array_equal(step(jax.random.key(1), x).shares, step(jax.random.key(1), x).shares)


# --- what is refused --------------------------------------------------------------------------------


def secret(parties=2, **protocol):
    return cn.share(jax.random.key(0), X, parties=parties, protocol=cn.Protocol(**protocol))


def test_an_unsupported_primitive_names_itself_its_line_and_a_way_out():
    with pytest.raises(NotImplementedError, match=r"`exp`.*test_secured\.py:\d+.*polynomial"):
        cn.secure(lambda x: jnp.exp(x))(jax.random.key(0), secret())


def test_a_primitive_without_advice_of_its_own_names_what_there_is():
    with pytest.raises(NotImplementedError, match=r"`sort`.*no rule.*arg max.*secret\.rules"):
        cn.secure(jnp.sort)(jax.random.key(0), secret())


def test_operations_that_mean_something_else_for_integers_are_refused():
    x = cn.share(jax.random.key(0), np.arange(4), parties=2)
    for function in (lambda x: x & 1, lambda x: ~x, lambda x: jax.lax.div(x, jnp.full(4, 2))):
        with pytest.raises(NotImplementedError, match="secret int64"):
            cn.secure(function)(jax.random.key(0), x)


def test_a_secret_divisor_and_a_secret_index_are_refused():
    with pytest.raises(NotImplementedError, match="the divisor is secret"):
        cn.secure(lambda x: 1.0 / x)(jax.random.key(0), secret())
    with pytest.raises(NotImplementedError, match="indices"):
        cn.secure(lambda x: jnp.arange(6)[jnp.argmax(x)])(jax.random.key(0), secret())


def test_nothing_secret_is_refused():
    with pytest.raises(ValueError, match="no argument is secret"):
        cn.secure(lambda x: x)(jax.random.key(0), X)


def test_mismatched_parties_are_refused():
    with pytest.raises(ValueError, match=r"different numbers of parties: \[2, 3\]"):
        cn.secure(jnp.add)(jax.random.key(0), secret(2), secret(3))


def test_a_mismatched_precision_is_refused():
    with pytest.raises(ValueError, match="18 fractional bits, the protocol 20"):
        cn.secure(jnp.square)(jax.random.key(0), secret(frac_bits=18))


def test_local_truncation_is_for_two_parties():
    protocol = cn.Protocol(truncation="local")
    with pytest.raises(ValueError, match="for two parties, got 3"):
        cn.secure(jnp.square, protocol=protocol)(jax.random.key(0), secret(3))


def test_a_missing_key_is_refused():
    with pytest.raises(TypeError, match="the dealer's random key"):
        cn.secure(jnp.square)(secret())


def test_differentiating_a_secure_function_says_what_to_write():
    step = cn.secure(lambda w, x: jnp.sum(w * x))
    with pytest.raises(TypeError, match=r"secure\(jax\.grad\(f\)\)"):
        jax.grad(lambda w: cn.reveal(step(jax.random.key(0), w, secret())))(jnp.asarray(X))
    with pytest.raises(TypeError, match=r"secure\(jax\.grad\(f\)\)"):
        jax.grad(lambda w: cn.reveal(cn.share(jax.random.key(0), w, parties=2)))(1.0)
    with pytest.raises(TypeError, match=r"secure\(jax\.grad\(f\)\)"):
        jax.grad(step, argnums=1)(jax.random.key(0), jnp.asarray(X), secret())


def test_a_protocol_names_its_variants():
    with pytest.raises(ValueError, match="probabilistic, local"):
        cn.Protocol(truncation="exact")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"1\.\.30"):
        cn.Protocol(frac_bits=40)
