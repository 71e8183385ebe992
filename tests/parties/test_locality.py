"""What is opened, and whether, is decided by what all parties know; programs made by hand."""

import jax
import jax.numpy as jnp
import pytest
from jax import lax
from jax.experimental import io_callback

from ciphernav_jax.parties.messages import openings
from ciphernav_jax.parties.party import AXIS, from_party_zero, open_sum
from ciphernav_jax.parties.run import one_partys_jaxpr

pytestmark = pytest.mark.newest_jax

PARTIES = 3
SHARES = jax.ShapeDtypeStruct((PARTIES, 4), jnp.uint64)


def traced(program):
    """Of one party's share and a public number."""
    return one_partys_jaxpr(lambda x, n: (program(x, n), None), PARTIES, SHARES, jnp.uint64(3))[0]


def unless(condition, x):
    return lax.cond(condition, open_sum, lambda x: x, x)


def first():
    return lax.axis_index(AXIS) == 0


PARTING = {
    "which party it is": (lambda x, n: unless(first(), x), "cond"),
    "its own share": (lambda x, n: unless(x[0] > n, x), "cond"),
    "its own share, in a jit": (lambda x, n: jax.jit(unless)(jax.jit(lambda x: x[0] > n)(x), x), "cond"),
    "a switch over parties": (
        lambda x, n: lax.switch(lax.axis_index(AXIS), [open_sum, lambda x: x, open_sum], x),
        "cond",
    ),
    "in a branch on a public number": (
        lambda x, n: lax.cond(n > 2, lambda: unless(first(), x), lambda: x),
        "cond",
    ),
    "a loop as long as its share": (
        lambda x, n: lax.while_loop(lambda c: c[0] < x[0], lambda c: (c[0] + 1, open_sum(c[1])), (n, x))[1],
        "while",
    ),
    "a loop as long as its number": (
        lambda x, n: lax.fori_loop(0, lax.axis_index(AXIS), lambda i, x: open_sum(x), x),
        "while",
    ),
    "an opening in a loop's condition": (
        lambda x, n: lax.while_loop(lambda c: (open_sum(c) < x)[0], lambda c: c + 1, x),
        "while",
    ),
    "a carry that is its own from the third iteration on": (
        lambda x, n: lax.scan(
            lambda c, _: ((unless(c[2] > 0, x), c[0][0], c[1]), None), (jnp.zeros_like(x), n, n), length=3
        )[0][0],
        "cond",
    ),
    "what a branch makes its own": (
        lambda x, n: unless(lax.cond(n > 2, lambda: x[0], lambda: n) > 0, x),
        "cond",
    ),
    "sorted": (lambda x, n: unless(jnp.sort(x)[0] > n, x), "cond"),
    "held by one": (lambda x, n: unless(from_party_zero(n) > 0, x), "cond"),
}


@pytest.mark.parametrize("name", PARTING)
def test_parties_must_not_part_ways(name):
    program, primitive = PARTING[name]
    message = rf"opens something in a `{primitive}`, at .*test_locality\.py.*may differ"
    with pytest.raises(ValueError, match=message):
        traced(program)


TOGETHER = {
    "a public number": lambda x, n: unless(n > 2, x),
    "what was opened": lambda x, n: unless(open_sum(x)[0] > n, x),
    "constants": lambda x, n: unless(jnp.arange(3, dtype=jnp.uint64)[1] > n, x),
    "a loop as long as a public number": lambda x, n: lax.fori_loop(
        jnp.uint64(0), n, lambda i, x: open_sum(x), x
    ),
    "a carry that stays public": lambda x, n: lax.scan(
        lambda c, _: ((unless(c[1] > 0, c[0] + x), c[1] + 1), None), (x, n), length=3
    )[0][0],
    "branches of its own without openings": lambda x, n: open_sum(
        lax.cond(first(), lambda: x + n, lambda: lax.while_loop(lambda x: x[0] < n, lambda x: x + 1, x))
    ),
}


@pytest.mark.parametrize("name", TOGETHER)
def test_together_they_may_decide(name):
    assert openings(traced(TOGETHER[name]))


def scoped(name, collective):
    def program(x, n):
        with jax.named_scope(name):
            return collective(x)

    return program


OUTSIDE = {
    "without a scope": (lambda x, n: lax.psum(x, AXIS), "psum"),
    "another collective": (lambda x, n: lax.ppermute(x, AXIS, [(0, 1), (1, 2), (2, 0)]), "ppermute"),
    "in a scope of its own": (scoped("private", lambda x: lax.psum(x, AXIS)), "psum"),
    "in the wrong scope": (scoped("open_xor", lambda x: lax.pmax(x, AXIS)), "pmax"),
    "among some parties": (
        scoped("open_shares", lambda x: lax.all_gather(x, AXIS, axis_index_groups=[[0, 1], [2]])),
        "all_gather",
    ),
    "in a jit": (lambda x, n: jax.jit(lambda x: lax.all_gather(x, AXIS))(x), "all_gather"),
    "in a loop": (lambda x, n: lax.scan(lambda c, _: (lax.psum(c, AXIS), None), x, length=2)[0], "psum"),
    "in a branch not taken": (
        lambda x, n: lax.cond(False, lambda x: lax.psum(x, AXIS), lambda x: x, x),
        "psum",
    ),
    "in a vmap of its own": (
        lambda x, n: jax.custom_batching.sequential_vmap(lambda x: lax.psum(x, AXIS))(x),
        "psum",
    ),
    "through the host": (
        lambda x, n: jax.pure_callback(lambda x: x, jax.ShapeDtypeStruct(x.shape, x.dtype), x),
        "pure_callback",
    ),
    "printed": (lambda x, n: jax.debug.print("{}", x), "debug_print"),
    "shown": (lambda x, n: jax.debug.callback(print, x), "debug_callback"),
    "written": (lambda x, n: io_callback(print, None, x), "io_callback"),
    "printed in a loop": (
        lambda x, n: lax.scan(lambda c, _: (c, jax.debug.print("{}", c)), x, length=2)[0],
        "debug_print",
    ),
    "foreign": (
        lambda x, n: jax.ffi.ffi_call("send", jax.typeof(x))(x),
        "ffi_call",
    ),
    "foreign and honest": (
        lambda x, n: jax.ffi.ffi_call("send", jax.typeof(x), has_side_effect=True)(x),
        "ffi_call",
    ),
    "a sum that is not named, over two axes": (
        lambda x, n: jax.vmap(lambda x: lax.psum(x, (AXIS, "mine")), axis_name="mine")(x),
        "psum",
    ),
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_reaches_out_of_the_program_is_refused(name):
    program, primitive = OUTSIDE[name]
    with pytest.raises(ValueError, match=rf"leaves the party by `{primitive}`, at .*test_locality\.py"):
        openings(traced(program))


def test_references_to_arrays_of_its_own_are_local():
    def program(x, n):
        own = jax.new_ref(x)
        own[0] = n
        return open_sum(own[...])

    assert [opening.rounds for opening in openings(traced(program))] == [(1,)]
