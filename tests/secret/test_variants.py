"""Variants compute what the function says, within bounds derived from its truncations.

The parts are tested for every number of parties where they live (tests/protocols). Here each is taken by
itself, on two parties; then every comparison and adder with some truncation and few parties, and every
truncation with many. `pytest --every-combination` takes the whole product, with P in {2, 3, 5, 8, 16}.
"""

import itertools
from functools import cache, partial
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import ciphernav_jax as cn
from ciphernav_jax.protocols import suite

from ..slow import slow
from .random_programs.variants import variants

PARTIES = [2, 3, 5, 8, 16]
SIGNS = [
    (c, a) for c in get_args(suite.Comparison) for a in get_args(suite.Adder) if c != "ideal" or a == "ripple"
]
TRUNCATIONS = get_args(suite.Truncation)
ROWS, INNER, COLUMNS = 3, 4, 5


def combinations(every: bool):
    """Protocols with numbers of parties: all that exist, or a part in which each variant occurs."""
    if every:
        for truncation, sign, multiplication, p in itertools.product(
            TRUNCATIONS, SIGNS, get_args(suite.Multiplication), PARTIES
        ):
            if truncation != "local" or p == 2:
                yield combined(truncation, sign, multiplication), p
        return
    for n, sign in enumerate(SIGNS):
        truncation = TRUNCATIONS[n % len(TRUNCATIONS)]
        yield combined(truncation, sign), 2 if truncation == "local" else PARTIES[n % 2]
    for n, (truncation, p) in enumerate(itertools.product(TRUNCATIONS, PARTIES[2:])):
        if truncation != "local":
            multiplication = "ideal" if n % 2 else "beaver"
            generator = "threefry" if n else "chacha20"
            yield combined(truncation, ("masked", "carry-tree"), multiplication, generator), p


def combined(truncation, sign, multiplication="beaver", generator="threefry") -> cn.Protocol:
    comparison, adder = sign
    # The ripple adder takes a round a bit: here it gets few.
    frac_bits, range_bits = (6, 4) if adder == "ripple" else (20, None)
    return cn.Protocol(
        frac_bits, multiplication, truncation, comparison, adder, range_bits, generator=generator
    )


EACH = variants()


@pytest.mark.parametrize("name", EACH)
def test_each_variant_by_itself_computes_products_signs_and_an_arg_max(name):
    protocol = EACH[name]
    rng = np.random.default_rng(4)
    x, w = rng.uniform(-1, 1, (ROWS, INNER)), rng.uniform(-1, 1, (INNER, COLUMNS))

    def layer(x, w):
        z = x @ w
        return jax.nn.relu(z), jnp.argmax(z, axis=1)

    secrets = cn.share(jax.random.key(0), (x, w), parties=2, protocol=protocol)
    relu, index = cn.reveal(cn.secure(layer, protocol=protocol)(jax.random.key(1), *secrets))
    exact, largest = layer(x, w)
    # What is encoded is off by half a unit, times less than one; a truncation by less than P units.
    np.testing.assert_allclose(relu, exact, atol=(INNER + 2) * 2.0**-protocol.frac_bits)
    np.testing.assert_array_equal(index, largest)


def pytest_generate_tests(metafunc):
    if "parties" in metafunc.fixturenames:
        rows = list(combinations(metafunc.config.getoption("every_combination")))
        metafunc.parametrize(("protocol", "parties"), slow(*rows), ids=[f"{r} P={p}" for r, p in rows])


def function(x, y, w):
    z = x @ w
    return jax.nn.relu(z), z > 0, x * y


@cache
def evaluated(protocol, parties):
    """Shared, evaluated and revealed: the function, and through it the gradients for given cotangents."""
    through = cn.simulate(function, parties=parties, protocol=protocol)

    @jax.jit
    def run(key, args, of_relu, of_product):
        results, pull = jax.vjp(partial(through, key), *args)
        of_bits = np.zeros(results[1].shape, jax.dtypes.float0)
        return results, pull((of_relu, of_bits, of_product))

    return run


def arrays(*shape):
    """Multiples of 2^-20 up to 2 in magnitude; often 0, one unit, or the ends."""
    fine = st.one_of(st.sampled_from([0, 1, -1, 2**21, -(2**21)]), st.integers(-(2**21), 2**21))
    size = int(np.prod(shape))
    return st.lists(fine, min_size=size, max_size=size).map(lambda v: np.reshape(v, shape) / 2**20)


# The error of one truncation, in units: at most the first times the number of parties plus the second.
ROUNDING = dict.fromkeys(TRUNCATIONS, (0, 1)) | {"wrap-count": (1, 0), "nearest": (0, 0.5)}


@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    x=arrays(ROWS, INNER),
    y=arrays(ROWS, INNER),
    w=arrays(INNER, COLUMNS).map(lambda w: w / 4),
    of_relu=arrays(ROWS, COLUMNS),
    of_product=arrays(ROWS, INNER),
    seed=st.integers(0, 2**32 - 1),
)
@example(  # nothing is positive
    x=np.zeros((ROWS, INNER)),
    y=np.ones((ROWS, INNER)),
    w=np.ones((INNER, COLUMNS)) / 4,
    of_relu=np.ones((ROWS, COLUMNS)),
    of_product=np.ones((ROWS, INNER)),
    seed=0,
)
def test_a_combination_of_variants_computes_the_function_and_its_gradients(
    protocol, parties, x, y, w, of_relu, of_product, seed
):
    units = 2.0**protocol.frac_bits
    x, y, w, of_relu, of_product = (np.round(v * units) / units for v in (x, y, w, of_relu, of_product))
    run = evaluated(protocol, parties)
    (relu, positive, product), (of_x, of_y, of_w) = run(jax.random.key(seed), (x, y, w), of_relu, of_product)
    each, constant = ROUNDING[protocol.truncation]
    error = (each * parties + constant) / units
    z = x @ w
    np.testing.assert_array_equal(positive, z > 0)
    # A local or wrap-count truncation may round what is positive to something at or below 0.
    assert np.all(np.abs(relu - np.maximum(z, 0)) <= error)
    assert np.all(np.abs(product - x * y) <= error)
    # The sign is exact, and so is what it selects: each product below is truncated once.
    of_z = of_relu * (z > 0)
    assert np.all(np.abs(of_x - (of_z @ w.T + of_product * y)) <= 2 * error)
    assert np.all(np.abs(of_y - of_product * x) <= error)
    assert np.all(np.abs(of_w - x.T @ of_z) <= error)


ENDS = st.sampled_from([0.0, 2.0**-20, -(2.0**-20), 1.0, 2.0**21 - 1, -(2.0**21) + 1, 2.0**20 + 2.0**-20])


@pytest.mark.slow
@settings(max_examples=30, deadline=None, derandomize=True)
@given(values=st.lists(st.tuples(ENDS, st.sampled_from([1.0, -1.0, 1.5, -1.5])), min_size=12, max_size=12))
def test_the_default_holds_at_both_ends_of_the_range(values):
    """Products up to 3/4 of the bound of 2^22, the limit of truncation, never fail."""
    x, y = np.array(values).T
    got = at_the_ends()(jax.random.key(len(values)), x, y)
    assert np.all(np.abs(got[0] - x * y) <= 2.0**-20)
    assert np.all(np.abs(got[1] - np.maximum(x, 0)) == 0)
    np.testing.assert_array_equal(got[2], x > y)


@cache
def at_the_ends():
    step = cn.secure(lambda x, y: (x * y, jax.nn.relu(x), x > y))

    @jax.jit
    def run(key, x, y):
        return cn.reveal(step(key, *cn.share(jax.random.fold_in(key, 1), (x, y), parties=5)))

    return run


@cache
def largest(argmax, comparison, parties, n):
    protocol = cn.Protocol(argmax=argmax, comparison=comparison)

    @jax.jit
    def run(key, x):
        shared = cn.share(key, x, parties=parties, protocol=protocol)
        # Entries with a truncation pending, as the last layer leaves them.
        f = cn.secure(lambda x: jnp.argmax(x * x[:1], axis=-1), protocol=protocol)
        return cn.reveal(f(jax.random.fold_in(key, 1), shared))

    return run


ARGMAX = [
    ("pairwise", "masked", 3, 5),
    ("tree", "masked", 3, 5),
    ("tree", "masked", 2, 9),
    ("tree", "ideal", 16, 2),
]


@pytest.mark.slow
@settings(max_examples=20, deadline=None, derandomize=True)
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
def test_both_ways_to_the_arg_max_give_the_first_of_the_largest(data, seed):
    for argmax, comparison, parties, n in ARGMAX:
        x = data.draw(arrays(4, n))
        x[0] = 1
        index = largest(argmax, comparison, parties, n)(jax.random.key(seed), x)
        np.testing.assert_array_equal(index, np.argmax(x, axis=-1))
