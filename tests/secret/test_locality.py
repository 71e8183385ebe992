"""No function that is given to `secure` can smuggle: what it does beyond its arithmetic is refused, and what
it calls itself is not taken for ours.
"""

import functools
import inspect
import itertools
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.experimental import io_callback

import ciphernav_jax as cn
from ciphernav_jax.parties.party import AXIS, open_sum
from ciphernav_jax.protocols import suite
from experiments import primitives

pytestmark = pytest.mark.newest_jax

KEY = jax.random.key(0)
X = np.arange(4.0)
N = np.float64(3)


@pytest.fixture(scope="module")
def secret():
    return cn.share(KEY, X, parties=3)


def through(callback):
    return lambda x: callback(lambda a: a, jax.ShapeDtypeStruct(x.shape, x.dtype), x)


def printed(x):
    jax.debug.print("{}", x)
    return x


def told(x):
    jax.debug.callback(print, x)
    return x


SMUGGLERS = {
    "debug_print": printed,
    "debug_callback": told,
    "pure_callback": through(jax.pure_callback),
    "io_callback": through(io_callback),
    "ffi_call": lambda x: jax.ffi.ffi_call("send", jax.ShapeDtypeStruct(x.shape, x.dtype))(x),
}

# What it is applied to: x is secret, n public.
HIDDEN = {
    "a secret": lambda f, x, n: f(x) + n,
    "a public number": lambda f, x, n: x * f(n),
    "a public number known while tracing": lambda f, x, n: x * f(jnp.float64(2.0)),
    "within a jit": lambda f, x, n: jax.jit(lambda x: f(x * x))(x),
    "within a loop": lambda f, x, n: lax.scan(lambda c, _: (f(c) * 0.5, None), x, length=2)[0],
    "within a loop on public values": lambda f, x, n: x * lax.fori_loop(0, 3, lambda i, c: f(c) + 1.0, 0.0),
    "within a branch that is not taken": lambda f, x, n: lax.cond(False, f, lambda x: x, x),
    "and thrown away": lambda f, x, n: (f(x), x)[1],
}


@pytest.mark.parametrize(("way", "name"), [*itertools.product(HIDDEN, SMUGGLERS)])
def test_a_function_that_reaches_out_is_refused(way, name, secret):
    step = cn.secure(lambda x, n: HIDDEN[way](SMUGGLERS[name], x, n))
    with pytest.raises(NotImplementedError, match=rf"`{name}` in a function on secrets: .*test_locality\.py"):
        step(KEY, secret, N)


def test_nor_is_it_counted_or_recorded(secret):
    step = cn.secure(printed)
    for looked_at in (lambda: cn.cost(step, secret), lambda: cn.transcript(step)(KEY, secret)):
        with pytest.raises(NotImplementedError, match="`debug_print` in a function on secrets"):
            looked_at()


@pytest.mark.parametrize("scope", ["open_sum", "ideal_sum", "protocol:mine", "primitive:mine"])
@pytest.mark.parametrize("operand", ["secret", "public"])
def test_a_function_cannot_speak_to_other_parties(scope, operand, secret):
    """Even under a vmap of its own over an axis of the parties' name."""

    def function(x, n):
        with jax.named_scope(scope):
            return (lax.psum(x, AXIS), n) if operand == "secret" else (x, lax.psum(n, AXIS))

    keys = jax.random.split(KEY, 2)
    over_an_axis = jax.vmap(cn.secure(function), in_axes=(0, None, None), axis_name=AXIS)
    with pytest.raises(NotImplementedError, match=r"`psum` in a function on secrets: it reaches out"):
        over_an_axis(keys, secret, N)
    with pytest.raises(NotImplementedError, match=r"`axis_index` in a function on secrets: it reaches out"):
        jax.vmap(
            cn.secure(lambda x: x * lax.axis_index(AXIS).astype(float)), in_axes=(0, None), axis_name=AXIS
        )(keys, secret)
    with pytest.raises(NameError, match="unbound axis name"):
        cn.secure(function)(KEY, secret, N)
    with pytest.raises(NameError, match="unbound axis name"):
        cn.secure(inspect.unwrap(open_sum))(KEY, secret)  # without its check of shapes


def test_a_sum_over_an_axis_of_the_users_own_is_of_public_values_alone(secret):
    """Not refused: it goes over entries, which are the user's."""
    step = cn.secure(lambda x, n: x + lax.psum(n, "mine"))
    entries = jax.vmap(step, in_axes=(0, None, 0), axis_name="mine")
    got = entries(jax.random.split(KEY, 2), secret, np.array([1.0, 2.0]))
    np.testing.assert_array_equal(cn.reveal(got), [X + 3, X + 3])
    with pytest.raises(NotImplementedError, match="`psum` on secrets"):
        jax.vmap(cn.secure(lambda x: lax.psum(x, "mine")), in_axes=(0, None), axis_name="mine")(
            jax.random.split(KEY, 2), secret
        )


def everywhere(scope, function):
    """Under that name outside, inside, in loops and in jits."""

    def named(x, w, n):
        with jax.named_scope(scope):
            x, w = jax.jit(jax.named_scope(scope)(lambda x, w: (x * w, w + 1)))(x, w)
            w = lax.fori_loop(0, 2, jax.named_scope(scope)(lambda i, w: w * 0.5), w)
            w = lax.cond(n > 2, jax.named_scope(scope)(lambda w: w), lambda w: -w, w)
            x, _ = lax.scan(jax.named_scope(scope)(lambda c, _: (function(c), None)), x, length=2)
            return function(x) * w

    return named


@pytest.mark.parametrize("scope", ["open_sum", "ideal_sum", "protocol:mine", "primitive:mine"])
def test_a_users_names_are_not_taken_for_ours(scope, secret):
    plain = cn.cost(cn.secure(everywhere("plain", jax.nn.relu)), secret, X, N)
    with jax.named_scope(scope):
        named = cn.cost(cn.secure(everywhere(scope, jax.nn.relu)), secret, X, N)
    assert named == plain
    assert named.bytes_sent
    assert not named.ideal


def variants():
    """A few protocols that have all variants among them, but for the ideal ones and the slow adder."""
    parts = {"truncation": suite.Truncation, "comparison": suite.Comparison, "adder": suite.Adder}
    names = {
        name: [x for x in get_args(part) if x not in ("ideal", "ripple")] for name, part in parts.items()
    }
    for i in range(max(map(len, names.values()))):
        chosen = {name: choices[i % len(choices)] for name, choices in names.items()}
        yield cn.Protocol(**chosen, argmax=("tree", "pairwise")[i % 2], range_bits=4)


WAYS_ACROSS = {"open_sum", "open_xor", "open_shares"}


@pytest.mark.parametrize("example", primitives.examples(), ids=lambda x: f"{x.primitive}: {x.expression}")
def test_no_rule_has_a_way_across_but_the_openings(example):
    """`cost` refuses every other."""
    found = primitives.example_cost(example)
    assert {opening.collective for opening in found.openings} <= WAYS_ACROSS
    assert all(opening.primitive for opening in found.openings)


@pytest.mark.parametrize("protocol", [*variants()], ids=str)
def test_nor_has_a_variant(protocol):
    def function(x):
        return jax.nn.relu(x * x), x[0] > x[1], jnp.argmax(x), lax.scan(lambda c, _: (c * c, c), x, length=2)

    secret = jax.eval_shape(functools.partial(cn.share, parties=2, protocol=protocol), KEY, X)
    found = cn.cost(cn.secure(function, protocol=protocol), secret)
    assert {opening.collective for opening in found.openings} <= WAYS_ACROSS
    assert {opening.primitive for opening in found.openings} <= {
        "mul",
        "max",
        "gt",
        "argmax",
        "scan",
        "output",
    }
