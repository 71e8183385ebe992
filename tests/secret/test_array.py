"""Secrets: sharing, opening, indexing, and what a Secret refuses."""

import copy
import io
import pickle
import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

from ..slow import slow

pytestmark = pytest.mark.newest_jax


@pytest.mark.parametrize("parties", [2, *slow(3, 5), 16])
def test_reveal_undoes_share(parties):
    values = {
        "floats": np.array([[0.0, 1.5, -2.25], [4e6, -4e6, 2.0**-20]]),
        "bits": np.array([True, False]),
        "integers": np.array([-3, 7]),
    }
    shared = cn.share(jax.random.key(0), values, parties=parties)
    for name, value in values.items():
        assert shared[name].shares.shape == (parties, *value.shape)
        assert shared[name].shares.dtype == np.uint64
        assert shared[name].shape == value.shape
        opened = cn.reveal(shared[name])
        assert opened.dtype == value.dtype
        np.testing.assert_array_equal(opened, value)


def test_float32_comes_back_as_float32():
    assert cn.reveal(cn.share(jax.random.key(0), np.ones(2, np.float32), parties=2)).dtype == np.float32


def test_entries_and_leaves_get_shares_of_their_own():
    """Equal values, and equal leaves, must not get equal shares."""
    a, b = cn.share(jax.random.key(0), (np.zeros(1000), np.zeros(1000)), parties=3)
    everything = np.concatenate([np.asarray(a.shares).ravel(), np.asarray(b.shares).ravel()])
    assert len(np.unique(everything)) == everything.size


def test_indexing_is_along_the_value_s_axes():
    values = np.arange(24.0).reshape(4, 6)
    x = cn.share(jax.random.key(0), values, parties=3)
    rows = np.array([3, 0, 0])
    np.testing.assert_array_equal(cn.reveal(x[1]), values[1])
    np.testing.assert_array_equal(cn.reveal(x[1:3, ::2]), values[1:3, ::2])
    np.testing.assert_array_equal(cn.reveal(x[rows]), values[rows])
    assert [row.shape for row in x] == [(6,)] * 4


def test_a_secret_is_a_pytree_of_its_shares_and_an_empty_seal():
    x = cn.share(jax.random.key(0), np.ones(3), parties=2)
    shares, seal = jax.tree.leaves(x)
    np.testing.assert_array_equal(shares, x.shares)
    assert seal.shape == (0, 3)
    assert seal.nbytes == 0
    np.testing.assert_array_equal(seal, jax.tree.leaves(jax.jit(lambda x: x)(x))[1])
    assert jax.jit(lambda x: x)(x).frac_bits == x.frac_bits


def test_a_secret_shows_no_value():
    x = cn.share(jax.random.key(0), np.full(3, 12345.0), parties=2)
    assert repr(x) == "Secret(float64[3], parties=2, frac_bits=20)"
    for leak in (lambda: np.asarray(x), lambda: jnp.sin(x), lambda: float(x)):  # pyright: ignore
        with pytest.raises(TypeError):
            leak()


def test_bad_values_are_refused():
    key = jax.random.key(0)
    with pytest.raises(ValueError, match="at least two parties"):
        cn.share(key, 1.0, parties=1)
    with pytest.raises(ValueError, match=r"stay below 4\.1943e\+06"):
        cn.share(key, 2.0**22, parties=2)
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match=r"finite|stay below"):
            cn.share(key, bad, parties=2)
    for bad, dtype in ((1j, "complex128"), (key, "key<"), ("a string", "<U")):
        with pytest.raises(TypeError, match=f"cannot share an array of dtype {dtype}"):
            cn.share(key, bad, parties=2)
    with pytest.raises(ValueError, match="one key is needed"):
        cn.share(jax.random.split(key), 1.0, parties=2)


# --- operators ---------------------------------------------------------------------------------------

P, Q = (cn.share(jax.random.key(i), np.array([1.0, 2.0]), parties=2) for i in (1, 2))
OPERATORS = {
    "plus": lambda: P + Q,
    "a number before": lambda: 2.0 * P,
    "a numpy array before": lambda: np.ones(2) * P,
    "a JAX array before": lambda: jnp.ones(2) - P,
    "a matrix product": lambda: P @ Q,
    "a ufunc": lambda: np.matmul(P, Q),
    "minus": lambda: -P,
    "absolute": lambda: abs(P),
    "equal": lambda: P == Q,
    "unequal to nothing": lambda: P != None,  # noqa: E711
    "order": lambda: max(P, Q),
    "sum": lambda: sum([P, Q]),
    "truth": lambda: P or Q,
    "int": lambda: int(P[0]),
    "an index": lambda: [1, 2][P[0]],
    "hash": lambda: {P: 1},
    "contains": lambda: 1.0 in P,
}


@pytest.mark.parametrize("name", OPERATORS)
def test_operators_say_where_to_compute(name):
    with pytest.raises(TypeError, match=r"secure|id\(x\)"):
        OPERATORS[name]()


ON_SHARES = {
    "a float multiple": lambda x, y: x - 0.1 * y,
    "a comparison": lambda x, y: x > y,
    "another dtype": lambda x, y: x.astype(np.int64),
    "a product": lambda x, y: x * y,
    "a sum": lambda x, y: x + y,
    "a public sum": lambda x, y: x + 1,
    "a public sum, from the left": lambda x, y: np.uint64(1) + x,
    "an integer multiple": lambda x, y: 3 * x,
    "a power": lambda x, y: x**2,
    "minus": lambda x, y: -x,
    "a dot product": lambda x, y: x @ y.T,
    "an update": lambda x, y: x.at[0].add(y[0]),
    "numpy's function": lambda x, y: np.multiply(x, y),
    "numpy's sum": lambda x, y: np.add.reduce(x),
    "numpy's order": lambda x, y: np.sort(np.asarray(x)) if x.nbytes else np.sort(x),
    "numpy's fill": lambda x, y: np.ones_like(x),
}


@pytest.mark.parametrize("name", ON_SHARES)
@pytest.mark.parametrize("trace", [lambda f: f, jax.jit], ids=["eager", "jit"])
def test_arithmetic_on_the_shares_by_tree_map_is_refused(name, trace):
    if trace is jax.jit and name.startswith("numpy"):
        pytest.skip("numpy does not compute with tracers")
    with (
        jax.numpy_dtype_promotion("standard"),
        pytest.raises((TypeError, AttributeError), match=r"tree\.map.*secure\(lambda"),
    ):
        trace(lambda x, y: jax.tree.map(ON_SHARES[name], x, y))(P, Q)


@pytest.mark.parametrize("f", [jnp.add, jnp.multiply, jax.lax.mul, jnp.matmul, jnp.maximum, jnp.dot])
def test_arithmetic_of_jax_on_the_shares_is_refused_by_jax(f):
    with pytest.raises((TypeError, AssertionError), match="seal"):
        jax.tree.map(f, X, X)


def test_what_else_looks_at_the_shares_and_not_at_the_value_is_refused():
    with pytest.raises(ValueError, match="ui32"):  # JAX's own, of the seal
        jax.tree.map(lambda a: jax.lax.top_k(a, 1)[0], X)
    with pytest.raises(AttributeError, match=r"tree\.map"):
        jax.tree.map(lambda a, b: a.at[:1].set(b[:1]), X, X)


def test_a_secret_may_be_donated():
    again = jax.jit(lambda x, y: (y, x), donate_argnums=(0, 1))
    x, y = (jax.tree.map(jnp.copy, X) for _ in range(2))
    for _ in range(3):
        x, y = again(x, y)
        (x,) = jax.jit(lambda *leaves: [jax.tree.unflatten(jax.tree.structure(X), leaves)], donate_argnums=0)(
            *jax.tree.leaves(x)
        )
    for each in (x, y, X, jax.tree.map(jnp.copy, X)):
        np.testing.assert_array_equal(cn.reveal(jax.jit(lambda x: x)(each)), [[1, 2], [3, 4]])


def test_jax_looks_for_keys_used_twice():
    with jax.debug_key_reuse(True):
        double = cn.secure(lambda x: 2 * x)
        for f in (double, jax.jit(double)):
            np.testing.assert_array_equal(cn.reveal(f(jax.random.key(8), X)), [[2, 4], [6, 8]])


@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))], ids=["deepcopy", "pickle"]
)
def test_a_secret_and_its_leaves_are_copied(copied):
    for x in (copied(X), jax.tree.unflatten(jax.tree.structure(X), copied(jax.tree.leaves(X)))):
        np.testing.assert_array_equal(cn.reveal(x), [[1, 2], [3, 4]])


def _through_a_file(x):
    file = io.BytesIO()
    np.savez(file, *jax.tree.leaves(jax.tree.map(np.asarray, x)))
    file.seek(0)
    arrays = np.load(file)
    return jax.tree.unflatten(jax.tree.structure(x), [jnp.asarray(arrays[name]) for name in arrays.files])


# Two entries for two parties: a mix-up of axes would show in no shape.
X = cn.share(jax.random.key(3), np.array([[1.0, 2.0], [3.0, 4.0]]), parties=2)
MOVES = {
    "numpy": (lambda x: jax.tree.map(np.asarray, x), [[1, 2], [3, 4]]),
    "a file": (lambda x: jax.jit(lambda x: x)(_through_a_file(x)), [[1, 2], [3, 4]]),
    "stack, to index": (lambda x: jax.tree.map(lambda *s: jnp.stack(s), x, x)[1], [[1, 2], [3, 4]]),
    "a pick by an index": (lambda x: jax.jit(_pick)(jnp.array([1, 0]), x), [[3, 4], [1, 2]]),
    "a choice": (lambda x: jax.tree.map(lambda a, b: jnp.where(True, a, b), x, x), [[1, 2], [3, 4]]),
    "reversed entries": (lambda x: jax.tree.map(lambda a: a[:, ::-1], x), [[3, 4], [1, 2]]),
    "joined entries": (lambda x: jax.tree.map(lambda a: jnp.concatenate([a, a], 1), x)[2:], [[1, 2], [3, 4]]),
    "other order of parties": (lambda x: jax.tree.map(lambda a: jnp.flip(a, 0), x), [[1, 2], [3, 4]]),
    "copies": (lambda x: jax.device_put(jax.tree.map(jnp.copy, x)), [[1, 2], [3, 4]]),
    "zeros": (lambda x: jax.tree.map(jnp.zeros_like, x), [[0, 0], [0, 0]]),
    "vmap": (lambda x: jax.vmap(lambda s: s, axis_size=2, in_axes=None)(x)[1], [[1, 2], [3, 4]]),
    "axes": (
        lambda x: jax.vmap(lambda s: s, in_axes=(jax.tree.map(lambda _: 0, x),))(_two(x))[0],
        [[1, 2], [3, 4]],
    ),
    "a carry": (
        lambda x: jax.lax.scan(lambda c, _: ((c[1], c[0]), None), (x, x), None, 3)[0][1],
        [[1, 2], [3, 4]],
    ),
    "outputs": (lambda x: jax.lax.scan(lambda c, _: (None, x), None, None, 3)[1][2], [[1, 2], [3, 4]]),
    "inputs": (lambda x: jax.lax.scan(lambda c, s: (s, None), x, _two(x))[0], [[1, 2], [3, 4]]),
    "a branch": (lambda x: jax.lax.cond(jnp.bool_(True), lambda x: x, lambda x: x, x), [[1, 2], [3, 4]]),
    "pickle": (lambda x: pickle.loads(pickle.dumps(x)), [[1, 2], [3, 4]]),
    "deepcopy": (copy.deepcopy, [[1, 2], [3, 4]]),
}
MIX_UPS = {
    "more parties": lambda x: jax.tree.map(lambda a: jnp.concatenate([a, a]), x),
    "repeated": lambda x: jax.tree.map(lambda a: jnp.repeat(a, 2, axis=0), x),
    "fewer parties": lambda x: jax.tree.map(lambda a: a[:1], x),
    "no parties": lambda x: jax.tree.map(lambda a: a[2:], x),
    "picked parties": lambda x: jax.tree.map(lambda a: a[jnp.array([1, 0, 1])], x),
    "numpy's pick": lambda x: jax.tree.map(lambda a: np.asarray(a)[[1, 1]], x),
    "one party": lambda x: jax.tree.map(lambda a: a[0], x),
    "transposed": lambda x: jax.tree.map(lambda a: a.T, x),
    "stacked behind": lambda x: jax.tree.map(lambda *a: jnp.stack(a, 1), x, x),
    "stacked last": lambda x: jax.tree.map(lambda *a: jnp.stack(a, -1), x, x),
    "flat": lambda x: jax.tree.map(lambda a: a.reshape(-1), x),
    "vmap's outputs elsewhere": lambda x: jax.vmap(lambda s: s, in_axes=None, out_axes=1, axis_size=2)(x),
    "vmap over parties": lambda x: jax.vmap(lambda s: s)(x),
    "scan over parties": lambda x: jax.lax.scan(lambda _, s: (None, s), None, x),
    "map over entries and parties": lambda x: jax.lax.map(lambda s: s[0], (x, np.arange(2))),
}


@pytest.mark.parametrize("name", MIX_UPS)
@pytest.mark.parametrize("trace", [lambda f: f, jax.jit], ids=["eager", "jit"])
def test_what_moves_the_party_axis_is_refused(name, trace):
    if trace is jax.jit and name.startswith("numpy"):
        pytest.skip("numpy does not compute with tracers")
    with pytest.raises(
        (ValueError, IndexError), match=r"party axis|axis sizes|inconsistent sizes|out of bounds"
    ):
        trace(MIX_UPS[name])(X)


def _two(x):
    return jax.tree.map(lambda *s: jnp.stack(s), x, x)


def _pick(i, x):
    return jax.tree.map(lambda a: a[:, i], x)


@pytest.mark.parametrize("name", MOVES)
@pytest.mark.parametrize("trace", [lambda f: f, jax.jit], ids=["eager", "jit"])
def test_what_moves_entries_goes_through(name, trace):
    if trace is jax.jit and name in ("numpy", "a file", "pickle", "deepcopy"):
        pytest.skip("tracers stay in their function")
    move, expected = MOVES[name]
    np.testing.assert_array_equal(cn.reveal(trace(move)(X)), expected)


# JAX lets them be traced with any type, and compiles nothing that leaves no trace in a result.
ORDERED = {
    "sort": lambda x: jax.tree.map(lambda a: jnp.sort(a, axis=1), x),
    "top_k": lambda x: jax.tree.map(lambda a: jax.lax.top_k(a, 2)[0], x),
    "in an inner function": lambda x: jax.jit(lambda x: jax.tree.map(jnp.sort, x))(x),
    "in a loop over arrays": lambda x: jax.tree.map(
        lambda a: jax.lax.fori_loop(0, 2, lambda i, a: jax.lax.sort(a, dimension=1), a), x
    ),
    "before it is moved": lambda x: jax.tree.map(lambda a: jnp.sort(a)[:, ::-1].reshape(a.shape), x),
    "in a branch": lambda x: jax.lax.cond(True, lambda x: jax.tree.map(jnp.sort, x), lambda x: x, x),
    "under vmap": lambda x: jax.vmap(lambda x: jax.tree.map(jnp.sort, x))(_two(x)),
}


@pytest.mark.parametrize("name", ORDERED)
def test_what_orders_shares_is_refused_under_a_trace(name):
    with pytest.raises(TypeError, match="of the shares of a Secret and not of its value"):
        jax.jit(ORDERED[name])(X)


def test_integers_of_four_bits_are_refused():
    with pytest.raises(TypeError, match="cannot share an array of dtype int4"):
        cn.share(jax.random.key(0), jnp.ones(2, jnp.int4), parties=2)


def test_trees_of_something_else_than_arrays_are_shown():
    assert repr(jax.tree.map(jnp.shape, X)) == "Secret((2, 2, 2))"
    assert sum(leaf.size for leaf in jax.tree.leaves(X)) == X.shares.size
    assert jax.eval_shape(lambda x: x, X).shape == (2, 2)
    lowered = jax.jit(lambda x: x).lower(X)
    np.testing.assert_array_equal(cn.reveal(lowered.compile()(X)), [[1, 2], [3, 4]])
    np.testing.assert_array_equal(
        cn.reveal(jax.jit(lambda x: x).trace(X).lower().compile()(X)), [[1, 2], [3, 4]]
    )


def test_a_secret_is_not_shared_again():
    for function in (lambda f: f, jax.jit):
        with pytest.raises(TypeError, match="a Secret is shared already"):
            function(lambda x: cn.share(jax.random.key(4), {"x": x}, parties=2))(X)


# --- out of range -------------------------------------------------------------------------------------

KEY = jax.random.key(0)
shared = partial(cn.share, KEY, parties=3)
UNDER_A_TRACE = {
    "jit": jax.jit(shared),
    "vmap": lambda x: jax.vmap(lambda i, x: cn.share(jax.random.fold_in(KEY, i), x, parties=3))(
        np.arange(4), np.stack([x] * 4)
    ),
    "scan": lambda x: jax.lax.scan(lambda i, _: (i + 1, shared(x)), 0, length=2)[1],
    "cond": jax.jit(lambda x: jax.lax.cond(x[-1] == 0, shared, shared, x)),
    "a product": jax.jit(lambda x: cn.secure(lambda x: x * x > 0)(KEY, shared(x))),
    "the gradient of a simulation": jax.jit(
        jax.grad(lambda x: jnp.sum(cn.simulate(lambda x: x * x, parties=3)(KEY, x)))
    ),
}


@pytest.mark.parametrize("name", UNDER_A_TRACE)
@pytest.mark.parametrize("value", [np.nan, *slow(np.inf, -np.inf, 2.0**22, -(2.0**22), 2.0**22 - 1)])
def test_what_cannot_be_shared_under_a_trace_is_found_when_it_runs(name, value):
    values = np.array([1.0, value, 0.0])
    if value == 2.0**22 - 1:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            jax.block_until_ready(UNDER_A_TRACE[name](values))
    elif name == "scan":  # what a loop does not change is looked at before it runs
        with pytest.raises(ValueError, match="cannot share"):
            UNDER_A_TRACE[name](values)
    else:
        found = f"cannot share {value:g}: .* is no number".replace("+", r"\+")
        with pytest.warns(RuntimeWarning, match=found):
            jax.block_until_ready(UNDER_A_TRACE[name](values))


@pytest.mark.filterwarnings("ignore:cannot share")
def test_what_cannot_be_shared_under_jit_is_revealed_as_nan():
    values = np.array([np.nan, np.inf, -np.inf, 2.0**22, -(2.0**22), 2.0**22 - 1, 0.0])
    share = jax.jit(shared)
    moved = cn.secure(lambda x: x[::-1] + 1.0)(jax.random.key(1), share(values))
    expected = np.where(np.abs(values) < 2.0**22, values, np.nan)
    np.testing.assert_array_equal(cn.reveal(share(values)), expected)
    np.testing.assert_array_equal(cn.reveal(moved), expected[::-1] + 1)
    np.testing.assert_array_equal(cn.reveal(share(values.astype(np.float32))), expected)


@pytest.mark.parametrize("dtype", [np.int64, np.uint64])
def test_integers_too_large_to_be_compared_are_refused_or_poisoned(dtype):
    for value in [2**62, -(2**62)] if dtype == np.int64 else [2**62, 2**64 - 1]:
        refused = rf"cannot share {value}: integers stay below 2\^62"
        with pytest.raises(ValueError, match=refused):
            cn.share(KEY, dtype(value), parties=2)
        with pytest.warns(RuntimeWarning, match=refused):
            poisoned = jax.block_until_ready(jax.jit(partial(cn.share, KEY, parties=2))(dtype(value)))
        assert cn.reveal(poisoned) == np.uint64(2**63).astype(dtype)
    assert cn.reveal(cn.share(KEY, dtype(2**62 - 1), parties=2)) == 2**62 - 1


def test_a_result_that_left_the_range_is_nan():
    """2^(62 - 20) is the largest result in range."""
    x = cn.share(jax.random.key(0), np.array([4e6, 1.0, -4e6]), parties=2)
    y = cn.secure(lambda x: x * 2.0**20)(jax.random.key(1), x)
    np.testing.assert_array_equal(cn.reveal(y), np.array([4e6, 1.0, -4e6]) * 2**20)
    y = cn.secure(lambda x: x * 2.0**21)(jax.random.key(1), x)
    np.testing.assert_array_equal(cn.reveal(y), [np.nan, 2.0**21, np.nan])
