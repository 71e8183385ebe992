"""Whatever is done to values within the contract of docs/guide/ranges.md comes out right, up to its ends.

Each function is computed on secrets and, independently, in float64 by numpy. With f fractional bits, one unit
is 2^-f and R = 2^(62 - 2f) is what shared values and products stay below. A bound counts truncations, each
off by at most a unit (P units for "wrap-count"), times what multiplies them afterwards.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.parties.party import ideal_sum
from ciphernav_jax.secret.arguments import Arguments
from ciphernav_jax.secret.value import Value
from ciphernav_jax.secret.witness import Witness

from ..slow import slow

MANY = 3000
ENDS = np.array([0.9, -0.9, 0.9, -0.9, 1e-3, 0.0])
OTHER = np.array([0.9, 0.9, -0.9, -0.9, -1e-3, 0.0])


def arguments(f: int) -> dict[str, np.ndarray]:
    """Secrets at the ends of the range, exact in fixed point: `e`, `o` of size R, `x`, `y` with products of
    size R, `n` and `m` many entries of size R and sqrt R, `b` bits, `s` small.
    """
    reach, root = 2.0 ** (62 - 2 * f), 2.0 ** (31 - f)

    def exact(values):
        return np.round(np.asarray(values) * 2.0**f) / 2.0**f

    return {
        "e": exact(reach * ENDS),
        "o": exact(reach * OTHER),
        "x": exact(root * ENDS / 1.5),
        "y": exact(root * 1.5 * np.ones(6)),
        "z": exact(root * OTHER / 1.5),
        "n": exact(reach * np.linspace(0.7, 0.9, MANY)),
        "m": exact(root * np.linspace(0.7, 0.9, MANY)),
        "s": exact(np.linspace(-3, 3, 6)),
        "b": np.array([True, False, True, False, True, False]),
        "i": np.array([0, 1, -7, 12345, 2**31 - 1, -(2**31)], np.int32),
    }


def public(f: int) -> dict[str, np.ndarray]:
    """Public numbers that only the run knows."""
    reach = 2.0 ** (62 - 2 * f)
    return {
        "p": np.array([3e-7, -1e-3, 0.3, 1.0, -0.7, 1e-5]),
        "q": np.array([-1e9, 1e9, -reach / 2, reach / 2, 0.0, -1e9]),
        "k": np.array([3, -1, 2, 0, 1000, -7]),
    }


MIXED = np.array([1e3, 1e-3, 0.3, 7.0, -1e-6, 0.0])
SMALL = np.array([1e-3, -1.0, 3e-7, 0.7, 0.5, 1e-9])
TABLE = np.stack([MIXED, SMALL])


MIXED = np.array([1e3, 1e-3, 0.3, 7.0, -1e-6, 0.0])
SMALL = np.array([1e-3, -1.0, 3e-7, 0.7, 0.5, 1e-9])
TABLE = np.stack([MIXED, SMALL])


def scaled(truncations, product):
    """Of a product with a constant: truncations, half a unit for what is below it, and 2^-f of itself."""
    return lambda f, a: truncations + 0.5 + np.abs(product(a))


def contexts():
    """(P, protocol): each number of parties, truncation and fractional bits."""
    yield 2, cn.Protocol()
    yield 3, cn.Protocol(frac_bits=16, truncation="nearest", comparison="resharing")
    yield 5, cn.Protocol(frac_bits=24, truncation="floor", comparison="ideal")


CONTEXTS = list(contexts())


def numbers(x):
    """Of a product of x with numbers that only the run knows: their last bits are lost."""
    return lambda f, a: 3 + np.abs(x(a)) * 2.0 ** -(f + 1)


# name: (function of the arguments by name, bound in units: a number, or a function of f and the arguments)
FUNCTIONS = {
    # Sums.
    "mean": (lambda a: jnp.mean(a["n"]), lambda f, a: 3 + np.mean(a["n"])),
    "mean of squares": (lambda a: jnp.mean(a["m"] ** 2), lambda f, a: 4 + np.mean(a["m"] ** 2)),
    "sum of squares": (lambda a: jnp.sum(a["m"] ** 2), MANY),
    "sum of scaled": (lambda a: jnp.sum(a["n"] / 1000.0), lambda f, a: 3 * MANY + np.sum(a["n"]) / 1000),
    "cumulative sum of scaled": (
        lambda a: jnp.cumsum(a["n"] * 3e-7)[-1] * 0.5,
        lambda f, a: 2 + 1.5 * MANY + np.sum(a["n"]) * 3e-7,
    ),
    "sum of products by index": (lambda a: a["e"].at[np.zeros(6, int)].add(a["x"] * a["y"]), 6),
    # Products together.
    "difference of products": (lambda a: a["x"] * a["y"] - a["z"] * a["y"], 2),
    "four products": (lambda a: a["x"] * a["y"] + a["z"] * a["y"] + 2 * (a["x"] * a["y"]), 4),
    "a product of a negative product": (lambda a: -(a["x"] * a["y"]) - a["e"], 1),
    "selected products": (lambda a: jnp.where(a["b"], a["x"] * a["y"], a["z"] * a["y"]), 3),
    "joined": (lambda a: jnp.concatenate([a["x"] * a["y"], jnp.sum(a["n"])[None], a["e"]]), 1),
    "relu": (lambda a: jax.nn.relu(a["x"] * a["y"] + a["o"]), 1),
    "relu of a difference": (lambda a: jax.nn.relu(a["x"] * a["y"] - a["z"] * a["y"]), 1),
    "relu of a slice": (lambda a: jax.nn.relu((a["x"] * a["y"] + a["o"])[1:4]) * 0.5, 1),
    # Comparisons.
    "greater": (lambda a: a["x"] * a["y"] > a["z"] * a["y"], 0),
    "greater than a value": (lambda a: a["x"] * a["y"] > a["o"], 0),
    "equal": (lambda a: a["x"] * a["y"] == a["z"] * a["y"], 0),
    "sign": (lambda a: jnp.sign(a["x"] * a["y"] - a["o"]), 0),
    "maximum": (lambda a: jnp.maximum(a["x"] * a["y"], a["z"] * a["y"]), 1),
    "minimum": (lambda a: jnp.minimum(a["x"] * a["y"], a["z"] * a["y"]), 1),
    "minimum with 0": (lambda a: jnp.minimum(a["x"] * a["y"], 0.0), 1),
    "clip": (lambda a: jnp.clip(a["x"] * a["y"], a["o"][1] * -0.5, a["o"][0] * 0.5), 3),
    "absolute": (lambda a: jnp.abs(a["x"] * a["y"] - a["o"]), 1),
    "largest": (lambda a: jnp.max(a["x"] * a["y"] + a["o"]), 1),
    "arg max": (lambda a: jnp.argmax((a["x"] * a["y"] + a["o"])[::-1]), 0),
    # Public numbers that only the run knows, of any size beside a product.
    "public relu": (lambda a: jax.nn.relu(a["x"] * a["y"] + a["q"]), 1),
    "public relu of the negative": (lambda a: jax.nn.relu(a["q"] - a["x"] * a["y"]), 1),
    "public comparison": (lambda a: a["x"] * a["y"] + a["q"] > 0, 0),
    "public maximum": (lambda a: jnp.maximum(a["q"], a["x"] * a["y"]), 1),
    "public mask": (lambda a: jnp.argmax(a["x"] * a["y"] + a["q"]), 0),
    "public sum": (lambda a: (a["x"] * a["y"] + a["q"]) * 0.5, 1.5),
    # Constants.
    "mixed": (lambda a: a["s"] * MIXED, scaled(3, lambda a: a["s"] * MIXED)),
    "mixed at the ends": (lambda a: a["e"] * SMALL, scaled(3, lambda a: a["e"] * SMALL)),
    "divided by mixed": (
        lambda a: a["s"][:5] / TABLE[:, :5],
        scaled(3, lambda a: a["s"][:5] / TABLE[:, :5]),
    ),
    "scaled product": (lambda a: a["x"] * a["y"] * 0.3, scaled(1.3, lambda a: a["e"] * 0.3)),
    "a product by an integer": (lambda a: a["x"] * a["y"] * 3.0, 3),
    "a large sum": (lambda a: jnp.sum(a["n"]) * 0.9, scaled(2, lambda a: np.sum(a["n"]) * 0.9)),
    "a large sum by mixed": (lambda a: jnp.sum(a["n"]) * SMALL, scaled(5, lambda a: np.sum(a["n"]) * SMALL)),
    "an integer": (lambda a: a["i"] * 3_000_001, 0),
    "a real integer": (lambda a: a["i"].astype(float) * 0.3, scaled(1, lambda a: a["i"].astype(float) * 0.3)),
    "a bit": (lambda a: a["b"].astype(float) * 0.3, 0.5),
    "mean of bits": (lambda a: jnp.mean(a["b"][:5].astype(float)), 1.5),
    "a row of a table": (lambda a: jax.nn.one_hot(a["i"][:2], 2) @ TABLE, 1.5),
    "a sum of rows": (lambda a: a["b"].astype(float) @ np.outer(SMALL, SMALL), 2),
    "by a matrix": (lambda a: a["e"] @ np.outer(SMALL, SMALL), lambda f, a: 2 + np.sum(np.abs(a["e"])) / 2),
    # Numbers that only the run knows.
    "by numbers": (lambda a: a["s"] * a["p"], numbers(lambda a: a["s"])),
    "by numbers at the ends": (
        lambda a: a["e"] * a["p"],
        numbers(lambda a: a["e"]),
    ),
    "a large sum by a number": (
        lambda a: jnp.sum(a["n"]) * a["p"][0],
        numbers(lambda a: np.sum(a["n"])),
    ),
    "divided by a number": (
        lambda a: a["s"] / (1 / a["p"]),
        numbers(lambda a: a["s"]),
    ),
    "a bit by numbers": (lambda a: a["b"].astype(float) * a["p"], 0.5),
    "an integer by numbers": (
        lambda a: a["i"][:4].astype(float) * a["p"][:4],
        2.5,
    ),
    "by integers": (lambda a: a["i"].astype(jnp.int64) * a["k"], 0),
    # One of two numbers.
    "divided by one of two": (
        lambda a: a["e"] / jnp.where(a["b"], 3e6, 1.0),
        scaled(3, lambda a: a["e"] / 3e6),
    ),
    "by one of two": (
        lambda a: a["s"] * jnp.where(a["b"], 1e-5, a["p"]),
        lambda f, a: 6 + np.abs(a["s"]) * 2.0 ** -(f + 1),
    ),
    # Loops, whose carry grows.
    "decayed": (
        lambda a: jax.lax.fori_loop(0, 9, lambda _, v: 0.9 * v + a["e"], a["e"]),
        lambda f, a: 9 * (3 + 9 * np.abs(a["e"])),
    ),
    "running sums": (
        lambda a: jax.lax.scan(lambda c, n: (c + n, (c + n) * 0.3), a["n"][0], a["n"][:20])[1],
        lambda f, a: 4 + 0.3 * (a["n"][0] + np.cumsum(a["n"][:20])),
    ),
    "running sums in a branch": (
        lambda a: jax.lax.cond(a["k"][0] > 2, lambda: jnp.sum(a["n"]), lambda: a["e"][0]) * 0.3,
        scaled(2, lambda a: np.sum(a["n"]) * 0.3),
    ),
}


# Circuits are slow to compile: the other variants take a few functions each.
FEW = ["sum of squares", "difference of products", "relu", "greater", "mixed at the ends", "a large sum"]
CONTEXTS = [
    (2, cn.Protocol(), list(FUNCTIONS)),
    (3, cn.Protocol(frac_bits=16, comparison="ideal"), list(FUNCTIONS)),
    (5, cn.Protocol(frac_bits=24, comparison="ideal"), list(FUNCTIONS)),
    (3, cn.Protocol(truncation="nearest", comparison="masked-words"), FEW),
    (2, cn.Protocol(frac_bits=16, truncation="floor", comparison="resharing"), FEW),
]


@cache
def results(number):
    """All functions of a context in one compilation."""
    parties, protocol, names = CONTEXTS[number]

    # To compile it takes longer than to run it.
    @partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
    def run(key, secret, known):
        keys = jax.random.split(key)
        step = cn.secure(
            lambda secret, known: {name: FUNCTIONS[name][0](secret | known) for name in names},
            protocol=protocol,
        )
        return cn.reveal(step(keys[0], cn.share(keys[1], secret, parties=parties, protocol=protocol), known))

    f = protocol.frac_bits
    return run(jax.random.key(f), arguments(f), public(f))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("context", "name"), [(i, name) for i, (_, _, names) in enumerate(CONTEXTS) for name in names]
)
def test_what_stays_within_the_contract_is_right(context, name):
    f = CONTEXTS[context][1].frac_bits
    function, bound = FUNCTIONS[name]
    given = arguments(f) | public(f)
    expected = np.asarray(function({name: jnp.asarray(x) for name, x in given.items()}), np.float64)
    error = np.abs(np.asarray(results(context)[name], np.float64) - expected)
    assert error.shape == expected.shape
    bound = bound(f, given) if callable(bound) else bound
    # Float64 itself rounds in the last of 53 bits.
    assert np.all(error <= bound * 2.0**-f + 1e-14 * np.max(np.abs(expected)))


class Bounded(Witness):
    """Counts as failed what exceeds the bound that a value claims."""

    def inside(self):
        return Bounded(self.protocol, self.beside)

    def evaluated(self, eqn, operands, results):
        super().evaluated(eqn, operands, results)
        for x in results:
            if isinstance(x, Value):
                word = jax.lax.bitcast_convert_type(ideal_sum(x.share), jnp.int64)
                self._row.add("failed", jnp.sum(jnp.abs(word) > x.bound, dtype=jnp.int64))


@pytest.mark.slow
def test_no_value_exceeds_its_bound():
    def function(secret, known):
        return {name: FUNCTIONS[name][0](secret | known) for name in FUNCTIONS}

    protocol = cn.Protocol(comparison="ideal", multiplication="ideal", truncation="ideal")
    step = cn.secure(function, protocol=protocol)
    f = protocol.frac_bits
    shared = cn.share(jax.random.key(0), arguments(f), parties=2, protocol=protocol)

    @partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
    def exceeding(key, *args):
        _, (notes, _) = step.witnessed(key, step.given(*args), Bounded(protocol, beside=False))
        return notes.total["failed"], notes.total["truncations"]

    failed, truncations = exceeding(jax.random.key(1), shared, public(f))
    assert np.sum(truncations) > MANY
    assert np.sum(failed) == 0


HUGE = {
    "mean": lambda x, p: jnp.mean(x),
    "variance": lambda x, p: jnp.var(x),
    "scaled": lambda x, p: jnp.cumsum(x * 3e-7) * 0.3,
    "products": lambda x, p: jnp.sum(x * x - x * x * 0.7) / 3,
    "numbers": lambda x, p: jnp.sum(jnp.sum(x * p) * p),
    "contraction": lambda x, p: jax.nn.relu((x @ x + x[:1]) * 0.1) @ p[:1],
}
# Constants of that shape would be made while tracing.
LARGE = {
    "selected": lambda x, p: jnp.sum(jnp.where(x * x > 0.5, jnp.clip(x * x, -1, 0.7), x) * 0.01),
    "gradient": lambda x, p: jax.grad(lambda x: jnp.mean((x * p - 0.3) ** 2))(x),
}


@pytest.mark.parametrize(
    "protocol",
    [
        cn.Protocol(1),
        cn.Protocol(16, truncation="nearest"),
        cn.Protocol(),
        cn.Protocol(truncation="nearest"),
        cn.Protocol(30),
    ],
    ids=str,
)
@pytest.mark.parametrize("count", [*slow(1000), 2**30])
def test_no_bits_run_out_for_a_thousand_million_entries(protocol, count):
    """Traced alone. A value that cannot be truncated when its turn comes would raise."""

    def functions(x, p):
        x = jnp.broadcast_to(x, (count,))
        chosen = HUGE if count > 10**6 else HUGE | LARGE
        return {name: function(x, p) for name, function in chosen.items()}

    key, scalar = jax.random.key(0), jax.ShapeDtypeStruct((), float)
    x = jax.eval_shape(partial(cn.share, parties=2, protocol=protocol), key, scalar)
    call = cn.secure(functions, protocol=protocol).call(
        Arguments((x, jax.ShapeDtypeStruct((count,), float)), {})
    )
    assert len(call.plan().requests) > 30


def test_range_bits_hold_for_what_is_compared():
    """15 and -15 differ by 30, which needs one bit more."""
    protocol = cn.Protocol(range_bits=4)
    x, y = np.array([15.0, -15.0, 15.0]), np.array([-15.0, 15.0, 15.0])

    def function(x, y):
        return (
            x > y,
            x * 0.9 >= y * 0.9,
            jnp.maximum(x, y),
            jnp.min(jnp.stack([x, y]), 0),
            jnp.argmax(jnp.stack([x, y]), 0),
            jnp.sign(x),
        )

    shared = cn.share(jax.random.key(0), (x, y), parties=3, protocol=protocol)
    found = cn.reveal(cn.secure(function, protocol=protocol)(jax.random.key(1), *shared))
    expected = function(*map(jnp.asarray, (x, y)))
    for got, exact in zip(found, expected, strict=True):
        np.testing.assert_array_equal(got, exact)


def test_local_truncation_gets_shares_that_are_random():
    """Shares of x - x, of a multiple of 0, of a constant, and of what was truncated locally, are not."""
    protocol = cn.Protocol(truncation="local")

    def function(x):
        return (
            (x - x - 1.0) * 0.3,
            (x * np.array([0.0, 1.0]) - 1.0) * 0.3,
            jnp.concatenate([x, np.array([-1.0, -2.0])]) * 0.3,
            jnp.broadcast_to(x * 0.3 * 2.0**-10, (20_000, 2)) * 0.3,
        )

    x = np.array([1.0, 2.0])
    shared = cn.share(jax.random.key(0), x, parties=2, protocol=protocol)
    found = cn.reveal(cn.secure(function, protocol=protocol)(jax.random.key(1), shared))
    for got, exact in zip(found, function(x), strict=True):
        np.testing.assert_allclose(got, exact, rtol=0, atol=4 * 2.0**-20)


def test_sums_that_are_larger_than_any_result_have_a_mean():
    """Of 16 million entries, in the three ways to divide by their number."""
    count, x, y = 2**24, np.array(1500.0), np.array(2500.25)

    def function(x, y, n):
        entries = jnp.broadcast_to(x * y, (count,))
        odd = entries[1:]
        return jnp.mean(entries), jnp.mean(odd), jnp.sum(odd) / n, jnp.sum(entries * 2.0**-20)

    shared = cn.share(jax.random.key(0), (x, y), parties=2)
    found = cn.reveal(cn.secure(function)(jax.random.key(1), *shared, np.float64(count - 1)))
    # The product is exact; a constant and a number are right to 2^-20 and 2^-41 of themselves.
    unit, product = 2.0**-20, 1500 * 2500.25
    assert abs(found[0] - product) <= 2 * unit
    assert abs(found[1] - product) <= (4 + product) * unit
    assert abs(found[2] - product) <= 4 * unit + product * (count - 1) * 2.0**-41
    # Each product is truncated by itself.
    assert abs(found[3] - count * product * 2.0**-20) <= count * unit


def test_a_quotient_by_a_number_is_a_scaling_by_a_constant():
    """Of one number too, so that it may be as large as a result."""
    x = np.array([4e6, -3e6, 0.5])
    step = cn.secure(lambda x: x / 0.05)
    shared = cn.share(jax.random.key(1), x, parties=2)
    got = cn.reveal(step(jax.random.key(2), shared))
    np.testing.assert_allclose(got, x / 0.05, rtol=2.0**-20)
    assert cn.cost(step, shared).openings == cn.cost(cn.secure(lambda x: x * (1 / 0.05)), shared).openings


@pytest.mark.slow
@pytest.mark.parametrize(("frac_bits", "once", "masked"), [(16, 6, 10), (20, 5, 9), (24, 4, 8)])
@pytest.mark.parametrize("magnitude", [0, 10, 30])
def test_a_scaling_takes_as_many_truncations_as_documented(frac_bits, once, masked, magnitude):
    """docs/guide/ranges.md and `scaling._times_float`: what is at rest, and what is beyond any result."""
    protocol = cn.Protocol(frac_bits=frac_bits)
    x = cn.share(jax.random.key(0), np.array([0.5, 0.25]), parties=2, protocol=protocol)
    c = np.array([1.1 * 2.0**magnitude, 1.1 * 2.0**-50])
    for function, most in (
        (lambda x: x * c, once),
        (lambda x: jnp.maximum(x, np.array([-1e30, 0])) * c, masked),
    ):
        _, (carried_out, failed) = cn.audit(cn.secure(function, protocol=protocol))(jax.random.key(1), x)
        assert x.size < carried_out <= x.size * most
        assert failed == 0


EXTREMES = {
    "above 0": lambda v: jnp.maximum(v, 0.0),
    "above a constant": lambda v: jnp.maximum(v, 0.5),
    "below a constant": lambda v: jnp.minimum(v, 0.5),
    "above a public number": lambda v: jnp.maximum(v, jnp.full(3, 0.25)),
    "of two": lambda v: jnp.maximum(2 * v, v - 1),
    "of two products": lambda v: jnp.minimum(v, v[::-1] + 1),
    "above the mean": lambda v: jnp.maximum(v, v.mean()),
    "clipped": lambda v: jnp.clip(v, -0.5, 0.5),
    "equal to its extremes": lambda v: (
        jnp.where(jnp.maximum(v, 0.1) == v, v, 0.0) + jnp.where(jnp.minimum(v, 0.2) != v, 2.0, 0.0)
    ),
}
ORDERS = {
    "in order with its extremes": lambda v: (
        jnp.where(jnp.maximum(v, 0.1) >= v, v, 0.0)
        + jnp.where(jnp.minimum(v, 0.2) > v, 2.0, 0.0)
        + jnp.where(v < jnp.minimum(v, 0.3), 2.0, 0.0)
        + jnp.where(v <= jnp.maximum(v, -0.3), v, 0.0)
    ),
    "the largest entry": lambda v: jnp.where(v == jnp.max(v), v, 0.0),
    "the smallest entries": lambda v: jnp.where(jnp.min(v, axis=0, keepdims=True) < v, 0.0, v),
}


def with_slopes(functions):
    def slope(f, a, b):
        return jax.grad(lambda a: jnp.sum(f(a * b) ** 2))(a)

    return lambda a, b: [slope(f, a, b) for f in functions.values()] + [f(a * b) for f in functions.values()]


# Orders with the comparison that costs least: it is decided what is compared, not how.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("functions", "parties", "protocol"),
    [
        (EXTREMES, 2, cn.Protocol()),
        (EXTREMES, 3, cn.Protocol()),
        (ORDERS, 3, cn.Protocol(comparison="ideal")),
    ],
    ids=["extremes, 2", "extremes, 3", "orders"],
)
def test_a_product_is_what_its_maximum_is_made_of(functions, parties, protocol):
    """JAX's derivative asks where a maximum equals its operand; the one is truncated, the other is not."""
    a, b = np.random.default_rng(3).uniform(-2, 2, (2, 2, 3))
    shared = cn.share(jax.random.key(0), (a, b), parties=parties, protocol=protocol)
    function = with_slopes(functions)
    results = cn.reveal(cn.secure(function, protocol=protocol)(jax.random.key(1), *shared))
    for got, exact in zip(results, function(a, b), strict=True):
        assert np.any(exact != 0)
        np.testing.assert_allclose(got, exact, atol=2.0**-14)


@pytest.mark.slow
@pytest.mark.parametrize("truncation", ["probabilistic", "nearest", "floor", "wrap-count"])
def test_a_small_value_that_might_be_large_is_scaled_as_precisely(truncation):
    """It is split into the first bits and the others, which nearly cancel: -0.01 is -1 and 0.99."""
    protocol = cn.Protocol(truncation=truncation, comparison="ideal")
    x = np.random.default_rng(5).uniform(-0.02, 0.02, 2000)
    shared = cn.share(jax.random.key(0), np.zeros(2000), parties=3, protocol=protocol)
    unit = 2.0**-20 * (3 if truncation == "wrap-count" else 1)
    large = 1.0 if truncation == "wrap-count" else 7e3  # it fails the more often, the larger the product
    for c in (17.3, 17.3 * large, np.resize([-12.7 * large, 0.7, 1e-3, 100.5], 2000)):
        step = cn.secure(lambda z, x, c=c: (z + x) * c, protocol=protocol)
        got = cn.reveal(step(jax.random.key(1), shared, x))
        x_shared = np.round(x * 2**20) / 2**20
        bound = np.abs(x_shared * c) * 2.0**-20 + (9 if np.ndim(c) else 3) * unit + 2.0**-21
        assert np.all(np.abs(got - x_shared * c) <= bound)


@pytest.mark.parametrize("shape", [(), (1,)])
def test_what_holds_of_every_secret_is_a_constant(shape):
    """Whose quotient may be as large as a result; that by a number of the run, a product, may not."""
    n, x = np.full(shape, 205.0), np.array([-20180.0, 3.0])
    known = [
        lambda n: n <= n,
        lambda n: n == n,
        lambda n: ~(jnp.maximum(n, 3.0) < n),
        jnp.isfinite,
        lambda n: n < 1e30,
    ]

    def quotients(n, x):
        return [x / jnp.where(f(n), 7e-4, 1.0) for f in known]

    shared = cn.share(jax.random.key(0), (n, x), parties=2)
    got = cn.reveal(cn.secure(quotients)(jax.random.key(1), *shared))
    np.testing.assert_allclose(got, [x / 7e-4] * len(known), rtol=2.0**-19)


@pytest.mark.parametrize(
    "function",
    [
        lambda x: jnp.max(x + np.array([-1e9, 0.0])),
        lambda x: jnp.max(jnp.where(x > 0, x, -np.inf)),
        lambda x: jnp.maximum(x, -1e9),
        lambda x: x > 100.0,
    ],
)
def test_what_range_bits_leave_no_room_for_is_refused(function):
    protocol = cn.Protocol(range_bits=4)
    x = cn.share(jax.random.key(0), np.array([0.5, -3.0]), parties=2, protocol=protocol)
    with pytest.raises(ValueError, match=r"range_bits=None with masks.*test_ranges"):
        cn.secure(function, protocol=protocol)(jax.random.key(1), x)


@pytest.mark.parametrize(
    ("function", "number"),
    [
        (lambda x, m: jnp.max(jnp.where(np.array([True, False]), x, m)), -1e9),
        (lambda x, m: jnp.max(x + m), -np.inf),
        (lambda x, m: jnp.maximum(x, m), -1e9),
        (lambda x, m: x > m, 1e3),
    ],
)
def test_what_range_bits_leave_no_room_for_is_refused_as_an_argument_too(function, number):
    protocol = cn.Protocol(range_bits=4)
    x = cn.share(jax.random.key(0), np.array([0.5, -3.0]), parties=2, protocol=protocol)
    step = cn.secure(function, protocol=protocol)
    with pytest.raises(ValueError, match=r"range_bits=None with masks.*test_ranges"):
        step(jax.random.key(1), x, number)
    plain = function(jnp.array([0.5, -3.0]), 2.0)
    np.testing.assert_array_equal(cn.reveal(step(jax.random.key(2), x, 2.0)), plain)
