"""Secret integers wrap around exactly where JAX's do, whatever is done with them afterwards."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

X = {
    "int8": np.array([100, -128, 127, -1, 0, 5], np.int8),
    "uint8": np.array([200, 3, 0, 255, 100, 1], np.uint8),
    "int32": np.array([2**30, -(2**31), 2**31 - 1, -1, 0, 46341], np.int32),
    "uint32": np.array([2**31, 3, 0, 2**32 - 1, 65536, 1], np.uint32),
}


# name: function of the integers and of the same in reverse
ALWAYS = {
    "sum as float": lambda x, y: (x + y).astype(np.float64),
    "compared": lambda x, y: (x + y > 0, x - y < y),
    "product": lambda x, y: x * y,
}
NARROW = {
    "negated": lambda x, y: (-x).astype(np.float64),
    "absolute": lambda x, y: jnp.abs(x) > 0,
    "times minus one": lambda x, y: x * np.array(-1).astype(x.dtype) > 0,
    "power to a bool": lambda x, y: (x**3).astype(np.bool_),
    "clipped": lambda x, y: jnp.clip(x + y, 1, 100),
    "arg max": lambda x, y: jnp.argmax(x + y),
    "of the other sign": lambda x, y: (x + y).astype(np.int8 if x.dtype == np.uint8 else np.uint8),
    "wider": lambda x, y: (x - y).astype(np.int16),
    "dot": lambda x, y: jax.lax.dot(x + x, y, preferred_element_type=np.int32),
    "loop": lambda x, y: jax.lax.fori_loop(0, 3, lambda i, c: jnp.where(c > 0, c + y, c + x), x),
    "select by an integer": lambda x, y: jax.lax.select_n((x + y).astype(np.int32), x, y),
    "added to entries": lambda x, y: jnp.sum(x.at[np.array([0, 0, 1])].add(y[:3])).astype(np.float64),
}
CASES = [(dtype, name) for dtype in X for name in (*ALWAYS, *(NARROW if dtype in ("int8", "uint8") else ()))]
FUNCTIONS = ALWAYS | NARROW


@cache
def results(parties):
    protocol = cn.Protocol(comparison="ideal")  # compiles fast

    def all_of(x, y):
        return {(dtype, name): FUNCTIONS[name](x[dtype], y[dtype]) for dtype, name in CASES}

    secrets = cn.share(jax.random.key(0), (X, {name: x[::-1] for name, x in X.items()}), parties=parties)
    step = cn.secure(lambda x, y: list(all_of(x, y).values()), protocol=protocol)
    return dict(zip(CASES, cn.reveal(step(jax.random.key(1), *secrets)), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("dtype", "name"), CASES)
def test_integers_wrap_around_as_in_jax(dtype, name):
    expected = FUNCTIONS[name](jnp.asarray(X[dtype]), jnp.asarray(X[dtype][::-1]))
    for got, exact in zip(jax.tree.leaves(results(2)[dtype, name]), jax.tree.leaves(expected), strict=True):
        assert got.dtype == exact.dtype
        np.testing.assert_allclose(got, exact, rtol=1e-6)


def test_what_cannot_be_out_of_range_is_not_brought_back():
    x = cn.share(jax.random.key(0), np.array([1.0, -1.0]), parties=2)

    def rounds(f):
        return cn.cost(cn.secure(f), x).rounds

    counted = rounds(lambda x: jnp.sum((x > 0).astype(np.int8)) > 1)
    assert counted == rounds(lambda x: jnp.sum((x > 0).astype(np.int64)) > 1)


def test_unsigned_integers_of_64_bits_do_not_fall_below_0():
    x = cn.share(jax.random.key(0), np.array([1, 2], np.uint64), parties=2)
    for f in (lambda x: x - x[::-1], lambda x: x.astype(np.int64).astype(np.uint64)):
        with pytest.raises(NotImplementedError, match=r"below 0.*Convert to int64"):
            cn.secure(f)(jax.random.key(1), x)
    np.testing.assert_array_equal(cn.reveal(cn.secure(lambda x: 3 * x + 1)(jax.random.key(1), x)), [4, 7])


def test_integers_of_64_bits_become_floats_within_the_range_of_results():
    x = np.array([-1000, 3, 2**21 + 1, 999], np.int64)

    def floats(x):
        y = x.astype(np.float64)
        return y * 2.5e-5, x / 7, jnp.mean(x), jnp.mean((y / 1024.0) ** 2), y * 0.3 - 1.0

    secret = cn.share(jax.random.key(0), x, parties=2)
    got = cn.reveal(cn.secure(floats)(jax.random.key(1), secret))
    for found, exact in zip(got, floats(jnp.asarray(x)), strict=True):
        np.testing.assert_allclose(found, exact, rtol=2e-6, atol=2e-5)


def test_means_of_small_integers_of_64_bits_are_as_fine_as_any_result():
    x = cn.share(jax.random.key(0), np.arange(10), parties=2)
    step = cn.secure(lambda x: (jnp.mean(x), x.astype(np.float64) * 0.1, jnp.sum(x) / 7))
    mean, tenth, seventh = cn.reveal(step(jax.random.key(1), x))
    np.testing.assert_allclose(mean, 4.5, atol=2e-5)
    np.testing.assert_allclose(tenth, np.arange(10) / 10, atol=2e-5)
    np.testing.assert_allclose(seventh, 45 / 7, atol=2e-5)


LARGE = np.array([2**50, 2**43, 5, -(2**50), 0, 2**61, -(2**61)])


def test_large_integers_are_scaled_down_to_results():
    x = cn.share(jax.random.key(0), LARGE, parties=2)

    def scaled(x):
        y = x.astype(np.float64)
        return y * 1e-12, y[:3] * 1e-7, y / 1e18, y * 2.0**-40

    found = cn.reveal(cn.secure(scaled)(jax.random.key(1), x))
    for got, exact in zip(found, scaled(jnp.asarray(LARGE)), strict=True):
        np.testing.assert_allclose(got, exact, rtol=1e-6, atol=2e-6)


@pytest.mark.parametrize("public", [1.5, -1.5, 5.0, 1e13, -(2.0**50), 2.0**43, np.inf])
def test_large_integers_are_compared_with_floats(public):
    def comparisons(x, c):
        x = x.astype(np.float64)
        return x > c, x >= c, x < c, x <= c, x == c, x != c

    x = cn.share(jax.random.key(0), LARGE, parties=2)
    protocol = cn.Protocol(comparison="ideal")
    exact = comparisons(jnp.asarray(LARGE), public)
    constant = cn.secure(lambda x: comparisons(x, public), protocol=protocol)(jax.random.key(1), x)
    of_the_run = cn.secure(comparisons, protocol=protocol)(jax.random.key(2), x, np.float64(public))
    np.testing.assert_array_equal(cn.reveal(constant), exact)
    np.testing.assert_array_equal(cn.reveal(of_the_run), exact)


def test_a_large_integer_that_becomes_a_result_is_named():
    x = cn.share(jax.random.key(0), LARGE, parties=2)
    _, report = cn.validate(cn.secure(lambda x: x.astype(np.float64)))(jax.random.key(1), x)
    assert "Range is lost first" in str(report)
    assert "`convert_element_type`" in str(report)


LEAST, MOST = np.iinfo(np.int64).min, np.iinfo(np.int64).max
MASKED = {
    "a mask": lambda x, least: jnp.max(jnp.where(np.array([True, False, True]), x, least)),
    "an initial entry": lambda x, least: jnp.max(x, initial=least),
    "a carry": lambda x, least: jax.lax.scan(lambda c, r: (jnp.maximum(c, r), None), least, x)[0],
    "joined": lambda x, least: jnp.max(jnp.concatenate([x, jnp.full(2, least)])),
}


@pytest.mark.parametrize("name", MASKED)
def test_masks_of_64_bits_lie_within_what_can_be_compared(name):
    f = MASKED[name]
    x = cn.share(jax.random.key(0), np.array([5, 70, 9]), parties=2)
    for number, least in enumerate([np.int64(-(2**62)), LEAST]):
        constant = cn.secure(lambda x, least=least: f(x, least))
        if name == "an initial entry" or least == -(2**62):
            exact = f(np.array([5, 70, 9]), least)
            assert cn.reveal(constant(jax.random.key(1 + number), x)) == exact
            assert cn.reveal(cn.secure(f)(jax.random.key(3 + number), x, least)) == exact
            continue
        with pytest.raises(ValueError, match=r"larger than 2\^62.*-2\*\*62.*test_integers\.py:\d+"):
            constant(jax.random.key(5), x)
        with pytest.raises(ValueError, match=r"larger than 2\^62.*test_integers\.py:\d+"):
            cn.secure(f)(jax.random.key(6), x, least)


def test_integers_compared_with_the_ends_of_their_type():
    x = cn.share(jax.random.key(0), np.array([5, -7]), parties=2)
    step = cn.secure(lambda x: (x > LEAST, x < MOST, jnp.maximum(x, LEAST), jnp.minimum(x, MOST)))
    above, below, same, too = cn.reveal(step(jax.random.key(1), x))
    assert np.all(above)
    assert np.all(below)
    np.testing.assert_array_equal(same, [5, -7])
    np.testing.assert_array_equal(too, [5, -7])
